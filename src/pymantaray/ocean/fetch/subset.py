"""A window of one step from THREDDS' NetCDF Subset Service, one variable a request."""

import math
import tempfile
from pathlib import Path
from urllib.parse import quote, urlencode

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.answers import decode_times, unpack
from pymantaray.ocean.fetch.kept import Array, Source, WindowFields
from pymantaray.ocean.fetch.messages import place
from pymantaray.ocean.fetch.region import LARGEST_VALUES, Region
from pymantaray.ocean.fetch.transport import ServerError
from pymantaray.ocean.files import numbers, open_file, text

_MARGIN = 0.12  # degrees; more than a step of the widest grid, so that the window can be enclosed
_LARGEST = 512 * 2**20  # bytes of one answer
_AXES = ("depth", "lat", "lon")


def read_window(
    source: Source, urls: dict[str, str], instant: np.datetime64, region: Region, *, seam: float
) -> WindowFields:
    """
    Read the variables of one step on a window.

    Parameters
    ----------
    source : Source
    urls : dict of str to str
        Address of the data set that holds each variable.
    instant : numpy.datetime64
    region : Region
    seam : float
        Where the server's longitudes begin. [degrees]

    Returns
    -------
    WindowFields

    Raises
    ------
    OceanError
        If the service refuses, or sends another time, place or grid than asked for.
    """
    return _read_all(source, urls, instant, region, region.boxes(seam, _MARGIN))


def _read_all(
    source: Source,
    urls: dict[str, str],
    instant: np.datetime64,
    region: Region,
    boxes: list[tuple[float, float]],
) -> WindowFields:
    fields: dict[str, Array] = {}
    axes: dict[str, Array] = {}
    done, total = 0, len(urls) * len(boxes)
    for name, url in urls.items():
        parts = []
        for box in boxes:
            source.report(done, total)
            parts.append(_read_box(source, url, name, instant, region, box))
            done += 1
        try:
            whole = _joined(parts)
            rows, (columns, lon) = (
                region.latitudes(whole["lat"].values),
                region.longitudes(whole["lon"].values),
            )
        except (OceanError, ValueError) as error:
            raise ServerError(f"{place(url)}: {error}") from None
        fields[name] = whole.values[:, rows][:, :, columns]
        found = {"depth": whole["depth"].values, "lat": whole["lat"].values[rows], "lon": lon}
        axes = axes or found
        for axis in _AXES:
            if axes[axis].shape != found[axis].shape or np.max(np.abs(axes[axis] - found[axis])) > 1e-3:
                raise ServerError(f"{place(url)}: {axis} of {name} differs from that of {next(iter(fields))}")
    source.report(total, total)
    return WindowFields(axes["depth"], axes["lat"], axes["lon"], fields)


def _read_box(
    source: Source,
    url: str,
    name: str,
    instant: np.datetime64,
    region: Region,
    box: tuple[float, float],
) -> xr.DataArray:
    time = f"{np.datetime_as_string(instant, unit='s')}Z"
    query = {
        "var": name,
        "north": f"{min(region.north + _MARGIN, 90.0):.4f}",
        "south": f"{max(region.south - _MARGIN, -90.0):.4f}",
        "west": f"{box[0]:.4f}",
        "east": f"{box[1]:.4f}",
        "horizStride": "1",
        "time_start": time,
        "time_end": time,
        "vertCoord": "",
        "accept": "netcdf4",
    }
    address = f"{url}?{urlencode(query, quote_via=quote)}"
    request = {"url": url, "kind": "subset", **query}
    return source.get(address, request, _LARGEST, lambda body: _read_netcdf(body, name, instant))


def _read_netcdf(body: bytes, name: str, instant: np.datetime64) -> xr.DataArray:
    """Values of one variable at one step of a NetCDF file, dimensions (depth, lat, lon)."""
    with tempfile.TemporaryDirectory(prefix="mantaray-") as folder:
        path = Path(folder) / "answer.nc"
        path.write_bytes(body)
        file = open_file(path)
        for needed in (name, "time", *_AXES):
            if needed not in file.variables:
                raise OceanError(f"answer holds no {needed}")
        field = file.variables[name]
        if set(field.dims) - {"time"} != set(_AXES) or math.prod(field.shape) > LARGEST_VALUES:
            sizes = dict(zip(field.dims, field.shape, strict=True))
            raise OceanError(f"{name} has dimensions {sizes}; needs depth, lat, lon of the window")
        times = decode_times(np.atleast_1d(numbers(file, "time")), text(file.variables["time"], "units"))
        steps = np.flatnonzero(np.abs(times - instant) < np.timedelta64(60, "s"))
        if not steps.size:
            raise ServerError(f"no step {np.datetime_as_string(instant, unit='m')} came from the service")
        step = int(steps[0])
        values = numbers(file, name, {"time": slice(step, step + 1)})
        axes = {axis: numbers(file, axis) for axis in _AXES}
    if not all(np.all(np.isfinite(values)) for values in axes.values()):
        raise OceanError("coordinates of the answer are not numbers")
    part = xr.DataArray(
        unpack(name, values, {"standard_name": text(field, "standard_name")}), dims=field.dims
    )
    part = part.isel(time=0) if "time" in part.dims else part
    return part.transpose(*_AXES).assign_coords(axes).sortby(["depth", "lat"])


def _joined(parts: list[xr.DataArray]) -> xr.DataArray:
    return parts[0] if len(parts) == 1 else xr.concat(parts, "lon", join="exact")
