"""
Time the two-point solver: microseconds per link by medium, direct and with bounces, by
threads.

Run with ``python benchmarks/bench_links.py``. Media: isovelocity, constant gradient, Munk's
channel, one column of the synthetic Beaufort Sea (Arctic 1-D), that sea in full (Arctic 3-D) and
the synthetic Fram Strait in full, both also with piecewise linear interpolation. Links are the
paper's: 42 pings of 11 vehicles, 2,310 unordered pairs, at made-up positions: its grid and target
depths, each vehicle at the surface or at depth by chance, displaced by 2 km. Medians of several
runs after one that compiles; smallest and largest beside them, and the CPU time of the process,
which other work on the machine disturbs less.

``--bounces N`` adds N reflections at the surface and N at the bottom (2 in the figures of the
docs). ``--threads 1 2`` names the thread counts. ``--links N`` takes more pings, ``--vehicles N``
all pairs of N vehicles spread over 20 km x 20 km instead. ``--both-ways`` solves the links of the
3-D media from both ends and compares.
"""

import argparse
import resource
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics.medium import Interpolation
from pymantaray.ocean import open_ocean, to_local
from pymantaray.records import RayStatus

GRID = (
    np.array(
        [[0, 0], *[[n, e] for n in (2, -2) for e in (-3, 0, 3)], *[[0, e] for e in (-6, -3, 3, 6)]]
    )
    * 1e3
)
TARGETS = np.array([0.5, 500, 2000, 750, 1000, 1750, 1250, 2250, 1500, 250, 2500])
LINKS = 2310
LEVELS = np.concatenate(
    [np.arange(0, 100, 10), np.arange(100, 500, 50), np.arange(500, 5001, 250)]
)  # m; about HYCOM's


def fleet_links(rng: np.random.Generator, n_links: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Both ends of the first n_links pairs of as many pings as it takes, shape (n_links, 3) each [m].
    """
    first, second = np.triu_indices(len(GRID), k=1)
    ends: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for _ in range(-(-n_links // first.size)):
        depth = np.where(rng.random(len(GRID)) < 0.1, 0.5, TARGETS)
        place = np.column_stack([GRID + rng.normal(0, 2e3, GRID.shape), depth])
        ends[0].append(place[first])
        ends[1].append(place[second])
    return np.concatenate(ends[0])[:n_links], np.concatenate(ends[1])[:n_links]


def crowd_links(rng: np.random.Generator, n_vehicles: int) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of all pairs of vehicles in a square of 20 km. [m]"""
    place = np.column_stack(
        [rng.uniform(-10e3, 10e3, (n_vehicles, 2)), rng.choice(TARGETS, n_vehicles)]
    )
    first, second = np.triu_indices(n_vehicles, k=1)
    return place[first], place[second]


def profile_medium(speed: np.ndarray, depth: np.ndarray = LEVELS) -> Medium:
    return Medium.from_profile(depth, speed, bottom_depth=3500.0)


def arctic(interpolation: Interpolation = "smooth") -> Medium:
    ocean = to_local(open_ocean("synthetic:beaufort"), half_extent=(60e3, 60e3))
    return Medium.from_dataset(ocean, interpolation=interpolation)


def fram(interpolation: Interpolation = "smooth") -> Medium:
    ocean = to_local(open_ocean("synthetic:fram"), half_extent=(60e3, 60e3))
    return Medium.from_dataset(ocean, interpolation=interpolation)


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
    "fram-3d": fram,
    "arctic-linear": lambda: arctic("linear"),
    "fram-linear": lambda: fram("linear"),
}


def peak_memory() -> float:
    """Most memory that the process has had. [MiB]"""
    unit = 1024.0**2 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def time_links(
    name: str,
    medium: Medium,
    ends: tuple[np.ndarray, np.ndarray],
    bounces: int,
    threads: int,
    options: argparse.Namespace,
) -> None:
    source, receiver = ends
    find_eigenrays(medium, source[:1], receiver[:1], bounces, bounces)
    seconds, busy = [], []
    for _ in range(options.runs):
        start, cpu = time.perf_counter(), time.process_time()
        arrivals = find_eigenrays(medium, source, receiver, bounces, bounces, threads=threads)
        seconds.append(time.perf_counter() - start)
        busy.append(time.process_time() - cpu)
    each = [1e6 * s / len(source) for s in seconds]
    print(
        f"{name:10} {bounces} bounces, {threads} threads: {statistics.median(each):7.1f} us a link"
        f" ({min(each):.1f} to {max(each):.1f}; CPU"
        f" {1e6 * statistics.median(busy) / len(source):.1f}), {statistics.median(seconds):6.2f} s"
        f" for {len(source)}, {len(arrivals.link)} arrivals,"
        f" {np.count_nonzero(arrivals.status != RayStatus.OK)} dropouts, peak {peak_memory():.0f}"
        " MiB",
        flush=True,
    )


def compare_ends(name: str, medium: Medium, bounces: int) -> None:
    source, receiver = fleet_links(np.random.default_rng(1), LINKS)
    there = find_eigenrays(medium, source, receiver, bounces, bounces, canonical=False)
    back = find_eigenrays(medium, receiver, source, bounces, bounces, canonical=False)
    counts = [np.bincount(a.link, minlength=len(source)) for a in (there, back)]
    gap = np.abs(there.first().travel_time - back.first().travel_time) * 1e6
    print(
        f"{name} solved from both ends: {np.count_nonzero(counts[0] != counts[1])} links differ in"
        f" their arrivals; first arrivals differ by {np.nanmedian(gap):.4f} us (median),"
        f" {np.nanpercentile(gap, 99):.3f} (p99), {np.nanmax(gap):.3f} (max)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--media", nargs="+", choices=MEDIA, default=list(MEDIA))
    parser.add_argument("--bounces", nargs="+", type=int, default=[0])
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--links", type=int, default=LINKS, help="so many, of more pings")
    parser.add_argument("--vehicles", type=int, default=0, help="all pairs of so many instead")
    parser.add_argument(
        "--both-ways", action="store_true", help="solve the links of the 3-D media from both ends"
    )
    options = parser.parse_args()
    rng = np.random.default_rng(1)
    ends = (
        crowd_links(rng, options.vehicles) if options.vehicles else fleet_links(rng, options.links)
    )
    for name in options.media:
        medium = MEDIA[name]()
        for bounces in options.bounces:
            for threads in options.threads:
                time_links(name, medium, ends, bounces, threads, options)
            if options.both_ways and name.endswith("3d"):
                compare_ends(name, medium, bounces)


if __name__ == "__main__":
    main()
