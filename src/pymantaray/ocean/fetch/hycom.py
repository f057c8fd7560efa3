"""
Download of HYCOM by place and time: experiment, time step, window over OPeNDAP, and a valid ocean
in a file.
"""

from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymantaray.arrays import Array, Instants
from pymantaray.errors import OceanError, optional_package
from pymantaray.jobs.progress import Progress
from pymantaray.ocean.convert import (
    decoded_times,
    minute,
    parse_instant,
    without_scaled_fill,
)
from pymantaray.ocean.fetch.catalogue import Experiment, covering, load_catalogue
from pymantaray.ocean.fetch.limits import FetchLimits, ServerError, TransientServerError
from pymantaray.ocean.fetch.region import MAX_VALUES, Region
from pymantaray.ocean.files import decoded
from pymantaray.ocean.schema import DIMS, assemble_ocean, with_history
from pymantaray.records.writing import write_netcdf

if TYPE_CHECKING:
    from pymantaray.ocean.fetch.transport import Connection

AXES = ("time", *DIMS)
BLOCK_VALUES = 200_000
"""Maximum size of one request: a variable on a few levels."""
_AXIS_TOLERANCE = 1e-3  # degrees or metres
_MINUTE = np.timedelta64(60, "s")
_MAX_TIME_OFFSET = np.timedelta64(72, "h")  # of the nearest step; gaps of 51 h are known
_PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "standard_name")


@dataclass(frozen=True)
class FetchResult:
    """A downloaded ocean and the requests for it."""

    path: Path
    title: str
    time: np.datetime64
    requests: int
    """Number of requests to servers."""
    remarks: tuple[str, ...] = ()
    """Deviations from the request: another time step, another experiment."""


@dataclass(frozen=True)
class _Remote:
    """A data set on a server: its pydap object, axes and times."""

    url: str
    data: Any
    axes: dict[str, Array]
    times: Instants

    def index(self, instant: np.datetime64) -> int:
        """Index of a time step; the first if the axis contains it more than once."""
        return int(np.flatnonzero(self.times == instant)[0])


