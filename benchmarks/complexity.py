"""
Time and memory against the number of links, vehicles, poses and grid points; a table and a figure
with slopes.

Run with ``python benchmarks/complexity.py``; ``--upto N`` leaves out larger points. Each point is
measured in a process of its own, on one thread: CPU seconds of the work after all that it needs is
compiled and loaded, and the most memory that the process has had, imports included. What was
measured is kept in ``docs/figures/complexity.csv``, so that a run that was stopped goes on,
``--fresh`` measures again. A point that takes more than ``--limit`` CPU seconds or asks for more
than ``--memory`` GiB is kept as such: that is where it breaks.

links
    the paper's, solved in the synthetic Beaufort Sea in full; more of them are more pings
vehicles
    all pairs of them in a square of 20 km, one ping, in the same sea
poses
    11 vehicles over a longer and longer mission, 4,620 ranges for 33,275 poses: graph built and
    solved with straight ranges
grid
    points of a 3-D medium of 40 levels, from the paper's 76 x 251 on: the medium made of sound
    speeds, and one link
"""

import argparse
import csv
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import bench_links
import numpy as np

FIGURES = Path(__file__).parent.parent / "docs" / "figures"
GRIDS = {
    40 * n * e: (n, e)
    for n, e in ((76, 251), (152, 502), (304, 1004), (608, 2008), (1626, 2250), (3251, 4500))
}
SIZES = {
    "links": (100, 1_000, 10_000, 100_000, 1_000_000),
    "vehicles": (10, 32, 100, 320, 1_000),
    "poses": (1_001, 10_010, 100_100, 1_000_010),
    "grid": tuple(GRIDS),
}
LETTERS = dict(zip(SIZES, "abcd", strict=True))


class Point(NamedTuple):
    """
    One measurement; CPU seconds and MiB are empty where it broke, and then `outcome` says by what.
    """

    sweep: str
    size: int
    cpu_s: str
    peak_mib: str
    outcome: str


def links(size: int) -> Callable[[], object]:
    medium, ends = bench_links.arctic(), bench_links.fleet_links(np.random.default_rng(1), size)
    return lambda: bench_links.find_eigenrays(medium, *ends, threads=1)


def vehicles(size: int) -> Callable[[], object]:
    medium, ends = bench_links.arctic(), bench_links.crowd_links(np.random.default_rng(1), size)
    return lambda: bench_links.find_eigenrays(medium, *ends, threads=1)


def poses(size: int) -> Callable[[], object]:
    import bench_solve

    n_times = size // len(bench_solve.TARGETS)
    position, rotation = bench_solve.fleet(np.random.default_rng(0), turn=0.0, n_times=n_times)
    measured = bench_solve.observe(position, rotation, np.random.default_rng(1))
    initial = bench_solve.GraphValues(
        position=position.reshape(-1, 3),
        quaternion=bench_solve.quaternion_from_matrix(rotation).reshape(-1, 4),
        landmark_position=np.zeros((0, 3)),
    )
    return lambda: bench_solve.ours(measured, "straight", initial, bench_solve.GraphSolver())


def grid(size: int) -> Callable[[], object]:
    n_north, n_east = GRIDS[size]
    north, east, depth = (
        4e3 * np.arange(n_north),
        4e3 * np.arange(n_east),
        np.linspace(0.0, 4e3, 40),
    )
    speed = np.empty((n_north, n_east, 40))
    speed[:] = 1450.0 + 0.016 * depth
    speed += 5.0 * np.sin(north / 6e4)[:, None, None] * np.exp(-depth / 300.0)
    bed = np.full((n_north, n_east), 3500.0)
    middle = np.array([2e3 * n_north, 2e3 * n_east, 100.0])

    def make() -> None:
        medium = bench_links.Medium.from_grid(north, east, depth, speed, bathymetry=bed)
        bench_links.find_eigenrays(medium, middle, middle + np.array([5e3, 0.0, 400.0]), threads=1)

    return make


def measure(sweep: str, size: int) -> None:
    """Measure one point in this process and print it."""
    work = {"links": links, "vehicles": vehicles, "poses": poses, "grid": grid}[sweep]
    work(min(SIZES[sweep]))()  # compiles and loads
    job = work(size)
    start = time.process_time()
    job()
    print(json.dumps([time.process_time() - start, bench_links.peak_memory()]))


