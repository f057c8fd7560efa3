"""Time the estimator at the paper's size on a made-up fleet: 11 vehicles, 3,025 poses each, 4,620 ranges.

Run with ``python benchmarks/bench_solve.py``. No ocean is needed: floats drift by a random walk and dive as
the paper's do; refraction is a made-up error of 30 m. Accuracy is the distance from an optimum that is ten
thousand times tighter.
"""

import argparse
import os
import statistics
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import gtsam
import numpy as np

from pymantaray.estimation import GraphSolver, SolveOptions, build_graph, solve_conditions
from pymantaray.estimation._gtsam.factors import FactorBuilder, to_graph_values
from pymantaray.estimation._gtsam.optimize import optimize
from pymantaray.estimation.graph import GraphValues
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, se3_exp, so3_log
from pymantaray.records import Observations, RayStatus

PERIOD, N_TIMES, SPEED = 200.0, 3025, 0.5
TARGETS = np.array([0.5, 500, 2000, 750, 2250, 1500, 250, 2500, 1000, 1750, 1250])


def fleet(rng: np.random.Generator, *, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """True positions and rotation matrices; ``turn`` is the sigma of the heading's random walk [rad]."""
    clock = np.arange(N_TIMES) * PERIOD
    position = np.empty((TARGETS.size, N_TIMES, 3))
    for a, target in enumerate(TARGETS):
        dive = target / SPEED
        phase = (clock + rng.uniform(0, 26 * 3600)) % (25 * 3600 + 2 * dive)
        depth = np.interp(
            phase, [0, dive, dive + 24 * 3600, 2 * dive + 24 * 3600], [0.5, target, target, 0.5]
        )
        position[a, :, 2] = depth
    drift = np.cumsum(rng.normal(0, 0.003, (TARGETS.size, N_TIMES, 2)), axis=1)
    position[..., :2] = np.cumsum(drift, axis=1) * 5.0
    position[0, :, :2] = 0.0
    grid = np.array([[x, y] for x in (-4e3, 0, 4e3) for y in (-4.5e3, -1.5e3, 1.5e3, 4.5e3)])[:11]
    position[1:, :, :2] += (grid[grid.any(axis=1)][:10] + rng.normal(0, 100, (10, 2)))[:, None]
    heading = np.cumsum(rng.normal(0, turn, (TARGETS.size, N_TIMES)), axis=1)
    rotation, _ = se3_exp(np.stack([0 * heading, 0 * heading, heading, *[0 * heading] * 3], axis=-1))
    return position, rotation


def observe(position: np.ndarray, rotation: np.ndarray, rng: np.random.Generator) -> Observations:
    """Measurements with the paper's noise levels."""
    n = TARGETS.size
    step = np.swapaxes(rotation[:, :-1], 2, 3) @ rotation[:, 1:]
    moved = np.einsum("atji,atj->ati", rotation[:, :-1], np.diff(position, axis=1))
    turned, way = (np.linalg.norm(v, axis=-1, keepdims=True) for v in (so3_log(step), moved))
    sigma = np.concatenate(
        [
            np.repeat(np.hypot(1e-6 * turned, 5e-7 * PERIOD), 3, axis=2),
            np.repeat(np.hypot(0.05 * way, 0.0125 * PERIOD), 2, axis=2),
            np.hypot(0.001 * way, 0.0125 * PERIOD),
        ],
        axis=2,
    )
    noise_rotation, noise_translation = se3_exp(sigma * rng.standard_normal(sigma.shape))
    moved = moved + np.einsum("atij,atj->ati", step, noise_translation)
    first_sigma = np.tile([1e-3] * 3 + [0.1] * 3, (n, 1))
    first_rotation, first_translation = se3_exp(first_sigma * rng.standard_normal((n, 6)))
    agent, sample = np.nonzero(position[..., 2] < 1.0)
    epoch = np.arange(72, N_TIMES, 72)
    pairs = np.array([(i, j) for i in range(n) for j in range(n) if i != j])
    transmitter, receiver = np.tile(pairs, (epoch.size, 1)).T
    at = np.repeat(epoch, len(pairs))
    distance = np.linalg.norm(position[transmitter, at] - position[receiver, at], axis=1)
    noise = rng.standard_normal(at.size)
    heard = rng.random(at.size) > 0.01
    return Observations(
        name=list("ABCDEFGHIJK"),
        time=np.arange(N_TIMES) * PERIOD,
        odometry_rotation=quaternion_from_matrix(step @ noise_rotation),
        odometry_translation=moved,
        odometry_sigma=sigma,
        depth=position[..., 2] + rng.normal(0, 0.01, position.shape[:2]),
        depth_sigma=np.full(n, 0.01),
        gnss_agent=agent,
        gnss_sample=sample,
        gnss_position=position[agent, sample] + rng.normal(0, 0.1, (agent.size, 3)),
        gnss_sigma=np.full(agent.size, 0.1),
        landmark_name=[],
        landmark_position=np.zeros((0, 3)),
        landmark_sigma=[],
        first_position=position[:, 0] + np.einsum("aij,aj->ai", rotation[:, 0], first_translation),
        first_quaternion=quaternion_from_matrix(rotation[:, 0] @ first_rotation),
        first_sigma=first_sigma,
        range_transmitter=transmitter,
        range_receiver=receiver,
        range_sample=at,
        range_status=np.where(heard, RayStatus.OK, RayStatus.SHADOW),
        travel_time=np.where(heard, distance / 1450.0, np.nan),
        chord_travel_time=distance / 1450.0,
        transmitter_sound_speed=np.full(at.size, 1450.0),
        straight_range=distance + noise,
        refracted_range=np.where(heard, distance + noise + rng.normal(-5.0, 30.0, at.size), np.nan),
        range_sigma=np.ones(at.size),
    )


def levenberg_marquardt(factors, values, ordering, tolerance):
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("SEQUENTIAL_CHOLESKY")
    parameters.setOrdering(ordering)
    parameters.setRelativeErrorTol(tolerance)
    parameters.setAbsoluteErrorTol(0.0)
    optimizer = gtsam.LevenbergMarquardtOptimizer(factors, values, parameters)
    return optimizer.optimize(), optimizer.iterations()


def timed(function, *arguments, **keywords):
    begin = time.perf_counter()
    result = function(*arguments, **keywords)
    return result, time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--realizations", type=int, default=3)
    parser.add_argument("--turn", type=float, default=0.0, help="sigma of the heading's random walk [rad]")
    arguments = parser.parse_args()
    position, rotation = fleet(np.random.default_rng(0), turn=arguments.turn)
    truth = position, quaternion_from_matrix(rotation)
    assert np.allclose(matrix_from_quaternion(truth[1]), rotation)
    solver, builder, rows = GraphSolver(), FactorBuilder(), []
    initial = GraphValues(
        position=truth[0].reshape(-1, 3),
        quaternion=truth[1].reshape(-1, 4),
        landmark_position=np.zeros((0, 3)),
    )
    totals = []
    for realization in range(arguments.realizations):
        o = observe(position, rotation, np.random.default_rng(1 + realization))
        _, total = timed(solve_conditions, o, ["straight", "refracted"], truth, solver=solver)
        totals.append(total)
        for ranges in ("straight", "refracted"):
            graph, tables = timed(build_graph, o, ranges)
            common, base = timed(builder.base, graph)
            factors, push = timed(builder.with_ranges, common, graph)
            values, start = timed(builder.values, initial)
            ordering, order = timed(builder.ordering, graph, factors)
            tight, _ = optimize(factors, values, ordering, SolveOptions(step_tolerance=1e-9))
            tight = to_graph_values(tight, initial).position
            runs = {}
            for tolerance in (1e-3, 1e-4, 1e-5):
                (end, progress), seconds = timed(
                    optimize, factors, values, ordering, SolveOptions(step_tolerance=tolerance)
                )
                runs[f"Gauss-Newton, step {tolerance:g} m"] = (seconds, progress.iterations, end)
            for tolerance in (1e-5, 1e-8, 1e-10):
                (end, iterations), seconds = timed(levenberg_marquardt, factors, values, ordering, tolerance)
                runs[f"Levenberg-Marquardt, relative {tolerance:g}"] = (seconds, iterations, end)
            for name, (seconds, iterations, end) in runs.items():
                error = np.abs(to_graph_values(end, initial).position - tight).max()
                rows.append((ranges, name, seconds, iterations, error))
            rows.append((ranges, "build: tables", tables, 0, 0.0))
            rows.append(
                (ranges, "build: factors, ranges, values, ordering", base + push + start + order, 0, 0.0)
            )
            print(
                f"{realization} {ranges}: {graph.n_poses} poses, {factors.size()} factors, cost {progress.final_cost:.0f}"
                f" of {graph.degrees_of_freedom / 2:.0f}; factors {base:.2f} ranges {push:.2f} values {start:.2f}"
                f" ordering {order:.2f} s"
            )
    print(f"{'condition':10} {'what':42} {'median [s]':>10} {'iterations':>10} {'off [m]':>9}")
    for key in dict.fromkeys(row[:2] for row in rows):
        mine = [row for row in rows if row[:2] == key]
        print(
            f"{key[0]:10} {key[1]:42} {statistics.median(r[2] for r in mine):10.2f}"
            f" {max(r[3] for r in mine):10d} {max(r[4] for r in mine):9.1e}"
        )
    print(
        f"one realization, two conditions, all in: {statistics.median(totals):.2f} s (first {totals[0]:.2f})"
    )


if __name__ == "__main__":
    main()
