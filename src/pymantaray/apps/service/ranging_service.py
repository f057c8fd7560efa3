"""
Ranges in a simulator's loop: a service that answers ping by ping, in the calling thread or in
worker processes, and the facts of its water.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymantaray.acoustics import Currents, Medium
from pymantaray.acoustics.solving import as_positions
from pymantaray.arrays import Array
from pymantaray.config import StudyConfig
from pymantaray.config.door.fleet import with_tracks
from pymantaray.config.door.water import Source, configuration_of, open_water
from pymantaray.errors import ServiceError
from pymantaray.jobs.processes import WorkerEndedError, Workers
from pymantaray.quantities.checks import check_number
from pymantaray.records import Arrivals, RayStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing import ReceptionOptions, Receptions, Timing, TwoWay, find_receptions
from pymantaray.sensing.exchanges import exchange_times, exchange_values, selected_exchanges
from pymantaray.sensing.water import Water

ArgumentT = TypeVar("ArgumentT")
ResultT = TypeVar("ResultT")
_INSTANTS = 4  # number of waters in memory; that of a basin takes 15 MB


def _water(ocean: Source | Water, options: dict[str, Any]) -> Water:
    """Water of any source; for a study, the frame is centred as its vehicles require."""
    if isinstance(ocean, Water):
        if options:
            raise ServiceError(f"water takes no options; found {', '.join(options)}")
        return ocean
    if isinstance(ocean, Medium | xr.Dataset):
        return open_water(ocean, **options)
    config = configuration_of(ocean, options)
    return open_water(with_tracks(config) if isinstance(config, StudyConfig) else config)


class RangingService:
    """
    Ranges, ping by ping, for a simulator that moves the vehicles.

    Travel times equal those of a study in the same water to the last digit. Any number of threads
    may use a service; the results do not depend on them. Kernels are compiled when the service is
    built.

    Parameters
    ----------
    ocean : SoundConfig, Water, or any source of `pymantaray.open_water`
        A configuration (`load_sound`, `load_study`) also contains the reception.
    reception : ReceptionOptions, optional
        Replaces the reception of the configuration. By default direct arrivals, all of them
        detected.
    currents : Currents or str, optional
        Replaces the currents of the configuration; or an option of `open_water`. By default the
        water is at rest.
    timing : OneWay or TwoWay, optional
        Replaces the timing of the configuration. By default one-way, with all participants at rest
        during a ping.
    water_interval : float
        If the ocean varies, the water of a ping is that of the last whole multiple of this
        interval. With 0 it is built for each time, which takes 0.2 s for a large ocean. [s]
    workers : int
        Number of worker processes; with 0 the calling thread does the work. Workers help if several
        threads call at the same time.
    **options
        Of `pymantaray.open_water`, such as ``ice=1.5`` and ``max_surface_bounces=2``.

    Raises
    ------
    MantaRayError
        If the ocean cannot be opened or an option is not allowed.

    Examples
    --------
    >>> from pymantaray.acoustics import Medium
    >>> medium = Medium.from_profile([0.0, 500.0], [1450.0, 1458.0], bottom_depth=500.0)
    >>> with RangingService(medium) as service:
    ...     ping = service.ping(60.0, (0.0, 0.0, 50.0), [(1500.0, 0.0, 100.0), (0.0, 900.0, 600.0)])
    >>> ping.status.tolist()
    [0, 3]
    >>> print(f"{ping.arrival_time[0]:.4f} s")
    61.0342 s
    """

    def __init__(
        self,
        ocean: Source | Water,
        *,
        reception: ReceptionOptions | None = None,
        currents: Currents | str | None = None,
        timing: Timing | None = None,
        water_interval: float = 0.0,
        workers: int = 0,
        **options: Any,
    ) -> None:
        check_number(ServiceError, "water_interval", water_interval, "s")
        if workers < 0:
            raise ServiceError(f"workers is {workers}; allowed are 0 and more")
        given: dict[str, Any] = {"reception": reception, "timing": timing}
        if isinstance(currents, str):
            options["currents"] = currents
        else:
            given["currents"] = currents
        parts = {name: value for name, value in given.items() if value is not None}
        self.water = replace(_water(ocean, options), **parts)
        self._pinger = Pinger(self.water, water_interval)
        self._workers: Workers | None = None
        with ExitStack() as running:
            if workers:
                one_thread = replace(self.water, reception=self.water.reception._replace(threads=1))
                start = partial(_Worker, one_thread, water_interval)
                self._workers = running.enter_context(Workers(start, workers))
                first = [
                    self._workers.submit((_ping, self._pinger.down_the_deepest()))
                    for _ in range(workers)
                ]
                for ping in first:  # one for each process, which builds what it needs with it
                    ping.result()
            self._running = running.pop_all()

    def __enter__(self) -> Self:
        """Use the service in a block; its processes end with the block."""
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the worker processes; otherwise they end with this process."""
        self._running.close()

    def ping(
        self,
        time: float,
        source: ArrayLike,
        receivers: ArrayLike,
        *,
        source_velocity: ArrayLike | None = None,
        receiver_velocities: ArrayLike | None = None,
        geographic: bool = False,
    ) -> Ping:
        """
        Return the outcome of a ping at all receivers.

        Parameters
        ----------
        time : float
            Time of the ping, since the start of the ocean if it varies. [s]
        source : array_like, shape (3,)
            North, east, down [m], or latitude, longitude [degrees], down [m].
        receivers : array_like, shape (n, 3)
            Positions in the same coordinates.
        source_velocity : array_like, shape (3,), optional
            North, east, down; for two-way timing only. By default the source is at rest. [m/s]
        receiver_velocities : array_like, shape (n, 3), optional
            North, east, down; for two-way timing only. By default receivers are at rest. [m/s]
        geographic : bool
            True if positions are latitudes and longitudes; velocities are then along true north and
            east.

        Returns
        -------
        Ping
            One row per receiver. The status says if a receiver is outside the water, in a shadow or
            behind the sea floor.

        Raises
        ------
        ServiceError
            If there is no water at that time, the source is beyond the horizontal extent of the
            ocean, or there is a velocity with one-way timing.
        AcousticsError
            If positions or velocities are not finite or have another shape.
        """
        if not math.isfinite(time):
            raise ServiceError(f"time is {time}; it must be a finite number of seconds")
        still = source_velocity is None and receiver_velocities is None
        if not still and not isinstance(self.water.timing, TwoWay):
            raise ServiceError(
                "velocity: one-way timing assumes that the fleet is at rest during a ping; leave"
                " out velocities or choose two-way timing"
            )
        places, velocities = self._local(
            _rows("source", source), source_velocity, "source_velocity", geographic
        )
        if len(places) != 1:
            raise ServiceError(f"source: {len(places)} positions; a ping has one source")
        require_place(self.water.at_start[0], "source", places[0])
        participants = Participants(
            float(time),
            places[0],
            *self._local(
                _rows("receivers", receivers),
                receiver_velocities,
                "receiver_velocities",
                geographic,
            ),
            velocities[0],
        )
        return self.call(_ping, participants)

    def call(
        self, function: Callable[[RangingService, ArgumentT], ResultT], argument: ArgumentT
    ) -> ResultT:
        """
        Return ``function(service, argument)``, computed in a worker process if the service has
        some.

        It is repeated once if a worker ends meanwhile, because another replaces it.

        Parameters
        ----------
        function : callable
            Function of a module, with this service or, in a worker, an equal one.
        argument : object
            Any object that can be pickled, as must be the result.

        Returns
        -------
        object
        """
        if self._workers is None:
            return function(self, argument)
        result: ResultT
        try:
            result = self._workers.call((function, argument))
        except WorkerEndedError:
            result = self._workers.call((function, argument))
        return result

    def _local(
        self, places: Array, velocity: ArrayLike | None, name: str, geographic: bool
    ) -> tuple[Array, Array]:
        """
        Positions and velocities in the local frame, both (n, 3); without velocities all are at
        rest.
        """
        along = np.zeros_like(places) if velocity is None else _rows(name, velocity)
        if along.shape != places.shape:
            raise ServiceError(
                f"{name}: {len(along)} velocities for {len(places)} positions; each needs one"
            )
        return self.water.to_local(places, along) if geographic else (places, along)