def fetch_hycom(
    lat: tuple[float, float],
    lon: tuple[float, float],
    time: str | np.datetime64,
    out: str | Path,
    *,
    servers: str | Path | None = None,
    experiment: str | None = None,
    nearest: bool = False,
    limits: FetchLimits | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> FetchResult:
    """
    Download a window of HYCOM at one time and write it as a valid ocean.

    The function reads the window over OPeNDAP block by block, with several attempts per block. The
    file gets its name when it is complete.

    Parameters
    ----------
    lat : tuple of float
        South and north. [degrees]
    lon : tuple of float
        West and east in any convention; ``(170, -170)`` crosses the antimeridian. [degrees]
    time : str or numpy.datetime64
        Instant (UTC). HYCOM has a time step of three hours.
    out : str or Path
        File to write; its folder must exist.
    servers : str or Path, optional
        A TOML file whose tables replace those of the package, or the address of an OPeNDAP root.
        Default: the value of the environment variable MANTARAY_OCEAN_SERVERS, else the package's
        own tables. Only the server of an address receives its user and password.
    experiment : str, optional
        Name of an experiment. Default: the preferred experiment that covers the time.
    nearest : bool, optional
        If True, use the nearest time step if the requested one does not exist.
    limits : FetchLimits, optional
        Time limits and number of attempts.
    overwrite : bool, optional
        If True, replace an existing file.
    progress : callable, optional
        Called with the name of the stage, the number of finished parts and the total.

    Returns
    -------
    FetchResult

    Raises
    ------
    OceanError
        If the download fails. The message gives the cause and the remedy.

    Examples
    --------
    >>> from pymantaray.ocean.fetch import fetch_hycom
    >>> result = fetch_hycom((78, 79), (0, 4), "2014-07-15T12:00", "fram.nc")  # doctest: +SKIP
    """
    region = Region.of(lat, lon)
    asked = parse_instant(time).astype("datetime64[s]")
    path = check_out(out, overwrite=overwrite)
    catalogue = load_catalogue(servers)
    candidates = covering(catalogue.experiments, asked, experiment, "experiment")
    remarks: tuple[str, ...] = ()
    with optional_package(OceanError, "fetch", "pydap", "fetch"):
        from pymantaray.ocean.fetch.transport import Connection
    with Connection(catalogue.addresses.opendap, limits or FetchLimits()) as connection:
        for chosen in candidates:
            step = _find_step(connection, chosen, asked, nearest=nearest)
            if step is not None:
                break
            remarks += (f"{chosen.title} on the server does not cover {minute(asked)}",)
        else:
            raise OceanError(f"fetch: {'; '.join(remarks)}; select another time")
        instant, datasets = step
        coordinates, fields = _read_window(
            connection, datasets, instant, region, progress or (lambda *_: None)
        )
    if abs(instant - asked) >= _MINUTE:
        remarks += (f"{minute(asked)} does not exist: nearest step {minute(instant)} used",)
    title = f"{chosen.title}, {minute(instant)}Z"
    try:
        ocean = assemble_ocean(
            coordinates, instant, fields, title=title, source=chosen.title, synthetic=False
        )
    except OceanError as error:
        raise OceanError(f"{title}, {region.text}: {error}") from None
    for line in (f"fetched over OPeNDAP from {connection.root}: {region.text}", *remarks):
        ocean = with_history(ocean, line)
    write_netcdf(ocean, path, replace=overwrite)
    return FetchResult(path, title, instant, connection.requests, remarks)


def check_out(out: str | Path, *, overwrite: bool) -> Path:
    """Raise an error if a file cannot be written, before any download."""
    path = Path(out)
    if not path.parent.is_dir():
        raise OceanError(f"{path.parent}: no such folder; create it first")
    if path.is_dir() or (path.exists() and not overwrite):
        raise OceanError(f"{path}: already exists; give another name or `overwrite=True`")
    return path


def _find_step(
    connection: "Connection", experiment: Experiment, asked: np.datetime64, *, nearest: bool
) -> tuple[np.datetime64, dict[str, _Remote]] | None:
    """
    Time step on the server's axes and the data set of each variable; None if the axes do not cover
    the time.
    """
    year = experiment.year_of(asked)
    opened = [_open_all(connection, experiment, year)]
    times = _common(opened[0])
    if not times.size:
        raise ServerError(f"{experiment.title}: its data sets have no step in common")
    if experiment.by_year and not times[0] <= asked <= times[-1]:
        beside = year + (-1 if asked < times[0] else 1)
        if experiment.first.year <= beside <= (experiment.last.year if experiment.last else beside):
            try:
                opened.append(_open_all(connection, experiment, beside))
                times = np.union1d(times, _common(opened[1]))
            except ServerError:
                pass  # that year may not exist; the message below stays the same
    closest = times[np.argmin(np.abs(times - asked))]
    if abs(closest - asked) >= _MINUTE:
        if not times[0] < asked < times[-1]:
            return None
        if not nearest:
            sides = (times[times < asked][-1], times[times > asked][0])
            raise OceanError(
                f"{experiment.title} has no step {minute(asked)}; the nearest are"
                f" {' and '.join(map(minute, sides))}; select one, or use `nearest=True`"
            )
        if abs(closest - asked) > _MAX_TIME_OFFSET:
            raise OceanError(
                f"{experiment.title}: no step within 72 h of {minute(asked)}; select another time"
            )
    return closest, next(datasets for datasets in opened if closest in _common(datasets))


def _open_all(connection: "Connection", experiment: Experiment, year: int) -> dict[str, _Remote]:
    remote: dict[str, _Remote] = {}
    for part in experiment.datasets:
        url = f"{connection.root}/{part.path.format(year=year)}"
        data = connection.ask(url, partial(_open, connection, url))
        remote |= dict.fromkeys(part.variables, data)
    return remote


def _open(connection: "Connection", url: str) -> _Remote:
    data = connection.open(url)
    axes = {}
    for name in AXES:
        if name not in data:
            raise ServerError(f"no coordinate {name}; the address must be a HYCOM data set")
        axes[name] = np.asarray(data[name].data[:], dtype=float)
        if axes[name].ndim != 1 or not axes[name].size or not np.all(np.isfinite(axes[name])):
            raise TransientServerError(f"coordinate {name} is not an axis of numbers")
    unit = str(data["time"].attributes.get("units", ""))
    times = decoded_times(axes["time"], unit, where="time")
    return _Remote(url, data, axes, (times + np.timedelta64(500, "ms")).astype("datetime64[s]"))


def _common(datasets: dict[str, _Remote]) -> Instants:
    """
    Time steps of all variables, increasing and unique; some servers have axes with steps back and
    repeats.
    """
    return reduce(np.intersect1d, [remote.times for remote in datasets.values()])


def _read_window(
    connection: "Connection",
    datasets: dict[str, _Remote],
    instant: np.datetime64,
    region: Region,
    report: Progress,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Coordinates and fields (depth, lat, lon) of one step; NaN below the sea bed."""
    first = next(iter(datasets.values()))
    for remote in datasets.values():
        for name in DIMS:
            a = remote.axes[name]
            b = first.axes[name]
            if a.shape != b.shape or np.any(np.abs(a - b) > _AXIS_TOLERANCE):
                raise ServerError(f"{remote.url}: {name} differs from {first.url}")
    depth = first.axes["depth"]
    grid = region.of_grid(first.axes["lat"], first.axes["lon"], first.url)
    if depth.size * grid.lat.size * grid.lon.size > MAX_VALUES:
        raise OceanError(
            f"fetch: the window has {grid.lat.size} x {grid.lon.size} x {depth.size} points; the"
            f" limit is {MAX_VALUES:,}; use a smaller window"
        )
    blocks = []
    for name in datasets:
        at = 0
        for columns in grid.blocks:
            width = columns.stop - columns.start
            height = max(1, BLOCK_VALUES // (grid.lat.size * width))
            for top in range(0, depth.size, height):
                levels = slice(top, min(top + height, depth.size))
                blocks.append((name, levels, columns, slice(at, at + width)))
            at += width
    fields = {name: np.full((depth.size, grid.lat.size, at), np.nan) for name in datasets}
    for done, (name, levels, columns, place) in enumerate(blocks):
        report("fetch", done, len(blocks))
        remote = datasets[name]
        index = remote.index(instant)
        key = (slice(index, index + 1), levels, grid.rows, columns)
        fields[name][levels, :, place] = connection.ask(
            remote.url, partial(_read_block, remote.data, name, key)
        )
    report("fetch", len(blocks), len(blocks))
    for remote in {d.url: d for d in datasets.values()}.values():
        connection.ask(remote.url, partial(_check_unmoved, remote, instant))
    coordinates = {"depth": depth, "lat": grid.lat, "lon": grid.lon}
    return coordinates, {name: grid.in_order(values) for name, values in fields.items()}


def _check_unmoved(remote: _Remote, instant: np.datetime64) -> None:
    """
    Raise an error if the index of the time step changed during the download, as in running
    analyses.
    """
    index = remote.index(instant)
    if remote.data["time"].data[index : index + 1][0] != remote.axes["time"][index]:
        raise ServerError("its time axis changed during the download; run the same command again")


def _read_block(data: Any, name: str, key: tuple[slice, ...]) -> Array:
    """Unpacked values (depth, lat, lon) of one time step."""
    if name not in data:
        raise ServerError(f"no variable {name}")
    variable = data[name]
    attrs = {k: v for k, v in variable.attributes.items() if k in _PACKING}
    if str(attrs.pop("standard_name", "")).startswith("sea_water_potential"):
        raise ServerError(f"{name} is potential temperature; it must be in-situ temperature")
    raw = np.asarray(getattr(variable, "array", variable).data[key])
    if raw.shape != tuple(s.stop - s.start for s in key):
        raise TransientServerError(f"wrong size: {name} has {raw.shape}")
    values = decoded(xr.Dataset({name: (AXES, raw, attrs)}))[name].values[0]
    return without_scaled_fill(name, np.asarray(values, dtype=float))
