"""
Planned errors of designs, compared with full studies of the same designs: values, order and the
designs on the front.

    python benchmarks/bench_plan.py [--designs sample|front] [--realizations 25] [--folder FOLDER]

`sample` draws 20 random designs: place and depth of a receiver, ping interval, standard deviation
of ranges and knowledge of the water. `front` takes all 20 combinations of none to three receivers
with five ping intervals, whose costs differ. All designs change the preset `quick`. The plan
evaluates them without realizations. A sweep runs their studies; their errors come from the records
of the runs: positions of vehicles under water at the pings. `--folder` keeps the studies, and
resumes them. Standard errors are bootstraps over realizations.
"""

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import kendalltau
from scipy.stats.qmc import LatinHypercube

from pymantaray.apps.plan import DeploymentPlan, PlanResults, PlanSection, search_designs
from pymantaray.apps.plan.evaluate import DesignEvaluator
from pymantaray.apps.plan.results import pareto_front
from pymantaray.apps.study import open_run
from pymantaray.apps.sweep import Sweep, run_sweep
from pymantaray.apps.sweep.plan import SweepPlan
from pymantaray.config import load_study
from pymantaray.records import VehicleStatus

RECEIVERS = [
    {"name": "T", "north": 2500.0, "east": 4500.0, "depth": 100.0, "sigma": 2.0},
    {"name": "U", "north": -2500.0, "east": -4500.0, "depth": 100.0, "sigma": 2.0},
    {"name": "V", "north": 2500.0, "east": -4500.0, "depth": 100.0, "sigma": 2.0},
]
MEAN = {"kind": "mean-slowness", "belief": "mean"}
SAMPLE: dict[str, Any] = {
    "landmarks.T.north": {"from": -4000.0, "to": 4000.0},
    "landmarks.T.east": {"from": -6000.0, "to": 6000.0},
    "landmarks.T.depth": {"from": 1.0, "to": 500.0},
    "mission.ping_interval_h": [1.0, 1.5, 2.0, 3.0, 4.0, 6.0],
    "noise.range_sigma": [0.5, 1.0, 3.0, 10.0],
    "conditions.assumed.range_model": ["transmitter", MEAN],
}
"""Values and limits of the free keys of the random designs."""
FRONT: dict[str, Any] = {
    "landmarks": [RECEIVERS[:count] for count in range(4)],
    "mission.ping_interval_h": [1.0, 2.0, 3.0, 4.0, 6.0],
}
PARTS = ("sample", "front")
COSTS = {"landmark": 50.0, "ping": 1.0}
SCORES = {"rmse": "RMSE", "error": "95 % error"}
RESAMPLES = 500


def plan_of(free: dict[str, Any], realizations: int) -> DeploymentPlan:
    """Plan whose base is the preset quick with one receiver and one condition."""
    condition = {"name": "assumed", "range_model": MEAN}
    base = load_study(
        "quick", realizations=realizations, conditions=[condition], landmarks=RECEIVERS[:1]
    )
    return DeploymentPlan(base, PlanSection(free=free, costs=COSTS, objectives=("error", "cost")))


def random_designs(realizations: int, count: int = 20, seed: int = 1) -> PlanResults:
    """Random designs, which fill the space of the free keys evenly, with their expected errors."""
    plan = plan_of(SAMPLE, realizations)
    evaluate = DesignEvaluator(plan)
    points = LatinHypercube(len(SAMPLE), rng=np.random.default_rng(seed)).random(count)
    designs = [
        {key: at(v, x) for (key, v), x in zip(SAMPLE.items(), row, strict=True)} for row in points
    ]
    return PlanResults(plan, designs, [evaluate(design) for design in designs], evaluate({}))


def at(values: Any, share: float) -> Any:
    """Value of a key at a share of its list or its range, rounded to a metre."""
    if isinstance(values, list):
        return values[int(share * len(values))]
    return float(round(values["from"] + share * (values["to"] - values["from"])))


def studied(results: PlanResults, folder: Path) -> list[np.ndarray]:
    """
    Sizes of the position errors of each design, shape (realizations, pings and vehicles under
    water).
    """
    table: dict[str, Any] = {key: [d[key] for d in results.designs] for key in results.plan.keys}
    table |= {"name": "design", "labels": list(range(len(results.designs)))}
    sweep = Sweep(results.plan.base, zipped=[table])
    run_sweep(sweep, folder, workers=1, studies=True)
    keys = {number: key for key, number in SweepPlan(sweep).points.items()}
    return [
        errors_at_pings(folder / "studies" / keys[number]) for number in range(len(results.designs))
    ]


