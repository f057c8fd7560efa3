"""How a travel time is measured: one way between clocks, or there and back on one clock."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import SensingError
from pymantaray.records import Trajectories

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OneWay:
    """
    The receiver notes the arrival on its own clock; the fleet is at rest while it pings, as in the paper.

    What clocks that are not synchronous add, the noise stage adds (`ClockModel`).
    """


@dataclass(frozen=True)
class TwoWay:
    """
    The responder answers each ping after a known time; the initiator notes the round trip on its own clock.

    Parameters
    ----------
    turn_around : float
        From the ping's arrival to the answer, on the responder's clock. [s]

    Raises
    ------
    SensingError
        If the turn-around time is negative or not finite.
    """

    turn_around: float = 0.0

    def __post_init__(self) -> None:
        """Check the turn-around time."""
        if not math.isfinite(self.turn_around) or self.turn_around < 0.0:
            raise SensingError(
                f"TwoWay: turn_around is {self.turn_around:g} s; it must be finite and zero or positive"
            )


Timing = OneWay | TwoWay


class Leg(NamedTuple):
    """
    One way of an exchange, by its travel time between the places of both vehicles at the ping.

    The gradients are those of travel time with respect to the place of the initiator and of the responder:
    the slowness vector along the ray where the ray ends, minus it where the ray begins.
    """

    travel_time: Array
    at_initiator: Array
    at_responder: Array


def half_round_trip(
    timing: TwoWay, ping: Leg, answer: Leg, initiator_velocity: Array, responder_velocity: Array
) -> Array:
    r"""
    Half of what is left of a round trip after the turn-around time, with both vehicles moving meanwhile.

    Parameters
    ----------
    timing : TwoWay
    ping, answer : Leg
        Travel times, shape (n,) [s], and gradients, shape (n, 3) [s m⁻¹], between the places at the ping. A
        gradient of NaN (equal positions, where there is none) counts as zero.
    initiator_velocity, responder_velocity : ndarray, shape (n, 3)
        Constant during the exchange. [m s⁻¹]

    Returns
    -------
    ndarray, shape (n,)
        NaN where a leg has no arrival. [s]

    Notes
    -----
    With the times :math:`t_1, t_2` of both legs at rest, their gradients :math:`g` and the turn-around time
    :math:`\tau`, the responder has moved for :math:`t_1` when the ping arrives and for :math:`t_1 + \tau` when
    it answers, the initiator for :math:`t_1 + \tau + t_2` when the answer arrives. To first order in
    :math:`v / c` the result is

    .. math:: \tfrac12 \left[ t_1 + t_2 + t_1\, g_1^r \cdot v_r
        + (t_1 + \tau)\, g_2^r \cdot v_r + (t_1 + \tau + t_2)\, g_2^i \cdot v_i \right],

    and for equal legs the travel time at the middle of the exchange, :math:`t + \tau / 2` after the ping.
    Neglected: :math:`(v / c)^2 t`; the curvature of travel time, at most :math:`(v_\perp T)^2 / 2 r c` for
    speeds across the link that add up to :math:`v_\perp`, a distance :math:`r` and an exchange of duration
    :math:`T`; and accelerations.
    """
    g1r, g2r, g2i = (np.nan_to_num(g) for g in (ping.at_responder, answer.at_responder, answer.at_initiator))
    t1, t2, wait = ping.travel_time, answer.travel_time, timing.turn_around
    moved = (
        t1 * _dot(g1r, responder_velocity)
        + (t1 + wait) * _dot(g2r, responder_velocity)
        + (t1 + wait + t2) * _dot(g2i, initiator_velocity)
    )
    return np.asarray(0.5 * (t1 + t2 + moved))


def velocities(truth: Trajectories, samples: NDArray[np.int64]) -> Array:
    """
    Mean velocity of every vehicle from each of some samples to the one after it.

    Parameters
    ----------
    truth : Trajectories
    samples : ndarray of int, shape (n_epochs,)
        Samples; at the last of the mission, the velocity is that from the one before it.

    Returns
    -------
    ndarray, shape (n_agents, n_epochs, 3)
        [m s⁻¹]
    """
    start = np.minimum(samples, truth.time.size - 2)
    step = truth.position[:, start + 1] - truth.position[:, start]
    return np.asarray(step / (truth.time[start + 1] - truth.time[start])[:, None])


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))
