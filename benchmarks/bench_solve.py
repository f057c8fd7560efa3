"""
Time the estimator at the paper's size against a plain GTSAM script: 11 vehicles, 3,025 poses each,
4,620 ranges.

Run with ``python benchmarks/bench_solve.py``. No ocean is needed: floats drift by a random walk and
dive as the paper's do; refraction is a made-up error of 30 m. The script loops over the same
measurements, adds GTSAM's factors one by one and optimises with GTSAM's own optimizers, by
Gauss-Newton until a step is as small as ours has to be and by Levenberg-Marquardt until the cost
stands still. Accuracy is the largest distance of a pose from the optimum of the script, iterated on
until a step is 1e-8 m. All take turns; medians, and the CPU time of the process beside the wall
clock, which other work on the machine disturbs more. Cold is a first realization; warm is a later
one, which has starting values and noise models or an ordering from before.

``--sizes`` prints time and memory of missions of 1e3 to 1e6 poses. ``--regions`` runs both of the
paper's studies as well, 25 realizations under two conditions each, on two workers.
"""

import argparse
import os
import resource
import statistics
import tempfile
import time
from collections import defaultdict
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import plain_gtsam

from pymantaray.apps.study import run_study
from pymantaray.apps.study.realization import RealizationSolver
from pymantaray.config import load_study
from pymantaray.estimation import GraphSolver, SolveOptions, build_graph, solve_conditions
from pymantaray.estimation.graph.graph import GraphValues
from pymantaray.geometry.se3 import quaternion_from_matrix, se3_exp, so3_log
from pymantaray.records import Measurements, RayStatus, SolveStatus

CONDITIONS = ("straight", "refracted")
STEP = SolveOptions().step_tolerance
PLAIN = (
    ("plain Gauss-Newton", plain_gtsam.gauss_newton, STEP),
    ("plain Levenberg-Marquardt 1e-8", plain_gtsam.levenberg_marquardt, 1e-8),
    ("plain Levenberg-Marquardt 1e-14", plain_gtsam.levenberg_marquardt, 1e-14),
)
PERIOD, N_TIMES, SPEED = 200.0, 3025, 0.5
TARGETS = np.array([0.5, 500, 2000, 750, 2250, 1500, 250, 2500, 1000, 1750, 1250])


def fleet(
    rng: np.random.Generator, *, turn: float, n_times: int = N_TIMES
) -> tuple[np.ndarray, np.ndarray]:
    """
    True positions and rotation matrices; ``turn`` is the sigma of the heading's random walk [rad].
    """
    clock = np.arange(n_times) * PERIOD
    position = np.empty((TARGETS.size, n_times, 3))
    for a, target in enumerate(TARGETS):
        dive = target / SPEED
        phase = (clock + rng.uniform(0, 26 * 3600)) % (25 * 3600 + 2 * dive)
        depth = np.interp(
            phase, [0, dive, dive + 24 * 3600, 2 * dive + 24 * 3600], [0.5, target, target, 0.5]
        )
        position[a, :, 2] = depth
    drift = np.cumsum(rng.normal(0, 0.003, (TARGETS.size, n_times, 2)), axis=1)
    position[..., :2] = np.cumsum(drift, axis=1) * 5.0
    position[0, :, :2] = 0.0
    grid = np.array([[x, y] for x in (-4e3, 0, 4e3) for y in (-4.5e3, -1.5e3, 1.5e3, 4.5e3)])[:11]
    position[1:, :, :2] += (grid[grid.any(axis=1)][:10] + rng.normal(0, 100, (10, 2)))[:, None]
    heading = np.cumsum(rng.normal(0, turn, (TARGETS.size, n_times)), axis=1)
    rotation, _ = se3_exp(
        np.stack([0 * heading, 0 * heading, heading, *[0 * heading] * 3], axis=-1)
    )
    return position, rotation


