"""Water and time of each event, and its ends in the frame of the water."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.replay.events import Events
from pymantaray.arrays import Array
from pymantaray.errors import ReplayError
from pymantaray.geometry import EarthSphere, LocalFrame
from pymantaray.geometry.frames import ellipsoid
from pymantaray.records.dates import seconds_since
from pymantaray.sensing.water import Water

_MAX_NAMES = 8  # in a message
ASIDE = 0.1
"""Horizontal distance between the ends of an echo, whose rays then have directions. [m]"""


def choose_water(events: Events, waters: Sequence[Water]) -> NDArray[np.int64]:
    """Index of the water of each event: the only one, the one it names, or the nearest in time."""
    names = [water.name for water in waters]
    if not names:
        raise ReplayError("replay: there is no water; add a cast or an ocean")
    has_name = events.cast != ""
    unknown = sorted(set(events.cast[has_name]) - set(names))
    if unknown:
        raise ReplayError(
            f"events: cast {unknown[0]} is unknown; allowed are {', '.join(names[:_MAX_NAMES])}"
            + (", ..." if len(names) > _MAX_NAMES else "")
        )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ReplayError(f"two casts are called {twice}; rename one")
    if len(waters) == 1:
        return np.zeros(events.time.size, dtype=np.int64)
    index = np.full(events.time.size, -1)
    index[has_name] = [names.index(name) for name in events.cast[has_name]]
    if not has_name.all():
        nameless = next((water.name for water in waters if np.isnat(water.time)), None)
        if nameless is not None or np.isnat(events.epoch):
            lacks = (
                "the events' times are seconds"
                if nameless is None
                else f"cast {nameless} has no time"
            )
            raise ReplayError(
                f"events without a cast use the nearest in time, but {lacks}; add a column cast"
                " with the name of each event's cast"
            )
        times = np.array([water.time for water in waters], dtype="datetime64[ns]")
        gap = np.abs(events.instant[~has_name][:, None] - times[None, :])
        index[~has_name] = np.argmin(gap, axis=1)
    return index


def instants_in(events: Events, rows: NDArray[np.int64], water: Water, interval: float) -> Array:
    """
    Time of the water of each event: the nearest multiple of an interval in its span. [s]

    Zero if the water does not vary.
    """
    if not water.varies:
        return np.zeros(rows.size)
    if np.isnat(events.epoch):
        raise ReplayError(
            "the events' times are seconds, but the water varies; write times as"
            " 2020-03-10T12:00:00"
        )
    since = seconds_since(events.instant[rows], np.datetime64(water.start, "ns"))
    for time in since:
        water.require(float(time))
    return np.clip(np.round(since / interval) * interval, *water.span)


def ends_of(
    events: Events, rows: NDArray[np.int64], water: Water, earth: EarthSphere | None = None
) -> tuple[Array, Array]:
    """
    Sources and receivers (n, 3) of some events in the frame of their water. [m]

    The Earth is a sphere or, for None, flat. The receiver of an echo is 0.1 m north of the source.
    """
    source, receiver = _ends_in_frame(events, rows, water, earth)
    is_echo = events.is_echo[rows, None]
    return source, np.where(is_echo, source + np.array([ASIDE, 0.0, 0.0]), receiver)


def _ends_in_frame(
    events: Events, rows: NDArray[np.int64], water: Water, earth: EarthSphere | None
) -> tuple[Array, Array]:
    source = events.source_position[rows]
    receiver = events.receiver_position[rows]
    if not events.geographic:
        return source, receiver
    if water.frame is not None and not water.uniform:
        return _in_frame(source, water.frame), _in_frame(receiver, water.frame)
    azimuth, _, distance = ellipsoid().inv(
        source[:, 1], source[:, 0], receiver[:, 1], receiver[:, 0]
    )
    bearing = np.radians(azimuth)
    distance = distance if earth is None else earth.frame_distance(distance)
    along = np.stack(
        [distance * np.cos(bearing), distance * np.sin(bearing), receiver[:, 2]], axis=-1
    )
    return np.stack([0.0 * distance, 0.0 * distance, source[:, 2]], axis=-1), along


def _in_frame(position: Array, frame: LocalFrame) -> Array:
    return np.stack([*frame.to_local(position[:, 0], position[:, 1]), position[:, 2]], axis=-1)


def water_of_echoes(water: Water, time: float) -> Water:
    """
    Water for echoes of an instrument at a time [s].

    The spreading of an echo is not compared with that of the straight path, and boundaries are
    smooth where the sound is vertical.
    """
    reception = water.reception
    if reception.max_surface_bounces + reception.max_bottom_bounces == 0:
        raise ReplayError(
            "events from a node to itself are echoes, but no reflections are allowed; set"
            " `max_surface_bounces` or `max_bottom_bounces` to 1"
        )
    medium, _ = water.at(time)
    smooth = replace(medium, surface=medium.surface.with_roughness(None))
    return replace(
        water, medium=smooth, reception=reception._replace(spreading_cutoff_db=None, leakage=None)
    )