def errors_at_pings(folder: Path) -> np.ndarray:
    """Sizes of position errors of active vehicles without a GNSS fix at the pings of a run. [m]"""
    run = open_run(folder)
    truth, m, position = run.truth, run.measurements, run.estimates.position[0]
    under = truth.status == VehicleStatus.ACTIVE
    under[m.gnss_vehicle, m.gnss_sample] = False
    samples = np.unique(m.range_sample)
    error = np.linalg.norm(position - truth.position, axis=-1)[..., samples]
    return error[:, under[:, samples]]


def score(errors: np.ndarray, name: str) -> float:
    """Root mean square, or 95 % quantile. [m]"""
    return float(np.sqrt(np.mean(errors**2)) if name == "rmse" else np.quantile(errors, 0.95))


def resampled(errors: list[np.ndarray], name: str) -> np.ndarray:
    """
    Scores of studies with resampled realizations, the same ones for all designs, shape (RESAMPLES,
    n_designs).
    """
    count, rng = len(errors[0]), np.random.default_rng(1)
    draws = rng.integers(0, count, (RESAMPLES, count))
    return np.array([[score(design[draw], name) for design in errors] for draw in draws])


def print_scores(results: PlanResults, errors: list[np.ndarray], name: str) -> None:
    """Table of one score of all designs, and the agreement of their order."""
    names = {key: key.rpartition(".")[2] for key in results.plan.keys}
    table = pd.DataFrame([{key: words(value) for key, value in d.items()} for d in results.designs])
    plan, draws = results.frame[f"{name}_m"].to_numpy(), resampled(errors, name)
    study = np.array([score(design, name) for design in errors])
    error = draws.std(axis=0, ddof=1)
    difference = 100.0 * (plan / study - 1.0)
    columns = {
        "planned [m]": plan,
        "study [m]": study,
        "SE [m]": error,
        "difference [%]": difference,
    }
    table = table.rename(columns=names).assign(**columns).sort_values("study [m]")
    with pd.option_context("display.width", 250, "display.max_columns", None):
        print(
            f"\n{SCORES[name]}\n{table.to_string(index=False, float_format=lambda x: f'{x:.2f}')}"
        )
    again = [tau(a, b) for a, b in zip(draws[::2], draws[1::2], strict=True)]
    low, median = np.quantile(again, [0.05, 0.5])
    print(f"Kendall's tau of plan and study: {tau(plan, study):.3f}")
    print(
        f"Kendall's tau of two studies with different noise: median {median:.3f}, 5 % quantile"
        f" {low:.3f}"
    )
    print(
        f"differences: {difference.min():.1f} to {difference.max():.1f} %, median size"
        f" {np.median(abs(difference)):.1f} %; standard errors of the studies:"
        f" {100 * min(error / study):.1f} to {100 * max(error / study):.1f} %"
    )


def words(value: Any) -> Any:
    """Value in a table; the kind of a range model, and the number of receivers."""
    return (
        value["kind"]
        if isinstance(value, dict)
        else len(value)
        if isinstance(value, list)
        else value
    )


def tau(a: np.ndarray, b: np.ndarray) -> float:
    """Kendall's rank correlation."""
    return float(kendalltau(a, b).statistic)


def print_front(results: PlanResults, errors: list[np.ndarray]) -> None:
    """Designs on the front of error and cost, in the plan and in the studies."""
    study = np.array([score(design, "error") for design in errors])
    cost, plan = results.frame["cost"].to_numpy(), results.frame["error_m"].to_numpy()
    front = np.flatnonzero(results.front)
    front = front[np.argsort(plan[front])]
    print("\nFront of 95 % error and cost")
    for k in front:
        print(f"cost {cost[k]:.0f}: planned {plan[k]:.2f} m, study {study[k]:.2f} m")
    same = np.array_equal(results.front, pareto_front(np.stack([study, cost], axis=1)))
    print(f"order in the studies: {'the same' if np.all(np.diff(study[front]) > 0) else 'another'}")
    print(f"designs on the front of the studies: {'the same' if same else 'others'}")


def cpu() -> float:
    """CPU time of this process and of workers that have ended. [s]"""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main() -> None:
    """Compare planned and studied designs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--designs", choices=PARTS, help="Default: both.")
    parser.add_argument("--realizations", type=int, default=25)
    parser.add_argument("--folder", type=Path, help="Folder of the studies, which are kept.")
    options = parser.parse_args()
    for part in [options.designs] if options.designs else PARTS:
        before = cpu()
        results = (
            random_designs(options.realizations)
            if part == "sample"
            else search_designs(plan_of(FRONT, options.realizations), workers=1)
        )
        after = cpu()
        with tempfile.TemporaryDirectory() as temporary:
            errors = studied(results, (options.folder or Path(temporary)) / part)
        print(f"\nDesigns: {part}")
        for name in SCORES:
            print_scores(results, errors, name)
        print_front(results, errors)
        print(f"CPU time: plan {after - before:.0f} s, studies {cpu() - after:.0f} s", flush=True)


if __name__ == "__main__":
    main()
