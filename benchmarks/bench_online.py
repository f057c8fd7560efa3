"""Time on-line estimators over a whole mission: CPU time of each update, and memory, by quarter of the mission.

Run with ``python benchmarks/bench_online.py RUN``; the run is a folder of ``mantaray study run``, such as that of the preset beaufort.
The estimators are iSAM2, its fixed-lag smoother, and the error-state Kalman filter. Times include the estimate after the update.
"""

import argparse
import os
import threading
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from pymantaray.estimation import (
    GraphSolver,
    IncrementalOptions,
    Method,
    SolveOptions,
    solve_conditions,
)
from pymantaray.estimation.incremental import solve_incrementally
from pymantaray.study.graphs import noisy_graphs
from pymantaray.study.store import Run

PAGE = os.sysconf("SC_PAGE_SIZE") / 2**20


class Memory(threading.Thread):
    """Resident memory of the process over time [MiB]."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.samples, self._end = [], threading.Event()

    def run(self) -> None:
        """Sample until the end."""
        while not self._end.wait(0.2):
            self.samples.append(PAGE * int(Path("/proc/self/statm").read_text().split()[1]))

    def quarters(self) -> list[float]:
        """Greatest value of each quarter of the time."""
        self._end.set()
        self.join()
        return [max(part, default=np.nan) for part in map(list, np.array_split(self.samples, 4))]


def show(
    name: str, update_time: np.ndarray, seconds: np.ndarray, pings: np.ndarray, memory: list[float]
) -> None:
    """Print a line for each quarter of the mission."""
    edges = np.linspace(0.0, update_time.max(), 5)
    for q in range(4):
        own = (update_time > edges[q] if q else update_time >= 0.0) & (update_time <= edges[q + 1])
        at_ping = own & np.isin(update_time, pings)
        cells = [
            f"{1e3 * np.median(seconds[rows]):.1f} / {1e3 * np.percentile(seconds[rows], 95):.1f} / {1e3 * seconds[rows].max():.1f}"
            if rows.any()
            else "-"
            for rows in (at_ping, own & ~at_ping)
        ]
        print(f"| {name} | {q + 1} | {' | '.join(cells)} | {memory[q]:.0f} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--lag", type=float, default=14760.0, help="lag [s]")
    parser.add_argument("--relinearize", type=float, default=1e-2, help="[m, rad]")
    parser.add_argument("--without", nargs="*", default=[], choices=("isam2", "lag", "kalman"))
    arguments = parser.parse_args()
    run = Run(arguments.run)
    o = run.noisy_measurements(0)
    graph = noisy_graphs(run, o)["straight"]
    pings = np.unique(o.time[o.range_sample])
    options = IncrementalOptions(relinearize=arguments.relinearize)
    batch = solve_conditions(o, ["straight"], (run.truth.position, run.truth.quaternion))["straight"]
    start = batch.values
    print("| estimator | quarter | ping: median / 95 % / longest [ms] | sample [ms] | memory [MiB] |")
    print("|---|---|---|---|---|")
    if "kalman" not in arguments.without:
        memory = Memory()
        memory.start()
        end = GraphSolver().solve(graph, start, method=Method(kalman=True))
        show("Kalman filter", o.time, end.update_seconds, pings, memory.quarters())
        print(f"Kalman filter: {end.status.name}")
    if "lag" not in arguments.without:
        memory = Memory()
        memory.start()
        end = GraphSolver(SolveOptions(incremental=options)).solve(
            graph, start, method=Method(lag=arguments.lag, incremental=True)
        )
        show("fixed lag", o.time, end.update_seconds, pings, memory.quarters())
        print(f"fixed lag: {end.status.name}")
    if "isam2" not in arguments.without:
        memory = Memory()
        memory.start()
        found = solve_incrementally(graph, start, options=SolveOptions(incremental=options))
        show("iSAM2", found.update_time, found.seconds, pings, memory.quarters())


if __name__ == "__main__":
    main()
