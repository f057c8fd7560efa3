"""One door to all oceans: files or the name of a synthetic region."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.assemble import ocean_at
from pymantaray.ocean.collection import Collection, Currents
from pymantaray.ocean.grid import GeographicWindow, crop
from pymantaray.ocean.synthetic import EPOCH, synthetic_ocean
from pymantaray.ocean.times import pick

Source = str | Path | Sequence[str | Path]
_SYNTHETIC = "synthetic:"
_P = ParamSpec("_P")
_R = TypeVar("_R")


def one_line(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """
    Make the message of an `OceanError` one line of printable text, whatever names a file holds.

    Parameters
    ----------
    function : callable

    Returns
    -------
    callable
    """

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return function(*args, **kwargs)
        except OceanError as error:
            line = "".join(c if c.isprintable() else "?" for c in " ".join(str(error).split()))
            raise OceanError(line if len(line) <= 600 else f"{line[:600]} ...") from None

    return checked


@one_line
def open_ocean(
    source: Source,
    *,
    time: str | np.datetime64 | None = None,
    window: GeographicWindow | None = None,
    currents: Currents = "required",
) -> xr.Dataset:
    """
    Open an ocean and check it.

    Parameters
    ----------
    source : str, Path or sequence of them
        A NetCDF file or zarr folder with HYCOM's variables or CF standard names, several that belong
        together, or ``"synthetic:beaufort"`` or ``"synthetic:fram"``. What `write_netcdf` wrote of a valid
        ocean comes back unchanged.
    time : str or numpy.datetime64, optional
        Instant (UTC). For files by default their only time; for synthetic oceans 15 July 2014, 12 h.
    window : tuple of float, optional
        South, north, west, east: only grid points inside are read. West may be the greater, across the
        antimeridian. By default everything. [degrees]
    currents : {"required", "rest"}
        Whether a data set without currents is refused, or taken with zero ones.

    Returns
    -------
    xarray.Dataset
        Valid in the sense of `pymantaray.ocean.schema.validate_ocean`; ``attrs["synthetic"]`` says
        whether it is made up, ``attrs["history"]`` what was converted, a line each.

    Raises
    ------
    OceanError
        If the source cannot be opened or is not a valid ocean.

    Examples
    --------
    >>> ocean = open_ocean("synthetic:fram", window=(77.5, 78.5, -2.0, 2.0))
    >>> dict(ocean.sizes)
    {'depth': 40, 'lat': 25, 'lon': 51}
    """
    sources = listed(source)
    region = region_of(sources)
    if region is not None:
        return crop(synthetic_ocean(region, EPOCH if time is None else time), window)
    with Collection(sources, window) as collection:
        collection.needed(currents)
        return ocean_at(collection, pick(collection.times(), time, collection.names), currents)


@one_line
def ocean_times(source: Source) -> NDArray[np.datetime64]:
    """
    Instants at which a source has an ocean.

    Parameters
    ----------
    source : str, Path or sequence of them
        As in `open_ocean`.

    Returns
    -------
    ndarray of datetime64[ns], shape (time,)
        Rising; those at which temperature and salinity are there, and currents where the source has any.
        Synthetic oceans exist at all times: their epoch.

    Raises
    ------
    OceanError
        If the source cannot be opened.
    """
    sources = listed(source)
    if region_of(sources) is not None:
        return np.array([EPOCH], dtype="datetime64[ns]")
    with Collection(sources) as collection:
        return collection.whole_times("rest")


def listed(source: Source) -> list[str | Path]:
    """
    Sources as a list.

    Parameters
    ----------
    source : str, Path or sequence of them

    Returns
    -------
    list of str or Path
    """
    return [source] if isinstance(source, str | Path) else list(source)


def region_of(sources: Sequence[str | Path]) -> str | None:
    """
    Name of the synthetic region, if the source is one.

    Parameters
    ----------
    sources : sequence of str or Path

    Returns
    -------
    str or None

    Raises
    ------
    OceanError
        If it is given together with other sources.
    """
    made_up = [str(s) for s in sources if str(s).startswith(_SYNTHETIC)]
    if not made_up:
        return None
    if len(sources) > 1:
        raise OceanError(f"ocean: {made_up[0]} cannot be combined with other sources; give it alone")
    return made_up[0].removeprefix(_SYNTHETIC)