def _ping(service: RangingService, participants: Participants) -> Ping:
    return service._pinger(participants)


class _Worker:
    """Service of a worker process; a message is a function and its argument."""

    def __init__(self, water: Water, water_interval: float) -> None:
        self._service = RangingService(water, water_interval=water_interval)

    def __call__(self, message: tuple[Callable[[RangingService, Any], Any], Any]) -> Any:
        function, argument = message
        return function(self._service, argument)


def _rows(name: str, values: ArrayLike) -> Array:
    """Positions or velocities (n, 3); an empty list has none."""
    rows = np.asarray(values, dtype=float)
    return as_positions(name, rows.reshape(0, 3) if rows.size == 0 else rows)


def require_place(medium: Medium, name: str, place: Array) -> None:
    """
    Refuse a position beyond the horizontal extent, which is an error of the request and no outcome
    of a ping. [m]
    """
    for k, along in enumerate(("north", "east")):
        axis = getattr(medium, along)
        if axis.size > 1 and not axis[0] <= place[k] <= axis[-1]:
            raise ServiceError(
                f"{name}: {along} {place[k]:.6g} m is outside the ocean, which reaches from"
                f" {axis[0]:.6g} to {axis[-1]:.6g} m; move it or take a larger ocean"
            )


def facts(water: Water) -> dict[str, Any]:
    """Facts to know before the first ping, as JSON takes them."""
    medium = water.at_start[0]
    detector = water.reception.detector
    timing = water.timing
    out: dict[str, Any] = {
        name: _ends(axis) if axis.size > 1 else None
        for name, axis in (("north", medium.north), ("east", medium.east))
    }
    out["sea_floor_depth"] = _ends(medium.bed.depth)
    out["sound_speed"] = _ends(_in_water(medium))
    out["start"] = water.start
    out["time"] = [float(t) for t in water.span] if water.varies else None
    for name in ("title", "source", "centre_latitude_deg", "centre_longitude_deg"):
        out[name] = None if water.local is None else water.local.attrs.get(name)
    out["arrival"] = water.reception.arrival
    out["max_surface_bounces"] = water.reception.max_surface_bounces
    out["max_bottom_bounces"] = water.reception.max_bottom_bounces
    out["currents"] = water.currents is not None
    out["timing"] = "two-way" if isinstance(timing, TwoWay) else "one-way"
    out["turn_around"] = timing.turn_around if isinstance(timing, TwoWay) else None
    out["source_level_db"] = None if detector is None else detector.sonar.source_level_db
    out["noise_level_db"] = None if detector is None else detector.sonar.noise_level_db
    return out


