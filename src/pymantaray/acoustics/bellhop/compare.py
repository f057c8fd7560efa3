"""Travel times of Bellhop by the paper's rule beside those of the two-point solver."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from pymantaray.acoustics.bellhop.files import BEAMS, CONE, STEP, Bottom, write_bellhop
from pymantaray.acoustics.bellhop.outputs import BellhopArrivals, read_bellhop_arrivals
from pymantaray.acoustics.bellhop.program import find_bellhop, run_bellhop
from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError
from pymantaray.records import RayStatus

MOST_BEAMS = 400


def bellhop_arrivals(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    *,
    program: str | Path | None = None,
    beams: int = BEAMS,
    cone: float = CONE,
    bottom: Bottom = "rigid",
    step: float = STEP,
    timeout: float = 600.0,
) -> tuple[BellhopArrivals, float]:
    """
    Run Bellhop on one link in a temporary folder.

    Parameters
    ----------
    medium : Medium
        With ``linear`` interpolation, Bellhop's own.
    source, receiver : array_like, shape (3,)
        Positions ``(north, east, down)``. [m]
    program : str or pathlib.Path, optional
        See `find_bellhop`.
    beams, cone, bottom, step
        See `write_bellhop`.
    timeout : float
        [s]

    Returns
    -------
    arrivals : BellhopArrivals
        All of them, bounced ones included; horizontal positions are relative to the source.
    cpu_time : float
        [s]

    Raises
    ------
    AcousticsError
        As `write_bellhop` and `run_bellhop`, or if the medium is smooth.
    """
    if medium.interpolation != "linear":
        raise AcousticsError(
            "interpolation: 'smooth'; Bellhop draws straight lines between grid points, compare a medium made with"
            " interpolation='linear' or by linear_medium"
        )
    start = np.asarray(source, dtype=float)
    with tempfile.TemporaryDirectory(prefix="mantaray-bellhop-") as folder:
        (env,) = write_bellhop(
            folder,
            medium,
            start,
            receiver,
            beams=beams,
            cone=cone,
            bottom=bottom,
            step=step,
            origin=tuple(start[:2]),
        )
        done = run_bellhop(program, env, timeout=timeout)
        return read_bellhop_arrivals(done.output), done.cpu_time


def compare_with_bellhop(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    *,
    program: str | Path | None = None,
    most_beams: int = MOST_BEAMS,
    cone: float = CONE,
    step: float = STEP,
    timeout: float = 600.0,
    progress: Callable[[str, int, int], None] | None = None,
) -> pd.DataFrame:
    """
    Earliest direct arrivals of the two-point solver and of Bellhop, link by link.

    Parameters
    ----------
    medium : Medium
        With ``linear`` interpolation, Bellhop's own.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        Positions ``(north, east, down)``. [m]
    program : str or pathlib.Path, optional
        See `find_bellhop`.
    most_beams : int
        Beams in declination and again in bearing at which the search for a direct arrival ends; it starts with
        100 and doubles.
    cone : float
        Width of the fan to either side of the chord. [rad]
    step : float
        Step along Bellhop's rays. [m]
    timeout : float
        Of each run of Bellhop. [s]
    progress : callable, optional
        Takes a stage's name, the links done and the links there are.

    Returns
    -------
    pandas.DataFrame
        One row per link: its length, our status and travel time (no amplitude cut-off), Bellhop's travel time
        and the beams it took, the difference (Bellhop minus ours) [us], and CPU times [ms]; ours are an average
        over all links on one thread, after compilation.

    Raises
    ------
    AcousticsError
        As `bellhop_arrivals`.

    Notes
    -----
    The rule is the paper's: a fan of 100 x 100 beams within 15 degrees of the chord, doubled until
    an arrival without a bounce appears; the earliest one counts. Bellhop's positions, relative to the source,
    and its travel times are in single precision, which alone makes up to about half a microsecond.
    """
    binary = find_bellhop(program)
    a, b = (np.ascontiguousarray(np.atleast_2d(np.asarray(p, dtype=float))) for p in (source, receiver))
    find_eigenrays(medium, a, b, spreading_cutoff_db=None, threads=1)  # compiles, and warms the caches
    start = time.process_time()
    ours = find_eigenrays(medium, a, b, spreading_cutoff_db=None, threads=1).first()
    our_cpu = (time.process_time() - start) / len(a)
    rows = []
    for i, (from_, to) in enumerate(zip(a, b, strict=True)):
        if progress is not None:
            progress("bellhop", i, len(a))
        cpu, beams = 0.0, min(BEAMS, most_beams)
        while True:
            arrivals, took = bellhop_arrivals(
                medium, from_, to, program=binary, beams=beams, cone=cone, step=step, timeout=timeout
            )
            cpu += took
            first = float(arrivals.first_direct().ravel()[0])
            if np.isfinite(first) or 2 * beams > most_beams:
                break
            beams *= 2
        rows.append(
            {
                "link": i,
                "distance_m": float(np.linalg.norm(to - from_)),
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
