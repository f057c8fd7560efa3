"""Time the two-point solver: microseconds per link by medium, direct and with bounces, on one thread and more.

Run with ``python benchmarks/bench_links.py``. Media: isovelocity, constant gradient, Munk's channel, one column of the
synthetic Beaufort Sea (Arctic 1-D), and that sea in full (Arctic 3-D). Links are the paper's: 42 pings of 11 vehicles, 2,310
unordered pairs, at made-up positions: its grid and target depths, each vehicle at the surface or at depth by
chance, displaced by 2 km. Medians of several runs after one that compiles; smallest and largest beside them.

``--bounces N`` adds N reflections at the surface and N at the bottom (2 in the figures of the docs). ``--threads 1 2`` names the
thread counts. ``--both-ways`` solves the Arctic 3-D links from both ends and compares. ``--start`` times fresh
processes instead: imports, the first link with an empty cache (compiles everything) and the first link with a full
one, in a cache folder of its own.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.ocean import open_ocean, to_local
from pymantaray.records import RayStatus

GRID = (
    np.array([[0, 0], *[[n, e] for n in (2, -2) for e in (-3, 0, 3)], *[[0, e] for e in (-6, -3, 3, 6)]])
    * 1e3
)
TARGETS = np.array([0.5, 500, 2000, 750, 1000, 1750, 1250, 2250, 1500, 250, 2500])
PINGS = 42
LEVELS = np.concatenate(
    [np.arange(0, 100, 10), np.arange(100, 500, 50), np.arange(500, 5001, 250)]
)  # m; about HYCOM's
FIRST_LINK = """
import time
start = time.perf_counter()
from pymantaray.acoustics import Medium, find_eigenrays
imported = time.perf_counter()
medium = Medium.from_profile([0.0, 100.0, 4000.0], [1500.0, 1490.0, 1550.0], bottom_depth=3000.0)
find_eigenrays(medium, [0.0, 0.0, 10.0], [1000.0, 0.0, 20.0], {bounces}, {bounces})
print(imported - start, time.perf_counter() - imported)
"""


def fleet_links(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of all pairs at 42 pings, shape (2310, 3) each [m]."""
    first, second = np.triu_indices(len(GRID), k=1)
    ends: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for _ in range(PINGS):
        depth = np.where(rng.random(len(GRID)) < 0.1, 0.5, TARGETS)
        place = np.column_stack([GRID + rng.normal(0, 2e3, GRID.shape), depth])
        ends[0].append(place[first])
        ends[1].append(place[second])
    return np.concatenate(ends[0]), np.concatenate(ends[1])


def profile_medium(speed: np.ndarray, depth: np.ndarray = LEVELS) -> Medium:
    return Medium.from_profile(depth, speed, bottom_depth=3500.0)


def arctic() -> Medium:
    return Medium.from_dataset(to_local(open_ocean("synthetic:beaufort"), half_extent=(60e3, 60e3)))


def arctic_column() -> Medium:
    sea = arctic()
    middle = sea.sound_speed[sea.north.size // 2, sea.east.size // 2]
    return profile_medium(middle, sea.depth)


def munk() -> Medium:
    scaled = 2.0 * (LEVELS - 1300.0) / 1300.0
    return profile_medium(1500.0 * (1.0 + 0.00737 * (scaled - 1.0 + np.exp(-scaled))))


MEDIA: dict[str, Callable[[], Medium]] = {
    "iso": lambda: profile_medium(np.full(LEVELS.size, 1500.0)),
    "gradient": lambda: profile_medium(1450.0 + 0.017 * LEVELS),
    "munk": munk,
    "arctic-1d": arctic_column,
    "arctic-3d": arctic,
}


def time_links(name: str, medium: Medium, bounces: int, threads: int, runs: int) -> None:
    source, receiver = fleet_links(np.random.default_rng(1))
    find_eigenrays(medium, source[:1], receiver[:1], bounces, bounces)
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        arrivals = find_eigenrays(medium, source, receiver, bounces, bounces, threads=threads)
        seconds.append(time.perf_counter() - start)
    each = [1e6 * s / len(source) for s in seconds]
    print(
        f"{name:10} {bounces} bounces, {threads} threads: {statistics.median(each):7.0f} us a link"
        f" ({min(each):.0f} to {max(each):.0f}), {statistics.median(seconds):6.2f} s for {len(source)},"
        f" {len(arrivals.link)} arrivals, {np.count_nonzero(arrivals.status != RayStatus.OK)} dropouts",
        flush=True,
    )


def compare_ends(medium: Medium, bounces: int) -> None:
    source, receiver = fleet_links(np.random.default_rng(1))
    there = find_eigenrays(medium, source, receiver, bounces, bounces, canonical=False)
    back = find_eigenrays(medium, receiver, source, bounces, bounces, canonical=False)
    counts = [np.bincount(a.link, minlength=len(source)) for a in (there, back)]
    gap = np.abs(there.first().travel_time - back.first().travel_time) * 1e6
    print(
        f"arctic-3d solved from both ends: {np.count_nonzero(counts[0] != counts[1])} links differ in their arrivals;"
        f" first arrivals differ by {np.nanmedian(gap):.4f} us (median), {np.nanpercentile(gap, 99):.3f} (p99),"
        f" {np.nanmax(gap):.3f} (max)"
    )


def time_start(bounces: int) -> None:
    """Start-up in fresh processes; the cache lies in a folder of its own, so that the installed one is left alone."""
    with tempfile.TemporaryDirectory() as cache:
        for label in ("cold", "cached", "cached"):
            start = time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-c", FIRST_LINK.format(bounces=bounces)],
                env={**os.environ, "NUMBA_CACHE_DIR": cache},
                capture_output=True,
                text=True,
                check=True,
            )
            imports, first = (float(word) for word in done.stdout.split())
            print(
                f"{label:6}: imports {imports:.2f} s, first link {first:.2f} s, process {time.perf_counter() - start:.2f} s",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--media", nargs="+", choices=MEDIA, default=list(MEDIA))
    parser.add_argument("--bounces", nargs="+", type=int, default=[0])
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--both-ways", action="store_true", help="solve Arctic 3-D links from both ends")
    parser.add_argument(
        "--start", action="store_true", help="time imports and compilation in fresh processes"
    )
    options = parser.parse_args()
    if options.start:
        for bounces in options.bounces:
            time_start(bounces)
        return
    for name in options.media:
        medium = MEDIA[name]()
        for bounces in options.bounces:
            for threads in options.threads:
                time_links(name, medium, bounces, threads, options.runs)
    if options.both_ways:
        for bounces in options.bounces:
            compare_ends(arctic(), bounces)


if __name__ == "__main__":
    main()
