"""
Compare robust losses, graduated non-convexity and iSAM2 replay on ranges of which some are far too
long.

Run with ``python benchmarks/bench_robust.py`` for the preset ``quick``, or with ``--run FOLDER``
for the measurements of a run. Ranges are straight ones with their noise; a share of them, drawn by
a seeded generator, gets a late arrival's error of 50 to 500 m. Every estimator starts at dead
reckoning and at the truth.
"""

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.apps.study.store import open_run
from pymantaray.config.door.study import build_study
from pymantaray.config.load import load_study
from pymantaray.estimation import (
    LOSSES,
    FactorGraph,
    GraphSolver,
    GraphValues,
    IncrementalOptions,
    Method,
    SolveOptions,
    build_graph,
    dead_reckon,
)
from pymantaray.estimation.filters.incremental import solve_incrementally
from pymantaray.estimation.solvers.losses import whitened_ranges
from pymantaray.sensing import perturb

LATE = (50.0, 500.0)  # m


def values_of(position: np.ndarray, quaternion: np.ndarray, landmarks: np.ndarray) -> GraphValues:
    return GraphValues(
        position=position.reshape(-1, 3),
        quaternion=quaternion.reshape(-1, 4),
        landmark_position=landmarks,
    )


def with_outliers(graph: FactorGraph, rate: float, seed: int) -> tuple[FactorGraph, np.ndarray]:
    rng = np.random.default_rng(seed)
    ranges = graph["range"]
    late = rng.random(len(ranges)) < rate
    error = np.where(late, rng.uniform(*LATE, late.size), 0.0)
    return graph.with_factors(
        range=ranges.with_columns(distance=ranges.column("distance") + error)
    ), late


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--run", type=Path, help="folder of a run; by default the preset quick is simulated"
    )
    parser.add_argument("--rates", type=float, nargs="+", default=[0.0, 0.1, 0.3])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--every",
        nargs="*",
        choices=("ping", "sample"),
        default=("ping", "sample"),
        help="updates of the replays",
    )
    arguments = parser.parse_args()
    if arguments.run:
        run = open_run(arguments.run)
        truth, o = run.truth, run.noisy_measurements(0)
    else:
        config = load_study("quick")
        mission = simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
        truth, o = (
            mission.truth,
            perturb(mission.measurements, root_seed=config.study.seed, realization=0),
        )
    graph = build_graph(o, "straight")
    starts = {
        "dead reckoning": values_of(*dead_reckon(o), o.landmark_position),
        "truth": values_of(truth.position, truth.quaternion, o.landmark_position),
    }
    reckoned, true = starts["dead reckoning"], starts["truth"].position

    def ate(position: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.sum((position - true) ** 2, axis=1))))

    print(
        f"{graph.n_poses} poses, {len(graph['range'])} ranges; dead reckoning"
        f" {ate(reckoned.position):.2f} m"
    )
    print(
        f"{'late':>5} {'loss':14} {'start':14} {'status':13} {'steps':>5} {'cost':>10}"
        f" {'ATE [m]':>8} {'[s]':>6} kept out"
    )
    for rate in arguments.rates:
        dirty, late = with_outliers(graph, rate, arguments.seed)
        for name in ("least squares", *LOSSES):
            for start, initial in starts.items():
                begin = time.perf_counter()
                found = GraphSolver().solve(
                    dirty, initial, method=Method(LOSSES.get(name)), model_is_right=False
                )
                seconds = time.perf_counter() - begin
                note = ""
                if name != "least squares" and found.usable:
                    low = LOSSES[name].weight(whitened_ranges(dirty, found.values)) < 0.1
                    note = (
                        f"{np.count_nonzero(low & late)} of {np.count_nonzero(late)} late,"
                        f" {np.count_nonzero(low & ~late)} good"
                    )
                print(
                    f"{rate:5.0%} {name:14} {start:14} {found.status.name:13} {found.iterations:5d}"
                    f" {found.final_cost:10.1f} {ate(found.position):8.2f} {seconds:6.2f} {note}",
                    flush=True,
                )
    print(
        f"{'replay':24} {'status':8} {'off [mm]':>8} {'on line':>8} {'batch':>8} {'updates':>7}"
        f" {'median [s]':>10} {'max [s]':>8}"
    )
    dirty, _ = with_outliers(graph, 0.1, arguments.seed)
    tight = SolveOptions(step_tolerance=1e-6)
    for label, used, loss, every in (
        ("clean, every ping", graph, None, "ping"),
        ("clean, every sample", graph, None, "sample"),
        ("10% late, huber, ping", dirty, LOSSES["huber"], "ping"),
        ("10% late, cauchy, ping", dirty, LOSSES["cauchy"], "ping"),
    ):
        if every not in arguments.every:
            continue
        batch = GraphSolver(tight).solve(used, reckoned, method=Method(loss))
        options = SolveOptions(incremental=IncrementalOptions(every=every))
        on_line = solve_incrementally(used, reckoned, loss=loss, options=options)
        off = np.abs(on_line.solution.position - batch.position).max()
        print(
            f"{label:24} {on_line.solution.status.name:8} {1e3 * off:8.2f}"
            f" {ate(on_line.position):8.2f} {ate(batch.position):8.2f} {on_line.seconds.size:7d}"
            f" {np.median(on_line.seconds):10.4f} {on_line.seconds.max():8.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