def observe(position: np.ndarray, rotation: np.ndarray, rng: np.random.Generator) -> Measurements:
    """Measurements with the paper's noise levels."""
    n, n_times = position.shape[:2]
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
    vehicle, sample = np.nonzero(position[..., 2] < 1.0)
    epoch = np.arange(72, n_times, 72)
    pairs = np.array([(i, j) for i in range(n) for j in range(n) if i != j])
    transmitter, receiver = np.tile(pairs, (epoch.size, 1)).T
    at = np.repeat(epoch, len(pairs))
    distance = np.linalg.norm(position[transmitter, at] - position[receiver, at], axis=1)
    noise = rng.standard_normal(at.size)
    heard = rng.random(at.size) > 0.01
    return Measurements(
        name=list("ABCDEFGHIJK"),
        time=np.arange(n_times) * PERIOD,
        odometry_rotation=quaternion_from_matrix(step @ noise_rotation),
        odometry_translation=moved,
        odometry_sigma=sigma,
        depth=position[..., 2] + rng.normal(0, 0.01, position.shape[:2]),
        depth_sigma=np.full(n, 0.01),
        gnss_vehicle=vehicle,
        gnss_sample=sample,
        gnss_position=position[vehicle, sample] + rng.normal(0, 0.1, (vehicle.size, 3)),
        gnss_sigma=np.full(vehicle.size, 0.1),
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
        transmitter_sound_speed=np.full(at.size, 1450.0),
        straight_range=distance + noise,
        refracted_range=np.where(heard, distance + noise + rng.normal(-5.0, 30.0, at.size), np.nan),
        range_sigma=np.ones(at.size),
    )


def ours(o, condition, initial, solver) -> tuple[np.ndarray, int]:
    solution = solver.solve(
        build_graph(o, condition), initial, model_is_right=condition == "straight"
    )
    assert solution.status == SolveStatus.OK
    return solution.position, solution.iterations


def timed(function, *arguments, **keywords):
    wall, cpu = time.perf_counter(), time.process_time()
    result = function(*arguments, **keywords)
    return result, (time.perf_counter() - wall, time.process_time() - cpu)


def compare(realizations: int, turn: float) -> None:
    """Measure a realization under both conditions, ours and plain, and print medians."""
    position, rotation = fleet(np.random.default_rng(0), turn=turn)
    truth = position, quaternion_from_matrix(rotation)
    initial = GraphValues(
        position=truth[0].reshape(-1, 3),
        quaternion=truth[1].reshape(-1, 4),
        landmark_position=np.zeros((0, 3)),
    )
    values, solver = plain_gtsam.start(truth), GraphSolver()
    solve_conditions(
        observe(position, rotation, np.random.default_rng(0)), CONDITIONS, truth, solver=solver
    )
    rows, both, sums = defaultdict(list), [], []
    for realization in range(realizations):
        o = observe(position, rotation, np.random.default_rng(1 + realization))
        of_both = []
        for condition in CONDITIONS:
            tight, _ = plain_gtsam.solve(
                o, condition, truth, plain_gtsam.gauss_newton, 1e-8, values
            )
            jobs = {
                "ours, cold": lambda o, c: ours(o, c, initial, GraphSolver()),
                "ours, warm": lambda o, c: ours(o, c, initial, solver),
            }
            for name, method, tolerance in PLAIN:
                for when, v in (("cold", None), ("warm", values)):
                    jobs[f"{name}, {when}"] = lambda o, c, m=method, t=tolerance, v=v: (
                        plain_gtsam.solve(o, c, truth, m, t, v)
                    )
            for name in np.roll(list(jobs), 3 * realization):
                (found, steps), seconds = timed(jobs[name], o, condition)
                rows[condition, name].append(
                    (*seconds, steps, np.linalg.norm(found - tight, axis=1).max())
                )
            of_both.append(rows[condition, f"{PLAIN[0][0]}, warm"][-1][:2])
        both.append(timed(solve_conditions, o, CONDITIONS, truth, solver=solver)[1])
        sums.append(np.sum(of_both, axis=0))
    print(
        f"{'condition':10} {'build and solve':32} {'wall [s]':>9} {'CPU [s]':>8} {'steps':>6}"
        f" {'off [m]':>8}"
    )
    table = {
        key: (*np.median(row, axis=0)[:3], max(r[3] for r in row)) for key, row in rows.items()
    }
    for (condition, name), (wall, cpu, steps, off) in table.items():
        print(f"{condition:10} {name:32} {wall:9.2f} {cpu:8.2f} {steps:6.0f} {off:8.1e}")
    for condition in CONDITIONS:
        for when in ("cold", "warm"):
            rivals = [v for (c, n), v in table.items() if c == condition and n.endswith(when)]
            mine = table[condition, f"ours, {when}"]
            best = min((v for v in rivals if v is not mine and v[3] <= 1e-5), key=lambda v: v[1])
            print(
                f"{condition}, {when}: {mine[0] / best[0]:.2f} (wall), {mine[1] / best[1]:.2f}"
                " (CPU) times the fastest script that is within 1e-5 m"
            )
    wall, cpu = (
        statistics.median(b[i] / s[i] for b, s in zip(both, sums, strict=True)) for i in (0, 1)
    )
    print(
        f"solve_conditions, both, warm: {np.median(both, axis=0)[0]:.2f} s (CPU"
        f" {np.median(both, axis=0)[1]:.2f} s), {wall:.2f} (wall), {cpu:.2f} (CPU) times the plain"
        " Gauss-Newton scripts"
    )


