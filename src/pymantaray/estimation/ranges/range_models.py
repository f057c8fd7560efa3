"""
Range models of estimators: predicted travel times, and unknowns that ranges share.

Range models are subclasses of `RangeModel`. The unknowns are amplitudes of sound-speed modes, and
offset and skew of clocks; they are estimated with the poses.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.errors import EstimationError
from pymantaray.geometry.se3 import lengths

Rows = Indices
# m; below this difference in depth, Simpson's rule gives the mean slowness
_LEVEL_DIFFERENCE = 0.01


class TimedRanges(NamedTuple):
    """
    Measured travel times of the ranges of a graph, row by row; the transmitter may be either
    variable.

    The epoch is the number of the ping, from 0; its time is since the start of the mission. [s]
    """

    transmitter: Rows
    receiver: Rows
    epoch: Rows
    time: Array
    sound_speed: Array  # measured at the transmitter [m/s]
    travel_time: Array  # measured, with its noise [s]

    def links(self, transmitter: Array, receiver: Array) -> RangeEndpoints:
        """Links of these ranges between positions, shape (n, 3)."""
        return RangeEndpoints(self.time, transmitter, receiver, self.sound_speed)


class RangeEndpoints(NamedTuple):
    """Measured links of a graph, row by row, at the current positions."""

    time: Array  # of the ping since the start of the mission, (n,) [s]
    transmitter: Array  # (n, 3) [m]
    receiver: Array  # (n, 3) [m]
    sound_speed: Array  # measured at the transmitter, (n,) [m/s]


class Prediction(NamedTuple):
    """Predicted travel times and their gradients; arbitrary numbers where there is no arrival."""

    travel_time: Array  # (n,) [s]
    transmitter_gradient: Array  # of the travel time by the transmitter's position, (n, 3) [s/m]
    receiver_gradient: Array  # by the receiver's
    possible: Mask  # true if the assumed ocean has an arrival, (n,)
    bounces: Rows | None = None  # reflections of each path, (n,); None if all paths are direct

    def put(self, rows: Rows | Mask, part: Prediction) -> None:
        """
        Replace some rows, in place.

        Parameters
        ----------
        rows : ndarray of int or bool
        part : Prediction
            Of these rows.
        """
        whole: Any
        for whole, values in zip(self, part, strict=True):
            if whole is not None:
                whole[rows] = values

    def scaled(self, factor: float | Array) -> Prediction:
        """
        Multiply travel times and gradients by a factor.

        Parameters
        ----------
        factor : float or ndarray, shape (n,)
            One factor, or one for each link.

        Returns
        -------
        Prediction
        """
        each = np.asarray(factor)[..., None]
        return self._replace(
            travel_time=factor * self.travel_time,
            transmitter_gradient=each * self.transmitter_gradient,
            receiver_gradient=each * self.receiver_gradient,
        )


class RangeModel(ABC):
    """
    Base of range models, which predict the travel times of links.

    A subclass needs `predict` only. By default, its ocean has no modes of unknown amplitude, and
    the sound speed along a link is not one number.
    """

    amplitude_sigma: Array = np.empty(0)
    """Prior standard deviation about zero of the amplitude of each mode, (n_modes,). [m/s]"""
    needs_sound_speed: bool = False
    """True if predictions depend on the sound speed measured at the transmitter."""

    @abstractmethod
    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Predict the travel times of all links of a graph.

        Parameters
        ----------
        links : RangeEndpoints
            Positions of both ends, times and measured sound speeds of the links.

        Returns
        -------
        Prediction
            Travel times and their gradients.
        """

    def speed(self, measured: Array) -> Array | None:  # noqa: ARG002
        """
        Sound speed along each link, if it is one number that does not depend on positions.

        Parameters
        ----------
        measured : ndarray, shape (n,)
            Sound speeds at the transmitters. [m/s]

        Returns
        -------
        ndarray, shape (n,), or None
            [m/s]
        """
        return None

    def adjusted(self, amplitudes: Array) -> RangeModel:  # noqa: ARG002
        """
        Return a copy of the model with other amplitudes of its modes.

        Parameters
        ----------
        amplitudes : ndarray, shape (n_modes,)
            Amplitudes relative to the initially assumed ocean. [m/s]

        Returns
        -------
        RangeModel
        """
        return self

    def sensitivity(self, links: RangeEndpoints) -> Array:
        """
        Derivatives of the travel times by the amplitudes.

        Parameters
        ----------
        links : RangeEndpoints
            Links, as in `predict`.

        Returns
        -------
        ndarray, shape (n, n_modes)
            Zero for a link without an arrival. [s²/m]
        """
        return np.zeros((links.time.size, self.amplitude_sigma.size))


