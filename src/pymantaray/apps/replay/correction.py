"""Events without the clock errors and the wrong positions that a replay of them found."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pymantaray.apps.replay.clocks import clock_errors
from pymantaray.apps.replay.compare import Replay
from pymantaray.apps.replay.events import Events
from pymantaray.arrays import Array
from pymantaray.geometry.frames import ellipsoid


def correct_events(events: Events, replay: Replay) -> Events:
    """
    Remove the clock errors and the wrong positions that a replay found.

    Parameters
    ----------
    events : Events
        Events of the same nodes, of any time: a replay of some hours may correct others.
    replay : Replay
        Its ``clocks`` (with drifts if ``clock_drift`` is set) and the offsets of its suspect
        ``nodes`` are used. Clocks that are unknown and nodes that are not suspect stay as they are.

    Returns
    -------
    Events

    Examples
    --------
    Continues the example of `pymantaray.apps.replay`:

    >>> from pymantaray.apps.replay import correct_events
    >>> print(replay.clocks[["node", "offset_s"]].round(4))
      node  offset_s
    0    A    -0.001
    1    B     0.001
    >>> print(correct_events(events, replay).travel_time.round(4))
    [1.031 1.031 1.031 1.031 1.031 1.031]
    """
    ends = {"source": events.source, "receiver": events.receiver, "time_s": events.time}
    clocks = replay.clocks
    values = [name for name in ("offset_s", "drift") if name in clocks]
    clocks = clocks.assign(**{name: clocks[name].fillna(0.0) for name in values})
    wrong = clock_errors(pd.DataFrame(ends), clocks)
    changes: dict[str, Any] = {"travel_time": events.travel_time - np.nan_to_num(wrong)}
    suspect = replay.nodes[replay.nodes["suspect"]]
    offsets = suspect[["node", "north_m", "east_m"]].to_numpy()
    for end in ("source", "receiver"):
        name = getattr(events, end)
        position = getattr(events, f"{end}_position").copy()
        for node, north, east in offsets.tolist():
            rows = name == node
            position[rows] = _translate(position[rows], north, east, events.geographic)
        changes[f"{end}_position"] = position
    return replace(events, **changes)


def _translate(position: Array, north: float, east: float, geographic: bool) -> Array:
    """Positions that are moved horizontally. [m]"""
    if not geographic:
        return np.asarray(position + np.array([north, east, 0.0]))
    azimuth = np.degrees(np.arctan2(east, north))
    distance = np.hypot(north, east)
    n = len(position)
    lon, lat, _ = ellipsoid().fwd(
        position[:, 1], position[:, 0], np.full(n, azimuth), np.full(n, distance)
    )
    return np.stack([lat, lon, position[:, 2]], axis=-1)
