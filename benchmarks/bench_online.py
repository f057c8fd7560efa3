"""
Time on-line estimators over a whole mission, and compare them with the batch: time of each update,
memory, and errors.

Run with ``python benchmarks/bench_online.py RUN``; the run is a folder of ``mantaray study run``,
such as that of the preset beaufort. The estimators are iSAM2, its fixed-lag smoother, and the
error-state Kalman filter. Times include the estimate after the update. Errors are those of vehicles
under water at the pings, and of all poses, in a realization with straight ranges.
"""

import argparse
import os
import threading
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from pymantaray.apps.study.graphs import noisy_graphs
from pymantaray.apps.study.store import Run
from pymantaray.estimation import (
    GraphSolver,
    IncrementalOptions,
    Method,
    SolveOptions,
    solve_conditions,
)
from pymantaray.estimation.filters.incremental import solve_incrementally
from pymantaray.evaluation.bound import ping_samples, submerged_at_pings
from pymantaray.records import Measurements

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
            f"{1e3 * np.median(seconds[rows]):.1f} / {1e3 * np.percentile(seconds[rows], 95):.1f}"
            f" / {1e3 * seconds[rows].max():.1f}"
            if rows.any()
            else "-"
            for rows in (at_ping, own & ~at_ping)
        ]
        print(f"| {name} | {q + 1} | {' | '.join(cells)} | {memory[q]:.0f} |", flush=True)


def compare(name: str, position: np.ndarray, run: Run, o: Measurements, batch: np.ndarray) -> str:
    """Row of the errors of positions (n_poses, 3), and of their distance from the batch."""
    submerged, samples, shape = (
        submerged_at_pings(run.truth, o),
        ping_samples(o),
        run.truth.position.shape,
    )
    cells = []
    for reference in (run.truth.position, batch.reshape(shape)):
        distance = np.linalg.norm(position.reshape(shape) - reference, axis=-1)
        at_pings = distance[:, samples].T[submerged]
        cells += [np.sqrt(np.mean(at_pings**2)), np.sqrt(np.mean(distance**2)), distance.max()]
    return f"| {name} | {' | '.join(f'{cell:.3g}' for cell in cells)} |"


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--lag", type=float, nargs="*", default=[3600.0], help="lags [s]")
    parser.add_argument(
        "--relinearize", type=float, nargs="*", default=[1e-3, 1e-2], help="[m, rad]"
    )
    parser.add_argument("--realization", type=int, default=0)
    parser.add_argument("--without", nargs="*", default=[], choices=("isam2", "kalman"))
    arguments = parser.parse_args()
    run = Run(arguments.run)
    o = run.noisy_measurements(arguments.realization)
    graph = noisy_graphs(run, o)["straight"]
    pings = o.time[ping_samples(o)]
    batch = solve_conditions(o, ["straight"], (run.truth.position, run.truth.quaternion))[
        "straight"
    ]
    start = batch.values
    methods = (
        {} if "kalman" in arguments.without else {"Kalman filter": (Method(kalman=True), None)}
    )
    for lag in arguments.lag:
        for threshold in arguments.relinearize:
            name = f"fixed lag, {lag / 3600.0:.3g} h, {threshold:g}"
            methods[name] = Method(lag=lag, incremental=True), threshold
    errors = [compare("batch", batch.position, run, o, batch.position)]
    print(
        "| estimator | quarter | ping: median / 95 % / longest [ms] | sample [ms] | memory [MiB] |"
    )
    print("|---|---|---|---|---|")
    for name, (method, threshold) in methods.items():
        options = SolveOptions(incremental=IncrementalOptions(relinearize=threshold or 1e-3))
        memory = Memory()
        memory.start()
        end = GraphSolver(options).solve(graph, start, method=method)
        show(name, o.time, end.update_seconds, pings, memory.quarters())
        errors.append(compare(f"{name} ({end.status.name})", end.position, run, o, batch.position))
    for threshold in [] if "isam2" in arguments.without else arguments.relinearize:
        options = SolveOptions(incremental=IncrementalOptions(relinearize=threshold))
        memory = Memory()
        memory.start()
        found = solve_incrementally(graph, start, options=options)
        show(f"iSAM2, {threshold:g}", found.update_time, found.seconds, pings, memory.quarters())
        name = f"iSAM2, {threshold:g}, each pose at its time"
        errors.append(compare(name, found.position, run, o, batch.position))
    print(
        "\n| estimator | RMSE at pings [m] | all poses [m] | largest [m] | from batch: at pings"
        " [m] | all poses [m] | largest [m] |"
    )
    print("|---|---|---|---|---|---|---|")
    print("\n".join(errors))


if __name__ == "__main__":
    main()
