"""
Events of the last minutes with the state after each; a late event is inserted at its time, and
later ones are applied again.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Iterable, Sequence

from pymantaray.apps.online.filter import (
    Event,
    FleetState,
    Kind,
    Outcome,
    RangePrediction,
    Step,
    advance,
    apply,
    innovation_of,
)
from pymantaray.errors import OnlineError


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
        self.total: Counter[Outcome] = Counter()  # of measurements that are not in the history
        self._states: list[
            FleetState
        ] = []  # after each event; the first `_valid` ones are up to date
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
            innovation = innovation_of(state.estimate, event, self.ranging)
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
