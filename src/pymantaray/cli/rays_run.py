"""One call of `mantaray rays`: read, solve block by block, write, and say what came of it."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import typer
import xarray as xr
from numpy.typing import NDArray

import pymantaray
from pymantaray.acoustics import find_eigenrays, trace_fan, trace_paths
from pymantaray.cli.output import check_output, progress_bars
from pymantaray.cli.rays_io import (
    SOURCE,
    Table,
    read_links,
    read_table,
    require_columns,
    sidecar,
    write_dataset,
    write_table,
)
from pymantaray.cli.rays_medium import LoadedMedium, load_medium
from pymantaray.cli.rays_options import MediumOptions, SearchOptions
from pymantaray.cli.rays_tables import TracedRays, joined, number_within, status_words
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals, RayPaths

Array = NDArray[np.float64]
_BLOCK = 4096  # links solved at once: for memory, and for progress
_TRACED_BLOCK = 256  # the same where paths are traced


class Fan(NamedTuple):
    """Launch angles of a fan [rad], its azimuth [rad] and length [m] where they are not those to the receiver."""

    angles: Array
    azimuth: float | None
    distance: float | None


@dataclass(frozen=True, eq=False)
class Job:
    """What one call of a command works on, read and checked."""

    out: Path
    quiet: bool
    search: SearchOptions
    cutoff_db: float | None
    loaded: LoadedMedium
    table: Table
    source: Array
    receiver: Array
    fan: Fan | None
    record: dict[str, Any]


def begin(
    command: str,
    links: Path,
    out: Path,
    medium: MediumOptions,
    search: SearchOptions,
    *,
    force: bool,
    quiet: bool,
    fan: tuple[float, float, int] | None = None,
    azimuth: float | None = None,
    distance: float | None = None,
) -> Job:
    """
    Read and check everything that a command is given, before it computes.

    Parameters
    ----------
    command : str
        For the record.
    links, out : pathlib.Path
    medium : MediumOptions
    search : SearchOptions
    force, quiet : bool
        Overwrite the output; print no summary.
    fan : tuple, optional
        First and last launch angle [degrees] and number of rays.
    azimuth, distance : float, optional
        Direction and length of the fan. [degrees, m]

    Returns
    -------
    Job

    Raises
    ------
    MantaRayError
        If something given cannot be used.
    """
    cutoff = search.spreading_cutoff_db
    if not 0.0 < search.tolerance < math.inf:
        raise AcousticsError(f"--tolerance {search.tolerance:g}: a positive length in metres is needed")
    if fan is None and (azimuth is not None or distance is not None):
        raise AcousticsError("--azimuth and --distance go with --fan FROM TO COUNT")
    if fan is not None and search.cutoff_db != SearchOptions.cutoff_db:
        raise AcousticsError("--cutoff-db: a fan is traced whole, without a cut-off; leave one of them out")
    inputs = [path for path in (links, medium.profile, *map(Path, medium.ocean or [])) if path is not None]
    beside = [sidecar(out)] if out.suffix == ".csv" else []
    check_output(out, (".csv", ".nc"), inputs=inputs, beside=beside, force=force)
    if azimuth is not None and distance is not None:
        table = read_table(links)
        require_columns(table, SOURCE)
        source = table.numbers(SOURCE)
        receiver = np.full_like(source, np.nan)
    else:
        table, source, receiver = read_links(links)
    record: dict[str, Any] = {"mantaray": pymantaray.__version__, "command": command, "links": str(links)}
    made = None
    if fan is not None:
        made = Fan(_fan_angles(*fan), None if azimuth is None else math.radians(azimuth), distance)
        record["fan"] = {
            "from_to_count": list(fan),
            "azimuth_deg": azimuth,
            "distance_m": distance,
        }
    loaded = load_medium(medium)
    record |= {"medium": loaded.record, "search": asdict(search)}
    return Job(out, quiet, search, cutoff, loaded, table, source, receiver, made, record)


def solve(job: Job) -> Arrivals:
    """
    Find the arrivals of all links.

    Parameters
    ----------
    job : Job

    Returns
    -------
    Arrivals
    """
    parts, starts = [], []
    for part in _blocks(job, _BLOCK):
        parts.append(_find(job, part))
        starts.append(part.start)
    return joined(parts, starts, "link")


def trace_arrivals(job: Job) -> tuple[TracedRays, NDArray[np.int8]]:
    """
    Find the arrivals of all links and trace their paths.

    Parameters
    ----------
    job : Job

    Returns
    -------
    TracedRays
    status : ndarray, shape (n_links,)
        RayStatus.
    """
    paths: list[RayPaths] = []
    links, status, before = [], [], [0]
    for part in _blocks(job, _TRACED_BLOCK):
        found = _find(job, part)
        source, receiver = job.source[part], job.receiver[part]
        paths.append(trace_paths(job.loaded.medium, source, receiver, found, tolerance=job.search.tolerance))
        links.append(found.link + part.start)
        status.append(found.status)
        before.append(before[-1] + found.link.size)
    link = np.concatenate(links)
    rays = TracedRays(joined(paths, before[:-1], "arrival"), link, number_within(link))
    return rays, np.concatenate(status)


def trace_fans(job: Job, fan: Fan) -> TracedRays:
    """
    Trace a fan from the source of every row.

    Parameters
    ----------
    job : Job
    fan : Fan

    Returns
    -------
    TracedRays

    Raises
    ------
    AcousticsError
        If a fan does not fit into the medium; the message names the line of the table.
    """
    paths: list[RayPaths] = []
    for part in _blocks(job, 1):
        i = part.start
        step = job.receiver[i] - job.source[i]
        try:
            paths.append(
                trace_fan(
                    job.loaded.medium,
                    job.source[i],
                    math.atan2(step[1], step[0]) if fan.azimuth is None else fan.azimuth,
                    fan.angles,
                    math.hypot(step[0], step[1]) if fan.distance is None else fan.distance,
                    max_surface_bounces=job.search.max_surface_bounces,
                    max_bottom_bounces=job.search.max_bottom_bounces,
                    tolerance=job.search.tolerance,
                )
            )
        except AcousticsError as error:
            raise AcousticsError(f"{job.table.path}, line {job.table.line[i]}: {error}") from None
    n, size = len(paths), fan.angles.size
    together = joined(paths, [i * size for i in range(n)], "arrival")
    return TracedRays(
        together, np.repeat(np.arange(n), size), np.tile(np.arange(size), n), np.tile(fan.angles, n)
    )


def finish(
    job: Job, result: pd.DataFrame | xr.Dataset, *, status: NDArray[np.int8] | None, found: str = ""
) -> None:
    """
    Write the result and print a summary and the output's name.

    Parameters
    ----------
    job : Job
    result : pandas.DataFrame or xarray.Dataset
        For CSV or for NetCDF.
    status : ndarray, shape (n_links,), or None
        RayStatus; None for fans.
    found : str
        What else to say.
    """
    counts = Counter([] if status is None else status_words(status))
    record = job.record | ({} if status is None else {"outcomes": dict(counts)})
    if isinstance(result, xr.Dataset):
        write_dataset(result, job.out, record)
    else:
        write_table(result, job.out, record)
    if not job.quiet:
        outcomes = ", ".join(f"{count} {word}" for word, count in counts.most_common())
        said = [part for part in (outcomes, found) if part]
        typer.echo(f"{len(job.source)} {'links' if status is not None else 'sources'}: {'; '.join(said)}")
        for note in job.loaded.notes:
            typer.echo(note)
    typer.echo(str(job.out))


def _find(job: Job, part: slice) -> Arrivals:
    return find_eigenrays(
        job.loaded.medium,
        job.source[part],
        job.receiver[part],
        job.search.max_surface_bounces,
        job.search.max_bottom_bounces,
        job.cutoff_db,
        tolerance=job.search.tolerance,
    )


def _blocks(job: Job, size: int) -> Iterator[slice]:
    """Parts of the links; progress is shown where there are several."""
    n = len(job.source)
    with progress_bars(quiet=job.quiet or n <= size) as report:
        for start in range(0, n, size):
            yield slice(start, min(start + size, n))
            if report is not None:
                report("links", min(start + size, n), n)


def _fan_angles(first: float, last: float, count: int) -> Array:
    if count < 1 or not first <= last or (count > 1 and first == last):
        raise AcousticsError(f"--fan {first:g} {last:g} {count}: needs FROM below TO and a positive COUNT")
    return np.radians(np.linspace(first, last, count))
