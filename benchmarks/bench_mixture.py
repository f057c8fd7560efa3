"""
Measure the mixture of arrivals in studies whose receivers take wrong arrivals, over many
realizations.

Run with ``python benchmarks/bench_mixture.py``. The study `quick` is the preset; in `surface` four
vehicles are at or near the surface (`factories.TINY` of the tests). Both have two surface bounces,
one bottom bounce and ``mistaken = "strongest-detected"``. Each row has the root mean square error
at the pings, its ratio to that of straight ranges, the ratio of the standard deviations that the
covariances give, and NEES, with standard errors from a jackknife over realizations.
"""

import argparse
import copy
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from factories import TINY

from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.apps.study.store import Run, run_in_memory
from pymantaray.config import parse_study
from pymantaray.config.door.estimators import EstimatorFactory
from pymantaray.config.door.study import build_study
from pymantaray.estimation import GraphSolution, solve_conditions
from pymantaray.evaluation.bound import ping_samples, submerged_at_pings

Row = dict[str, float]  # numbers of one realization and condition
MULTIPATH = {
    "acoustics": {"max_surface_bounces": 2, "max_bottom_bounces": 1},
    "ranging": {"mistaken": "strongest-detected"},
}


def mixture(**options: object) -> dict[str, object]:
    """Keys of a condition with a mixture in the true ocean, or in one that is 0.5 m/s too fast."""
    belief: object = "exact"
    if options.pop("off", False):
        belief = {"kind": "offset", "sound_speed": [0.5]}
    model = {"kind": "mixture", "belief": belief} | dict(options.pop("model", {}))  # type: ignore[call-overload]
    return {"range_model": model, "start": "dead-reckoning"} | options


CONDITIONS = {
    "straight": {"ranges": "straight", "range_model": "transmitter"},
    "mixture": mixture(),
    "off": mixture(off=True),
    "off-sigma": mixture(off=True, model={"sound_speed_sigma": 0.5}),
    "off-scale": mixture(off=True, scale_sigma=3.5e-4),
}


def flown(name: str, conditions: list[str], realizations: int) -> Run:
    """Mission of a study, without estimates."""
    tree = copy.deepcopy(TINY) if name == "surface" else {"base": "quick"}
    for section, keys in (MULTIPATH | {"study": {"realizations": realizations}}).items():
        tree[section] = tree.get(section, {}) | keys
    tree["conditions"] = [{"name": c} | CONDITIONS[c] for c in conditions]
    config = parse_study(tree, name)
    return run_in_memory(
        build_study(config), simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
    )


def numbers(run: Run, solution: GraphSolution) -> Row:
    """Mean square errors at the pings, NEES over its dimension, and cost of a solution."""
    m, truth = run.measurements, run.truth
    samples, under = ping_samples(m), submerged_at_pings(truth, m)
    error = (solution.position - truth.position)[:, samples].swapaxes(0, 1)
    square = np.sum(error**2, axis=-1)
    expected = np.einsum("kvivi->kv", solution.covariances.position)
    nees = []
    for k, there in enumerate(under):
        e = error[k, there].ravel()
        covariance = solution.covariances.position[k][there][:, :, there].reshape(e.size, e.size)
        nees.append(e @ np.linalg.solve(covariance, e) / e.size)
    return {
        "all": np.mean(square),
        "under water": np.mean(square[under]),
        "expected, all": np.mean(expected),
        "expected, under water": np.mean(expected[under]),
        "nees": np.mean(nees),
        "cost": solution.final_cost,
        "usable": solution.usable,
        "seconds": solution.seconds,
    }


def jackknife(statistic: Callable[[np.ndarray], float], columns: np.ndarray) -> tuple[float, float]:
    """
    Return a statistic of columns (n_realizations, ...) and its standard error; NaN for one
    realization.
    """
    n = len(columns)
    each = [statistic(np.delete(columns, k, axis=0)) for k in range(n)] if n > 1 else [np.nan]
    return statistic(columns), float(np.sqrt((n - 1) / n * np.sum((each - np.mean(each)) ** 2)))


def show(name: str, rows: dict[str, list[Row]]) -> None:
    """Print the row of each condition."""
    print(
        f"\n| {name}, {len(rows['straight'])} realizations | all vehicles [m] | under water [m] |"
        " ratio, all | ratio, under water"
        " | expected ratio, all | expected ratio, under water | NEES | usable | CPU [s] |"
    )
    print(f"|{'---|' * 10}")

    def column(condition: str, key: str) -> np.ndarray:
        return np.array([row[key] for row in rows[condition]], dtype=float)

    def root(x: np.ndarray) -> float:
        return float(np.sqrt(np.mean(x)))

    def ratio(x: np.ndarray) -> float:
        return root(x[:, 0]) / root(x[:, 1])

    for condition in rows:
        places = "all", "under water", "expected, all", "expected, under water"
        pairs = [
            np.stack([column(c, key) for c in (condition, "straight")], axis=1) for key in places
        ]
        cells = [jackknife(root, column(condition, key)) for key in places[:2]]
        cells += [jackknife(ratio, pair) for pair in pairs]
        cells.append(jackknife(lambda x: float(np.mean(x)), column(condition, "nees")))
        texts = [f"{value:.2f} ± {error:.2f}" for value, error in cells]
        texts.append(f"{100.0 * np.mean(column(condition, 'usable')):.0f} %")
        print(
            f"| `{condition}` | {' | '.join(texts)} | {np.median(column(condition, 'seconds')):.1f}"
            " |",
            flush=True,
        )


def main() -> None:
    """Print the table of each study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--studies", nargs="*", default=["surface", "quick"], choices=("surface", "quick")
    )
    parser.add_argument(
        "--conditions", nargs="*", default=list(CONDITIONS), choices=tuple(CONDITIONS)
    )
    parser.add_argument("--realizations", type=int, default=25)
    parser.add_argument(
        "--seconds", type=float, default=np.inf, help="stop each study after this time"
    )
    arguments = parser.parse_args()
    names = ["straight", *(c for c in arguments.conditions if c != "straight")]
    for study in arguments.studies:
        begin, run = time.monotonic(), flown(study, names, arguments.realizations)
        factory, rows = EstimatorFactory(run), {name: [] for name in names}
        sections = {c.name: c for c in run.config.conditions}
        for k in range(arguments.realizations):
            m = run.noisy_measurements(k)
            solved = solve_conditions(
                m,
                {name: factory.estimator(sections[name], k) for name in names},
                covariance_samples=ping_samples(m),
            )
            for name, solution in solved.items():
                rows[name].append(numbers(run, solution))
            own = ", ".join(
                f"{name} {np.sqrt(r[-1]['all']):.2f} m (cost {r[-1]['cost']:.1f})"
                for name, r in rows.items()
            )
            print(f"{study} {k}: {own}", file=sys.stderr, flush=True)
            if time.monotonic() - begin > arguments.seconds:
                break
        show(study, rows)


if __name__ == "__main__":
    main()
