"""
Events of an on-line estimator, and the update of a fleet's state by each: pure functions on arrays
that never change.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.filters.error_state import (
    SIZE,
    Innovation,
    Motion,
    State,
    exceeds,
    predict,
    range_innovation,
    update,
)
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


class FleetState(NamedTuple):
    """
    Estimate of all vehicles and of beacons with unknown positions; each vehicle has the time up to
    which its odometry was applied.
    """

    estimate: State
    time: tuple[float, ...]  # of each vehicle [s]
    begin: tuple[float, ...]  # end of the last complete step of each vehicle [s]


class Step(NamedTuple):
    """Odometry step of a vehicle up to a time."""

    time: float
    rotation: Array  # (3, 3)
    translation: Array  # (3,) in the axes of the body at its begin [m]
    variance: Array  # (6,) in the tangent of the body at its end, rotation first

    @classmethod
    def of(cls, event: Event) -> Step:
        """Step of an odometry event."""
        translation, rotation, sigma = np.split(np.array(event.values), (3, 6))
        return cls(event.time, so3_exp(rotation), translation, sigma**2)


def advance(state: FleetState, vehicle: int, step: Step, time: float) -> FleetState:
    """Move a vehicle to a time within a step; a part of a step is a part of its screw motion."""
    begin = state.begin[vehicle]
    now = state.time[vehicle]
    rotation = step.rotation
    translation = step.translation
    variance = step.variance
    if now != begin or time != step.time:
        part = (time - now) / (step.time - begin)
        rotation, translation = se3_exp(part * se3_log(rotation, translation))
        variance = part * variance
    motion = Motion(rotation[None], translation[None], np.diag(variance)[None])
    return FleetState(
        predict(state.estimate, slice(vehicle, vehicle + 1), motion),
        _with(state.time, vehicle, time),
        _with(state.begin, vehicle, time) if time == step.time else state.begin,
    )


class RangePrediction(NamedTuple):
    """
    Range model, its uncertainty if it has one, and the beacons with exactly known positions (n, 3).
    """

    model: RangeModel
    uncertainty: TravelTimeUncertainty | None
    fixed: Array


def innovation_of(state: State, event: Event, ranging: RangePrediction) -> Innovation | None:
    """Innovation of a measurement; None if the range model has no arrival."""
    if event.kind == Kind.RANGE:
        return _range(state, event, ranging)
    axes = [2] if event.kind == Kind.DEPTH else [0, 1, 2]
    value, sigma = np.array(event.values).reshape(2, -1)
    vehicle = event.members[0]
    columns = SIZE * vehicle + 3 + np.array(axes)
    return Innovation(state.position[vehicle, axes] - value, columns, np.diag(sigma**2))


def _range(state: State, event: Event, ranging: RangePrediction) -> Innovation | None:
    travel_time, sigma, sound_speed = event.values
    ends = np.array([event.members])
    positions = np.concatenate([state.position, ranging.fixed])[ends]
    links = RangeEndpoints(
        np.array([event.time]), positions[:, 0], positions[:, 1], np.array([sound_speed])
    )
    prediction = ranging.model.predict(links)
    if not prediction.possible[0]:
        return None
    variance = np.array([sigma * sigma])
    if ranging.uncertainty is not None:
        variance += ranging.uncertainty.covariances(links, _ONE_LINK)[0][0]
    return range_innovation(
        state,
        ends,
        prediction,
        np.array([travel_time]),
        variance,
        scale=np.ones(1),
        n_fixed=len(ranging.fixed),
    )


def apply(
    state: FleetState, event: Event, ranging: RangePrediction, gate: float
) -> tuple[FleetState, Outcome]:
    """
    Update by a measurement, unless it is a range whose innovation exceeds the gate, in standard
    deviations.
    """
    innovation = innovation_of(state.estimate, event, ranging)
    if innovation is None:
        return state, Outcome.NO_ARRIVAL
    if event.kind == Kind.RANGE and exceeds(state.estimate, innovation, gate):
        return state, Outcome.GATED
    updated = update(state.estimate, innovation)
    if updated is None:
        return state, Outcome.FAILED
    return state._replace(estimate=updated.state), Outcome.USED


def _with(values: tuple[float, ...], at: int, value: float) -> tuple[float, ...]:
    return (*values[:at], value, *values[at + 1 :])
