"""
Definitions of the tables of a run, in the order of the page. Terminal, notebooks, `run.tables`,
report and sweeps use them.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pymantaray.apps.study.graphs import noisy_graphs
from pymantaray.config.settings import NOISE, TIMING, settings_table
from pymantaray.errors import EstimationError
from pymantaray.estimation import CONDITIONS, GraphValues
from pymantaray.estimation.solvers.influence import MEASURES, factor_influence, worst_factors
from pymantaray.evaluation import (
    attitude_table,
    bound_table,
    comparison_table,
    consistency_summary,
    consistency_table,
    coverage_table,
    directions_table,
    dropout_table,
    error_table,
    ping_error_table,
    range_error_table,
    range_split_table,
    unknowns_table,
)
from pymantaray.records import Estimates, SharedUnknowns, SolveStatus
from pymantaray.records.result_table import ResultTable

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run

_ERRORS = "mean_m median_m rmse_m rmse_standard_error_m p5_m p25_m p75_m p95_m max_m"
_BRIEF_ERRORS = "mean_m median_m rmse_m rmse_standard_error_m p95_m"
SUMMARY = ("dropouts", "range_error", "ate_pooled", "ping_error")
"""Tables that a command prints and a notebook shows after a run."""
OF_MISSION = ("bound",)
"""Tables that take time and do not depend on the realizations."""
_INFLUENTIAL = ("fix", "survey", "range")
_MOST_INFLUENTIAL = 10  # of each measure


@dataclass(frozen=True)
class TableDefinition:
    """
    Table of every run that has its data; column names end with their units, ``_m``, ``_s``, ``_h``,
    ``_deg``.
    """

    caption: str
    make: "Callable[[Run], pd.DataFrame]"
    needs: "Callable[[Run], bool]" = lambda _: True
    columns: str = ""  # shown to people; by default all
    brief: str = ""  # in the terminal and in notebooks
    folded: bool = False  # a page shows only the caption until a click
    # heads of columns that have another meaning in other tables
    words: Mapping[str, str] = field(default_factory=dict)
    by_row: bool = False  # the numbers of a row are one quantity
    paper: str = ""  # counterpart in the paper


class RunTables(Mapping[str, ResultTable]):
    """
    Tables of a run by name, in the order of the page; each is computed at its first use.

    Parameters
    ----------
    run : Run
    """

    def __init__(self, run: "Run") -> None:
        self._run, self._made = run, dict[str, ResultTable]()

    def __getitem__(self, name: str) -> ResultTable:
        if name not in self:
            raise KeyError(f"{name!r}; this run has {', '.join(self)}")
        if name not in self._made:
            what = TABLES[name]
            self._made[name] = ResultTable(
                name,
                what.make(self._run),
                what.caption,
                columns=what.columns.split(),
                brief=what.brief.split(),
                words=what.words,
                by_row=what.by_row,
                folded=what.folded,
                paper=what.paper,
            )
        return self._made[name]

    def use(self, tables: Mapping[str, ResultTable]) -> None:
        """Use tables of the same run that were computed before it was finished."""
        self._made.update(tables)

    def __contains__(self, name: object) -> bool:
        return name in TABLES and TABLES[str(name)].needs(self._run)

    def __iter__(self) -> Iterator[str]:
        return (name for name in TABLES if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f"<RunTables: {', '.join(self)}>"


def solve_table(estimates: Estimates) -> pd.DataFrame:
    """
    Status, iterations and costs of every solve; ``expected_cost`` is half the degrees of freedom.
    """
    e = estimates
    c, r = (index.ravel() for index in np.indices(e.solve_status.shape))
    columns = {
        "condition": e.condition[c],
        "realization": e.realization[r],
        "status": [SolveStatus(int(status)).name for status in e.solve_status.ravel()],
    }
    numbers = [
        "iterations",
        "initial_cost",
        "final_cost",
        "expected_cost",
        "gradient_norm",
        "gated_links",
    ]
    return pd.DataFrame(columns | {name: np.asarray(getattr(e, name)).ravel() for name in numbers})


def cost_table(run: "Run") -> pd.DataFrame:
    """
    Settings of each condition, its seed, the CPU time of its solves, and the distance of GTSAM from
    the batch solver.
    """
    apart = run.manifest.get("from_batch_m", {})
    own = {c.name: c.settings for c in run.study.conditions}
    rows = []
    for name, seconds in run.manifest.get("solve_cpu_seconds", {}).items():
        settings = own.get(name)
        rows.append(
            {
                "condition": name,
                "settings": json.dumps(settings) if settings else "-",
                "seed": run.study.seed,
                "realizations": len(seconds),
                "cpu_median_s": float(np.median(seconds)),
                "cpu_total_s": float(np.sum(seconds)),
                **({"from_batch_m": max(apart[name])} if name in apart else {}),
            }
        )
    return pd.DataFrame(rows)


def _errors(run: "Run", *by: str) -> pd.DataFrame:
    """Position errors by condition, and by vehicle or realization, with standard errors."""
    return error_table(run.truth, run.estimates, by=by, freedom=run.degrees_of_freedom)


def _consistency(run: "Run", *, by_vehicle: bool = False) -> pd.DataFrame:
    """Consistency at each epoch, of the fleet or of each vehicle."""
    assert run.covariances is not None
    return consistency_table(run.truth, run.estimates, run.covariances, by_vehicle=by_vehicle)


def _unknowns(run: "Run") -> SharedUnknowns:
    assert run.unknowns is not None
    return run.unknowns


def _coverage(run: "Run") -> pd.DataFrame:
    assert run.covariances is not None
    return coverage_table(run.truth, run.estimates, run.covariances)


def _region(run: "Run") -> pd.DataFrame:
    """Region of the run, whose texts that are numbers become numbers."""
    return run.region.reset_index().astype(object).map(_number)


def _number(value: object) -> object:
    if not isinstance(value, str):
        return value
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value


def _solves(run: "Run") -> bool:
    """True if the run has estimates, not ranges alone."""
    return run.study.solves


def _has_covariances(run: "Run") -> bool:
    return run.study.solves and run.covariances is not None


def _has_range_graphs(run: "Run") -> bool:
    standard = (c.name for c in run.study.conditions if c.standard)
    return run.study.solves and any(CONDITIONS[name].ranges is not None for name in standard)


def _has_unknowns(run: "Run") -> bool:
    return run.unknowns is not None


def _ranging_draws(run: "Run") -> pd.DataFrame:
    """Dropouts and range errors of all links, by realization."""
    assert run.ranging_draws is not None
    rows = []
    for realization in range(run.study.realizations):
        truth = run.ranging_truth_in(realization)
        m = run.ranging_draws.measurements(run.measurements, run.ranging_truth, realization)
        lost = dropout_table(m, run.truth).iloc[-1]
        error = range_error_table(m, truth, run.truth).iloc[-1]
        rows.append(
            {"realization": realization, **lost.drop("category"), **error.drop(["category", "n"])}
        )
    return pd.DataFrame(rows)


def influence_table(run: "Run") -> pd.DataFrame:
    """
    Fixes, surveys and ranges with the largest residual, leverage and Cook's distance in realization
    0, by condition.
    """
    noisy = run.noisy_measurements(0)
    estimates = run.estimates
    tables = []
    graphs = noisy_graphs(run, noisy)
    for row, condition in enumerate(estimates.condition.tolist()):
        position = estimates.position[row, 0].reshape(-1, 3)
        if condition not in graphs or not np.isfinite(position).all():  # the solve failed
            continue
        graph = graphs[condition]
        quaternion = estimates.quaternion[row, 0].reshape(-1, 4).astype(float)
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        values = GraphValues(position, quaternion, estimates.landmark_position[row, 0])
        try:
            influence = factor_influence(graph, values, kinds=_INFLUENTIAL)
        except EstimationError:
            continue
        for measure in MEASURES:
            worst = worst_factors(influence, measure, _MOST_INFLUENTIAL)
            tables.append(worst.assign(condition=condition, largest=measure))
    columns = ["condition", "largest", "kind", "first", "second", "time_s", *MEASURES]
    return (
        pd.concat(tables, ignore_index=True)[columns] if tables else pd.DataFrame(columns=columns)
    )


TABLES: dict[str, TableDefinition] = {
    "ate_pooled": TableDefinition(
        "Position error by condition, pooled over vehicles, times and realizations",
        lambda run: _errors(run),
        _solves,
        columns=f"condition failed_solves {_ERRORS}",
        brief=f"condition failed_solves {_BRIEF_ERRORS}",
    ),
    "ate_per_vehicle": TableDefinition(
        "Position error by condition and vehicle",
        lambda run: _errors(run, "vehicle"),
        _solves,
        columns=f"condition vehicle {_ERRORS}",
        brief=f"condition vehicle {_BRIEF_ERRORS}",
    ),
    "ping_error": TableDefinition(
        "Position error of vehicles under water at the pings, distance from the estimate with"
        " straight ranges, and bound of the RMSE of unbiased estimators, an expectation over the"
        " noise",
        lambda run: ping_error_table(
            run.truth, run.estimates, run.measurements, run.bounds, run.degrees_of_freedom
        ),
        _solves,
        brief="condition rmse_m rmse_standard_error_m median_m from_straight_rmse_m bound_rmse_m",
    ),
    "ate_difference": TableDefinition(
        "Difference of position error between conditions, 95 % intervals over realizations",
        lambda run: comparison_table(run.truth, run.estimates, root_seed=run.study.seed),
        _solves,
        columns="condition baseline statistic realizations pooled_difference_m bootstrap_low_m"
        " bootstrap_high_m",
    ),
    "consistency": TableDefinition(
        "Consistency: sums over realizations of NEES and of range innovations by their degrees of"
        " freedom, and at how many epochs they are inside their 95 % bounds",
        lambda run: consistency_summary(run.tables["consistency_per_epoch"].frame),
        _has_covariances,
    ),
    "unknowns": TableDefinition(
        "Sound-speed modes and clocks: prior and posterior standard deviation, fraction of the"
        " prior variance that the measurements remove, and errors",
        lambda run: unknowns_table(_unknowns(run)),
        _has_unknowns,
    ),
    "attitude": TableDefinition(
        "Errors of attitudes about the horizontal axes and about the vertical",
        lambda run: attitude_table(run.truth, run.estimates, run.degrees_of_freedom),
        lambda run: run.study.solves and run.measurements.attitude_vehicle.size > 0,
    ),
    "dropouts": TableDefinition(
        "Range attempts and dropouts by kind of link, and their causes",
        lambda run: dropout_table(run.measurements, run.truth),
        brief="category attempts dropouts percent",
        words={"percent": "dropouts [%]"},
        paper="Table IV",
    ),
    "ranging_draws": TableDefinition(
        "Dropouts and range errors of each realization, which has its own draw of rough ice. All"
        " other tables and figures of ranges are those of realization 0",
        _ranging_draws,
        lambda run: run.ranging_draws is not None,
        columns="realization attempts dropouts percent mean_m sd_m",
        words={"percent": "dropouts [%]"},
    ),
    "range_error": TableDefinition(
        "Signed range error, refracted minus straight, by kind of link",
        lambda run: range_error_table(run.measurements, run.ranging_truth, run.truth),
        columns="category n mean_m sd_m skewness excess_kurtosis p1_m p5_m p95_m p99_m min_m max_m"
        " percent_beyond_3_sigma",
        brief="category n mean_m sd_m p1_m p99_m",
    ),
    "range_error_split": TableDefinition(
        "Range error split into reference speed and bending",
        lambda run: range_split_table(run.measurements, run.ranging_truth, run.truth),
    ),
    "region": TableDefinition("Region", _region, by_row=True, paper="Table I"),
    "timing": TableDefinition(
        "Mission timing",
        lambda run: settings_table(run.config, TIMING),
        by_row=True,
        paper="Table II",
    ),
    "noise": TableDefinition(
        "Sensor noise",
        lambda run: settings_table(run.config, NOISE),
        by_row=True,
        paper="Table III",
    ),
    "ate_per_realization": TableDefinition(
        "Position error by condition and realization",
        lambda run: _errors(run, "realization"),
        _solves,
        columns=f"condition realization {_ERRORS}",
        brief=f"condition realization {_BRIEF_ERRORS}",
        folded=True,
    ),
    "consistency_per_epoch": TableDefinition(
        "Consistency at each epoch", _consistency, _has_covariances, folded=True
    ),
    "consistency_per_vehicle": TableDefinition(
        "Consistency of each vehicle at each epoch",
        lambda run: _consistency(run, by_vehicle=True),
        _has_covariances,
        folded=True,
    ),
    "coverage": TableDefinition(
        "Share of position errors within 1 and 3 sigma, with binomial bounds",
        _coverage,
        _has_covariances,
        folded=True,
    ),
    "unknowns_directions": TableDefinition(
        "Combinations of modes and clocks that the measurements observe, from best to least",
        lambda run: directions_table(_unknowns(run)),
        _has_unknowns,
        folded=True,
    ),
    "bound": TableDefinition(
        "Bound of the position error of unbiased estimators at each ping, without and with ranges,"
        " and directions that the ranges of the ping alone do not observe",
        lambda run: bound_table(run.truth, run.measurements),
        _solves,
        folded=True,
    ),
    "costs": TableDefinition(
        "Settings and seed of each condition, and CPU time of its solves; mantaray study run"
        " config.toml repeats them",
        cost_table,
        lambda run: run.study.solves and "solve_cpu_seconds" in run.manifest,
        folded=True,
    ),
    "influence": TableDefinition(
        "Measurements of realization 0 with the largest whitened residual, leverage or Cook's"
        " distance, by condition; a large distance means that the estimate depends on this"
        " measurement",
        influence_table,
        _has_range_graphs,
        folded=True,
    ),
    "solves": TableDefinition(
        "Health of each solve", lambda run: solve_table(run.estimates), _solves, folded=True
    ),
}
"""Definitions by the name of the CSV file; every definition is in every report."""
