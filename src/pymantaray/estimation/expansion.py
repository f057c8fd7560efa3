"""Residuals of ranges near the place where a range model was asked."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.range_models import Prediction, RangeLinks

Array = NDArray[np.float64]
_STEADY, _BEND = 0.1, 1e-5  # m; no new prediction after a smaller move that bends the chords by less
_SAME = (
    0.01  # standard deviations of an unknown; its second order is then a ten-thousandth of what it is for one
)


class Expansion:
    """
    Residuals of ranges near the place where a model was asked.

    Parameters
    ----------
    found : Prediction
    links : RangeLinks
        Where it was asked.
    travel_time : ndarray, shape (n,)
        Measured. [s]
    unknowns : ndarray, shape (n_unknowns,)
        What else the model was asked with. [-]
    by_unknowns : ndarray, shape (n, n_unknowns)
        Change of the travel times by them. [s]

    Notes
    -----
    The predicted travel time and its gradient, and the curvature of the distance between the ends over the mean
    speed; what is left out is the change of refraction alone.
    """

    def __init__(
        self, found: Prediction, links: RangeLinks, travel_time: Array, unknowns: Array, by_unknowns: Array
    ) -> None:
        fine = found.possible
        self._unknowns = unknowns
        self.by_unknowns = links.sound_speed[:, None] * np.where(fine[:, None], by_unknowns, 0.0)
        """Change of the residuals by the unknowns, shape (n, n_unknowns). [m]"""
        self._a, self._b, self._speed, self._measured = (
            links.transmitter,
            links.receiver,
            links.sound_speed,
            travel_time,
        )
        self._time = np.where(fine, found.travel_time, 0.0)
        self._by_a, self._by_b = (
            np.where(fine[:, None], g, 0.0) for g in (found.transmitter_gradient, found.receiver_gradient)
        )
        self._distance, self._unit = chord(self._a, self._b)
        self._slowness = self._time / np.where(self._distance > 0.0, self._distance, 1.0)

    def __call__(self, transmitter: Array, receiver: Array, unknowns: Array) -> tuple[Array, Array, Array]:
        """
        Residuals and their gradients.

        Parameters
        ----------
        transmitter, receiver : ndarray, shape (n, 3)
            [m]
        unknowns : ndarray, shape (n_unknowns,)
            [-]

        Returns
        -------
        residual : ndarray, shape (n,)
            Sound speed at the transmitter times predicted less measured travel time. [m]
        by_transmitter, by_receiver : ndarray, shape (n, 3)
            [-]
        """
        da, db = transmitter - self._a, receiver - self._b
        distance, unit = chord(transmitter, receiver)
        turned = self._slowness[:, None] * (unit - self._unit)
        time = (
            self._time
            + np.sum(self._by_a * da + self._by_b * db, axis=1)
            + self._slowness * self._bent(distance, da, db)
        )
        speed = self._speed[:, None]
        return (
            self._speed * (time - self._measured) + self.by_unknowns @ (unknowns - self._unknowns),
            speed * (self._by_a - turned),
            speed * (self._by_b + turned),
        )

    def is_good_at(self, transmitter: Array, receiver: Array, unknowns: Array) -> bool:
        """
        Whether ends and unknowns moved so little that a new prediction could not differ.

        Parameters
        ----------
        transmitter, receiver : ndarray, shape (n, 3)
            [m]
        unknowns : ndarray, shape (n_unknowns,)
            [-]

        Returns
        -------
        bool
        """
        da, db = transmitter - self._a, receiver - self._b
        distance, _ = chord(transmitter, receiver)
        far = max(float(np.abs(d).max(initial=0.0)) for d in (da, db))
        if float(np.abs(unknowns - self._unknowns).max(initial=0.0)) > _SAME:
            return False
        return far <= _STEADY and float(np.abs(self._bent(distance, da, db)).max(initial=0.0)) <= _BEND

    def _bent(self, distance: Array, da: Array, db: Array) -> Array:
        return np.asarray(distance - self._distance - np.sum(self._unit * (db - da), axis=1))


def chord(a: Array, b: Array) -> tuple[Array, Array]:
    """
    Distances and directions between places.

    Parameters
    ----------
    a, b : ndarray, shape (n, 3)
        [m]

    Returns
    -------
    distance : ndarray, shape (n,)
        [m]
    unit : ndarray, shape (n, 3)
        From ``a`` to ``b``; zero where both are one.
    """
    step = b - a
    distance = np.linalg.norm(step, axis=1)
    return distance, step / np.where(distance > 0.0, distance, 1.0)[:, None]
