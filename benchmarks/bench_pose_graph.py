"""
Solve plain pose graphs beside GTSAM's stock Levenberg-Marquardt: spheres of 2,500 poses, from edges
composed and from chordal initialization.

Run with ``python benchmarks/bench_pose_graph.py``. The spheres are the public sphere2500 that GTSAM
ships, with its noise as GTSAM's reader takes it (the first three of the diagonal for the rotation:
0.3 rad) and as it was meant, and one made here, 50 rings of 50 poses, with 0.1 rad and 0.2 m on
each edge. Stock is `LevenbergMarquardtOptimizer` with zero tolerances, one iteration at a time,
until its cost is within 1e-6 of ours, or stands still. CPU time of the process, ours with
everything, stock's without building its graph; both take turns, medians. The last rows are of
reading a chain of 95,000 poses from PyFactorGraph text and from g2o.
"""

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import gtsam
import numpy as np

from pymantaray.apps.graphs import open_graph, to_gtsam
from pymantaray.apps.graphs.g2o import LEFT_OUT, write_g2o
from pymantaray.estimation import FactorGraph, GraphSolver, GraphValues, write_pyfg
from pymantaray.estimation.graph.graph import KINDS
from pymantaray.estimation.solvers.starts import anchor_loose_parts, chordal, dead_reckon_graph
from pymantaray.geometry.se3 import quaternion_from_matrix, so3_exp

SAME, STANDS_STILL, MOST = 1e-6, 1e-12, 300


def pose_graph(
    ends: np.ndarray, step: np.ndarray, turn: np.ndarray, covariance: np.ndarray
) -> FactorGraph:
    """Graph of one vehicle, its first pose held."""
    n = int(ends.max()) + 1
    graph = FactorGraph(
        vehicle_name=np.array(["A"]),
        landmark_name=np.array([], dtype=str),
        pose_vehicle=np.zeros(n, dtype=int),
        pose_number=np.arange(n),
        pose_time=np.arange(n, dtype=float),
        factors={
            "edge": KINDS["edge"].table(ends, [step, quaternion_from_matrix(turn)], covariance)
        },
    )
    return anchor_loose_parts(graph, somewhere(graph))[0]


def somewhere(graph: FactorGraph) -> GraphValues:
    """All poses at the origin."""
    n = graph.n_poses
    return GraphValues(np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.empty((0, 3)))


def public_sphere(*, translation_first: bool) -> FactorGraph:
    """The sphere that GTSAM ships."""
    factors, _ = gtsam.load3D(str(Path(gtsam.__file__).parent / "Data" / "sphere2500.txt"))
    edges = [factors.at(i) for i in range(factors.size())]
    roots = np.array([edge.noiseModel().R() for edge in edges])
    covariance = np.linalg.inv(np.swapaxes(roots, 1, 2) @ roots)
    if translation_first:
        order = [3, 4, 5, 0, 1, 2]
        covariance = covariance[:, order][:, :, order]
    return pose_graph(
        np.array([list(edge.keys()) for edge in edges]),
        np.array([edge.measured().translation() for edge in edges]),
        np.array([edge.measured().rotation().matrix() for edge in edges]),
        0.5 * (covariance + np.swapaxes(covariance, 1, 2)),
    )


def made_sphere(
    rings: int = 50, radius: float = 50.0, angle: float = 0.1, length: float = 0.2
) -> FactorGraph:
    """Rings of as many poses, each seen from the one before and from that below, with noise."""
    rng = np.random.default_rng(0)
    n = rings * rings
    around = 2.0 * np.pi * np.arange(n) / rings
    up = np.pi * ((np.arange(n) + 0.5) / n - 0.5)
    out = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1)
    east = np.stack([-np.sin(around), np.cos(around), np.zeros(n)], axis=1)
    rotation, place = np.stack([east, np.cross(out, east), out], axis=2), radius * out
    one = np.concatenate([np.arange(n - 1), np.arange(n - rings)])
    other = np.concatenate([np.arange(1, n), np.arange(rings, n)])
    back = np.swapaxes(rotation[one], 1, 2)
    step = np.einsum("nij,nj->ni", back, place[other] - place[one]) + rng.normal(
        0, length, (one.size, 3)
    )
    turn = back @ rotation[other] @ so3_exp(rng.normal(0, angle, (one.size, 3)))
    sigma = np.array([angle] * 3 + [length] * 3)
    return pose_graph(
        np.stack([one, other], axis=1), step, turn, np.tile(np.diag(sigma**2), (one.size, 1, 1))
    )


