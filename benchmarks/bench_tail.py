"""
Count and time the links that the two-point solver finds hardest: shallow ducts, links without a
ray, raw casts.

Run with ``python benchmarks/bench_tail.py``; it needs the reference and the real data in
../shared/data beside the repository, and without them does nothing. One thread; each link is solved
by itself, so that CPU time and rays of the fan are known of each, and some sets of links in one
call.

``duct``: medium `e` of the reference (an Arctic duct with a front and an eddy), smooth, 2,310 links
of 0.5 to 12 km between twelve depths. ``gulf``, ``gulf-1d``: a map of 60 ranges and 60 depths from
one source in HYCOM's Gulf Stream, and in the profile at its source: links with a direct ray and
links without; and random links there of 6 to 30 km, by range. ``cast``: links of 2 km in a raw
Arctic cast of 1 m, `linear`, direct and with 7 reflections at the surface. Beside them the time of
sorting a million numbers.
"""

import argparse
import statistics
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics._kernels.layout import (
    N_ARRIVAL,
    N_INFO,
    RAYS,
    Results,
    Settings,
    solver_room,
)
from pymantaray.acoustics._kernels.link import solve_links
from pymantaray.acoustics.solving import MAX_ARRIVALS
from pymantaray.ocean import open_ocean, read_cast, to_local
from pymantaray.records import RayStatus

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
DEPTHS = np.array([0.5, 50, 250, 500, 750, 1000, 1250, 1500, 1750, 2000, 2250, 2500])
Ends = tuple[np.ndarray, np.ndarray]


class Cost(NamedTuple):
    """What each link took: CPU time [s], rays of fans, status, number of arrivals."""

    seconds: np.ndarray
    rays: np.ndarray
    status: np.ndarray
    arrivals: np.ndarray


def solve_each(
    medium: Medium, ends: Ends, surface_bounces: int = 0, *, canonical: bool = True
) -> Cost:
    """Solve links one by one, canonical from their deeper ends, else from the first ones."""
    domain, room = medium.domain(), solver_room(medium.depth.size)
    bounces = (surface_bounces, 0) if surface_bounces else None
    settings = Settings(15.0, 1e-3, canonical, False)
    n = len(ends[0])
    seconds, info = np.empty(n), np.full((n, N_INFO), np.nan)
    status, counts = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.int64)
    rows = np.empty((1, MAX_ARRIVALS, N_ARRIVAL))
    for i in [0, *range(n)]:  # the first compiles
        one = slice(i, i + 1)
        start = time.thread_time_ns()
        results = Results(rows, counts[one], status[one], info[one])
        solve_links(domain, bounces, settings, ends[0][one], ends[1][one], (0, 1), room, results)
        seconds[i] = 1e-9 * (time.thread_time_ns() - start)
    return Cost(seconds, info[:, RAYS], status, counts)


def row(name: str, cost: Cost, links: np.ndarray, sort_seconds: float) -> None:
    """Print what some of the links took."""
    if not links.any():
        print(f"{name:34} no link")
        return
    each, rays = 1e6 * cost.seconds[links], cost.rays[links]
    print(
        f"{name:34} {links.sum():5d} links {cost.arrivals[links].sum():5d} arrivals:"
        f" {each.mean():8.0f} us a link on average, median {np.median(each):7.0f}, worst"
        f" {each.max():8.0f}; {rays.mean():7.0f} rays of fans, most {rays.max():6.0f};"
        f" {1e-3 * each.mean() / sort_seconds:6.1f} thousandths of a sort",
        flush=True,
    )


def one_call(name: str, medium: Medium, ends: Ends, sort_seconds: float) -> None:
    """Print what links take in one call, whose rays are traced together: median of five."""
    seconds = []
    for _ in range(6):  # the first compiles
        start = time.process_time()
        find_eigenrays(medium, *ends, threads=1)
        seconds.append(time.process_time() - start)
    each = 1e6 * statistics.median(seconds[1:]) / len(ends[0])
    print(
        f"{name:34} {len(ends[0]):5d} links in one call: {each:8.0f} us a link;"
        f" {1e-3 * each / sort_seconds:6.1f} thousandths of a sort",
        flush=True,
    )


def sorting() -> float:
    """CPU time of sorting a million numbers. [s]"""
    numbers, times = np.random.default_rng(0).random(1_000_000), []
    for _ in range(5):
        start = time.thread_time_ns()
        np.sort(numbers)
        times.append(1e-9 * (time.thread_time_ns() - start))
    return statistics.median(times)


