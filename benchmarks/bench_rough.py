"""
Time the search for eigenrays under rough ice: milliseconds of CPU per link by class of range and
of most reflections at the surface.

Run with ``python benchmarks/bench_rough.py``. The water is the duct of examples/replay_campaign.py
on a spherical Earth, the ends are 20 to 100 m deep, the ice has a slope of 0.5 degrees and a
correlation length of 20 m. Each class has ``--links`` links. Times are from one thread, for each
of ``--draws`` draws of the ice in one call, after one that compiles: the table of skips, the draw
and the rays without a reflection are included. With ``--general N`` the general solver searches
the first N links of each class under the first draw, on a grid of the same surface; at 3 to 10 km
it takes 1 to 20 s per link.
"""

import argparse
import math
import statistics
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from replay_campaign import BOTTOM, DEPTH, SPEED

from pymantaray.acoustics import BoundarySurface, Medium, find_eigenrays
from pymantaray.acoustics.levels.rough import Ends, realized
from pymantaray.geometry import EarthSphere
from pymantaray.geometry.roughness import Roughness

ROUGH = Roughness(math.radians(0.5), 20.0)
RANGES = (500.0, 1e3, 3e3, 10e3)  # m
BOUNCES = (1, 3, 7)


def random_links(
    rng: np.random.Generator, n_links: int, shortest: float, longest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of links in all directions, shape (n_links, 3) each. [m]"""
    distance = rng.uniform(shortest, longest, n_links)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n_links)
    depth = rng.uniform(20.0, 100.0, (2, n_links))
    source = np.column_stack([rng.uniform(-1e3, 1e3, (n_links, 2)), depth[0]])
    step = np.column_stack([distance * np.cos(azimuth), distance * np.sin(azimuth)])
    return source, np.column_stack([source[:, :2] + step, depth[1]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--links", type=int, default=48, help="of each class")
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--general", type=int, default=0, help="links of the general solver")
    options = parser.parse_args()
    ice = BoundarySurface(1.5, roughness=ROUGH)
    medium = Medium.from_profile(
        DEPTH, SPEED, bottom_depth=BOTTOM, ice_draft=ice, earth=EarthSphere.at_latitude(72.0)
    )
    find_eigenrays(medium, [[0.0, 0.0, 50.0]], [[600.0, 0.0, 40.0]], 1)
    for shortest, longest in pairwise(RANGES):
        ends = random_links(np.random.default_rng(1), options.links, shortest, longest)
        for bounces in BOUNCES:
            busy, counts = [], []
            for draw in range(1, options.draws + 1):
                drawn = replace(medium, surface=ice.with_roughness(ROUGH.with_draw(draw)))
                start = time.process_time()
                arrivals = find_eigenrays(drawn, *ends, bounces, threads=1)
                busy.append(1e3 * (time.process_time() - start) / options.links)
                counts.append(np.count_nonzero(arrivals.surface_bounces) / options.links)
            print(
                f"rough ice, {1e-3 * shortest:g} to {1e-3 * longest:g} km, {bounces} reflections:"
                f" {statistics.median(busy):6.1f} ms a link ({min(busy):.1f} to {max(busy):.1f}),"
                f" {statistics.mean(counts):.1f} reflected arrivals",
                flush=True,
            )
            if options.general:
                drawn = replace(medium, surface=ice.with_roughness(ROUGH.with_draw(1)))
                print_general(drawn, ends, bounces, options.general)


def print_general(
    medium: Medium, ends: tuple[np.ndarray, np.ndarray], bounces: int, n_links: int
) -> None:
    """Time the general solver, each link on its own grid."""
    busy, counts = [], []
    for source, receiver in zip(*(end[:n_links, None] for end in ends), strict=True):
        gridded = realized(medium, Ends(source, receiver, (bounces, 0), 0.0))
        find_eigenrays(gridded, source, receiver, 0, threads=1)  # compiles
        start = time.process_time()
        arrivals = find_eigenrays(gridded, source, receiver, bounces, threads=1)
        busy.append(1e3 * (time.process_time() - start))
        counts.append(np.count_nonzero(arrivals.surface_bounces))
    print(
        f"  general solver: {statistics.median(busy):6.1f} ms a link ({min(busy):.1f} to"
        f" {max(busy):.1f}), {statistics.mean(counts):.1f} reflected arrivals",
        flush=True,
    )


if __name__ == "__main__":
    main()
