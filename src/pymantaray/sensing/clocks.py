"""Clocks of the vehicles: offset and skew, and what they do to a measured travel time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.records import Measurements, RangingTruth
from pymantaray.sensing.timing import Timing, TwoWay

Array = NDArray[np.float64]
_NOMINAL_SPEED = (
    1500.0  # m/s; for the straight range of a link with an end outside the water, where c is unknown
)


@dataclass(frozen=True, eq=False)
class Clocks:
    """
    One realization's clocks, one of each vehicle; landmarks keep true time.

    Parameters
    ----------
    offset : array_like, shape (n_agents,)
        Clock minus true time at the start of the mission. [s]
    skew : array_like, shape (n_agents,)
        Growth of the offset with time. [-]

    Raises
    ------
    SensingError
        If the shapes differ or a value is not finite.
    """

    offset: Array
    skew: Array

    def __post_init__(self) -> None:
        """Check and freeze both arrays."""
        for name in ("offset", "skew"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.offset.ndim != 1 or self.offset.shape != self.skew.shape:
            raise SensingError(
                f"Clocks: offset has shape {self.offset.shape}, skew {self.skew.shape}; both must be (n_agents,)"
            )
        if not (np.isfinite(self.offset).all() and np.isfinite(self.skew).all()):
            raise SensingError("Clocks: an offset or skew is not finite; 0 is a perfect clock")

    def offset_at(self, participant: ArrayLike, time: ArrayLike) -> Array:
        """
        Offset of participants' clocks.

        Parameters
        ----------
        participant : array_like of int, shape (...)
            Index of a vehicle; one beyond the vehicles is a landmark, with offset 0.
        time : array_like, shape (...)
            Since the start of the mission. [s]

        Returns
        -------
        ndarray, shape (...)
            [s]
        """
        return np.asarray(self._of(self.offset, participant) + self.skew_of(participant) * np.asarray(time))

    def skew_of(self, participant: ArrayLike) -> Array:
        """
        Skew of participants' clocks.

        Parameters
        ----------
        participant : array_like of int, shape (...)

        Returns
        -------
        ndarray, shape (...)
            [-]
        """
        return self._of(self.skew, participant)

    def _of(self, values: Array, participant: ArrayLike) -> Array:
        index = np.asarray(participant, dtype=np.int64)
        n = values.size
        return np.where(index < n, np.append(values, 0.0)[np.minimum(index, n)], 0.0)


@dataclass(frozen=True)
class ClockModel:
    """
    How far apart the vehicles' clocks are.

    Parameters
    ----------
    offset_sigma : float
        Standard deviation of a clock's offset at the start of the mission. [s]
    skew_sigma : float
        Standard deviation of its skew. [-]

    Raises
    ------
    SensingError
        If a value is negative or not finite.
    """

    offset_sigma: float = 0.0
    skew_sigma: float = 0.0

    def __post_init__(self) -> None:
        """Check both values."""
        for f in fields(self):
            value = getattr(self, f.name)
            if not math.isfinite(value) or value < 0.0:
                raise SensingError(
                    f"ClockModel: {f.name} is {value:g}; it must be finite and zero or positive"
                )

    def draw(self, names: Sequence[str], *, root_seed: int, realization: int) -> Clocks:
        """
        Draw one realization's clocks, each from its vehicle's own stream.

        Parameters
        ----------
        names : sequence of str
            Of the vehicles.
        root_seed, realization : int
            As for `pymantaray.geometry.stream`.

        Returns
        -------
        Clocks
        """
        draws = np.array(
            [stream(root_seed, realization, "sensing", name, "clock").standard_normal(2) for name in names]
        ).reshape(-1, 2)
        return Clocks(offset=draws[:, 0] * self.offset_sigma, skew=draws[:, 1] * self.skew_sigma)


def clock_error(measurements: Measurements, truth: RangingTruth, clocks: Clocks, timing: Timing) -> Array:
    r"""
    Share of the clocks in each range attempt, as a length.

    Parameters
    ----------
    measurements : Measurements
    truth : RangingTruth
    clocks : Clocks
    timing : OneWay or TwoWay

    Returns
    -------
    ndarray, shape (n_ranges,)
        What a range becomes a pseudorange by. A dropout has one too, from the chord's travel time. [m]

    Raises
    ------
    SensingError
        If the clocks are not those of the vehicles.

    Notes
    -----
    One way, a ping sent at true time T and received at T + t is measured as too long by
    :math:`o_r(T + t) - o_t(T)`, with the offsets of receiver and transmitter. Two ways, the initiator's
    offset cancels and the skews :math:`k` of initiator and responder leave
    :math:`\frac12 [k_i (2 t + \tau) - k_r \tau]`, to first order in the skews.
    """
    o = measurements
    if clocks.offset.size != o.name.size:
        raise SensingError(f"clocks of {clocks.offset.size} vehicles; the measurements have {o.name.size}")
    speed = np.where(np.isnan(o.transmitter_sound_speed), _NOMINAL_SPEED, o.transmitter_sound_speed)
    time = np.where(np.isnan(truth.travel_time), truth.chord_travel_time, truth.travel_time)
    time = np.where(np.isnan(time), truth.distance / speed, time)
    if isinstance(timing, TwoWay):
        own, other = clocks.skew_of(o.range_transmitter), clocks.skew_of(o.range_receiver)
        return np.asarray(
            speed * 0.5 * (own * (2.0 * time + timing.turn_around) - other * timing.turn_around)
        )
    sent = o.time[o.range_sample]
    received = clocks.offset_at(o.range_receiver, sent + time)
    return np.asarray(speed * (received - clocks.offset_at(o.range_transmitter, sent)))
