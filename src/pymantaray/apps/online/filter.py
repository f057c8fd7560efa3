"""
State of a fleet and of its beacons, and what each event does to it: pure functions on arrays that
never change.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.filters.kalman import SIZE, corrected, moved
from pymantaray.estimation.ranges.range_models import (
    RangeEndpoints,
    RangeModel,
    TravelTimeUncertainty,
)
from pymantaray.geometry.se3 import se3_exp, se3_log, so3_exp

_ONE_LINK = np.zeros(1, dtype=np.intp)


class Kind(IntEnum):
    """Kind of an event; events of one time are applied in this order."""

    ODOMETRY = 0
    DEPTH = 1
    FIX = 2
    RANGE = 3


class Outcome(IntEnum):
    """Outcome of a measurement."""

    USED = 0
    GATED = 1  # the innovation is too large: probably a later arrival or an outlier
    NO_ARRIVAL = 2  # the range model has no arrival there: shadow, border or outside of a table
    WAITING = 3  # the odometry does not reach its time yet
    TOO_LATE = 4  # older than the lag
    DUPLICATE = 5  # the same measurement has arrived before
    FAILED = 6  # the covariance of the innovation is not positive definite


class Event(NamedTuple):
    """
    Odometry or a measurement; events are sorted, so their order does not depend on the order of
    arrival.

    ``members`` are the vehicle, or the transmitter and the receiver of a range: vehicles come
    first, then beacons with unknown and with exact positions. ``values`` are translation, rotation
    vector and the six standard deviations of odometry; depth and sigma; position and three sigmas;
    or travel time, sigma and sound speed at the transmitter (0 if unknown). [m, rad, s, m/s]
    """

    time: float
    kind: Kind
    members: tuple[int, ...]
    values: tuple[float, ...]


class State(NamedTuple):
    """
    Estimate of all vehicles and of beacons with unknown positions; each vehicle has the time up to
    which its odometry was applied.
    """

    rotation: Array  # (n, 3, 3), body to world
    position: Array  # (n, 3) [m]
    covariance: Array  # (6 n, 6 n), rotation in body axes and position in world axes
    time: tuple[float, ...]  # of each vehicle [s]
    begin: tuple[float, ...]  # end of the last complete step of each vehicle [s]


class Step(NamedTuple):
    """Odometry step of a vehicle up to a time."""

    time: float
    turn: Array  # (3, 3)
    way: Array  # (3,) in the axes of the body at its begin [m]
    variance: Array  # (6,) in the tangent of the body at its end, rotation first

    @classmethod
    def of(cls, event: Event) -> Step:
        """Step of an odometry event."""
        values = np.array(event.values)
        return cls(event.time, so3_exp(values[3:6]), values[:3], values[6:] ** 2)


def advanced(state: State, vehicle: int, step: Step, time: float) -> State:
    """Move a vehicle to a time within a step; a part of a step is a part of its screw motion."""
    begin = state.begin[vehicle]
    now = state.time[vehicle]
    turn = step.turn
    way = step.way
    variance = step.variance
    if now != begin or time != step.time:
        part = (time - now) / (step.time - begin)
        turn, way = se3_exp(part * se3_log(turn, way))
        variance = part * variance
    rotation, position, by_pose, by_step = moved(
        state.rotation[vehicle, None], state.position[vehicle, None], turn[None], way[None]
    )
    own = slice(SIZE * vehicle, SIZE * (vehicle + 1))
    covariance = state.covariance.copy()
    covariance[own] = by_pose[0] @ covariance[own]
    covariance[:, own] = covariance[:, own] @ by_pose[0].T
    covariance[own, own] += (by_step[0] * variance) @ by_step[0].T
    rotations = state.rotation.copy()
    positions = state.position.copy()
    rotations[vehicle] = rotation[0]
    positions[vehicle] = position[0]
    times = _with(state.time, vehicle, time)
    begins = _with(state.begin, vehicle, time) if time == step.time else state.begin
    return State(rotations, positions, covariance, times, begins)


class Measured(NamedTuple):
    """
    Residual predicted minus measured (m,), its derivatives by the errors (m, 6 n), and its
    variances (m,).
    """

    residual: Array
    by_errors: Array
    variance: Array


class RangePrediction(NamedTuple):
    """
    Range model, its uncertainty if it has one, and the beacons with exactly known positions (n, 3).
    """

    model: RangeModel
    uncertainty: TravelTimeUncertainty | None
    fixed: Array


def measured(state: State, event: Event, ranging: RangePrediction) -> Measured | None:
    """Residual of a measurement; None if the range model has no arrival."""
    if event.kind == Kind.RANGE:
        return _range(state, event, ranging)
    at = SIZE * event.members[0]
    rows = [at + 5] if event.kind == Kind.DEPTH else [at + 3, at + 4, at + 5]
    values = np.array(event.values).reshape(2, -1)
    by_errors = np.zeros((len(rows), len(state.covariance)))
    by_errors[np.arange(len(rows)), rows] = 1.0
    position = state.position[event.members[0]]
    return Measured(position[-len(rows) :] - values[0], by_errors, values[1] ** 2)


def _range(state: State, event: Event, ranging: RangePrediction) -> Measured | None:
    travel_time, sigma, sound_speed = event.values
    n = len(state.position)
    ends = [state.position[k] if k < n else ranging.fixed[k - n] for k in event.members]
    links = RangeEndpoints(
        np.array([event.time]), ends[0][None], ends[1][None], np.array([sound_speed])
    )
    prediction = ranging.model.predict(links)
    if not prediction.possible[0]:
        return None
    by_errors = np.zeros((1, len(state.covariance)))
    for k, gradient in zip(event.members, prediction[1:3], strict=True):
        if k < n:
            by_errors[0, SIZE * k + 3 : SIZE * k + 6] = gradient[0]
    variance = sigma * sigma
    if ranging.uncertainty is not None:
        variance += float(ranging.uncertainty.covariances(links, _ONE_LINK)[0][0, 0])
    return Measured(prediction.travel_time - travel_time, by_errors, np.array([variance]))


def updated(state: State, found: Measured, gate: float) -> tuple[State, Outcome]:
    """
    Update by a measurement unless one of its innovations exceeds the gate, in standard deviations.
    """
    if np.isfinite(gate):
        spread = (
            np.einsum("ij,jk,ik->i", found.by_errors, state.covariance, found.by_errors)
            + found.variance
        )
        if (found.residual**2 > gate * gate * spread).any():
            return state, Outcome.GATED
    after = corrected(
        state.rotation,
        state.position,
        state.covariance,
        found.residual,
        found.by_errors,
        np.diag(found.variance),
    )
    if after is None:
        return state, Outcome.FAILED
    rotation, position, covariance, _ = after
    return State(rotation, position, covariance, state.time, state.begin), Outcome.USED


def _with(values: tuple[float, ...], at: int, value: float) -> tuple[float, ...]:
    return (*values[:at], value, *values[at + 1 :])