class TravelTimeUncertainty(ABC):
    """Uncertainty of predicted travel times due to the uncertainty of the ocean."""

    @abstractmethod
    def covariances(self, links: RangeEndpoints, epoch: Rows) -> list[Array]:
        """Covariance matrix of the links of each epoch, in the order of the rows. [s²]."""


class ConstantSpeed(RangeModel):
    """
    One positive finite sound speed for all water. [m/s].

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.estimation import ConstantSpeed, RangeEndpoints
    >>> ends = np.array([[0.0, 0.0, 20.0]]), np.array([[2000.0, 0.0, 400.0]])
    >>> links = RangeEndpoints(np.zeros(1), *ends, sound_speed=np.array([1452.0]))
    >>> print(ConstantSpeed(1460.0).predict(links).travel_time.round(4))
    [1.3944]
    """

    def __init__(self, sound_speed: float) -> None:
        if not (sound_speed > 0.0 and np.isfinite(sound_speed)):
            raise EstimationError(
                f"constant range model: sound speed {sound_speed} m/s; it must be positive and"
                " finite"
            )
        self.sound_speed = float(sound_speed)

    def speed(self, measured: Array) -> Array:
        """
        Sound speed along each link.

        Parameters
        ----------
        measured : ndarray, shape (n,)
            Sound speeds at the transmitters, without effect. [m/s]

        Returns
        -------
        ndarray, shape (n,)
            The constant. [m/s]
        """
        return np.full(np.shape(measured), self.sound_speed)

    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Predict the distance divided by the sound speed; parameters as in `RangeModel.predict`.
        """
        return _along_chords(links, 1.0 / self.speed(links.sound_speed))


class TransmitterSpeed(RangeModel):
    """
    The sound speed measured at the transmitter for the whole link: the paper's c_i.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.estimation import RangeEndpoints, TransmitterSpeed
    >>> ends = np.array([[0.0, 0.0, 20.0]]), np.array([[2000.0, 0.0, 400.0]])
    >>> links = RangeEndpoints(np.zeros(1), *ends, sound_speed=np.array([1452.0]))
    >>> print(TransmitterSpeed().predict(links).travel_time.round(4))
    [1.4021]
    """

    needs_sound_speed = True

    def speed(self, measured: Array) -> Array:
        """
        Sound speed along each link.

        Parameters
        ----------
        measured : ndarray, shape (n,)
            Sound speeds at the transmitters. [m/s]

        Returns
        -------
        ndarray, shape (n,)
            The same sound speeds. [m/s]
        """
        return np.asarray(measured, dtype=float)

    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Predict the distance divided by the transmitter's sound speed; parameters as in
        `RangeModel.predict`.
        """
        return _along_chords(links, 1.0 / self.speed(links.sound_speed))


