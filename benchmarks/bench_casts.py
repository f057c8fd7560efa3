"""
Time the two-point solver in raw casts of 1 m, thinned and smoothed, and say what that does to
travel times.

Run with ``python benchmarks/bench_casts.py CAST.csv...``. Links, up to 6 km long, join depths of 10
to 300 m. For each cast and treatment: levels, milliseconds of CPU a link, links with an arrival,
and how far the earliest arrival is from that in the raw cast, piecewise linear, which is traced
exactly. The profile of ``docs/how-to/travel-times.md`` stands beside them. One thread, after a link
that compiles.
"""

import argparse
import time

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays, read_profile, smooth_profile, thin_profile

DOCS = (
    np.array([0, 50, 100, 200, 400, 800, 1500, 3000.0]),
    np.array([1434, 1436, 1442, 1443, 1455, 1462, 1473, 1499.0]),
)


def links(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of so many links. [m]"""
    rng = np.random.default_rng(7)
    source, receiver = np.zeros((n, 3)), np.zeros((n, 3))
    source[:, 2], receiver[:, 2] = rng.uniform(10.0, 300.0, (2, n))
    receiver[:, 0] = rng.uniform(500.0, 6000.0, n)
    return source, receiver


def first_times(
    medium: Medium, ends: tuple[np.ndarray, np.ndarray], bounces: int
) -> tuple[float, np.ndarray]:
    """Milliseconds of CPU a link, and travel times. [ms, s]"""
    find_eigenrays(medium, *(end[:1] for end in ends), bounces, threads=1)
    start = time.process_time()
    arrivals = find_eigenrays(medium, *ends, bounces, threads=1)
    return 1e3 * (time.process_time() - start) / len(ends[0]), arrivals.first().travel_time


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("casts", nargs="+", metavar="CAST.csv")
    parser.add_argument("--links", type=int, default=60)
    parser.add_argument("--bounces", type=int, default=0, help="at the surface")
    parser.add_argument("--position", type=float, nargs=2, default=None, metavar=("LAT", "LON"))
    options = parser.parse_args()
    ends = links(options.links)
    print(
        f"{'':34} levels  ms/link  heard   change of the earliest arrival [us]: median, 90 %,"
        " links that differ"
    )
    spent, _ = first_times(Medium.from_profile(*DOCS, bottom_depth=3000.0), ends, options.bounces)
    print(f"{'profile of the page, smooth':34} {DOCS[0].size:6d} {spent:8.3f}")
    for name in options.casts:
        profile = read_profile(name, options.position and tuple(options.position))
        z, c = profile.depth, profile.sound_speed
        print(name.rpartition("/")[2])
        exact = None
        for label, reduced, kind in (
            ("raw, linear", None, "linear"),
            (
                "thinned by 0.1 m/s, linear",
                thin_profile(z, c, tolerance=0.1, interpolation="linear"),
                "linear",
            ),
            ("thinned by 0.1 m/s, smooth", thin_profile(z, c, tolerance=0.1), "smooth"),
            ("smoothed over 10 m, smooth", smooth_profile(z, c, length=10.0), "smooth"),
        ):
            levels, speed = (z, c) if reduced is None else (reduced.depth, reduced.sound_speed)
            medium = Medium.from_profile(levels, speed, bottom_depth=3000.0, interpolation=kind)
            spent, first = first_times(medium, ends, options.bounces)
            exact = first if exact is None else exact
            change = 1e6 * np.abs(first - exact)
            both = np.isfinite(change)
            median, most = np.percentile(change[both], (50, 90)) if both.any() else (np.nan, np.nan)
            lost = int(np.count_nonzero(np.isfinite(first) != np.isfinite(exact)))
            heard = int(np.isfinite(first).sum())
            print(
                f"  {label:32} {levels.size:6d} {spent:8.2f} {heard:6d} {median:10.1f}"
                f" {most:10.1f} {lost:6d}"
            )


if __name__ == "__main__":
    main()
