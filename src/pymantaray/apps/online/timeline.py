"""
Events of an on-line estimator with the state after each. A late event is inserted at its time, and
later ones are applied again; states are never changed.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from pymantaray.apps.online.slow_errors import SlowErrors
from pymantaray.arrays import Array
from pymantaray.errors import OnlineError
from pymantaray.estimation.filters.error_state import (
    SIZE,
    Innovation,
    Motion,
    State,
    average_states,
    exceeds,
    log_likelihood,
    predict,
    range_innovation,
    update,
)
from pymantaray.estimation.filters.gauss_markov import CLUTTER, CLUTTER_WIDTH, average_models
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

    If errors of ways are learned, there is a second estimate without such errors.
    """

    estimate: State
    time: tuple[float, ...]  # of each vehicle [s]
    begin: tuple[float, ...]  # end of the last complete step of each vehicle [s]
    errors_time: float = 0.0  # of the errors of water and ways [s]
    without: State | None = None
    no_error: float = 0.95  # probability of the second estimate, which is right in right water

    def changed(self, change: Callable[[State], State], **more: Any) -> FleetState:
        """Both estimates after a change, and other fields."""
        without = None if self.without is None else change(self.without)
        return self._replace(estimate=change(self.estimate), without=without, **more)

    @property
    def average(self) -> State:
        """Mean and covariance of both estimates by their probabilities."""
        if self.without is None:
            return self.estimate
        return average_states(self.estimate, self.without, 1.0 - self.no_error)


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
    return state.changed(
        lambda estimate: predict(estimate, slice(vehicle, vehicle + 1), motion),
        time=_with(state.time, vehicle, time),
        begin=_with(state.begin, vehicle, time) if time == step.time else state.begin,
    )


class RangePrediction(NamedTuple):
    """
    Range model, its uncertainty if it has one, the beacons with exactly known positions (n, 3), and
    errors of the water or of ways if they are estimated.
    """

    model: RangeModel
    uncertainty: TravelTimeUncertainty | None
    fixed: Array
    errors: SlowErrors | None = None


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
    errors = ranging.errors
    n = len(state.position) - (0 if errors is None else errors.members)
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
    if errors is None:
        return innovation
    depths = float(transmitter[0, 2]), float(receiver[0, 2])
    numbers = errors.numbers_of(event.members, depths)
    error = errors.errors(state)[0][numbers].sum()
    innovation.by_errors[
        :, errors.columns_of(len(state.position))[numbers]
    ] = -prediction.travel_time
    return innovation._replace(residual=innovation.residual - prediction.travel_time * error)


def apply(
    state: FleetState, event: Event, ranging: RangePrediction, gate: float
) -> tuple[FleetState, Outcome]:
    """
    Update by a measurement, unless it is a range whose innovation exceeds the gate, in standard
    deviations.

    The outcome is that of the more probable estimate.
    """
    errors = ranging.errors
    if event.kind == Kind.RANGE and errors is not None:
        elapsed = event.time - state.errors_time
        state = state.changed(lambda one: errors.relax(one, elapsed), errors_time=event.time)
    innovation = innovation_of(state.estimate, event, ranging)
    estimate, outcome = _updated(state.estimate, event, innovation, gate)
    if state.without is None:
        return state._replace(estimate=estimate), outcome
    other = innovation_of(state.without, event, ranging)
    without, other_outcome = _updated(state.without, event, other, gate)
    no_error = state.no_error
    if event.kind != Kind.DEPTH:  # both estimates have the same depths
        fit, other_fit = (
            _fit(one, event, its)
            for one, its in ((state.estimate, innovation), (state.without, other))
        )
        _, no_error = average_models(fit, other_fit, no_error)
    return state._replace(estimate=estimate, without=without, no_error=no_error), (
        outcome if no_error < 0.5 else other_outcome
    )


