"""
Time `mantaray.locate` and its memory against the number of pings and nodes.

Run with ``python benchmarks/bench_locate.py [--sizes N:K ...]``. Each size is a survey of N pings,
each answered by one of K nodes in turn, or, with ``N:Kall``, by all K. Times are CPU of one process
without imports and compilation, the search for hyperparameters included; memory is the largest
resident size so far, so that sizes should rise. Rows: pings, nodes, two-way times, seconds of CPU,
those per time, MiB, model chosen, largest error.
"""

import argparse
import resource
import time

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.locate import LocateOptions, Node, Survey, locate

SIGMA = 1e-4  # s


def water() -> Medium:
    """Water with a minimum of sound speed at 600 m."""
    depth = np.arange(0.0, 1601.0, 40.0)
    speed = 1480.0 + 12.0 * np.exp(-depth / 150.0) + 0.016 * np.maximum(depth - 600.0, 0.0)
    return Medium.from_profile(depth, speed, bottom_depth=1600.0, interpolation="linear")


def survey(medium: Medium, pings: int, nodes: int, *, every: bool) -> tuple[Survey, np.ndarray]:
    """Survey of a ship on laps of two sizes over nodes on a grid, and the nodes' true places."""
    rng = np.random.default_rng(3)
    side = int(np.ceil(np.sqrt(nodes)))
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)[:nodes]
    truth = np.column_stack(
        [400.0 * (grid - (side - 1) / 2.0), 1300.0 + rng.uniform(-20.0, 20.0, nodes)]
    )
    node = np.tile(np.arange(nodes), pings) if every else np.arange(pings) % nodes
    at = np.repeat(10.0 * np.arange(pings), nodes) if every else 10.0 * np.arange(pings)
    turn = at / 450.0
    radius = np.where((turn // (2.0 * np.pi)) % 2 == 0, 900.0, 450.0)
    place = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(at.size, 5.0)])
    down = find_eigenrays(medium, place, truth[node]).first().travel_time
    fraction = 3e-4 * np.sin(2.0 * np.pi * at / 9000.0)
    measured = 2.0 * down * np.exp(-fraction) + rng.normal(0.0, SIGMA, at.size)
    prior = truth + rng.normal(0.0, 5.0, truth.shape)
    known = [Node(f"N{k}", tuple(map(float, p)), (5.0, 5.0, 5.0)) for k, p in enumerate(prior)]
    return Survey(tuple(known), node, at, measured, place, place), truth


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--sizes", nargs="+", default=["1000:4", "3600:4", "10000:4", "10000:20", "10000:20all"]
    )
    parser.add_argument(
        "--speed-model", default="auto", choices=["auto", "known", "scale", "time", "gradient"]
    )
    chosen = parser.parse_args()
    medium = water()
    warm, _ = survey(medium, 100, 2, every=False)
    locate(warm, medium)
    print("  pings nodes    times   CPU s  us/time    MiB  model     worst error [m]")
    for size in chosen.sizes:
        pings, nodes = size.removesuffix("all").split(":")
        one, truth = survey(medium, int(pings), int(nodes), every=size.endswith("all"))
        start = time.process_time()
        found = locate(one, medium, LocateOptions(speed_model=chosen.speed_model))
        spent = time.process_time() - start
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        worst = float(np.abs(found.positions - truth).max())
        model = found.hyperparameters["sound_speed"]
        print(
            f"{int(pings):7d} {int(nodes):5d} {len(one):8d} {spent:7.2f}"
            f" {1e6 * spent / len(one):8.0f} {peak:6.0f}  {model:9s} {worst:.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
