"""
Events of an on-line estimator, and the update of a fleet's state by each: pure functions on arrays
that never change.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pymantaray.apps.online.drifting_water import DriftingWater
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
    water_time: float = 0.0  # of the errors of the water [s]


class Step(NamedTuple):
    """Odometry step of a vehicle up to a time."""

    time: float
    motion: Motion

    @classmethod
    def of(cls, event: Event) -> Step:
        """Step of an odometry event."""
        values = np.array(event.values)
        translation = values[None, :3]
        rotation = so3_exp(values[None, 3:6])
        sigma = values[6:]
        return cls(event.time, Motion(rotation, translation, np.diag(sigma**2)[None]))


def advance(state: FleetState, vehicle: int, step: Step, time: float) -> FleetState:
    """Move a vehicle to a time within a step; a part of a step is a part of its screw motion."""
    begin = state.begin[vehicle]
    now = state.time[vehicle]
    motion = step.motion
    if now != begin or time != step.time:
        part = (time - now) / (step.time - begin)
        rotation, translation = se3_exp(part * se3_log(motion.rotation, motion.translation))
        motion = Motion(rotation, translation, part * motion.covariance)
    return state._replace(
        estimate=predict(state.estimate, slice(vehicle, vehicle + 1), motion),
        time=_with(state.time, vehicle, time),
        begin=_with(state.begin, vehicle, time) if time == step.time else state.begin,
    )


class RangePrediction(NamedTuple):
    """
    Range model, its uncertainty if it has one, the beacons with exactly known positions (n, 3), and
    the errors of the water if they are estimated.
    """

    model: RangeModel
    uncertainty: TravelTimeUncertainty | None
    fixed: Array
    water: DriftingWater | None = None


def innovation_of(state: State, event: Event, ranging: RangePrediction) -> Innovation | None:
    """Innovation of a measurement; None if the range model has no arrival."""
    if event.kind == Kind.RANGE:
        return _range(state, event, ranging)
    value, sigma = np.array(event.values).reshape(2, -1)
    vehicle = event.members[0]
    end = SIZE * (vehicle + 1)  # a depth is the last coordinate, a fix all three
    estimated = state.position[vehicle, -value.size :]
    return Innovation(estimated - value, np.arange(end - value.size, end), np.diag(sigma**2))


def _range(state: State, event: Event, ranging: RangePrediction) -> Innovation | None:
    travel_time, sigma, sound_speed = event.values
    water = ranging.water
    n = len(state.position) - (0 if water is None else water.members)
    transmitter, receiver = (
        state.position[k : k + 1] if k < n else ranging.fixed[k - n : k - n + 1]
        for k in event.members
    )
    links = RangeEndpoints(np.array([event.time]), transmitter, receiver, np.array([sound_speed]))
    prediction = ranging.model.predict(links)
    if not prediction.possible[0]:
        return None
    variance = np.array([sigma * sigma])
    if ranging.uncertainty is not None:
        variance += ranging.uncertainty.covariances(links, _ONE_LINK)[0][0]
    # fixed beacons are numbered after all members of the state
    ends = np.array([[k if k < n else k + len(state.position) - n for k in event.members]])
    innovation = range_innovation(
        state,
        ends,
        prediction.travel_time - travel_time,
        (prediction.transmitter_gradient, prediction.receiver_gradient),
        variance,
        n_fixed=len(ranging.fixed),
    )
    if water is None:
        return innovation
    number = water.number_of(float(transmitter[0, 2]), float(receiver[0, 2]))
    error = water.errors(state)[0][number]
    innovation.by_errors[:, water.columns_of(len(state.position))[number]] = -prediction.travel_time
    return innovation._replace(residual=innovation.residual - prediction.travel_time * error)


def apply(
    state: FleetState, event: Event, ranging: RangePrediction, gate: float
) -> tuple[FleetState, Outcome]:
    """
    Update by a measurement, unless it is a range whose innovation exceeds the gate, in standard
    deviations.
    """
    if event.kind == Kind.RANGE and ranging.water is not None:
        elapsed = event.time - state.water_time
        estimate = ranging.water.relax(state.estimate, elapsed)
        state = state._replace(estimate=estimate, water_time=event.time)
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
