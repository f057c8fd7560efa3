"""
Time that range models take, and where they end: outer iterations against a plain solve of the same
graph.

``NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 python benchmarks/bench_range_models.py`` measures one core;
the first, untimed mission compiles the solver. "Extra" is in plain solves: what a model takes
beyond the plain solve, rays included.
"""

import argparse
import statistics
import time

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.config import load_study
from pymantaray.config.door.study import build_study
from pymantaray.estimation import ClockPrior, Estimator, GraphSolver, MeanSlowness, solve_conditions
from pymantaray.ocean.modes import vertical_modes
from pymantaray.range_models.eigenray_model import AdjustableEigenrays, EigenrayModel
from pymantaray.range_models.ray_uncertainty import RayUncertainty
from pymantaray.sensing import perturb


def timed(function, *arguments, **keywords):
    begin = time.perf_counter()
    result = function(*arguments, **keywords)
    return result, time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", default="beaufort")
    parser.add_argument("--realizations", type=int, default=3)
    arguments = parser.parse_args()
    config = load_study(arguments.study)
    mission = simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
    medium = Medium.from_dataset(mission.ocean.local, interpolation=config.acoustics.interpolation)
    truth = mission.truth.position, mission.truth.quaternion
    profile = medium.sound_speed.mean(axis=(0, 1))
    modes = vertical_modes(mission.ocean.geographic)
    covariance = modes.covariance(20e3)
    shared = EigenrayModel(medium, spreading_cutoff_db=config.acoustics.cutoff_db)

    shapes, sigma = modes.modes[:4], np.sqrt(modes.variance[:4])

    def joint(**options):
        rays = EigenrayModel(medium, spreading_cutoff_db=config.acoustics.cutoff_db)
        water = AdjustableEigenrays(rays, modes.depth, shapes, sigma)
        return Estimator("refracted", "refracted", water, initial=truth, **options)

    def eigenray(start, *, correlated=None, model=None):
        model = model or EigenrayModel(medium, spreading_cutoff_db=config.acoustics.cutoff_db)
        uncertainty = None if correlated is None else RayUncertainty(model, covariance)
        return Estimator("refracted", "refracted", model, uncertainty, bool(correlated), start)

    makers = {
        "mean-slowness from truth": lambda: Estimator(
            "refracted", "refracted", MeanSlowness(medium.depth, profile), initial=truth
        ),
        "eigenray from truth": lambda: eigenray(truth),
        "eigenray from truth, rays of the start kept": lambda: eigenray(truth, model=shared),
        "eigenray from truth, per-link": lambda: eigenray(truth, correlated=False),
        "eigenray from truth, correlated": lambda: eigenray(truth, correlated=True),
        "eigenray from truth, 4 modes": joint,
        "eigenray from truth, 4 modes and all clocks": lambda: joint(clocks=ClockPrior(1e-3, 1e-8)),
        "eigenray from dead reckoning": lambda: eigenray(None),
    }
    solver, rows = GraphSolver(), []
    for realization in range(-1, arguments.realizations):
        o = perturb(
            mission.measurements, root_seed=config.study.seed, realization=max(realization, 0)
        )
        plain, base = timed(solve_conditions, o, ["straight"], truth, solver=solver)
        found = {"straight, plain": (base, plain["straight"])}
        for name, make in makers.items():
            estimators = {"e": make()}
            solved, seconds = timed(solve_conditions, o, estimators, solver=solver)
            found[name] = seconds, solved["e"]
        if realization < 0:  # compiles, and fills the caches
            continue
        near = found["eigenray from truth"][1].position
        for name, (seconds, s) in found.items():
            rows.append(
                (name, seconds, (seconds - base) / base, s, np.abs(s.position - near).max())
            )
    print(
        f"{'model':46} {'median [s]':>10} {'extra':>6} {'steps':>5} {'asked':>5} {'gated':>5}"
        f" {'status':>8} {'off [m]':>9}"
    )
    for name in dict.fromkeys(row[0] for row in rows):
        mine = [row for row in rows if row[0] == name]
        s = mine[0][3]
        print(
            f"{name:46} {statistics.median(r[1] for r in mine):10.2f}"
            f" {statistics.median(r[2] for r in mine):6.2f} {max(r[3].iterations for r in mine):5d}"
            f" {max(r[3].expansions for r in mine):5d} {max(r[3].gated_links for r in mine):5d}"
            f" {s.status.name:>8} {max(r[4] for r in mine):9.1e}"
        )


if __name__ == "__main__":
    main()
