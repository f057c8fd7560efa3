"""HYCOM by place and time: the experiment, the step, the window over OPeNDAP, and a valid ocean in a file."""

from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.jobs.progress import Progress
from pymantaray.ocean.convert import Instants, decoded_times, minute, parse_instant, without_scaled_fill
from pymantaray.ocean.fetch.catalogue import Experiment, covering, load_catalogue
from pymantaray.ocean.fetch.limits import Limits, PassingError, ServerError
from pymantaray.ocean.fetch.region import LARGEST_VALUES, Region
from pymantaray.ocean.files import decoded
from pymantaray.ocean.schema import DIMS, assemble_ocean, with_history
from pymantaray.records.writing import write_netcdf

if TYPE_CHECKING:
    from pymantaray.ocean.fetch.transport import Connection

Array = NDArray[np.float64]
AXES = ("time", *DIMS)
BLOCK_VALUES = 200_000
"""Of one request: a variable on some levels."""
_SAME = 1e-3  # degrees, metres
_MINUTE = np.timedelta64(60, "s")
_FARTHEST = np.timedelta64(72, "h")  # that still counts as nearest; gaps of 51 h have been reported
_PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "standard_name")


@dataclass(frozen=True)
class Fetched:
    """What was fetched, and how."""

    path: Path
    title: str
    time: np.datetime64
    requests: int
    """Asked of servers."""
    remarks: tuple[str, ...] = ()
    """What is not as asked for first: another step, another experiment."""


@dataclass(frozen=True)
class _Remote:
    """A data set on a server: pydap's, its axes and its times."""

    url: str
    data: Any
    axes: dict[str, Array]
    times: Instants

    def index(self, instant: np.datetime64) -> int:
        """Of a step: the first, where the axis repeats itself."""
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
    limits: Limits | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Fetched:
    """
    Fetch a window of HYCOM at one time and write it as a valid ocean.

    The window is read over OPeNDAP, block by block, each tried several times. The file appears under its name when
    it is whole.

    Parameters
    ----------
    lat : tuple of float
        South and north. [degrees]
    lon : tuple of float
        West and east in any convention; ``(170, -170)`` crosses the antimeridian. [degrees]
    time : str or numpy.datetime64
        UTC; HYCOM has a step every three hours.
    out : str or Path
        File to write; its folder must exist.
    servers : str or Path, optional
        A TOML file whose tables replace those of the package, or the address of an OPeNDAP root; by default what
        the environment variable MANTARAY_OCEAN_SERVERS names, else the package's own. A user and password in an
        address are given to the server and to nobody else.
    experiment : str, optional
        Name of an experiment; by default the preferred one that covers the time.
    nearest : bool, optional
        Take the nearest step where the one asked for does not exist.
    limits : Limits, optional
        How long to wait and how often to ask.
    overwrite : bool, optional
        Replace an existing file.
    progress : callable, optional
        Takes the stage's name, the parts done and the parts there are.

    Returns
    -------
    Fetched

    Raises
    ------
    OceanError
        With one line: what cannot be had, why, and what to do.
    """
    region = Region.of(lat, lon)
    asked = parse_instant(time).astype("datetime64[s]")
    path = check_out(out, overwrite=overwrite)
    catalogue = load_catalogue(servers)
    candidates = covering(catalogue.experiments, asked, experiment, "experiment")
    remarks: tuple[str, ...] = ()
    try:
        from pymantaray.ocean.fetch.transport import Connection
    except ImportError:
        raise OceanError('fetch: needs the packages of the extra: pip install "pymantaray[fetch]"') from None
    with Connection(catalogue.addresses.opendap, limits or Limits()) as connection:
        for chosen in candidates:
            step = _find_step(connection, chosen, asked, nearest=nearest)
            if step is not None:
                break
            remarks += (f"{chosen.title} does not reach {minute(asked)} on the server",)
        else:
            raise OceanError(f"fetch: {'; '.join(remarks)}; choose another time")
        instant, datasets = step
        coordinates, fields = _read_window(
            connection, datasets, instant, region, progress or (lambda *_: None)
        )
    if abs(instant - asked) >= _MINUTE:
        remarks += (f"{minute(asked)} does not exist: {minute(instant)} was taken",)
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
    return Fetched(path, title, instant, connection.requests, remarks)


