"""HYCOM by place and time: the experiment, the step, the window, and a valid ocean in a file."""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.fetch import dap, subset
from pymantaray.ocean.fetch.answers import readers
from pymantaray.ocean.fetch.cache import Cache
from pymantaray.ocean.fetch.catalogue import Addresses, Experiment, load_catalogue, minute
from pymantaray.ocean.fetch.kept import Report, Source, WindowFields
from pymantaray.ocean.fetch.region import Region
from pymantaray.ocean.fetch.steps import Step, expected_step, find_step
from pymantaray.ocean.fetch.transport import Limits, ServerError, Transport
from pymantaray.ocean.schema import assemble_ocean, with_history
from pymantaray.records import write_netcdf


@dataclass(frozen=True)
class Fetched:
    """What was fetched, and how."""

    path: Path
    title: str
    time: np.datetime64
    service: str
    requests: int
    """Asked of servers."""
    kept: int
    """Answers that came from the cache."""
    remarks: tuple[str, ...] = ()
    """What is not as asked for first: another step, another experiment, the other service."""


@dataclass(frozen=True)
class _Got:
    experiment: Experiment
    time: np.datetime64
    window: WindowFields
    service: str
    remarks: tuple[str, ...]


def fetch_hycom(
    lat: tuple[float, float],
    lon: tuple[float, float],
    time: str | np.datetime64,
    out: str | Path,
    *,
    servers: str | Path | None = None,
    experiment: str | None = None,
    nearest: bool = False,
    cache: str | Path | None = None,
    use_cache: bool = True,
    limits: Limits | None = None,
    overwrite: bool = False,
    progress: Report | None = None,
) -> Fetched:
    """
    Fetch a window of HYCOM at one time and write it as a valid ocean.

    The window is read over OPeNDAP, block by block; where that fails, through the NetCDF Subset Service.
    What has arrived is kept, so that a fetch that broke goes on where it stopped. The file appears under
    its name when it is whole.

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
        See `pymantaray.ocean.fetch.catalogue.load_catalogue`.
    experiment : str, optional
        Name of an experiment; by default the preferred one that covers the time.
    nearest : bool, optional
        Take the nearest step where the one asked for does not exist.
    cache : str or Path, optional
        Folder of what is kept; by default the platform's.
    use_cache : bool, optional
        False: nothing is kept and nothing kept is used.
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
    wanted = parse_instant(time).astype("datetime64[s]")
    path = check_out(out, overwrite=overwrite)
    catalogue = load_catalogue(servers)
    candidates = catalogue.covering(wanted, experiment)
    readers()  # missed now, not after a request
    kept = Cache(cache) if use_cache else None
    source = Source(Transport(limits), kept, progress)
    with closing(source.transport):
        got = _get(source, catalogue.addresses, candidates, wanted, region, nearest=nearest)
    title = f"{got.experiment.title}, {minute(got.time)}Z"
    history = f"fetched over {got.service} from {catalogue.addresses.opendap}: {region.text}"
    try:
        ocean = assemble_ocean(
            {"depth": got.window.depth, "lat": got.window.lat, "lon": got.window.lon},
            got.time,
            got.window.fields,
            title=title,
            source=got.experiment.title,
            synthetic=False,
        )
    except OceanError as error:
        raise OceanError(f"{title}, {region.text}: {error}") from None
    for line in (history, *got.remarks):
        ocean = with_history(ocean, line)
    write_whole(ocean, path)
    if kept is not None:
        kept.prune()
    return Fetched(path, title, got.time, got.service, source.transport.requests, source.kept, got.remarks)


def check_out(out: str | Path, *, overwrite: bool) -> Path:
    """
    Check that a file can be written, before anything is fetched.

    Parameters
    ----------
    out : str or Path
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    OceanError
        If its folder does not exist, or it exists itself.
    """
    path = Path(out)
    if not path.parent.is_dir():
        raise OceanError(f"{path.parent}: no such folder; make it first")
    if path.is_dir() or (path.exists() and not overwrite):
        raise OceanError(f"{path}: exists already; give another name, or overwrite it (--overwrite)")
    return path


def write_whole(ocean: xr.Dataset, path: Path) -> None:
    """
    Write an ocean under a temporary name, then rename.

    Parameters
    ----------
    ocean : xarray.Dataset
    path : pathlib.Path

    Raises
    ------
    WriteError
        If it cannot be written.
    """
    write_netcdf(ocean, path)


def _get(
    source: Source,
    addresses: Addresses,
    candidates: tuple[Experiment, ...],
    wanted: np.datetime64,
    region: Region,
    *,
    nearest: bool,
) -> _Got:
    """Ask the experiments that cover the time in turn; the next only where a server's axes do not reach."""
    passed: tuple[str, ...] = ()
    for experiment in candidates:
        instant = expected_step(experiment, wanted, nearest=nearest)
        try:
            step = find_step(source, addresses.opendap, experiment, wanted, nearest=nearest)
            if step is None:
                passed += (f"{experiment.title} does not reach {minute(wanted)} on the server",)
                continue
            instant = step.time
            window = _over_opendap(source, addresses.opendap, experiment, step, region)
            return _Got(experiment, instant, window, "OPeNDAP", passed + _other_step(wanted, instant))
        except ServerError as error:
            window = _fall_back(source, addresses, experiment, instant, region, error)
            remarks = (*passed, *_other_step(wanted, instant), f"OPeNDAP failed: {error}")
            return _Got(experiment, instant, window, "the NetCDF Subset Service", remarks)
    raise OceanError(f"fetch: {'; '.join(passed)}; choose another time")


def _over_opendap(
    source: Source, root: str, experiment: Experiment, step: Step, region: Region
) -> WindowFields:
    try:
        return dap.read_window(source, step.datasets, step.time, region)
    except dap.MovedError as moved:  # the kept axes are of before
        anew = find_step(source, root, experiment, step.time, nearest=False, fresh=True)
        if anew is None:
            raise ServerError(str(moved)) from None
        return dap.read_window(source, anew.datasets, anew.time, region)


def _fall_back(
    source: Source,
    addresses: Addresses,
    experiment: Experiment,
    instant: np.datetime64,
    region: Region,
    failed: ServerError,
) -> WindowFields:
    if not addresses.subset:
        raise OceanError(f"{failed}; what arrived is kept, run the same command again later") from None
    root = addresses.subset.rstrip("/")
    # a data set of a year may or may not hold the first hours of it
    years = dict.fromkeys([experiment.year_of(instant), int(str(instant)[:4])])
    reason = ""
    for year in years if experiment.by_year else [0]:
        urls = {
            name: f"{root}/{d.path.format(year=year)}" for d in experiment.datasets for name in d.variables
        }
        try:
            return subset.read_window(source, urls, instant, region, seam=experiment.longitudes)
        except ServerError as error:
            reason = reason or str(error)
    raise OceanError(
        f"OPeNDAP: {failed}; subset service: {reason}; what arrived is kept, run the same command again later"
    )


def _other_step(wanted: np.datetime64, taken: np.datetime64) -> tuple[str, ...]:
    if abs(taken - wanted) < np.timedelta64(60, "s"):
        return ()
    return (f"{minute(wanted)} does not exist: {minute(taken)} was taken",)
