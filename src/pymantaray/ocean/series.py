"""Oceans at the instants of a source that enclose a span of time."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.assemble import ocean_at
from pymantaray.ocean.collection import Collection, Currents
from pymantaray.ocean.grid import GeographicWindow, crop
from pymantaray.ocean.schema import parse_instant
from pymantaray.ocean.source import Source, listed, one_line, region_of
from pymantaray.ocean.synthetic import synthetic_ocean
from pymantaray.ocean.times import listing

_SYNTHETIC_STEP = np.timedelta64(3, "h")  # HYCOM's


@one_line
def open_ocean_series(
    source: Source,
    start: str | np.datetime64,
    stop: str | np.datetime64,
    *,
    window: GeographicWindow | None = None,
    currents: Currents = "required",
) -> tuple[xr.Dataset, ...]:
    """
    Open the oceans at a source's own instants that enclose a span of time.

    Parameters
    ----------
    source : str, Path or sequence of them
        As in `open_ocean`. Synthetic oceans are given every 3 h.
    start, stop : str or numpy.datetime64
        The span (UTC).
    window : tuple of float, optional
        South, north, west, east; only grid points inside are read. [degrees]
    currents : {"required", "rest"}

    Returns
    -------
    tuple of xarray.Dataset
        Valid oceans on one grid, times rising: the last at or before the start, the first at or after the
        stop, and all between.

    Raises
    ------
    OceanError
        If the source does not cover the span, or its grid changes.
    """
    first, last = parse_instant(start), parse_instant(stop)
    if last < first:
        raise OceanError(f"ocean: span from {start} to {stop} runs backward; exchange them")
    sources = listed(source)
    region = region_of(sources)
    if region is not None:
        step = _SYNTHETIC_STEP
        origin = first.astype("datetime64[D]").astype("datetime64[ns]")
        begin = origin + (first - origin) // step * step
        times = np.arange(begin, last + step, step)
        return tuple(crop(synthetic_ocean(region, t), window) for t in enclosing(times, first, last, region))
    with Collection(sources, window) as collection:
        chosen = enclosing(collection.whole_times(currents), first, last, collection.names)
        oceans = tuple(ocean_at(collection, np.datetime64(t), currents) for t in chosen)
        for ocean in oceans[1:]:
            for name in ("depth", "lat", "lon"):
                if not np.array_equal(ocean[name], oceans[0][name]):
                    raise OceanError(
                        f"{collection.names}: {name} at {ocean['time'].values} differs from that at"
                        f" {oceans[0]['time'].values}; a series needs one grid"
                    )
        return oceans


def enclosing(
    times: NDArray[np.datetime64], start: np.datetime64, stop: np.datetime64, names: str
) -> NDArray[np.datetime64]:
    """
    Instants that enclose a span.

    Parameters
    ----------
    times : ndarray of datetime64, shape (time,)
        Rising.
    start, stop : numpy.datetime64
    names : str
        Of the files, for the message.

    Returns
    -------
    ndarray of datetime64, shape (n,)

    Raises
    ------
    OceanError
        If there is none before, or none after.
    """
    low = int(np.searchsorted(times, start, side="right")) - 1
    high = int(np.searchsorted(times, stop, side="left"))
    if low < 0 or high >= len(times):
        there = f"there is {listing(times)}" if len(times) else "no time has everything"
        raise OceanError(
            f"{names}: does not cover {np.datetime_as_string(start, unit='m')} to"
            f" {np.datetime_as_string(stop, unit='m')}; {there}"
        )
    return times[low : high + 1]
