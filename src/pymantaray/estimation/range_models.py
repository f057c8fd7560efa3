"""What an estimator believes of a range: the travel time that a model of the water predicts for each link."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import EstimationError

Array = NDArray[np.float64]
_LEVEL = 0.01  # m; ends nearer in depth than this have the slowness between them by Simpson's rule


class RangeLinks(NamedTuple):
    """Measured links of a graph, row by row, at the positions believed now."""

    time: Array
    """Of the ping since the start of the mission, shape (n,). [s]"""
    transmitter: Array
    """Shape (n, 3). [m]"""
    receiver: Array
    """Shape (n, 3). [m]"""
    sound_speed: Array
    """Measured at the transmitter, shape (n,). [m s⁻¹]"""


class Prediction(NamedTuple):
    """Travel times that a model predicts, and how they change with the ends; any number where not possible."""

    travel_time: Array
    """Shape (n,). [s]"""
    transmitter_gradient: Array
    """Of the travel time by the transmitter's position, shape (n, 3). [s m⁻¹]"""
    receiver_gradient: Array
    """By the receiver's position, shape (n, 3). [s m⁻¹]"""
    possible: NDArray[np.bool_]
    """Whether the believed ocean has an arrival there, shape (n,)."""


class RangeModel(Protocol):
    """Predicts the travel times of links."""

    def predict(self, links: RangeLinks) -> Prediction:
        """Travel times of all links of a graph."""
        ...


class TravelTimeUncertainty(Protocol):
    """Knows how uncertain the predicted travel times are because the ocean is not known exactly."""

    def covariances(self, links: RangeLinks, epoch: NDArray[np.intp]) -> list[Array]:
        """Give one covariance matrix for each epoch, of its links in the order of the rows. [s²]."""
        ...


class ConstantSpeed:
    """
    One sound speed for all water.

    Parameters
    ----------
    sound_speed : float
        [m s⁻¹]

    Raises
    ------
    EstimationError
        If it is not positive and finite.
    """

    def __init__(self, sound_speed: float) -> None:
        if not (sound_speed > 0.0 and np.isfinite(sound_speed)):
            raise EstimationError(
                f"constant range model: sound speed {sound_speed} m/s; it must be positive and finite"
            )
        self.sound_speed = float(sound_speed)

    def speed(self, measured: Array) -> Array:
        """
        Sound speed along each link.

        Parameters
        ----------
        measured : ndarray, shape (n,)
            At the transmitters; only its length is used. [m s⁻¹]

        Returns
        -------
        ndarray, shape (n,)
            [m s⁻¹]
        """
        return np.full(np.shape(measured), self.sound_speed)

    def predict(self, links: RangeLinks) -> Prediction:
        """
        Distance over the sound speed.

        Parameters
        ----------
        links : RangeLinks

        Returns
        -------
        Prediction
        """
        return _along_chords(links, 1.0 / self.speed(links.sound_speed))


class TransmitterSpeed:
    """The sound speed measured at the transmitter, along the whole link: the paper's c_i."""

    def speed(self, measured: Array) -> Array:
        """
        Sound speed along each link.

        Parameters
        ----------
        measured : ndarray, shape (n,)
            At the transmitters. [m s⁻¹]

        Returns
        -------
        ndarray, shape (n,)
            The same. [m s⁻¹]
        """
        return np.asarray(measured, dtype=float)

    def predict(self, links: RangeLinks) -> Prediction:
        """
        Distance over the transmitter's sound speed.

        Parameters
        ----------
        links : RangeLinks

        Returns
        -------
        Prediction
        """
        return _along_chords(links, 1.0 / self.speed(links.sound_speed))