class MeanSlowness(RangeModel):
    r"""
    The mean slowness of a profile over the straight chord.

    Parameters
    ----------
    depth : array_like, shape (n_levels,)
        Strictly increasing, positive down. [m]
    sound_speed : array_like, shape (n_levels,)
        Linear between the levels and constant beyond them. [m/s]

    Raises
    ------
    EstimationError
        If there are fewer than two levels, they do not increase, or a sound speed is not positive.

    Notes
    -----
    A chord is straight, so its depth is uniform along it and the mean of :math:`1/c` over it is
    :math:`(S(z_r) - S(z_t)) / (z_r - z_t)` with :math:`S(z) = \int_0^z dz' / c(z')`; in a layer of
    gradient
    :math:`g` between :math:`c_1` and :math:`c_2` the integral is :math:`\ln(c_2 / c_1) / g`. The
    harmonic mean of the sound speed is its inverse. Exact for vertical rays, which are straight; by
    Fermat's principle never earlier than the ray for others.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.estimation import MeanSlowness, RangeEndpoints
    >>> ends = np.array([[0.0, 0.0, 20.0]]), np.array([[2000.0, 0.0, 400.0]])
    >>> links = RangeEndpoints(np.zeros(1), *ends, sound_speed=np.array([1452.0]))
    >>> model = MeanSlowness([0.0, 100.0, 1000.0], [1450.0, 1460.0, 1475.0])
    >>> print(model.predict(links).travel_time.round(4))
    [1.3933]
    """

    def __init__(self, depth: ArrayLike, sound_speed: ArrayLike) -> None:
        z = np.array(depth, dtype=float)
        c = np.array(sound_speed, dtype=float)
        if z.ndim != 1 or z.shape != c.shape or z.size < 2 or not np.all(np.diff(z) > 0.0):
            raise EstimationError(
                f"mean slowness: depths of shape {z.shape} for sound speeds {c.shape}; give at"
                " least two increasing depths and one speed for each"
            )
        if not np.all((c > 0.0) & np.isfinite(c)):
            raise EstimationError(
                f"mean slowness: sound speed {c.min():g} m/s; sound speeds must be positive and"
                " finite"
            )
        self.depth = z
        self.sound_speed = c
        self._sum = np.concatenate([[0.0], np.cumsum(np.diff(z) * _mean_inverse(c[:-1], c[1:]))])

    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Predict the distance times the mean slowness between the ends' depths; parameters as in
        `RangeModel.predict`.

        The gradients include both factors.
        """
        a = links.transmitter[:, 2]
        b = links.receiver[:, 2]
        slow_a = self._slowness(a)
        slow_b = self._slowness(b)
        level = np.abs(b - a) < _LEVEL_DIFFERENCE
        apart = np.where(level, 1.0, b - a)
        mean = np.where(
            level,
            (slow_a + 4.0 * self._slowness(0.5 * (a + b)) + slow_b) / 6.0,
            (self._integral(b) - self._integral(a)) / apart,
        )
        # nearly equal depths: the mean changes by half the change of slowness
        middle = 0.5 * (a + b)
        h = 0.5 * _LEVEL_DIFFERENCE
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
        return np.asarray(1.0 / np.interp(z, self.depth, self.sound_speed))

    def _integral(self, z: Array) -> Array:
        """Integral of slowness from the first level down to a depth. [s]."""
        i = np.clip(np.searchsorted(self.depth, z, side="right") - 1, 0, self.depth.size - 2)
        inside = np.clip(z, self.depth[0], self.depth[-1])
        beyond = (z - inside) * self._slowness(z)
        here = np.interp(inside, self.depth, self.sound_speed)
        top = self.sound_speed[i]
        return np.asarray(
            self._sum[i] + (inside - self.depth[i]) * _mean_inverse(top, here) + beyond
        )


class ClockPrior(NamedTuple):
    """Prior knowledge of the vehicles' clocks; landmarks have true time."""

    offset_sigma: float
    """
    Standard deviation of each clock's offset at the start of the mission; 0 if there is no offset.
    [s]
    """
    skew_sigma: float
    """Standard deviation of the growth of the offset with time; 0 if there is none. [-]"""
    turn_around: float | None = None
    """Time from ping to reply of a two-way exchange; None for one-way ranging. [s]"""