def _updated(
    state: State, event: Event, innovation: Innovation | None, gate: float
) -> tuple[State, Outcome]:
    """State after a measurement, and outcome."""
    if innovation is None:
        return state, Outcome.NO_ARRIVAL
    if event.kind == Kind.RANGE and exceeds(state, innovation, gate):
        return state, Outcome.GATED
    updated = update(state, innovation)
    if updated is None:
        return state, Outcome.FAILED
    return updated.state, Outcome.USED


def _fit(state: State, event: Event, innovation: Innovation | None) -> float:
    """
    Log likelihood of a measurement, by which estimates are compared.

    A share of all ranges has any time.
    """
    floor = math.log(CLUTTER / CLUTTER_WIDTH)
    if innovation is None:
        return floor
    fit = log_likelihood(state, innovation)
    if event.kind != Kind.RANGE:
        return fit
    density = (1.0 - CLUTTER) / math.sqrt(2.0 * math.pi)
    return float(np.logaddexp(math.log(density) + fit, floor))


def _with(values: tuple[float, ...], at: int, value: float) -> tuple[float, ...]:
    return (*values[:at], value, *values[at + 1 :])


class Timeline:
    """
    Kalman filter with a history of fixed length.

    The state depends only on the events, not on the order in which they arrive: events are sorted,
    and all events after a late one are applied again when their result is needed.

    Parameters
    ----------
    state : FleetState
        At the horizon.
    ranging : RangePrediction
    lag : float
        Length of the history. [s]
    gate : float
        Largest innovation of a range, in standard deviations.
    horizon : float
        Time before which nothing changes any more. [s]
    """

    def __init__(
        self,
        state: FleetState,
        ranging: RangePrediction,
        *,
        lag: float,
        gate: float,
        horizon: float,
    ) -> None:
        self.base = state
        self.ranging = ranging
        self.lag = lag
        self.gate = gate
        self.horizon = horizon
        self.events: list[Event] = []
        self.waiting: list[Event] = []
        # of measurements that are not in the history
        self.total: Counter[Outcome] = Counter()
        # after each event; the first `_valid` ones are up to date
        self._states: list[FleetState] = []
        self._valid = 0
        self._outcomes: list[Outcome] = []
        self._steps: list[list[Step]] = [[] for _ in state.time]

    def front(self, vehicle: int) -> float:
        """Time up to which a vehicle has odometry. [s]."""
        steps = self._steps[vehicle]
        return steps[-1].time if steps else self.base.begin[vehicle]

    def add(self, event: Event) -> Outcome:
        """Apply an event at its time, and return its outcome."""
        if event.time < self.horizon:
            outcome = Outcome.TOO_LATE
        elif event.kind == Kind.ODOMETRY:
            return self._add_step(event)
        elif _contains(self.events, event) or _contains(self.waiting, event):
            outcome = Outcome.DUPLICATE
        elif not self._covers(event):
            insort(self.waiting, event)
            return Outcome.WAITING
        else:
            at = self._insert(event)
            self._apply_until(at + 1)
            return self._outcomes[at]
        if event.kind != Kind.ODOMETRY:
            self.total[outcome] += 1
        return outcome

    def load(self, events: Iterable[Event], waiting: Sequence[Event]) -> None:
        """Apply the events of a saved history."""
        for event in events:
            self._insert(event)
            if event.kind == Kind.ODOMETRY:
                self._steps[event.members[0]].append(Step.of(event))
        self.waiting = list(waiting)

    def state_at(self, vehicle: int, time: float) -> FleetState:
        """State after all events up to a time, with a vehicle moved to that time."""
        k = bisect_left(self.events, (math.nextafter(time, math.inf),))
        self._apply_until(k)
        return self._moved(self._states[k - 1] if k else self.base, vehicle, time)

    def counts(self) -> dict[Outcome, int]:
        """Number of measurements with each outcome."""
        self._apply_until(len(self.events))
        counts = self.total + Counter(
            outcome
            for event, outcome in zip(self.events, self._outcomes, strict=True)
            if event.kind != Kind.ODOMETRY
        )
        counts[Outcome.WAITING] = len(self.waiting)
        return {outcome: counts[outcome] for outcome in Outcome}

    def range_residuals(self) -> list[tuple[float, float, float]]:
        """
        Residual after the event, travel time and standard deviation of each range in the history
        with a prediction. [s]
        """
        self._apply_until(len(self.events))
        rows = []
        for event, state in zip(self.events, self._states, strict=True):
            if event.kind != Kind.RANGE:
                continue
            innovation = innovation_of(state.average, event, self.ranging)
            if innovation is not None:
                sigma = math.sqrt(float(innovation.variance[0, 0]))
                rows.append((float(innovation.residual[0]), event.values[0], sigma))
        return rows

    def _covers(self, event: Event) -> bool:
        """True if the odometry of all vehicles of a measurement reaches its time."""
        return all(self.front(v) >= event.time for v in event.members if v < len(self._steps))

    def _add_step(self, event: Event) -> Outcome:
        vehicle = event.members[0]
        steps = self._steps[vehicle]
        k = bisect_left(steps, event.time, key=lambda step: step.time)
        if k < len(steps) and steps[k].time == event.time:
            if _contains(self.events, event):
                return Outcome.DUPLICATE
            raise OnlineError(
                f"odometry: another step ends at {event.time:g} s; steps need different times"
            )
        begin = steps[k - 1].time if k else self.base.begin[vehicle]
        if self.base.time[vehicle] > begin or event.time <= begin:
            return Outcome.TOO_LATE  # a part of the step after it is in the base
        self._insert(event)
        if k < len(steps):  # measurements since its begin have used the step after it
            self._valid = min(
                self._valid, bisect_left(self.events, (math.nextafter(begin, math.inf),))
            )
        steps.insert(k, Step.of(event))
        if self.waiting:
            ready = [other for other in self.waiting if self._covers(other)]
            self.waiting = [other for other in self.waiting if not self._covers(other)]
            for other in ready:
                self._insert(other)
        self._forget()
        return Outcome.USED

    def _insert(self, event: Event) -> int:
        at = bisect_left(self.events, event)
        self.events.insert(at, event)
        self._states.insert(at, self.base)
        self._outcomes.insert(at, Outcome.WAITING)
        self._valid = min(self._valid, at)
        return at

    def _apply_until(self, count: int) -> None:
        """Bring the states after the first events up to date."""
        for k in range(self._valid, count):
            state = self._states[k - 1] if k else self.base
            event = self.events[k]
            for vehicle in event.members:
                if vehicle < len(self._steps):
                    state = self._moved(state, vehicle, event.time)
            outcome = Outcome.USED
            if event.kind != Kind.ODOMETRY:
                state, outcome = apply(state, event, self.ranging, self.gate)
            self._states[k], self._outcomes[k] = state, outcome
            self._valid = k + 1

    def _moved(self, state: FleetState, vehicle: int, time: float) -> FleetState:
        """State with a vehicle at a time within its next step."""
        if state.time[vehicle] >= time:
            return state
        steps = self._steps[vehicle]
        k = bisect_left(steps, time, key=lambda step: step.time)
        return advance(state, vehicle, steps[k], time)

    def _forget(self) -> None:
        """Move the horizon, and forget events before it."""
        newest = max(self.front(v) for v in range(len(self._steps)))
        self.horizon = max(self.horizon, newest - self.lag)
        k = bisect_left(self.events, (self.horizon,))
        if not k:
            return
        self._apply_until(k)
        self.base, self._valid = self._states[k - 1], self._valid - k
        for event, outcome in zip(self.events[:k], self._outcomes[:k], strict=True):
            if event.kind != Kind.ODOMETRY:
                self.total[outcome] += 1
        del self.events[:k], self._states[:k], self._outcomes[:k]
        for steps, begin in zip(self._steps, self.base.begin, strict=True):
            del steps[
                : bisect_left(steps, math.nextafter(begin, math.inf), key=lambda step: step.time)
            ]
        late = bisect_left(self.waiting, (self.horizon,))
        self.total[Outcome.TOO_LATE] += late
        del self.waiting[:late]


def _contains(events: Sequence[Event], event: Event) -> bool:
    at = bisect_left(events, event)
    return at < len(events) and events[at] == event
