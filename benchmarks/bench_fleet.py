"""Time one ping of a large fleet: every unordered pair of N vehicles through the two-point solver, with its memory.

Run with ``python benchmarks/bench_fleet.py``; 1,000 vehicles are 499,500 pairs. The vehicles are scattered evenly
over a square of 40 km, at the paper's target depths, one in ten at the surface, in the synthetic Beaufort Sea. Of each
size: wall and processor time, pairs a second, the resident memory at its peak beyond that before the first pair (Linux),
and the size of the result. Where other work loads the machine, go by the processor time. ``--threads 1 2`` compares
thread counts.
"""

import argparse
import math
import os
import sys
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
from bench_links import TARGETS, arctic

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.records import Arrivals, RayStatus


def scatter(n_vehicles: int, side: float, rng: np.random.Generator) -> np.ndarray:
    """Positions of a fleet, shape (n_vehicles, 3) [m]."""
    place = rng.uniform(-0.5 * side, 0.5 * side, (n_vehicles, 2))
    depth = np.where(rng.random(n_vehicles) < 0.1, 0.5, rng.choice(TARGETS, n_vehicles))
    return np.column_stack([place, depth])


def resident_mib(name: str) -> float:
    """Resident memory of this process, VmRSS now or VmHWM at its peak, as Linux tells it; NaN elsewhere."""
    status = Path("/proc/self/status")
    if not status.exists():
        return math.nan
    words = dict(line.split(":", 1) for line in status.read_text().splitlines())
    return float(words[name].split()[0]) / 1024


def forget_peak() -> None:
    """Let the peak begin anew (Linux, proc(5): clear_refs)."""
    if Path("/proc/self/clear_refs").exists():
        Path("/proc/self/clear_refs").write_text("5")


def size(arrivals: Arrivals) -> int:
    return sum(getattr(arrivals, f.name).nbytes for f in fields(arrivals))


def ping(medium: Medium, n_vehicles: int, side: float, threads: int, bounces: int) -> None:
    place = scatter(n_vehicles, side, np.random.default_rng(1))
    first, second = np.triu_indices(n_vehicles, k=1)
    source, receiver = place[first], place[second]
    shown = 0

    def progress(done: int, total: int) -> None:
        nonlocal shown
        if sys.stderr.isatty() and (done == total or 100 * done // total > shown):
            shown = 100 * done // total
            print(
                f"\r{done:,} of {total:,} pairs",
                end="\n" if done == total else "",
                file=sys.stderr,
                flush=True,
            )

    forget_peak()
    before = resident_mib("VmRSS")
    wall, cpu = time.perf_counter(), os.times()
    arrivals = find_eigenrays(
        medium, source, receiver, bounces, bounces, threads=threads, device="cpu", progress=progress
    )
    wall, now = time.perf_counter() - wall, os.times()
    used = now.user + now.system - cpu.user - cpu.system
    n = len(source)
    print(
        f"{n_vehicles:5} vehicles, {n:7} pairs, {threads} threads: {wall:7.1f} s, {n / wall:6.0f} pairs a second;"
        f" processor {used:7.1f} s, {1e6 * used / n:.0f} us a pair;"
        f" peak {resident_mib('VmHWM') - before:.0f} MiB beyond {before:.0f};"
        f" result {size(arrivals) / 2**20:.0f} MiB, {size(arrivals) / n:.0f} bytes a pair,"
        f" {arrivals.link.size} arrivals, {np.count_nonzero(arrivals.status != RayStatus.OK)} dropouts",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicles", nargs="+", type=int, default=[317, 633, 1000])
    parser.add_argument("--threads", nargs="+", type=int, default=[os.cpu_count() or 1])
    parser.add_argument("--bounces", type=int, default=0)
    parser.add_argument("--side-km", type=float, default=40.0)
    options = parser.parse_args()
    medium = arctic()
    origin = np.array([[0.0, 0.0, 10.0]])
    find_eigenrays(medium, origin, origin + 1e3, options.bounces, options.bounces)  # compiles
    for n_vehicles in options.vehicles:
        for threads in options.threads:
            ping(medium, n_vehicles, 1e3 * options.side_km, threads, options.bounces)


if __name__ == "__main__":
    main()
