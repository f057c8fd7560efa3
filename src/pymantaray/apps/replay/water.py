"""Water and time of each event, and its ends in the frame of the water."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.replay.events import Events
from pymantaray.arrays import Array
from pymantaray.errors import ReplayError
from pymantaray.geometry import EarthSphere, LocalFrame
from pymantaray.geometry.frames import ELLIPSOID
from pymantaray.sensing.water import Water


def choose_water(events: Events, waters: Sequence[Water]) -> NDArray[np.int64]:
    """
    Index of the water of each event: the only one, the one with its name, or the nearest in time.
    """
    names = [water.name for water in waters]
    if not names:
        raise ReplayError("replay: there is no water; add a cast or an ocean")
    named = events.cast != ""
    unknown = sorted(set(events.cast[named]) - set(names))
    if unknown:
        raise ReplayError(
            f"events: cast {unknown[0]} is unknown; allowed are {', '.join(names[:8])}"
            + (", ..." if len(names) > 8 else "")
        )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ReplayError(f"two casts are called {twice}; rename one")
    if len(waters) == 1:
        return np.zeros(events.time.size, dtype=np.int64)
    chosen = np.full(events.time.size, -1)
    chosen[named] = [names.index(name) for name in events.cast[named]]
    if not named.all():
        nameless = next((w.name for w in waters if np.isnat(w.time)), None)
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
        apart = np.abs(events.instant[~named][:, None] - times[None, :])
        chosen[~named] = np.argmin(apart, axis=1)
    return chosen


def instants_in(events: Events, rows: NDArray[np.int64], water: Water, interval: float) -> Array:
    """
    Time of the water of each of some events [s]: the nearest multiple of an interval within the
    water's span.

    Zero if the water does not vary.
    """
    if not water.varies:
        return np.zeros(rows.size)
    if np.isnat(events.epoch):
        raise ReplayError(
            "the events' times are seconds, but the water varies; write times as"
            " 2020-03-10T12:00:00"
        )
    since = (events.instant[rows] - np.datetime64(water.start, "ns")) / np.timedelta64(1, "s")
    for time in since:
        water.require(float(time))
    return np.clip(np.round(since / interval) * interval, *water.span)


def ends_of(
    events: Events, rows: NDArray[np.int64], water: Water, earth: EarthSphere | None = None
) -> tuple[Array, Array]:
    """
    Sources and receivers (n, 3) of some events in the frame of their water, on a sphere or, for
    None, a flat Earth. [m]
    """
    source = events.source_position[rows]
    receiver = events.receiver_position[rows]
    if not events.geographic:
        return source, receiver
    if water.frame is not None and not water.uniform:
        return _in_frame(source, water.frame), _in_frame(receiver, water.frame)
    azimuth, _, distance = ELLIPSOID.inv(source[:, 1], source[:, 0], receiver[:, 1], receiver[:, 0])
    bearing = np.radians(azimuth)
    distance = distance if earth is None else earth.frame_distance(distance)
    along = np.stack(
        [distance * np.cos(bearing), distance * np.sin(bearing), receiver[:, 2]], axis=-1
    )
    return np.stack([0.0 * distance, 0.0 * distance, source[:, 2]], axis=-1), along


def _in_frame(position: Array, frame: LocalFrame) -> Array:
    return np.stack([*frame.to_local(position[:, 0], position[:, 1]), position[:, 2]], axis=-1)