def _in_water(medium: Medium) -> Array:
    """
    Sound speeds at grid points in the water, and at the sea bed and the surface below and above
    them. [m/s]
    """
    north, east = (x.ravel() for x in np.meshgrid(medium.north, medium.east, indexing="ij"))
    columns = np.stack([north, east], axis=-1)
    top, bed = (
        depth[:, None] for depth in (medium.surface_depth(columns), medium.bottom_depth(columns))
    )
    speed = medium.sound_speed.reshape(len(columns), -1)
    ends = [
        medium.sound_speed_at(np.column_stack([columns, depth]))
        for depth in (top, np.minimum(bed, medium.depth[-1]))
    ]
    inside = speed[(medium.depth >= top) & (medium.depth <= bed)]
    return np.concatenate([inside, *(values[np.isfinite(values)] for values in ends)])


def _ends(values: Array) -> list[float]:
    """Smallest and largest value."""
    return [float(values.min()), float(values.max())]


class Participants(NamedTuple):
    """Positions and velocities of the participants of a ping, in the local frame."""

    time: float
    source: Array
    """Shape (3,). [m]"""
    receivers: Array
    """Shape (n, 3). [m]"""
    receiver_velocities: Array
    """Shape (n, 3). [m/s]"""
    source_velocity: Array
    """Shape (3,). [m/s]"""


