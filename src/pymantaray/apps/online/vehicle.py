"""
Estimator for use on board: odometry, depths, fixes and ranges in any order, position and covariance
at any time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.acoustics import Medium
from pymantaray.apps.online.drifting_water import DriftingWater, SoundSpeedBias, saved_water
from pymantaray.apps.online.range_model import range_model_of
from pymantaray.apps.online.saved_state import fault_of, read_state, write_state
from pymantaray.apps.online.slow_errors import LearnedWays, SlowErrors, WayError, saved_ways
from pymantaray.apps.online.timeline import (
    Event,
    FleetState,
    Kind,
    Outcome,
    RangePrediction,
    Timeline,
)
from pymantaray.apps.table.table import TravelTimeTable
from pymantaray.arrays import Array
from pymantaray.errors import GeometryError, OnlineError
from pymantaray.estimation.filters.error_state import SIZE, State
from pymantaray.estimation.graph.graph import LARGEST
from pymantaray.estimation.ranges.range_models import RangeModel
from pymantaray.evaluation import unexplained
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix
from pymantaray.quantities.checks import check_number, checked_array, is_number

Ranges = TravelTimeTable | Medium | RangeModel | float
Water = DriftingWater | LearnedWays | tuple[DriftingWater | LearnedWays, ...] | None


_MIN_RANGES = 3  # that are judged
_LATEST = 1e12  # s; 30,000 years, with digits of 0.1 ms


class StartPose(NamedTuple):
    """
    Pose of a vehicle at the start, with standard deviations.

    Attributes
    ----------
    position : array_like, shape (3,)
        North, east, down. [m]
    quaternion : array_like, shape (4,)
        Rotation from the body (forward, right, down) to the world (w, x, y, z). By default the
        vehicle points north.
    sigma : array_like, shape (6,)
        Rotations about the body's axes [rad], then position along them [m].

    Examples
    --------
    >>> from pymantaray.apps.online import StartPose
    >>> StartPose((0.0, 0.0, 50.0)).position
    (0.0, 0.0, 50.0)
    """

    position: ArrayLike
    quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0)
    sigma: ArrayLike = (0.01, 0.01, 0.02, 5.0, 5.0, 1.0)


class Beacon(NamedTuple):
    """
    Beacon at rest.

    Attributes
    ----------
    position : array_like, shape (3,)
        North, east, down. [m]
    sigma : float
        Standard deviation of each coordinate; if positive, the position is estimated, too. [m]

    Examples
    --------
    >>> from pymantaray.apps.online import Beacon
    >>> Beacon((1000.0, 0.0, 50.0), sigma=2.0).sigma
    2.0
    """

    position: ArrayLike
    sigma: float = 0.0


class PoseEstimate(NamedTuple):
    """
    Estimate of a pose from all measurements up to its time.

    Attributes
    ----------
    time : float
        [s]
    position : ndarray, shape (3,)
        North, east, down. [m]
    quaternion : ndarray, shape (4,)
        Rotation from the body to the world (w, x, y, z).
    covariance : ndarray, shape (6, 6)
        Of rotation errors about the body's axes [rad] and of position errors along north, east and
        down [m].

    Examples
    --------
    >>> from pymantaray.apps.online import Beacon, OnlineEstimator, StartPose
    >>> beacons = {"B1": Beacon((1000.0, 0.0, 50.0))}
    >>> estimator = OnlineEstimator(StartPose((0.0, 0.0, 50.0)), beacons, 1500.0, lag=60.0)
    >>> estimator.pose().covariance.shape
    (6, 6)
    """

    time: float
    position: Array
    quaternion: Array
    covariance: Array


class OnlineEstimator:
    """
    Position of one vehicle or of a fleet, updated as measurements arrive.

    An error-state Kalman filter with a history of the last ``lag`` seconds. A measurement within
    the lag is applied at its own time, whenever it arrives: the filter goes back and repeats what
    follows. The result does not depend on the order of arrival. Memory and work per sample do not
    grow with the duration of the mission.

    Parameters
    ----------
    vehicles : StartPose or mapping of str to StartPose
        Vehicles by name; a single pose is a vehicle named ``vehicle``.
    beacons : mapping of str to Beacon
    ranges : TravelTimeTable, Medium, RangeModel or float
        Range model: a table; eigenrays in a medium; any model of `pymantaray.estimation`; or a
        sound speed [m/s]. The table's standard deviation over its ensemble of oceans adds to that
        of each range.
    start : float
        Time of the start poses. [s]
    lag : float
        Longest delay of a measurement. [s]
    longest_step : float
        Longest step of odometry. A later time is refused, because it would make all measurements
        before it too late. [s]
    gate : float
        A range whose innovation exceeds this number of standard deviations is not used; ``inf``
        uses all ranges.
    water : DriftingWater, LearnedWays or tuple of both, optional
        Relative errors of the predicted travel times, which are estimated too: of the sound speed
        by depth (`DriftingWater`), of each way (`LearnedWays`), or a tuple of both. By default
        there are none.

    Raises
    ------
    OnlineError
        If a value is not finite or not allowed, or two members have the same name.

    Examples
    --------
    >>> start, beacon = StartPose((0.0, 0.0, 50.0)), Beacon((1000.0, 0.0, 50.0))
    >>> estimator = OnlineEstimator(start, {"B": beacon}, 1500.0)
    >>> still, variance = (0.0, 0.0, 0.0), [1e-5] * 3 + [0.01] * 3
    >>> for k in range(1, 101):
    ...     step = estimator.add_odometry(0.1 * k, (0.15, 0.0, 0.0), still, variance)
    >>> estimator.add_range(8.0, "B", 0.66, 0.001).name
    'USED'
    >>> print(estimator.position().round(1))
    [13.2  0.  50. ]
    """

    def __init__(
        self,
        vehicles: StartPose | Mapping[str, StartPose],
        beacons: Mapping[str, Beacon],
        ranges: Ranges,
        *,
        start: float = 0.0,
        lag: float = 60.0,
        longest_step: float = 600.0,
        gate: float = 4.0,
        water: Water = None,
    ) -> None:
        fleet = {"vehicle": vehicles} if isinstance(vehicles, StartPose) else dict(vehicles)
        if not fleet:
            raise OnlineError("vehicles: found none; at least one is needed")
        for name in fleet:
            if name in beacons:
                raise OnlineError(
                    f"{name}: the name of a vehicle and of a beacon; names must differ"
                )
        _check_time("start", start)
        check_number(OnlineError, "lag", lag, "s", positive=True)
        check_number(OnlineError, "longest_step", longest_step, "s", positive=True)
        self._longest_step = float(longest_step)
        if not (is_number(gate) and gate > 0.0):
            raise OnlineError(f"gate is {gate!r} standard deviations; it must be positive")
        for name, beacon in beacons.items():
            check_number(OnlineError, f"sigma of beacon {name}", beacon.sigma, "m")
            _sized(f"sigma of beacon {name}", [beacon.sigma], (1,))
        unknown = [name for name, beacon in beacons.items() if beacon.sigma > 0.0]
        fixed = [name for name in beacons if name not in unknown]
        positions = [_sized(f"beacon {name}", beacons[name].position, (3,)) for name in fixed]
        model, uncertainty = range_model_of(ranges)
        self._vehicles = list(fleet)
        self._beacons = unknown + fixed
        errors = _slow_errors(water, len(fleet), len(fleet) + len(beacons))
        self._timeline = Timeline(
            _start_state(fleet, {name: beacons[name] for name in unknown}, float(start), errors),
            RangePrediction(model, uncertainty, np.array(positions).reshape(-1, 3), errors),
            lag=float(lag),
            gate=float(gate),
            horizon=float(start),
        )

    @property
    def vehicles(self) -> tuple[str, ...]:
        """Names of the vehicles."""
        return tuple(self._vehicles)

    @property
    def beacons(self) -> tuple[str, ...]:
        """Names of the beacons."""
        return tuple(self._beacons)

    def add_odometry(
        self,
        time: float,
        translation: ArrayLike,
        rotation: ArrayLike,
        sigma: ArrayLike,
        *,
        vehicle: str | None = None,
    ) -> Outcome:
        """
        Add the motion of a vehicle since its previous odometry.

        Parameters
        ----------
        time : float
            End of the step. [s]
        translation : array_like, shape (3,)
            In the axes of the body at the start of the step: forward, right, down. [m]
        rotation : array_like, shape (3,)
            Rotation vector from the body at the start to the body at the end. [rad]
        sigma : array_like, shape (6,)
            Standard deviations of rotation [rad] and translation [m] of this step.
        vehicle : str, optional
            May be omitted if there is one vehicle.

        Returns
        -------
        Outcome
            USED, TOO_LATE or DUPLICATE.

        Raises
        ------
        OnlineError
            If a value is not finite or too large, another step ends at this time, or the step is
            longer than ``longest_step``.
        """
        who = self._vehicle(vehicle)
        what = f"odometry of {self._vehicles[who]}"
        _check_time(what, time)
        front = self._timeline.front(who)
        if time > front + self._longest_step:
            raise OnlineError(
                f"{what}: time {time:.10g} s is {time - front:.4g} s after the end of the last"
                f" step; allowed are {self._longest_step:g} s (longest_step): check the clock"
            )
        values = (
            _sized(f"{what}: translation", translation, (3,)),
            _sized(f"{what}: rotation", rotation, (3,)),
            _sigmas(f"{what}: sigma", sigma, 6, zero=True),
        )
        return self._add(time, Kind.ODOMETRY, (who,), np.concatenate(values).tolist())

    def add_depth(
        self, time: float, depth: float, sigma: float, *, vehicle: str | None = None
    ) -> Outcome:
        """
        Add a measured depth.

        Parameters
        ----------
        time : float
            [s]
        depth : float
            Positive down. [m]
        sigma : float
            Standard deviation. [m]
        vehicle : str, optional
            May be omitted if there is one vehicle.

        Returns
        -------
        Outcome
        """
        return self._add_place(time, Kind.DEPTH, vehicle, np.atleast_1d(depth), sigma)

    def add_fix(
        self, time: float, position: ArrayLike, sigma: ArrayLike, *, vehicle: str | None = None
    ) -> Outcome:
        """
        Add a position fix, such as GNSS at the surface.

        Parameters
        ----------
        time : float
            [s]
        position : array_like, shape (3,)
            North, east, down. [m]
        sigma : array_like, shape (3,) or ()
            Standard deviations. [m]
        vehicle : str, optional
            May be omitted if there is one vehicle.

        Returns
        -------
        Outcome
        """
        return self._add_place(time, Kind.FIX, vehicle, position, sigma)

    def add_range(
        self,
        time: float,
        source: str,
        travel_time: float,
        sigma: float,
        *,
        vehicle: str | None = None,
        sound_speed: float | None = None,
    ) -> Outcome:
        """
        Add a travel time from a beacon, or from another vehicle, to a vehicle.

        Parameters
        ----------
        time : float
            Time at which the vehicle hears the ping. A vehicle that pings is assumed to be at its
            position of that time. [s]
        source : str
            Beacon or vehicle that transmits.
        travel_time : float
            One way, or half of a round trip without the turn-around time. [s]
        sigma : float
            Standard deviation of the travel time. [s]
        vehicle : str, optional
            Vehicle that hears the ping. May be omitted if there is one vehicle.
        sound_speed : float, optional
            Measured at the source, for the range model ``TransmitterSpeed``. [m/s]

        Returns
        -------
        Outcome

        Raises
        ------
        OnlineError
            If a name is unknown, or a value is not finite.
        """
        who = self._vehicle(vehicle)
        members = self._vehicles + self._beacons
        if source not in members or source == self._vehicles[who]:
            allowed = [name for name in members if name != self._vehicles[who]]
            raise OnlineError(
                f"source {source!r}: unknown; allowed: {', '.join(allowed) or 'none'}"
            )
        what = f"range from {source} to {self._vehicles[who]}"
        _check_time(what, time)
        check_number(OnlineError, f"{what}: travel time", travel_time, "s")
        _sized(f"{what}: travel time", [travel_time, sound_speed or 0.0], (2,))
        if sound_speed is not None:
            check_number(OnlineError, f"{what}: sound speed", sound_speed, "m/s", positive=True)
        elif (model := self._timeline.ranging.model).needs_sound_speed:
            raise OnlineError(
                f"{what}: no sound speed; the range model {type(model).__name__} needs one"
            )
        values = [
            float(travel_time),
            *_sigmas(f"{what}: sigma", sigma, 1).tolist(),
            float(sound_speed or 0.0),
        ]
        return self._add(time, Kind.RANGE, (members.index(source), who), values)

    def pose(self, time: float | None = None, *, vehicle: str | None = None) -> PoseEstimate:
        """
        Return the pose of a vehicle from all measurements up to a time.

        Parameters
        ----------
        time : float, optional
            Within the lag. By default the end of the vehicle's odometry. [s]
        vehicle : str, optional
            May be omitted if there is one vehicle.

        Returns
        -------
        PoseEstimate

        Raises
        ------
        OnlineError
            If the time is before the lag or after the end of the odometry.
        """
        who, at, state = self._state(time, vehicle)
        own = slice(SIZE * who, SIZE * (who + 1))
        return PoseEstimate(
            at,
            state.position[who].copy(),
            quaternion_from_matrix(state.rotation[who]),
            state.covariance[own, own].copy(),
        )

    def position(self, time: float | None = None, *, vehicle: str | None = None) -> Array:
        """
        Return the position of a vehicle: north, east, down. [m].

        Parameters
        ----------
        time : float, optional
            As in `pose`. [s]
        vehicle : str, optional
            May be omitted if there is one vehicle.

        Returns
        -------
        ndarray, shape (3,)
        """
        return self.pose(time, vehicle=vehicle).position

    def covariance(self, time: float | None = None, *, vehicle: str | None = None) -> Array:
        """
        Return the covariance of the position of a vehicle. [m²].

        Parameters
        ----------
        time : float, optional
            As in `pose`. [s]
        vehicle : str, optional
            May be omitted if there is one vehicle.

        Returns
        -------
        ndarray, shape (3, 3)
        """
        return self.pose(time, vehicle=vehicle).covariance[3:, 3:].copy()

    def water_errors(self, time: float | None = None) -> list[SoundSpeedBias]:
        """
        Return the relative errors of the sound speed.

        Parameters
        ----------
        time : float, optional
            As in `pose`, for the first vehicle. [s]

        Returns
        -------
        list of SoundSpeedBias
            One for each pair of depth bands; empty if the estimator has no `DriftingWater`.
        """
        errors = self._timeline.ranging.errors
        water = None if errors is None else errors.water
        if water is None:
            return []
        bands = water.bands
        return [
            SoundSpeedBias(bands[a], bands[b], *error)
            for (a, b), error in zip(water.pairs, self._errors(time), strict=False)
        ]

    def way_errors(self, time: float | None = None) -> list[WayError]:
        """
        Return the relative errors of the predicted travel times of each way.

        Parameters
        ----------
        time : float, optional
            As in `pose`, for the first vehicle. [s]

        Returns
        -------
        list of WayError
            One for each source and vehicle; empty if the estimator has no `LearnedWays`.
        """
        errors = self._timeline.ranging.errors
        if errors is None or errors.ways is None:
            return []
        all_errors = self._errors(time)
        names = self._vehicles + self._beacons
        return [
            WayError(source, vehicle, *all_errors[errors.way(k, v)])
            for v, vehicle in enumerate(self._vehicles)
            for k, source in enumerate(names)
            if k != v
        ]

    def counts(self) -> dict[str, int]:
        """
        Return the number of depths, fixes and ranges with each outcome.

        Returns
        -------
        dict
            Name of the outcome in lower case, and the number.
        """
        return {outcome.name.lower(): n for outcome, n in self._timeline.counts().items()}

    def unexplained(self) -> str | None:
        """
        Return why the estimate does not explain the ranges within the lag.

        Returns
        -------
        str or None
            None if it does, or if there are fewer than three. Ranges that the gate rejects count as
            well; the limits are those of `pymantaray.evaluation.unexplained`.
        """
        rows = self._timeline.range_residuals()
        if len(rows) < _MIN_RANGES:
            return None
        return unexplained(*np.transpose(rows))

    def save(self, path: Path | str) -> None:
        """
        Save the state in one file, which is replaced atomically.

        Parameters
        ----------
        path : pathlib.Path or str
            The range model is not saved.
        """
        line = self._timeline
        base = line.base.estimate._asdict() | {
            "time": line.base.time,
            "begin": line.base.begin,
            "errors_time": line.base.errors_time,
            "no_error": line.base.no_error,
        }
        without = line.base.without
        errors = line.ranging.errors
        water = None if errors is None else errors.water
        ways = None if errors is None else errors.ways
        content = {
            "vehicles": self._vehicles,
            "beacons": self._beacons,
            "model": type(line.ranging.model).__name__,
            "lag": line.lag,
            "longest_step": self._longest_step,
            "gate": line.gate if math.isfinite(line.gate) else None,
            "horizon": line.horizon,
            "fixed": line.ranging.fixed.tolist(),
            "water": None if water is None else [water.sigma, water.hours, list(water.depths)],
            "ways": None if ways is None else list(ways),
            "base": _lists(base),
            "without": None if without is None else _lists(without._asdict()),
            "events": line.events,
            "waiting": line.waiting,
            "total": {outcome.name: n for outcome, n in line.total.items()},
        }
        write_state(content, path)

    @classmethod
    def restore(cls, path: Path | str, ranges: Ranges) -> Self:
        """
        Restore an estimator, which continues with the same numbers to the last digit.

        Parameters
        ----------
        path : pathlib.Path or str
            File from `save`.
        ranges : TravelTimeTable, Medium, RangeModel or float
            The same range model as before.

        Returns
        -------
        OnlineEstimator

        Raises
        ------
        OnlineError
            If the file is missing, damaged, of another format, or the range model has another type.
        """
        # the state must be usable with this range model
        content = read_state(path)
        if fault := fault_of(content):
            raise OnlineError(f"{path}: not a usable state: {fault}; use an earlier file")
        model, uncertainty = range_model_of(ranges)
        if type(model).__name__ != content["model"]:
            raise OnlineError(
                f"{path}: saved with the range model {content['model']}; found"
                f" {type(model).__name__}"
            )
        # an estimator with the saved values
        base, without = content["base"], content["without"]
        saved = saved_water(content["water"]), saved_ways(content["ways"])
        self = cls.__new__(cls)
        self._vehicles = content["vehicles"]
        self._beacons = content["beacons"]
        self._longest_step = float(content["longest_step"])
        self._timeline = Timeline(
            FleetState(
                _state_of(base),
                tuple(base["time"]),
                tuple(base["begin"]),
                float(base["errors_time"]),
                None if without is None else _state_of(without),
                float(base["no_error"]),
            ),
            RangePrediction(
                model,
                uncertainty,
                np.array(content["fixed"]).reshape(-1, 3),
                _slow_errors(
                    tuple(one for one in saved if one is not None) or None,
                    len(self._vehicles),
                    len(self._vehicles) + len(self._beacons),
                ),
            ),
            lag=content["lag"],
            gate=math.inf if content["gate"] is None else content["gate"],
            horizon=content["horizon"],
        )
        # outcomes and events so far
        self._timeline.total = Counter({Outcome[name]: n for name, n in content["total"].items()})
        self._timeline.load(_events(content["events"]), _events(content["waiting"]))
        return self

    def _add_place(
        self, time: float, kind: Kind, vehicle: str | None, place: ArrayLike, sigma: ArrayLike
    ) -> Outcome:
        """Add a depth or a position of a vehicle."""
        who = self._vehicle(vehicle)
        size = 1 if kind == Kind.DEPTH else 3
        what = f"{kind.name.lower()} of {self._vehicles[who]}"
        _check_time(what, time)
        values = _sized(what, place, (size,)), _sigmas(f"{what}: sigma", sigma, size)
        return self._add(time, kind, (who,), np.concatenate(values).tolist())

    def _add(
        self, time: float, kind: Kind, members: tuple[int, ...], values: list[float]
    ) -> Outcome:
        if kind != Kind.ODOMETRY:
            line = self._timeline
            newest = max(line.front(v) for v in range(len(self._vehicles)))
            if time > newest + line.lag:
                raise OnlineError(
                    f"{kind.name.lower()} at {time:g} s: more than the lag of {line.lag:g} s after"
                    f" the last odometry at {newest:g} s; check the clock"
                )
        return self._timeline.add(Event(float(time), kind, members, tuple(values)))

    def _state(self, time: float | None, vehicle: str | None) -> tuple[int, float, State]:
        """Number of a vehicle, time, and the state at this time; an error outside the lag."""
        who = self._vehicle(vehicle)
        front = self._timeline.front(who)
        at = front if time is None else time
        _check_time("time", at)
        if at > front:
            raise OnlineError(
                f"time {at:g} s: after the last odometry of {self._vehicles[who]} at {front:g} s"
            )
        if at < self._timeline.horizon:
            raise OnlineError(
                f"time {at:g} s: before the lag, which begins at {self._timeline.horizon:g} s; ask"
                f" earlier or choose a longer lag than {self._timeline.lag:g} s"
            )
        return who, at, self._timeline.state_at(who, at).average

    def _errors(self, time: float | None) -> list[tuple[float, float]]:
        """Errors of the water and of the ways with their standard deviations."""
        errors = self._timeline.ranging.errors
        if errors is None:
            return []
        _, at, _ = self._state(time, self._vehicles[0])
        state = self._timeline.state_at(0, at)
        elapsed = max(at - state.errors_time, 0.0)
        later = state.changed(lambda one: errors.relax(one, elapsed))
        values, sigma = errors.errors(later.average)
        return list(zip(values.tolist(), sigma.tolist(), strict=True))

    def _vehicle(self, name: str | None) -> int:
        if name is None and len(self._vehicles) == 1:
            return 0
        if name not in self._vehicles:
            found = "missing" if name is None else f"{name!r} is unknown"
            raise OnlineError(f"vehicle: {found}; allowed: {', '.join(self._vehicles)}")
        return self._vehicles.index(name)


def _start_state(
    fleet: Mapping[str, StartPose],
    unknown: Mapping[str, Beacon],
    start: float,
    errors: SlowErrors | None,
) -> FleetState:
    """
    State of the vehicles at their start poses, of the beacons with unknown positions, and of the
    errors of the water and of ways.
    """
    n = len(fleet)
    rotation = np.empty((n, 3, 3))
    position = np.empty((n, 3))
    covariance = np.empty((n, SIZE, SIZE))
    for k, (name, pose) in enumerate(fleet.items()):
        position[k] = _sized(f"position of {name}", pose.position, (3,))
        quaternion = checked_array(OnlineError, f"quaternion of {name}", pose.quaternion, (4,))
        try:
            rotation[k] = matrix_from_quaternion(quaternion)
        except GeometryError as error:
            raise OnlineError(f"{name}: {error}") from None
        covariance[k] = np.diag(_sigmas(f"sigma of {name}", pose.sigma, SIZE, zero=True) ** 2)
    beacons = [_sized(f"beacon {name}", one.position, (3,)) for name, one in unknown.items()]
    variance = np.array([one.sigma**2 for one in unknown.values()])
    if errors is not None:
        beacons += [np.zeros(3)] * errors.members
        variance = np.append(variance, np.zeros(errors.members))
    estimate = State.at_start(
        rotation,
        position,
        covariance,
        np.array(beacons).reshape(-1, 3),
        variance[:, None, None] * np.eye(3),
    )
    if errors is None:
        return FleetState(estimate, (start,) * n, (start,) * n, start)
    columns = errors.columns_of(len(estimate.position))
    estimate.covariance[columns, columns] = errors.processes.sigma**2
    without = None if errors.ways is None else errors.without_ways(estimate)
    return FleetState(estimate, (start,) * n, (start,) * n, start, without)


def _slow_errors(water: Water, vehicles: int, nodes: int) -> SlowErrors | None:
    """Errors that are estimated; None without any."""
    if water is None:
        return None
    is_one = isinstance(water, DriftingWater | LearnedWays) or not isinstance(water, tuple)
    options = (water,) if is_one else water
    bands = [one.checked() for one in options if isinstance(one, DriftingWater)]
    ways = [one.checked() for one in options if isinstance(one, LearnedWays)]
    if not options or max(len(bands), len(ways)) > 1 or len(bands) + len(ways) < len(options):
        raise OnlineError(f"water: {water}; allowed are a DriftingWater, a LearnedWays, or both")
    return SlowErrors(next(iter(bands), None), next(iter(ways), None), vehicles, nodes)


def _lists(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: np.asarray(value).tolist() for name, value in values.items()}


def _state_of(content: Mapping[str, Any]) -> State:
    return State(**{name: np.array(content[name]) for name in State._fields})


def _events(rows: Sequence[Any]) -> list[Event]:
    return [
        Event(time, Kind(kind), tuple(members), tuple(values))
        for time, kind, members, values in rows
    ]


def _check_time(what: str, time: float) -> None:
    if not (is_number(time) and abs(time) <= _LATEST):  # nor does NaN
        raise OnlineError(
            f"{what}: time is {time}; it must be a finite number of seconds, at most {_LATEST:g}"
        )


def _sized(what: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """
    Finite values that are not too large: the squares of larger ones leave no digits of a
    covariance, or overflow.
    """
    array = checked_array(OnlineError, what, values, shape)
    largest = float(np.abs(array).max(initial=0.0))
    if largest > LARGEST:
        raise OnlineError(f"{what}: {largest:g}; allowed are magnitudes up to {LARGEST:g}")
    return array


def _sigmas(what: str, sigma: ArrayLike, size: int, *, zero: bool = False) -> Array:
    """Standard deviations, one or one each; zero is allowed on request."""
    several = isinstance(sigma, list | tuple) or np.ndim(sigma) > 0
    values = _sized(what, sigma if several else np.full(size, sigma), (size,))
    if (values < 0.0).any() or (not zero and (values == 0.0).any()):
        raise OnlineError(
            f"{what} is {values.min():g}; it must be {'zero or ' if zero else ''}positive"
        )
    return values
