"""Time-varying local ocean: snapshots on one grid with linear interpolation between instants."""

from collections.abc import Iterable
from itertools import chain

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import StudyError

VARYING = ("sound_speed", "current_north", "current_east")
"""Variables that vary; the sea floor and all others are from the first snapshot."""


def series_of(snapshots: Iterable[xr.Dataset], time: Array) -> xr.Dataset:
    """Join local snapshots at instants [s]; only one snapshot is in memory at a time."""
    remaining = iter(snapshots)
    first = next(remaining)
    fields = {name: np.empty((time.size, *first[name].shape)) for name in VARYING}
    for k, snapshot in enumerate(chain([first], remaining)):
        if not all(
            np.array_equal(snapshot[name], first[name]) for name in ("north", "east", "depth")
        ):
            raise StudyError(
                f"ocean: the local grids at {first.attrs['time']} and {snapshot.attrs['time']}"
                " differ; a time-varying ocean needs one grid"
            )
        for name, values in fields.items():
            values[k] = snapshot[name].values
    return first.assign(
        {
            name: (("time", *first[name].dims), values, first[name].attrs)
            for name, values in fields.items()
        }
    ).assign_coords(
        time=("time", time, {"long_name": "time since the start of the mission", "units": "s"})
    )


def snapshot_at(series: xr.Dataset, time: float) -> xr.Dataset:
    """Snapshot at a time [s], linear between the instants of a series and exact at them."""
    instants = series["time"].values
    if not instants[0] <= time <= instants[-1]:
        raise StudyError(
            f"ocean: no water at {time:g} s; it covers {instants[0]:g} to {instants[-1]:g} s after"
            " the mission's start"
        )
    after = int(np.searchsorted(instants, time))
    if instants[after] == time:
        return series.isel(time=after, drop=True)
    before = after - 1
    share = (time - instants[before]) / (instants[after] - instants[before])
    still = series.isel(time=before, drop=True)
    fields = {name: series[name].values for name in VARYING}
    return still.assign(
        {
            name: (still[name].dims, v[before] + share * (v[after] - v[before]), still[name].attrs)
            for name, v in fields.items()
        }
    )