class RangeUnknowns:
    r"""
    Parameters that the ranges of one graph share, each with a Gaussian prior about zero.

    The amplitudes of a model with modes are unknowns; so are, with priors of theirs, a factor on
    all travel times, the clocks of the vehicles that ``pose_vehicle`` gives for each pose, and a
    bias of each ordered pair. ``sigma``, the prior standard deviations, has one entry for each;
    ``name`` and ``unit`` leave out the biases, which come last.

    The solver uses units of their standard deviations: one variable :math:`u \sim N(0, I)`. One
    way, a ping sent at true time T and received at T + t is measured as

    .. math:: t + o_r + k_r (T + t) - o_t - k_t T

    with the offsets o and skews k of receiver and transmitter; two ways, after the turn-around time
    :math:`\tau`, half the round trip less that as :math:`t + \frac12 [k_i (2 t + \tau) - k_r
    \tau]`.
    """

    def __init__(
        self,
        model: RangeModel,
        ranges: TimedRanges,
        pose_vehicle: NDArray[np.int32],
        vehicle_name: Sequence[str],
        *,
        clocks: ClockPrior | None = None,
        scale_sigma: float | None = None,
        bias_sigma: float | None = None,
    ) -> None:
        self._model = model
        self._clocks = clocks
        n = len(vehicle_name)
        modes = np.asarray(model.amplitude_sigma)
        entries = [(f"mode {k + 1}", "m/s", size) for k, size in enumerate(modes.tolist())]
        self._scaled = scale_sigma is not None
        if scale_sigma is not None:
            entries.append(("scale", "1", scale_sigma))
        priors = (0.0, 0.0) if clocks is None else (clocks.offset_sigma, clocks.skew_sigma)
        self._known = [prior == 0.0 for prior in priors]
        for prior, what, unit in zip(priors, ("offset", "skew"), ("s", "1"), strict=True):
            if prior != 0.0:
                entries += [(f"clock {what} {name}", unit, prior) for name in vehicle_name]
        self.name = tuple(name for name, _, _ in entries)
        self.unit = tuple(unit for _, unit, _ in entries)
        sigma = [size for _, _, size in entries]
        self._pair = np.empty(0, dtype=np.intp)
        if bias_sigma is not None:
            # landmarks are numbered after the vehicles
            ends = np.concatenate([ranges.transmitter, ranges.receiver])
            n_landmarks = max(int(ends.max(initial=-1)) + 1 - len(pose_vehicle), 0)
            who = np.append(np.asarray(pose_vehicle, dtype=np.intp), n + np.arange(n_landmarks))
            pairs = np.stack([who[ranges.transmitter], who[ranges.receiver]], axis=1)
            distinct, self._pair = np.unique(pairs, axis=0, return_inverse=True)
            sigma += [bias_sigma] * len(distinct)
        self.sigma = np.array(sigma, dtype=float)
        if not self.sigma.size:
            raise EstimationError(
                "unknowns: neither modes, scale, clocks nor biases; give at least one of them, or"
                " no unknowns"
            )
        wrong = ~((self.sigma > 0.0) & np.isfinite(self.sigma))
        if wrong.any():
            first = int(np.argmax(wrong))
            what, unit, _ = [*entries, ("a bias", "m", bias_sigma)][min(first, len(entries))]
            raise EstimationError(
                f"unknowns: prior sigma of {what} is {self.sigma[first]:g} {unit}; it must be"
                " positive and finite"
            )
        self._n_modes = modes.size
        self._n_vehicles = n
        # all landmarks as one vehicle, left out in the end
        vehicle = np.append(np.asarray(pose_vehicle, dtype=np.intp), n)
        last = vehicle.size - 1
        self._transmitter, self._receiver = (
            vehicle[np.minimum(v, last)] for v in (ranges.transmitter, ranges.receiver)
        )

    def predict(self, links: RangeEndpoints, rows: Rows, u: Array) -> tuple[Prediction, Array]:
        """
        Predict the measured travel times of some ranges, and their derivatives by the unknowns, (n,
        n_unknowns).
        """
        model = self._model.adjusted((self.sigma * u)[: self._n_modes])
        return self.applied(model.predict(links), links, rows, u, [model.sensitivity(links)])

    def applied(
        self,
        prediction: Prediction,
        links: RangeEndpoints,
        rows: Rows,
        u: Array,
        by_modes: Sequence[Array] = (),
    ) -> tuple[Prediction, Array]:
        """
        Measured travel times and their derivatives as `predict`, of travel times that were
        predicted for some ranges.
        """
        value = self.sigma * u
        k = self._n_modes
        columns = list(by_modes)
        if self._scaled:
            columns = [(1.0 + value[k]) * by for by in columns]
            columns.append(np.where(prediction.possible, prediction.travel_time, 0.0)[:, None])
            prediction = prediction.scaled(1.0 + value[k])
            k += 1
        added = []
        if not all(self._known):
            added.append(
                self._by_clocks(
                    links.time, np.where(prediction.possible, prediction.travel_time, 0.0), rows
                )
            )
        if self._pair.size:
            biases = np.zeros((rows.size, self.sigma.size - len(self.name)))
            biases[np.arange(rows.size), self._pair[rows]] = 1.0 / links.sound_speed
            added.append(biases)
        if added:
            by_added = np.hstack(added)
            prediction = prediction._replace(
                travel_time=prediction.travel_time + by_added @ value[k:]
            )
            columns.append(by_added)
        return prediction, np.hstack(columns) * self.sigma

    def _by_clocks(self, sent: Array, time: Array, rows: Rows) -> Array:
        """Derivatives of measured travel times by unknown clock offsets, then by unknown skews."""
        assert self._clocks is not None  # called only then
        n = self._n_vehicles
        offset = np.zeros((rows.size, n + 1))
        skew = np.zeros((rows.size, n + 1))
        row = np.arange(rows.size)
        t = self._transmitter[rows]
        r = self._receiver[rows]
        if self._clocks.turn_around is None:
            offset[row, r] += 1.0
            offset[row, t] -= 1.0
            skew[row, r] += sent + time
            skew[row, t] -= sent
        else:
            skew[row, t] += time + 0.5 * self._clocks.turn_around
            skew[row, r] -= 0.5 * self._clocks.turn_around
        return np.hstack(
            [by[:, :n] for by, known in zip((offset, skew), self._known, strict=True) if not known]
        )