def ours(graph: FactorGraph, start: GraphValues) -> tuple[int, float, float]:
    """Iterations, cost and CPU time of a solve."""
    begin = time.process_time()
    solution = GraphSolver().solve(graph, start, model_is_right=False)
    assert solution.usable
    return solution.iterations, solution.final_cost, time.process_time() - begin


def stock(graph: FactorGraph, start: GraphValues, until: float) -> tuple[int, float, float]:
    """The same of GTSAM's, until its cost is as good as some cost, or stands still."""
    factors, values = to_gtsam(graph, start)
    parameters = gtsam.LevenbergMarquardtParams()
    for limit in (
        parameters.setRelativeErrorTol,
        parameters.setAbsoluteErrorTol,
        parameters.setErrorTol,
    ):
        limit(0.0)
    begin = time.process_time()
    optimizer = gtsam.LevenbergMarquardtOptimizer(factors, values, parameters)
    cost, iterations = optimizer.error(), 0
    while iterations < MOST and cost > until * (1.0 + SAME):
        optimizer.iterate()
        before, cost, iterations = cost, optimizer.error(), iterations + 1
        if before - cost <= STANDS_STILL * cost:
            break
    return iterations, cost, time.process_time() - begin


def made_chain(n: int = 95_000) -> tuple[FactorGraph, GraphValues]:
    """
    Poses about one metre apart, each turned at random from the last, whose full covariances all
    differ.
    """
    rng = np.random.default_rng(0)
    root = 0.1 * np.eye(6) + 0.01 * np.tril(rng.standard_normal((n - 1, 6, 6)), -1)
    graph = pose_graph(
        np.stack([np.arange(n - 1), np.arange(1, n)], axis=1),
        np.array([1.0, 0.0, 0.0]) + rng.normal(0, 0.1, (n - 1, 3)),
        so3_exp(rng.normal(0, 0.1, (n - 1, 3))),
        root @ np.swapaxes(root, 1, 2),
    )
    return graph, dead_reckon_graph(graph, somewhere(graph)).values


def reading(repeat: int) -> None:
    """Print the time that reading a long chain takes."""
    graph, values = made_chain()
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"chain.{ending}" for ending in ("pyfg", "g2o")]
        write_pyfg(graph, files[0], initial=values)
        write_g2o(graph, files[1], initial=values, leave_out=LEFT_OUT)
        for file in files:
            seconds = []
            for _ in range(repeat):
                begin = time.process_time()
                open_graph(file)
                seconds.append(time.process_time() - begin)
            print(
                f"reading {graph.n_poses:,} poses, {file.suffix[1:]},"
                f" {file.stat().st_size / 1e6:.0f} MB: {statistics.median(seconds):.2f} s"
            )


def main() -> None:
    """Print a row for each graph and start."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="turns (3)")
    repeat = parser.parse_args().repeat
    graphs = {
        "sphere2500 as GTSAM reads it": public_sphere(translation_first=False),
        "sphere2500 as meant": public_sphere(translation_first=True),
        "sphere of 0.1 rad, 0.2 m": made_sphere(),
    }
    print(
        f"{'graph':<30} {'start':<15} {'ours: steps':>11} {'cost':>12} {'CPU s':>6}"
        f" {'stock: steps':>12} {'cost':>12} {'CPU s':>6} {'ratio':>6}"
    )
    for name, graph in graphs.items():
        values = somewhere(graph)
        starts = {
            "edges composed": dead_reckon_graph(graph, values).values,
            "chordal": chordal(graph, values).values,
        }
        for where, start in starts.items():
            ours(graph, start)  # compiled
            rows = []
            for _ in range(repeat):
                mine = ours(graph, start)
                rows.append((*mine, *stock(graph, start, mine[1])))
            steps, cost, seconds, their_steps, their_cost, their_seconds = map(
                statistics.median, zip(*rows, strict=True)
            )
            print(
                f"{name:<30} {where:<15} {steps:>11.0f} {cost:>12.6g} {seconds:>6.2f}"
                f" {their_steps:>12.0f} {their_cost:>12.6g} {their_seconds:>6.2f}"
                f" {seconds / their_seconds:>6.2f}"
            )
    reading(repeat)


if __name__ == "__main__":
    main()
