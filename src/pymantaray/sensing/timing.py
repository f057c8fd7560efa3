"""Timing of ranges: one-way between two clocks or two-way on one clock; and clock errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.quantities.checks import check_fields, checked_array
from pymantaray.records import Measurements, RangingTruth, Trajectories

_NOMINAL_SPEED = 1500.0  # m/s; for ends outside the water, where the sound speed is unknown


@dataclass(frozen=True)
class OneWay:
    """
    The receiver records the arrival on its own clock.

    The fleet is at rest during a ping, as in the paper.

    Errors of the clocks are part of the noise (`ClockModel`).
    """


@dataclass(frozen=True)
class TwoWay:
    """
    The responder answers each ping after a known time.

    The initiator measures the round trip on its own clock.

    Parameters
    ----------
    turn_around : float
        Time between the arrival of the ping and the answer, on the responder's clock. [s]

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import Clocks, OneWay, TwoWay, perturb
    >>> clocks = Clocks(offset=[1e-3, 0.0], skew=[0.0, 0.0])
    >>> draw = {"root_seed": 1, "realization": 0, "ranging_truth": ranging.truth}
    >>> for timing in (OneWay(), TwoWay(turn_around=0.5)):
    ...     noisy = perturb(measurements, timing=timing, clocks=clocks, **draw)
    ...     print(noisy.refracted_range.round(2))
    [2021.9  2042.82]
    [2023.36 2041.35]
    """

    turn_around: float = 0.0

    def __post_init__(self) -> None:
        """Check the turn-around time."""
        check_fields(SensingError, self, "", *vars(self))


Timing = OneWay | TwoWay
"""Timing of ranges."""
ONE_WAY = OneWay()


class Leg(NamedTuple):
    """
    One way of an exchange: travel time between the positions of both vehicles at the ping.

    The gradients are derivatives of the travel time by the positions of initiator and responder:
    the slowness vector along the ray at its end, and minus this vector at its start.
    """

    travel_time: Array
    at_initiator: Array
    at_responder: Array


def half_round_trip(
    timing: TwoWay, ping: Leg, answer: Leg, initiator_velocity: Array, responder_velocity: Array
) -> Array:
    r"""
    Half of a round trip without the turn-around time, for moving vehicles.

    With the times :math:`t_1, t_2` of both legs at rest, their gradients :math:`g` and the
    turn-around time
    :math:`\tau`, the responder has moved for :math:`t_1` when the ping arrives and for :math:`t_1 +
    \tau` when it answers, the initiator for :math:`t_1 + \tau + t_2` when the answer arrives. To
    first order in
    :math:`v / c` the result is

    .. math:: \tfrac12 \left[ t_1 + t_2 + t_1\, g_1^r \cdot v_r
        + (t_1 + \tau)\, g_2^r \cdot v_r + (t_1 + \tau + t_2)\, g_2^i \cdot v_i \right],

    and for equal legs the travel time at the middle of the exchange, :math:`t + \tau / 2` after the
    ping. Neglected: :math:`(v / c)^2 t`; the curvature of travel time, at most :math:`(v_\perp T)^2
    / 2 r c` for speeds across the link that add up to :math:`v_\perp`, a distance :math:`r` and an
    exchange of duration
    :math:`T`; and accelerations.
    """
    g1r, g2r, g2i = (
        np.nan_to_num(gradient)
        for gradient in (ping.at_responder, answer.at_responder, answer.at_initiator)
    )
    t1 = ping.travel_time
    t2 = answer.travel_time
    wait = timing.turn_around
    displacement = (
        t1 * _dot(g1r, responder_velocity)
        + (t1 + wait) * _dot(g2r, responder_velocity)
        + (t1 + wait + t2) * _dot(g2i, initiator_velocity)
    )
    return np.asarray(0.5 * (t1 + t2 + displacement))


def velocities(truth: Trajectories, samples: Indices) -> Array:
    """
    Mean velocity (n_vehicles, n_epochs, 3) from each sample to the next. [m/s]

    For the last sample it is that from the previous one.
    """
    start = np.minimum(samples, truth.time.size - 2)
    step = truth.position[:, start + 1] - truth.position[:, start]
    return np.asarray(step / (truth.time[start + 1] - truth.time[start])[:, None])


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))


@dataclass(frozen=True, eq=False)
class Clocks:
    """
    Clocks of the vehicles in one realization; clocks of landmarks have no errors.

    Parameters
    ----------
    offset : array_like, shape (n_vehicles,)
        Clock minus true time at the start of the mission. [s]
    skew : array_like, shape (n_vehicles,)
        Rate of change of the offset. [-]

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import Clocks, perturb
    >>> draw = {"root_seed": 1, "realization": 0, "ranging_truth": ranging.truth}
    >>> for offset in (0.0, 1e-3):
    ...     clocks = Clocks(offset=[offset, 0.0], skew=[0.0, 0.0])
    ...     print(perturb(measurements, clocks=clocks, **draw).refracted_range.round(2))
    [2023.36 2041.35]
    [2021.9  2042.82]
    """

    offset: Array
    skew: Array

    def __post_init__(self) -> None:
        """Check and freeze both arrays."""
        for name in ("offset", "skew"):
            array = checked_array(
                SensingError, f"Clocks: {name}", getattr(self, name), (np.size(self.offset),)
            )
            object.__setattr__(self, name, array)

    def of(self, participant: Indices) -> tuple[Array, Array]:
        """
        Offsets and skews of participants' clocks.

        Parameters
        ----------
        participant : ndarray of int, shape (n,)
            Indices of participants; indices beyond the vehicles are landmarks, whose clocks have no
            errors.

        Returns
        -------
        offset, skew : ndarray, shape (n,)
            Offset at the start of the mission [s] and skew [-].
        """
        row = np.minimum(participant, self.offset.size)
        return np.append(self.offset, 0.0)[row], np.append(self.skew, 0.0)[row]


@dataclass(frozen=True)
class ClockModel:
    """
    Distribution of the errors of the vehicles' clocks.

    Parameters
    ----------
    offset_sigma : float
        Standard deviation of the offset at the start of the mission. [s]
    skew_sigma : float
        Standard deviation of the skew. [-]

    Examples
    --------
    >>> from pymantaray.sensing import ClockModel
    >>> clocks = ClockModel(offset_sigma=1e-3, skew_sigma=1e-8)
    >>> clocks.draw(["A", "B"], root_seed=1, realization=0).offset.round(6)
    array([-0.000946, -0.000354])
    """

    offset_sigma: float = 0.0
    skew_sigma: float = 0.0

    def __post_init__(self) -> None:
        """Check both values."""
        check_fields(SensingError, self, "", *vars(self))

    def draw(self, names: Sequence[str], *, root_seed: int, realization: int) -> Clocks:
        """
        Draw the clocks of one realization, each from the random stream of its vehicle.

        Parameters
        ----------
        names : sequence of str
            Names of the vehicles.
        root_seed : int
            Seed of the study.
        realization : int
            Index of the realization.

        Returns
        -------
        Clocks
        """
        draws = np.array(
            [
                stream(root_seed, realization, "sensing", name, "clock").standard_normal(2)
                for name in names
            ]
        ).reshape(-1, 2)
        return Clocks(offset=draws[:, 0] * self.offset_sigma, skew=draws[:, 1] * self.skew_sigma)


def clock_error(
    measurements: Measurements, truth: RangingTruth, clocks: Clocks, timing: Timing
) -> Array:
    r"""
    Error of each range due to the clocks. [m]

    One-way, the measured time of a ping from true time T to T + t is too long by
    :math:`o_r(T + t) - o_t(T)`, with the offsets of receiver and transmitter. Two-way, the offset
    of the initiator cancels, and the skews :math:`k` of initiator and responder cause
    :math:`\frac12 [k_i (2 t + \tau) - k_r \tau]`, to first order in the skews.
    """
    if clocks.offset.size != measurements.name.size:
        raise SensingError(
            f"clocks of {clocks.offset.size} vehicles; the measurements have"
            f" {measurements.name.size}"
        )
    speed = np.where(
        np.isnan(measurements.transmitter_sound_speed),
        _NOMINAL_SPEED,
        measurements.transmitter_sound_speed,
    )
    time = np.where(np.isnan(truth.travel_time), truth.chord_travel_time, truth.travel_time)
    time = np.where(np.isnan(time), truth.distance / speed, time)
    (offset, skew), (other_offset, other_skew) = (
        clocks.of(participant)
        for participant in (measurements.range_transmitter, measurements.range_receiver)
    )
    if isinstance(timing, TwoWay):
        wait = timing.turn_around
        return np.asarray(speed * 0.5 * (skew * (2.0 * time + wait) - other_skew * wait))
    transmit_time = measurements.time[measurements.range_sample]
    receive_offset = other_offset + other_skew * (transmit_time + time)
    return np.asarray(speed * (receive_offset - (offset + skew * transmit_time)))
