"""Ranges of a model, expanded about the estimate: residuals, gradients and weights."""

from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import solve_triangular

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.estimation.ranges.range_models import (
    ModelRanges,
    Prediction,
    RangeEndpoints,
    Rows,
    chord,
)

# rows of the ranges of one epoch, and the covariance of their residuals [m2]
EpochBlock = tuple[Rows, Array]

_SAME_POSITION = 0.1  # m; smaller displacements and changes of curvature need no new prediction
_SAME_CHORD = 1e-5
_SAME_UNKNOWN = 0.01  # standard deviations of an unknown; a smaller change needs no new prediction
_REWEIGHT_DISTANCE = 100.0  # m; a larger displacement of any end needs new variances


class Images(NamedTuple):
    """
    Positions in which receivers appear to transmitters, from which the curvature of reflected
    travel times follows.

    The image lies in the direction in which sound leaves the transmitter, at the length of the
    path. If the receiver moves, its image moves in the same way, but up instead of down if the
    number of reflections is odd. That of a direct path is the receiver itself. All of this is exact
    for horizontal mirrors in uniform water.
    """

    position: Array  # (n, 3) [m]
    receiver: Array  # (n, 3) [m]
    mirror: Array  # signs of a displacement of the image, (n, 3)
    reflected: Mask

    @classmethod
    def of(cls, prediction: Prediction, links: RangeEndpoints, bounces: Indices) -> Self:
        """Images of the receivers of links, whose paths have some numbers of reflections."""
        reflected = prediction.possible & (bounces > 0)
        slowness = np.linalg.norm(prediction.transmitter_gradient, axis=1)
        reflected &= slowness > 0.0
        square = np.where(reflected, slowness, 1.0) ** 2
        path = -(prediction.travel_time / square)[:, None] * prediction.transmitter_gradient
        mirror = np.ones_like(links.receiver)
        mirror[reflected & (bounces % 2 == 1), 2] = -1.0
        position = np.where(reflected[:, None], links.transmitter + path, links.receiver)
        return cls(position, links.receiver, mirror, reflected)

    def at(self, receiver: Array) -> Array:
        """Positions of the images of moved receivers."""
        image = self.position + self.mirror * (receiver - self.receiver)
        return np.where(self.reflected[:, None], image, receiver)