def sizes() -> None:
    """
    Print what a solve takes against the number of poses: missions of 11 vehicles, longer and
    longer.
    """
    print(f"{'poses':>9} {'ranges':>8} {'CPU [s]':>8} {'steps':>6} {'peak memory [GiB]':>18}")
    for n_times in (100, 300, 1000, 3025, 10_000, 30_000, 100_000):
        position, rotation = fleet(np.random.default_rng(0), turn=0.0, n_times=n_times)
        o = observe(position, rotation, np.random.default_rng(1))
        start = GraphValues(
            position.reshape(-1, 3),
            quaternion_from_matrix(rotation).reshape(-1, 4),
            np.zeros((0, 3)),
        )
        graph = build_graph(o, "straight")
        GraphSolver().solve(graph, start)  # compiles
        solution, (_, cpu) = timed(GraphSolver().solve, graph, start)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        ranges = len(graph["range"])
        print(
            f"{graph.n_poses:9d} {ranges:8d} {cpu:8.2f} {solution.iterations:6d} {peak:18.2f}",
            flush=True,
        )


def regions(workers: int) -> None:
    """Run both studies and print how long they took."""
    solving, total = 0.0, 0.0
    for name in ("beaufort", "fram"):
        config = load_study(name)
        study = config.study.model_copy(update={"conditions": CONDITIONS})
        with tempfile.TemporaryDirectory() as folder:
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            run, (wall, _) = timed(
                run_study,
                config.model_copy(update={"study": study}),
                Path(folder) / name,
                workers=workers,
            )
            seconds = run.manifest["seconds"]
            e = run.estimates
            cpu = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
            usable = np.isin(
                e.solve_status, [status for status in SolveStatus if status.usable]
            ).sum()
            solver = RealizationSolver(run)
            first, *later = (timed(solver.solve, n)[1][1] for n in range(6))
        solving, total = solving + seconds["realizations"], total + wall
        print(
            f"{name}: {seconds['realizations']:.0f} s for {e.solve_status.size} solves ({usable}"
            f" usable) on {workers} workers (CPU {cpu:.0f} s), {wall:.0f} s with mission, rays and"
            f" files; one realization, perturbed, solved twice, covariances and all, {first:.2f} s"
            f" of CPU at first, {statistics.median(later):.2f} s later; load"
            f" {os.getloadavg()[0]:.1f}"
        )
    print(f"both regions: {solving:.0f} s, {total:.0f} s with mission, rays and files")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--realizations", type=int, default=3)
    parser.add_argument(
        "--turn", type=float, default=0.0, help="sigma of the heading's random walk [rad]"
    )
    parser.add_argument(
        "--regions", action="store_true", help="run both of the paper's studies, too"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--sizes", action="store_true", help="time and memory against poses, nothing else"
    )
    arguments = parser.parse_args()
    if arguments.sizes:
        sizes()
        return
    compare(arguments.realizations, arguments.turn)
    if arguments.regions:
        regions(arguments.workers)


if __name__ == "__main__":
    main()