@dataclass(frozen=True, eq=False)
class Ping(Record):
    """
    Outcome of a ping, one row per receiver; without noise, NaN without an arrival.

    Attributes
    ----------
    arrivals : Arrivals
        All eigenrays to the receivers; ``link`` is the receiver's row. Their travel times are those
        in water at rest.
    receptions : Receptions
        All receptions of the ping, and of the answers in the other direction; ``link`` is the
        receiver's row. Their travel times include the current.

    Examples
    --------
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.service import RangingService
    >>> medium = Medium.from_profile([0.0, 500.0], [1450.0, 1458.0], bottom_depth=500.0)
    >>> with RangingService(medium) as service:
    ...     ping = service.ping(0.0, (0.0, 0.0, 50.0), [(1500.0, 0.0, 100.0)])
    >>> print(ping.travel_time.round(4), ping.refracted_range.round(1))
    [1.0342] [1500.4]
    """

    kind: ClassVar[str] = "ping"

    arrivals: Arrivals
    receptions: Receptions
    status: Column = column("receiver", "1", "outcome of the ping", "i1", flags=RayStatus)
    travel_time: Column = column(
        "receiver", "s", "travel time of the selected arrival, two-way half of the round trip"
    )
    arrival_time: Column = column(
        "receiver",
        "s",
        "time at which the receiver detects the ping, two-way the source the answer",
    )
    refracted_range: Column = column(
        "receiver", "m", "travel time times the sound speed at the source"
    )
    straight_range: Column = column("receiver", "m", "distance between both ends at the ping")
    source_sound_speed: Column = column("receiver", "m s-1", "sound speed at the source")
    chord_travel_time: Column = column("receiver", "s", "travel time along the straight chord")
    level_db: Column = column(
        "receiver", "1", "received level in the band, in dB re 1 uPa, of the selected arrival"
    )
    probability: Column = column(
        "receiver", "1", "probability of detection, two-way of the ping and the answer"
    )


class Pinger:
    """
    Pings through one water, in one process and by any number of threads.

    If the ocean varies, the water of a ping is that of the last whole multiple of an interval; with
    0 that of its own time. [s]
    """

    def __init__(self, water: Water, interval: float = 0.0) -> None:
        self._water = water
        self._interval = interval
        self._at = lru_cache(_INSTANTS)(water.at)
        self(self.down_the_deepest())  # compiles the kernels

    def __call__(self, participants: Participants) -> Ping:
        """Return the outcome of a ping."""
        water = self._water
        receivers = participants.receivers
        n = len(receivers)
        source, velocity = (
            np.repeat(x[None], n, axis=0)
            for x in (participants.source, participants.source_velocity)
        )
        medium, currents = self._at(self._instant(participants.time))
        sound = find_receptions(source, receivers, medium, water.reception, currents=currents)
        exchanges = selected_exchanges(
            sound.receptions, n, np.arange(n), np.zeros(n, dtype=np.int64)
        )
        time = exchange_times(
            sound.receptions, exchanges, water.timing, (velocity, participants.receiver_velocities)
        )
        arrival_time = participants.time + time
        if isinstance(water.timing, TwoWay):
            arrival_time = participants.time + 2.0 * time + water.timing.turn_around
        level = probability = np.full(n, np.nan)
        if water.reception.detector is not None:
            level = water.reception.detector.sonar.source_level_db - sound.selected("loss_db")[0]
            chances = exchange_values(sound.receptions.probability, exchanges, water.timing)
            probability = np.prod(chances, axis=0)
        speed = sound.arrivals.source_sound_speed
        return Ping(
            status=sound.status,
            travel_time=time,
            arrival_time=arrival_time,
            refracted_range=speed * time,
            straight_range=medium.straight_distance(source, receivers),
            source_sound_speed=speed,
            chord_travel_time=sound.arrivals.chord_travel_time,
            level_db=level,
            probability=probability,
            arrivals=sound.arrivals,
            receptions=sound.receptions,
        )

    def _instant(self, time: float) -> float:
        """Time of the water of a ping; always 0 if the water does not vary."""
        if not self._water.varies:
            return 0.0
        self._water.require(time)
        return max(time - time % self._interval, self._water.span[0]) if self._interval else time

    def down_the_deepest(self) -> Participants:
        """Participants of a ping straight down in the deepest water, which always arrives."""
        time = max(self._water.span[0], 0.0)
        medium, _ = self._at(self._instant(time))
        ends = _deepest(medium)
        return Participants(time, ends[0], ends[1:], np.zeros((1, 3)), np.zeros(3))


def _deepest(medium: Medium) -> Array:
    """Two positions (2, 3), one above the other, in the deepest water. [m]"""
    row, col = np.unravel_index(np.argmax(medium.bed.depth), medium.bed.depth.shape)
    north, east = (
        np.clip(bed[k], axis[0], axis[-1]) if axis.size > 1 else 0.0
        for bed, k, axis in (
            (medium.bed.north, row, medium.north),
            (medium.bed.east, col, medium.east),
        )
    )
    top = medium.surface_depth((north, east))[0]
    bed = medium.bottom_depth((north, east))[0]
    return np.array([[north, east, top + share * (bed - top)] for share in (0.25, 0.75)])