class Expansion:
    """
    Residuals of ranges near the links of a prediction, with unknowns in their standard deviations.

    The expansion has the predicted travel time, its gradient, and the curvature of the distance
    between the ends divided by the mean speed; for a reflected path, the distance to the image of
    the receiver. It omits only the change of refraction. The argument ``by_unknowns`` is the
    derivative of the travel times [s]; the attribute is that of the residuals [m], shape (n,
    n_unknowns).
    """

    def __init__(
        self,
        prediction: Prediction,
        links: RangeEndpoints,
        travel_time: Array,
        unknowns: Array,
        by_unknowns: Array,
    ) -> None:
        fine = prediction.possible
        self._unknowns = unknowns
        self._travel_time = travel_time
        self.by_unknowns = links.sound_speed[:, None] * np.where(fine[:, None], by_unknowns, 0.0)
        self._transmitter = links.transmitter
        self._receiver = links.receiver
        self._speed = links.sound_speed
        self._images: Images | None = None
        if prediction.bounces is not None:
            self._images = Images.of(prediction, links, prediction.bounces)
            self._receiver = self._images.position
            prediction = prediction._replace(
                receiver_gradient=self._images.mirror * prediction.receiver_gradient
            )
        self._time = np.where(fine, prediction.travel_time, 0.0)
        self._by_transmitter, self._by_receiver = (
            np.where(fine[:, None], g, 0.0)
            for g in (prediction.transmitter_gradient, prediction.receiver_gradient)
        )
        self._distance, self._unit = chord(self._transmitter, self._receiver)
        self._slowness = self._time / np.where(self._distance > 0.0, self._distance, 1.0)

    def __call__(
        self, transmitter: Array, receiver: Array, unknowns: Array
    ) -> tuple[Array, Array, Array]:
        """
        Residuals for positions of the ends, shape (n,), and their gradients by either end, (n, 3).

        A residual is the sound speed at the transmitter times predicted less measured travel time.
        [m]
        """
        receiver = receiver if self._images is None else self._images.at(receiver)
        da = transmitter - self._transmitter
        db = receiver - self._receiver
        distance, unit = chord(transmitter, receiver)
        by_direction = self._slowness[:, None] * (unit - self._unit)
        time = (
            self._time
            + np.sum(self._by_transmitter * da + self._by_receiver * db, axis=1)
            + self._slowness * self._bent(distance, da, db)
        )
        speed = self._speed[:, None]
        by_receiver = speed * (self._by_receiver + by_direction)
        return (
            self._speed * (time - self._travel_time)
            + self.by_unknowns @ (unknowns - self._unknowns),
            speed * (self._by_transmitter - by_direction),
            by_receiver if self._images is None else self._images.mirror * by_receiver,
        )

    def is_good_at(self, transmitter: Array, receiver: Array, unknowns: Array) -> bool:
        """True if ends and unknowns moved so little that a new prediction cannot differ."""
        receiver = receiver if self._images is None else self._images.at(receiver)
        da = transmitter - self._transmitter
        db = receiver - self._receiver
        distance, _ = chord(transmitter, receiver)
        far = max(float(np.abs(d).max(initial=0.0)) for d in (da, db))
        if float(np.abs(unknowns - self._unknowns).max(initial=0.0)) > _SAME_UNKNOWN:
            return False
        return (
            far <= _SAME_POSITION
            and float(np.abs(self._bent(distance, da, db)).max(initial=0.0)) <= _SAME_CHORD
        )

    def _bent(self, distance: Array, da: Array, db: Array) -> Array:
        return np.asarray(distance - self._distance - np.sum(self._unit * (db - da), axis=1))


class RangeWeights:
    """Covariances of the residuals of each epoch, updated when the ends have moved far."""

    def __init__(self, model_ranges: ModelRanges, variance: Array) -> None:
        self._model_ranges = model_ranges
        self._variance = variance
        epoch = model_ranges.ranges.epoch
        # rows of the ranges of each epoch
        self.rows = [
            np.flatnonzero(epoch == number) for number in range(int(epoch.max(initial=-1)) + 1)
        ]
        self._position: Array | None = None
        self._full = [np.diag(variance[rows]) for rows in self.rows]

    def at(self, links: RangeEndpoints) -> None:
        """Update the covariances for the positions of some links."""
        uncertainty = self._model_ranges.uncertainty
        position = np.concatenate([links.transmitter, links.receiver])
        stale = (
            self._position is None
            or float(np.abs(position - self._position).max(initial=0.0)) > _REWEIGHT_DISTANCE
        )
        if uncertainty is None or not stale:
            return
        self._position = position
        c = links.sound_speed
        for e, extra in enumerate(uncertainty.covariances(links, self._model_ranges.ranges.epoch)):
            rows = self.rows[e]
            added = c[rows][:, None] * extra * c[rows]
            if not self._model_ranges.correlated:
                added = np.diag(np.diagonal(added))
            self._full[e] = np.diag(self._variance[rows]) + added

    def blocks(self, used: Mask) -> list[EpochBlock]:
        """Rows and covariances of the used ranges of each epoch."""
        mine = [used[rows] for rows in self.rows]
        return [
            (rows[m], full[np.ix_(m, m)])
            for rows, full, m in zip(self.rows, self._full, mine, strict=True)
        ]


def whiten(root: Array, values: Array) -> Array:
    """
    Divide by the lower triangular root of a covariance, (m, m): values (m,) or (m, k).

    Most roots are diagonal, because most links share no error.
    """
    if np.count_nonzero(root) == root.shape[0]:
        return np.asarray((values.T / np.diagonal(root)).T)
    return np.asarray(solve_triangular(root, values, lower=True))