def check_out(out: str | Path, *, overwrite: bool) -> Path:
    """Refuse a file that cannot be written before anything is fetched."""
    path = Path(out)
    if not path.parent.is_dir():
        raise OceanError(f"{path.parent}: no such folder; make it first")
    if path.is_dir() or (path.exists() and not overwrite):
        raise OceanError(f"{path}: exists already; give another name or --force (overwrite=True)")
    return path


def _find_step(
    connection: "Connection", experiment: Experiment, asked: np.datetime64, *, nearest: bool
) -> tuple[np.datetime64, dict[str, _Remote]] | None:
    """Step on the time axes that the server reports, with the data set of each variable; None if they do not reach."""
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
                pass  # there may be none, and the answer to the question is the same: no such step
    closest = times[np.argmin(np.abs(times - asked))]
    if abs(closest - asked) >= _MINUTE:
        if not times[0] < asked < times[-1]:
            return None
        if not nearest:
            sides = (times[times < asked][-1], times[times > asked][0])
            raise OceanError(
                f"{experiment.title} has no step {minute(asked)}; nearest: {' and '.join(map(minute, sides))};"
                " choose one, or let the nearest be taken (--nearest)"
            )
        if abs(closest - asked) > _FARTHEST:
            raise OceanError(
                f"{experiment.title}: no step within 72 h of {minute(asked)}; choose another time"
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
            raise ServerError(f"no coordinate {name}; is it a data set of HYCOM?")
        axes[name] = np.asarray(data[name].data[:], dtype=float)
        if axes[name].ndim != 1 or not axes[name].size or not np.all(np.isfinite(axes[name])):
            raise PassingError(f"coordinate {name} is not an axis of numbers")
    unit = str(data["time"].attributes.get("units", ""))
    times = decoded_times(axes["time"], unit, where="time")
    return _Remote(url, data, axes, (times + np.timedelta64(500, "ms")).astype("datetime64[s]"))


def _common(datasets: dict[str, _Remote]) -> Instants:
    """Steps that all variables have, rising and once: axes that step back and repeat have been reported."""
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
            a, b = remote.axes[name], first.axes[name]
            if a.shape != b.shape or np.any(np.abs(a - b) > _SAME):
                raise ServerError(f"{remote.url}: {name} differs from that of {first.url}")
    depth, grid = first.axes["depth"], region.of_grid(first.axes["lat"], first.axes["lon"], first.url)
    if depth.size * grid.lat.size * grid.lon.size > LARGEST_VALUES:
        raise OceanError(
            f"fetch: the window has {grid.lat.size} x {grid.lon.size} x {depth.size} points; allowed are"
            f" {LARGEST_VALUES:,}, make it smaller"
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
    """Refuse what was read if the index of the step means another one now: steps of running analyses come and go."""
    index = remote.index(instant)
    if remote.data["time"].data[index : index + 1][0] != remote.axes["time"][index]:
        raise ServerError("its time axis has moved during the fetch; run the same command again")


def _read_block(data: Any, name: str, key: tuple[slice, ...]) -> Array:
    """Values (depth, lat, lon) of one step, unpacked."""
    if name not in data:
        raise ServerError(f"holds no {name}")
    variable = data[name]
    attrs = {k: v for k, v in variable.attributes.items() if k in _PACKING}
    if str(attrs.pop("standard_name", "")).startswith("sea_water_potential"):
        raise ServerError(f"{name} is potential temperature; in-situ temperature is needed")
    raw = np.asarray(getattr(variable, "array", variable).data[key])
    if raw.shape != tuple(s.stop - s.start for s in key):
        raise PassingError(f"wrong size: {name} has {raw.shape}")
    values = decoded(xr.Dataset({name: (AXES, raw, attrs)}))[name].values[0]
    return without_scaled_fill(name, np.asarray(values, dtype=float))