def point(sweep: str, size: int, limit: float, memory: float) -> Point:
    """Measure one point in a process of its own."""

    def bounded() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (int(memory * 2**30),) * 2)
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 1))

    done = subprocess.run(
        [sys.executable, __file__, "--point", sweep, str(size)],
        env={**os.environ, "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        preexec_fn=bounded,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return Point(sweep, size, "", "", f"more than {limit:g} s")
    if done.returncode == 0:
        cpu, peak = json.loads(done.stdout)
        return Point(sweep, size, f"{cpu:.4g}", f"{peak:.0f}", "measured")
    last = (
        done.stderr.strip().splitlines()[-1]
        if done.stderr.strip()
        else f"signal {-done.returncode}"
    )
    if "MemoryError" in last or "memory" in last.lower():
        return Point(sweep, size, "", "", f"more than {memory:g} GiB")
    raise SystemExit(done.stderr)


def draw(points: list[Point], path: Path) -> None:
    """
    CPU time above, memory below, a column a sweep; the slope is that of the last two points
    measured.
    """
    from pymantaray.plotting import style

    @style.styled
    def figure() -> object:
        figure = style.new_figure(
            style.DOUBLE, 3.6, "One core of a shared machine; each point a process of its own"
        )
        panels = figure.subplots(2, len(SIZES), sharex="col", sharey="row")
        for column, sweep in enumerate(SIZES):
            mine = [p for p in points if p.sweep == sweep and p.outcome == "measured"]
            size = np.array([p.size for p in mine], dtype=float)
            values = [[float(p.cpu_s) for p in mine], [float(p.peak_mib) for p in mine]]
            for axes, y, colour in zip(
                panels[:, column], values, (style.BLUE, style.ORANGE), strict=True
            ):
                axes.loglog(size, y, "o-", color=colour, markersize=3.0)
                if len(mine) > 1:
                    slope = np.diff(np.log(y[-2:]))[0] / np.diff(np.log(size[-2:]))[0]
                    axes.annotate(
                        f"slope {slope:.2f}",
                        (size[-1], y[-1]),
                        (-4, 4),
                        textcoords="offset points",
                        ha="right",
                        fontsize=6.5,
                    )
            for p in points:
                if p.sweep == sweep and p.outcome != "measured":
                    for axes in panels[:, column]:
                        axes.axvline(p.size, color=style.PALE, linestyle=":")
                    panels[0, column].annotate(
                        p.outcome,
                        (p.size, 0.02),
                        xycoords=("data", "axes fraction"),
                        rotation=90,
                        ha="right",
                        fontsize=6.0,
                        color=style.GREY,
                    )
                    break
            style.panel_title(panels[0, column], LETTERS[sweep], sweep)
            panels[1, column].set_xlabel({"grid": "grid points"}.get(sweep, sweep))
        for axes in panels[:, 0]:
            style.short_numbers(axes.yaxis)
        panels[1, 0].set_ylim(200.0, 2e4)
        panels[0, 0].set_ylabel("CPU time [s]")
        panels[1, 0].set_ylabel("Peak memory [MiB]")
        return figure

    path.write_bytes(style.rendered(figure(), ["png"])["png"])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--point", nargs=2, metavar=("SWEEP", "SIZE"), help=argparse.SUPPRESS)
    parser.add_argument("--upto", type=int, default=10**9, help="leave out points of more")
    parser.add_argument(
        "--limit", type=float, default=200.0, help="CPU seconds that a point may take"
    )
    parser.add_argument("--memory", type=float, default=8.0, help="GiB that it may ask for")
    parser.add_argument("--fresh", action="store_true", help="measure again what has been measured")
    parser.add_argument(
        "--out", type=Path, default=FIGURES, help="folder of complexity.csv and complexity.png"
    )
    options = parser.parse_args()
    if options.point:
        measure(options.point[0], int(options.point[1]))
        return
    table = options.out / "complexity.csv"
    points: list[Point] = []
    if table.is_file() and not options.fresh:
        with table.open(newline="") as file:
            points = [
                Point(r["sweep"], int(r["size"]), r["cpu_s"], r["peak_mib"], r["outcome"])
                for r in csv.DictReader(file)
            ]
    for sweep, sizes in SIZES.items():
        if any((sweep, size) not in {p[:2] for p in points} for size in sizes):
            point(
                sweep, sizes[0], options.limit, options.memory
            )  # what is compiled is kept on disk
        for size in sizes:
            if size > options.upto or (sweep, size) in {p[:2] for p in points}:
                continue
            points.append(point(sweep, size, options.limit, options.memory))
            print(*points[-1], sep="  ", flush=True)
            points.sort(key=lambda p: (list(SIZES).index(p.sweep), p.size))
            with table.open("w", newline="") as file:
                csv.writer(file).writerows([Point._fields, *points])
            if points[-1].outcome != "measured" and points[-1].sweep == sweep:
                break
    draw(points, options.out / "complexity.png")


if __name__ == "__main__":
    main()