class UnknownsEstimate(NamedTuple):
    """Estimate of the unknowns that ranges share, (n_unknowns,), in their units."""

    name: tuple[str, ...]
    unit: tuple[str, ...]
    prior_sigma: Array
    value: Array
    covariance: Array  # (n_unknowns, n_unknowns)


@dataclass(frozen=True, eq=False)
class ModelRanges:
    """Range model of an estimator with the measured travel times of a graph."""

    model: RangeModel
    ranges: TimedRanges  # rows are those of the graph's ranges
    uncertainty: TravelTimeUncertainty | None = None  # adds to the ranges' own variance
    correlated: bool = False  # use covariances between the links of an epoch, too
    unknowns: RangeUnknowns | None = None  # unknowns to estimate with the poses

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns that all ranges share."""
        return 0 if self.unknowns is None else self.unknowns.sigma.size

    def predict(self, links: RangeEndpoints, rows: Rows, u: Array) -> tuple[Prediction, Array]:
        """Predict as `RangeUnknowns.predict`, without columns if there are no unknowns."""
        if self.unknowns is None:
            return self.model.predict(links), np.empty((links.time.size, 0))
        return self.unknowns.predict(links, rows, u)


def _mean_inverse(c1: Array, c2: Array) -> Array:
    """Mean of 1/c over a layer with c linear from c1 to c2."""
    x = (c2 - c1) / c1
    small = np.abs(x) < 1e-5
    safe = np.where(small, 1.0, x)
    return np.asarray(np.where(small, 1.0 - x / 2.0 + x**2 / 3.0, np.log1p(safe) / safe) / c1)


def _along_chords(links: RangeEndpoints, slowness: Array) -> Prediction:
    """Travel times along straight lines, each with its own slowness."""
    distance, unit = chord(links.transmitter, links.receiver)
    gradient = slowness[:, None] * unit
    return Prediction(distance * slowness, -gradient, gradient, np.ones(distance.size, dtype=bool))


def chord(a: Array, b: Array) -> tuple[Array, Array]:
    """
    Distances between positions, shape (n,), and directions from first to second, (n, 3); zero for
    equal positions.
    """
    step = b - a
    distance = lengths(step)
    return distance, step / np.where(distance > 0.0, distance, 1.0)[:, None]