def duct_links() -> Ends:
    rng = np.random.default_rng(13)
    n = 2310
    middle = np.column_stack([rng.uniform(20e3, 80e3, n), rng.uniform(15e3, 45e3, n)])
    azimuth, half = rng.uniform(0, 2 * np.pi, n), 0.5 * rng.uniform(500.0, 12e3, n)
    step = half[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    depth = rng.choice(DEPTHS, (n, 2))
    return np.column_stack([middle - step, depth[:, 0]]), np.column_stack(
        [middle + step, depth[:, 1]]
    )


def bench_duct(sort_seconds: float) -> None:
    grid = dict(np.load(DATA / "reference" / "medium_e_front_eddy.npz"))
    medium = Medium.from_grid(
        *(grid[k] for k in ("north", "east", "depth", "sound_speed")), bathymetry=grid["bathymetry"]
    )
    ends = duct_links()
    cost = solve_each(medium, ends)
    shallow = np.sum([end[:, 2] <= 50.0 for end in ends], axis=0)
    row("duct, all", cost, shallow >= 0, sort_seconds)
    for n, words in enumerate(
        ("both ends at 250 m or below", "one end at 50 m or above", "both ends at 50 m or above")
    ):
        row(f"duct, {words}", cost, shallow == n, sort_seconds)
    row("duct, links above 3 ms", cost, cost.seconds > 3e-3, sort_seconds)
    one_call("duct, all", medium, ends, sort_seconds)
    both = [end[shallow == 2] for end in ends]
    one_call("duct, both ends at 50 m or above", medium, (both[0], both[1]), sort_seconds)


def map_links(source: np.ndarray, azimuth: float, longest: float, deepest: float) -> Ends:
    """From a source to 60 ranges and 60 depths."""
    r, z = np.meshgrid(
        np.linspace(longest / 60, longest, 60), np.linspace(deepest / 60, deepest, 60)
    )
    receiver = np.column_stack(
        [r.ravel() * np.cos(azimuth), r.ravel() * np.sin(azimuth), z.ravel()]
    )
    receiver[:, :2] += source[:2]
    return np.broadcast_to(source, receiver.shape).copy(), receiver


def random_links(medium: Medium, n: int) -> Ends:
    """Links of 0.5 to 20 km at random places of a medium, with both ends between 5 and 200 m."""
    rng = np.random.default_rng(1)
    source, receiver = np.empty((n, 3)), np.empty((n, 3))
    low, high = (
        np.array([medium.north[0], medium.east[0]]),
        np.array([medium.north[-1], medium.east[-1]]),
    )
    azimuth, length = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(500.0, 20e3, n)
    step = length[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    least, most = np.maximum(low, low - step), np.minimum(high, high - step)
    source[:, :2] = rng.uniform(least, most)
    receiver[:, :2] = source[:, :2] + step
    source[:, 2], receiver[:, 2] = rng.uniform(5.0, 200.0, (2, n))
    return source, receiver


def bench_maps(sort_seconds: float) -> None:
    ocean = open_ocean(DATA / "hycom" / "hycom_glby_930_2019030712_t003_ts3z.nc", currents="rest")
    sea = Medium.from_dataset(to_local(ocean))
    one_call("gulf, 0.5 to 20 km above 200 m", sea, random_links(sea, 1000), sort_seconds)
    source = np.array([0.0, 20e3, 50.0])
    ends = map_links(source, 0.25 * np.pi, 20e3, 1000.0)
    column = sea.sound_speed[np.argmin(np.abs(sea.north)), np.argmin(np.abs(sea.east - 20e3))]
    profile = Medium.from_profile(sea.depth, column, bottom_depth=3000.0)
    for name, medium in (("gulf", sea), ("gulf-1d", profile)):
        cost = solve_each(medium, ends)
        row(f"{name}, with a ray", cost, cost.status == RayStatus.OK, sort_seconds)
        row(f"{name}, without", cost, cost.status != RayStatus.OK, sort_seconds)
        more = solve_each(medium, ends, canonical=False).arrivals - cost.arrivals
        print(
            f"{name}, from the source: {(more > 0).sum()} links with more arrivals,"
            f" {(more < 0).sum()} with fewer"
        )


def bench_ranges(sort_seconds: float) -> None:
    """Random links through the Gulf Stream's front, by range, with a direct ray and without."""
    ocean = open_ocean(DATA / "hycom" / "hycom_glby_930_2019030712_t003_ts3z.nc", currents="rest")
    sea = Medium.from_dataset(to_local(ocean))
    rng, n = np.random.default_rng(12), 4000
    source = rng.uniform([-40e3, -33e3, 1.0], [40e3, 33e3, 200.0], (n, 3))
    azimuth, distance = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(6e3, 30e3, n)
    along = distance[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    receiver = np.column_stack([source[:, :2] + along, rng.uniform(1.0, 500.0, n)])
    arrivals = find_eigenrays(sea, source, receiver)
    has_ray = np.bincount(arrivals.link, minlength=n) > 0
    for low, high in ((6, 12), (12, 18), (18, 30)):
        here = (distance >= 1e3 * low) & (distance < 1e3 * high)
        here &= arrivals.status != RayStatus.OUTSIDE
        for name, own in (("with a ray", here & has_ray), ("without", here & ~has_ray)):
            some = np.flatnonzero(own)[:200]
            ends = source[some], receiver[some]
            one_call(f"gulf, {low} to {high} km, {name}", sea, ends, sort_seconds)


def bench_cast(sort_seconds: float) -> None:
    cast = read_cast(DATA / "casts" / "beaufort_axctd_20140724_74N140W.csv")
    medium = Medium.from_profile(
        cast.depth, cast.sound_speed(), bottom_depth=float(cast.depth[-1]), interpolation="linear"
    )
    rng, n = np.random.default_rng(2), 40
    ends = (
        np.column_stack([np.zeros((n, 2)), rng.uniform(5.0, 900.0, n)]),
        np.column_stack([np.full(n, 2e3), np.zeros(n), rng.uniform(5.0, 900.0, n)]),
    )
    for bounces in (0, 7):
        cost = solve_each(medium, ends, bounces)
        row(f"cast, {bounces} surface bounces", cost, cost.status >= 0, sort_seconds)


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    if not DATA.is_dir():
        print(f"nothing done: no {DATA}")
        return
    sort_seconds = sorting()
    print(f"sorting a million numbers: {1e3 * sort_seconds:.1f} ms")
    bench_duct(sort_seconds)
    bench_maps(sort_seconds)
    bench_ranges(sort_seconds)
    bench_cast(sort_seconds)


if __name__ == "__main__":
    main()
