"""
Runner of Bellhop, and comparison of its travel times by the paper's rule with those of the
two-point solver.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.medium import Medium
from pymantaray.apps.bellhop.options import BellhopOptions
from pymantaray.apps.bellhop.output import BellhopArrivals, read_bellhop_arrivals
from pymantaray.apps.bellhop.write import write_bellhop
from pymantaray.errors import AcousticsError
from pymantaray.jobs.progress import Progress
from pymantaray.records import RayStatus

PROGRAMS = ("bellhopcxx3d", "bellhopcxx", "bellhop3d", "bellhop3d.exe")
MAX_BEAMS = 400
_TAIL = 200  # characters of the print file in a message


class BellhopRun(NamedTuple):
    """One finished run: the `.arr` or `.ray` file, and the CPU time of the program [s]."""

    output: Path
    cpu_time: float


def find_bellhop(program: str | Path | None = None) -> Path:
    """
    Absolute path of a program from its path or its name on PATH; default: the first of the known
    names on PATH.
    """
    names = PROGRAMS if program is None else (str(program),)
    for path in map(shutil.which, names):
        if path:
            return Path(path).resolve()
    if program is not None and Path(program).is_file():
        raise AcousticsError(f"{program}: is not executable; change its permissions")
    raise AcousticsError(
        f"Bellhop: no {' or '.join(names)} on PATH; install it, or give the path of the program"
    )


def run_bellhop(
    program: str | Path | None, env: str | Path, *, timeout: float = 600.0
) -> BellhopRun:
    """
    Run Bellhop on an `.env` file with one thread; it writes its results into the same folder.

    The Fortran program takes only the name of the file; ``bellhopcxx`` and ``bellhopcuda`` also get
    options for 3-D runs on one thread with 64 MiB: their default clears 4 GiB in every run.
    """
    binary = find_bellhop(program)
    file = Path(env).resolve()
    words = ["--3D", "-1", "-mem=64MiB"] if "cxx" in binary.name or "cuda" in binary.name else []
    outputs = [file.with_suffix(suffix) for suffix in (".arr", ".ray")]
    for old in (*outputs, file.with_suffix(".prt")):
        old.unlink(missing_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(  # program from the user, without a shell
            [str(binary), *words, file.stem],
            cwd=file.parent,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout,
            check=False,
            env={**os.environ, "LC_ALL": "C"},
        )
    except subprocess.TimeoutExpired:
        raise AcousticsError(
            f"{binary.name}: not finished with {file.name} after {timeout:g} s{_tail(file, b'')}"
        ) from None
    except OSError as error:
        raise AcousticsError(f"{binary}: cannot be run: {error.strerror}") from None
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    tail = _tail(file, done.stdout + done.stderr)
    if done.returncode != 0:
        raise AcousticsError(
            f"{binary.name}: failed on {file.name} with exit code {done.returncode}{tail}"
        )
    written = [path for path in outputs if path.is_file() and path.stat().st_size > 0]
    if not written or "FATAL ERROR" in tail:
        raise AcousticsError(f"{binary.name}: wrote no arrivals or rays for {file.name}{tail}")
    return BellhopRun(
        written[0], after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    )


def bellhop_arrivals(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    options: BellhopOptions,
    *,
    program: str | Path | None = None,
    timeout: float = 600.0,
) -> tuple[BellhopArrivals, float]:
    """
    Bellhop's arrivals of one link, with horizontal positions relative to the source, and its CPU
    time [s].
    """
    if medium.interpolation != "linear":
        raise AcousticsError(
            "interpolation is 'smooth'; Bellhop interpolates linearly between grid points; use"
            " `interpolation='linear'`, or a medium from linear_medium"
        )
    start = np.asarray(source, dtype=float)
    with tempfile.TemporaryDirectory(prefix="mantaray-bellhop-") as folder:
        (env,) = write_bellhop(folder, medium, start, receiver, options, origin=start[:2].tolist())
        done = run_bellhop(program, env, timeout=timeout)
        return read_bellhop_arrivals(done.output), done.cpu_time


def compare_with_bellhop(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    options: BellhopOptions | None = None,
    *,
    program: str | Path | None = None,
    timeout: float = 600.0,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """
    Earliest direct arrivals of the two-point solver and of Bellhop for each link.

    Parameters
    ----------
    medium : Medium
        Medium with ``linear`` interpolation, which is that of Bellhop.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        Positions ``(north, east, down)``. [m]
    options : BellhopOptions, optional
        Options as in `write_bellhop`. The search for a direct arrival starts with their number of
        beams and doubles it up to 400.
    program : str or pathlib.Path, optional
        Name on PATH, or a path. Default: the first of ``bellhopcxx3d``, ``bellhopcxx``,
        ``bellhop3d`` and ``bellhop3d.exe`` on PATH.
    timeout : float
        Time limit of each run of Bellhop. [s]
    progress : callable, optional
        Called with the name of the stage, the number of finished links and the total.

    Returns
    -------
    pandas.DataFrame
        One row per link: its length, status and travel time of the two-point solver (without
        amplitude cut-off), Bellhop's travel time and number of beams, the difference (Bellhop minus
        solver) [us], and CPU times [ms]. The CPU time of the solver is an average over all links on
        one thread, after compilation.

    Raises
    ------
    AcousticsError
        As `write_bellhop`; also if the medium is smooth, or if Bellhop is missing, fails, exceeds
        the time limit or writes no result. The message ends with the last lines of its print file.

    Notes
    -----
    The rule is that of the paper: a fan of 100 x 100 beams within 15 degrees of the chord, doubled
    until an arrival without a bounce exists; the earliest one counts. Bellhop stores positions
    relative to the source and travel times in single precision. This alone causes differences of up
    to about half a microsecond.

    Examples
    --------
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.bellhop import compare_with_bellhop, linear_medium
    >>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
    >>> compare_with_bellhop(linear_medium(medium), [0, 0, 50], [3000, 0, 400])  # doctest: +SKIP
    """
    options = options or BellhopOptions()
    binary = find_bellhop(program)
    a, b = (
        np.ascontiguousarray(np.atleast_2d(np.asarray(p, dtype=float))) for p in (source, receiver)
    )
    # the first call compiles the kernels and fills the caches
    find_eigenrays(medium, a, b, spreading_cutoff_db=None, threads=1)
    start = time.process_time()
    ours = find_eigenrays(medium, a, b, spreading_cutoff_db=None, threads=1).first()
    our_cpu = (time.process_time() - start) / len(a)
    rows = []
    for i, ends in enumerate(zip(a, b, strict=True)):
        if progress is not None:
            progress("bellhop", i, len(a))
        first, beams, cpu = _first_direct(medium, *ends, options, binary, timeout)
        rows.append(
            {
                "link": i,
                "distance_m": float(np.linalg.norm(ends[1] - ends[0])),
                "status": RayStatus(int(ours.status[i])).name,
                "travel_time_s": ours.travel_time[i],
                "bellhop_travel_time_s": first,
                "difference_us": 1e6 * (first - ours.travel_time[i]),
                "bellhop_beams": beams,
                "cpu_ms": 1e3 * our_cpu,
                "bellhop_cpu_ms": 1e3 * cpu,
            }
        )
    if progress is not None:
        progress("bellhop", len(a), len(a))
    return pd.DataFrame(rows)


def _first_direct(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    options: BellhopOptions,
    program: Path,
    timeout: float,
) -> tuple[float, int, float]:
    """
    Earliest arrival without a bounce or NaN [s], its number of beams, and the CPU time of all runs
    [s].
    """
    cpu = 0.0
    beams = options.beams
    while True:
        fan = replace(options, beams=beams)
        arrivals, spent = bellhop_arrivals(
            medium, source, receiver, fan, program=program, timeout=timeout
        )
        cpu += spent
        first = arrivals.first_direct().item()
        if np.isfinite(first) or 2 * beams > MAX_BEAMS:
            return first, beams, cpu
        beams *= 2


def _tail(file: Path, printed: bytes) -> str:
    """Last lines of the print file, or of the output of the program, on one line."""
    try:
        text = file.with_suffix(".prt").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = printed.decode("utf-8", "replace")
    words = " ".join(text.split())
    return f"; its print file ends: {words[-_TAIL:]}" if words else "; it printed nothing"