class MeanSlowness:
    r"""
    The mean slowness of a profile over the straight chord.

    Parameters
    ----------
    depth : array_like, shape (n_levels,)
        Strictly increasing, positive down. [m]
    sound_speed : array_like, shape (n_levels,)
        Linear between the levels and constant beyond them. [m s⁻¹]

    Raises
    ------
    EstimationError
        If there are fewer than two levels, they do not increase, or a sound speed is not positive.

    Notes
    -----
    A chord is straight, so its depth is uniform along it and the mean of :math:`1/c` over it is
    :math:`(S(z_r) - S(z_t)) / (z_r - z_t)` with :math:`S(z) = \int_0^z dz' / c(z')`; in a layer of gradient
    :math:`g` between :math:`c_1` and :math:`c_2` the integral is :math:`\ln(c_2 / c_1) / g`. The harmonic mean
    of the sound speed is its inverse. Exact for vertical rays, which are straight; by Fermat's
    principle never earlier than the ray for others.
    """

    def __init__(self, depth: ArrayLike, sound_speed: ArrayLike) -> None:
        z, c = np.array(depth, dtype=float), np.array(sound_speed, dtype=float)
        if z.ndim != 1 or z.shape != c.shape or z.size < 2 or not np.all(np.diff(z) > 0.0):
            raise EstimationError(
                f"mean slowness: depths of shape {z.shape} for sound speeds {c.shape}; needs two or more increasing"
                " depths, one speed each"
            )
        if not np.all((c > 0.0) & np.isfinite(c)):
            raise EstimationError(f"mean slowness: sound speed {c.min():g} m/s; needs positive finite values")
        self._depth, self._speed = z, c
        self._sum = np.concatenate([[0.0], np.cumsum(np.diff(z) * _mean_inverse(c[:-1], c[1:]))])

    def predict(self, links: RangeLinks) -> Prediction:
        """
        Distance times the mean slowness between the ends' depths.

        Parameters
        ----------
        links : RangeLinks

        Returns
        -------
        Prediction
            The gradients include the change of the mean slowness with the ends' depths.
        """
        a, b = links.transmitter[:, 2], links.receiver[:, 2]
        slow_a, slow_b = self._slowness(a), self._slowness(b)
        level = np.abs(b - a) < _LEVEL
        apart = np.where(level, 1.0, b - a)
        mean = np.where(
            level,
            (slow_a + 4.0 * self._slowness(0.5 * (a + b)) + slow_b) / 6.0,
            (self._integral(b) - self._integral(a)) / apart,
        )
        # nearly level ends: the mean changes by half of what the slowness there does
        middle, h = 0.5 * (a + b), 0.5 * _LEVEL
        half = 0.5 * (self._slowness(middle + h) - self._slowness(middle - h)) / (2.0 * h)
        by_a = np.where(level, half, (mean - slow_a) / apart)
        by_b = np.where(level, half, (slow_b - mean) / apart)
        chords = _along_chords(links, mean)
        distance = np.linalg.norm(links.receiver - links.transmitter, axis=1)
        down = np.array([0.0, 0.0, 1.0])
        return chords._replace(
            transmitter_gradient=chords.transmitter_gradient + (distance * by_a)[:, None] * down,
            receiver_gradient=chords.receiver_gradient + (distance * by_b)[:, None] * down,
        )

    def _slowness(self, z: Array) -> Array:
        return np.asarray(1.0 / np.interp(z, self._depth, self._speed))

    def _integral(self, z: Array) -> Array:
        """Integral of slowness from the first level down to a depth. [s]."""
        i = np.clip(np.searchsorted(self._depth, z, side="right") - 1, 0, self._depth.size - 2)
        inside = np.clip(z, self._depth[0], self._depth[-1])
        beyond = (z - inside) * self._slowness(z)
        here = np.interp(inside, self._depth, self._speed)
        return np.asarray(
            self._sum[i] + (inside - self._depth[i]) * _mean_inverse(self._speed[i], here) + beyond
        )


def _mean_inverse(c1: Array, c2: Array) -> Array:
    """Mean of 1/c over a layer in which c runs linearly from c1 to c2."""
    x = (c2 - c1) / c1
    small = np.abs(x) < 1e-5
    safe = np.where(small, 1.0, x)
    return np.asarray(np.where(small, 1.0 - x / 2.0 + x**2 / 3.0, np.log1p(safe) / safe) / c1)


def _along_chords(links: RangeLinks, slowness: Array) -> Prediction:
    """Travel times along straight lines at a given slowness each."""
    step = links.receiver - links.transmitter
    distance = np.linalg.norm(step, axis=1)
    unit = step / np.where(distance > 0.0, distance, 1.0)[:, None]
    gradient = slowness[:, None] * unit
    return Prediction(distance * slowness, -gradient, gradient, np.ones(distance.size, dtype=bool))
