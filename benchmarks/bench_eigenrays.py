"""Time the two-point solver on the paper's links: 42 pings of 11 vehicles, 2,310 unordered pairs.

Run with ``python benchmarks/bench_eigenrays.py``. The positions are made up: vehicles of the paper's grid and
target depths, each at the surface or at depth by chance, displaced by 2 km. One thread; medians of several
runs after one that compiles. ``--cold`` empties the cache first and prints what compilation takes. Then every
link is solved from both ends, and the travel times are compared.
"""

import argparse
import statistics
import time
from pathlib import Path

import numpy as np

from pymantaray import acoustics
from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.ocean import open_ocean, to_local
from pymantaray.records import RayStatus

GRID = (
    np.array([[0, 0], *[[n, e] for n in (2, -2) for e in (-3, 0, 3)], *[[0, e] for e in (-6, -3, 3, 6)]])
    * 1e3
)
TARGETS = np.array([0.5, 500, 2000, 750, 1000, 1750, 1250, 2250, 1500, 250, 2500])


def fleet_links(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of all pairs at 42 pings, shape (2310, 3) each [m]."""
    first, second = np.triu_indices(len(GRID), k=1)
    ends: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for _ in range(42):
        depth = np.where(rng.random(len(GRID)) < 0.1, 0.5, TARGETS)
        place = np.column_stack([GRID + rng.normal(0, 2e3, GRID.shape), depth])
        ends[0].append(place[first])
        ends[1].append(place[second])
    return np.concatenate(ends[0]), np.concatenate(ends[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--cold", action="store_true", help="compile anew")
    options = parser.parse_args()
    if options.cold:
        for index in (Path(acoustics.__file__).parent / "_kernels" / "__pycache__").glob("*.nbi"):
            index.unlink()
    for region in ("beaufort", "fram"):
        medium = Medium.from_dataset(to_local(open_ocean(f"synthetic:{region}"), half_extent=(60e3, 60e3)))
        source, receiver = fleet_links(np.random.default_rng(1))
        start = time.perf_counter()
        find_eigenrays(medium, source[:1], receiver[:1])
        print(f"{region}: first call {time.perf_counter() - start:.2f} s")
        seconds = []
        for _ in range(options.runs):
            start = time.perf_counter()
            arrivals = find_eigenrays(medium, source, receiver, threads=1)
            seconds.append(time.perf_counter() - start)
        middle = statistics.median(seconds)
        print(
            f"{region}: {len(source)} links in {middle:.2f} s ({min(seconds):.2f} to {max(seconds):.2f}),"
            f" {middle / len(source) * 1e6:.0f} us a link, {len(arrivals.link)} arrivals,"
            f" {np.count_nonzero(arrivals.status != RayStatus.OK)} dropouts"
        )
        there = find_eigenrays(medium, source, receiver, canonical=False)
        back = find_eigenrays(medium, receiver, source, canonical=False)
        counts = [np.bincount(a.link, minlength=len(source)) for a in (there, back)]
        gap = np.abs(there.first().travel_time - back.first().travel_time) * 1e6
        print(
            f"{region}: solved from both ends: {np.count_nonzero(counts[0] != counts[1])} links differ in their"
            f" arrivals; first arrivals differ by {np.nanmedian(gap):.4f} us (median),"
            f" {np.nanpercentile(gap, 99):.3f} (p99), {np.nanmax(gap):.3f} (max)"
        )


if __name__ == "__main__":
    main()
