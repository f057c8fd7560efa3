"""Candidates of each event: arrivals of all draws of rough ice, merged by bounces and time."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.arrays import Array

MERGED = 1e-3
"""Arrivals of one candidate differ by less than this in time. [s]"""
GRADIENT = ("by_range", "by_first_depth", "by_second_depth")
"""
Derivatives of the travel time by horizontal range and by the depths of both nodes of a pair, in
alphabetical order. [s/m]
"""


class DrawnArrivals(NamedTuple):
    """Arrivals of several events in all draws, one row each."""

    event: NDArray[np.int64]
    draw: NDArray[np.int64]
    time: Array
    loss_db: Array
    surface_bounces: NDArray[np.int64]
    bottom_bounces: NDArray[np.int64]
    gradient: Array
    """(n, 3), see `GRADIENT`. [s/m]"""

    def at(self, rows: NDArray[np.bool_]) -> "DrawnArrivals":
        """Some of the arrivals."""
        columns: list[Any] = [column[rows] for column in self]
        return DrawnArrivals(*columns)


def merge_draws(arrivals: DrawnArrivals, draws: int) -> pd.DataFrame:
    """
    Merge the arrivals of all draws into candidates.

    Parameters
    ----------
    arrivals : DrawnArrivals
    draws : int
        Number of draws.

    Returns
    -------
    pandas.DataFrame
        One row per candidate, by event and time: ``event``, mean ``travel_time_s``, ``loss_db``,
        bounces, ``share`` of the draws that contain it, ``spread_s``, the standard deviation of its
        times over the draws, and the derivatives of `GRADIENT`.

    Notes
    -----
    Arrivals of an event with the same bounces are sorted by time. The earliest begins a candidate,
    which takes all arrivals less than 1 ms later; the next arrival begins the next candidate. The
    loss of a candidate is that of the mean power of the draws that contain it, to which all its
    arrivals in a draw contribute; its time is the mean weighted by power. The result does not
    depend on the order of the arrivals.
    """
    order = np.lexsort(
        (
            arrivals.loss_db,
            arrivals.draw,
            arrivals.time,
            arrivals.bottom_bounces,
            arrivals.surface_bounces,
            arrivals.event,
        )
    )
    event, draw, time, loss, surface, bottom, gradient = (column[order] for column in arrivals)
    first = np.zeros(time.size, dtype=bool)
    start = -np.inf
    before = (-1, -1, -1)
    for i, key in enumerate(zip(event.tolist(), surface.tolist(), bottom.tolist(), strict=True)):
        if key != before or time[i] - start >= MERGED:
            first[i] = True
            start = time[i]
            before = key
    group = np.cumsum(first) - 1
    n = int(group[-1]) + 1 if group.size else 0
    power = 10.0 ** (-0.1 * loss)
    total = np.bincount(group, power, minlength=n)
    in_draws = np.bincount(np.unique(group * draws + draw) // draws, minlength=n)
    mean = np.bincount(group, power * time, minlength=n) / total
    unweighted_mean = np.bincount(group, time, minlength=n) / np.bincount(group, minlength=n)
    variance = np.bincount(group, (time - unweighted_mean[group]) ** 2, minlength=n) / np.bincount(
        group, minlength=n
    )
    columns = {
        "event": event[first],
        "travel_time_s": mean,
        "loss_db": -10.0 * np.log10(total / np.maximum(in_draws, 1)),
        "surface_bounces": surface[first],
        "bottom_bounces": bottom[first],
        "share": in_draws / draws,
        "spread_s": np.sqrt(variance),
    }
    for name, derivative in zip(GRADIENT, gradient.T, strict=True):
        columns[name] = np.bincount(group, power * derivative, minlength=n) / total
    table = pd.DataFrame(columns)
    return table.sort_values(["event", "travel_time_s"], kind="stable", ignore_index=True)
