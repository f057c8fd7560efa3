"""Tables of a run: what is in each, and how it stands on the page, in the order of the page."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

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
from pymantaray.records import Estimates, SolveStatus
from pymantaray.report.settings import NOISE, TIMING, settings_table
from pymantaray.study.store import Run

_ERRORS = "mean_m median_m rmse_m p5_m p25_m p75_m p95_m max_m"


@dataclass(frozen=True)
class Table:
    """A table of every report; columns end in their units, ``_m``, ``_s``, ``_h``, ``_deg``."""

    caption: str
    make: Callable[[Run], pd.DataFrame | None]  # None where the run does not have what it needs
    columns: str = ""  # those on the page, where the CSV file has more than fit
    folded: bool = False  # only the caption is shown until it is clicked
    words: Mapping[str, str] = field(
        default_factory=dict
    )  # heads of columns that mean something else in other tables
    by_row: bool = False  # its rows are quantities, which have digits of their own
    paper: str = ""  # its counterpart in the paper


def solve_table(estimates: Estimates) -> pd.DataFrame:
    """Status, iterations and costs of every solve; ``expected_cost`` is half the degrees of freedom."""
    e = estimates
    c, r = (index.ravel() for index in np.indices(e.solve_status.shape))
    columns = {
        "condition": e.condition[c],
        "realization": e.realization[r],
        "status": [SolveStatus(int(status)).name for status in e.solve_status.ravel()],
    }
    numbers = ["iterations", "initial_cost", "final_cost", "expected_cost", "gradient_norm", "gated_links"]
    return pd.DataFrame(columns | {name: np.asarray(getattr(e, name)).ravel() for name in numbers})


def cost_table(run: Run) -> pd.DataFrame:
    """What each condition is, as the configuration has it, its seed and the CPU time of its solves."""
    own = [c for c in run.config.conditions if not c.standard]
    sections = {c.name: c.model_dump(mode="json", exclude_defaults=True) for c in own}
    rows = []
    for name, seconds in run.manifest.get("solve_cpu_seconds", {}).items():
        settings = {key: value for key, value in sections.get(name, {}).items() if key != "name"}
        rows.append(
            {
                "condition": name,
                "settings": json.dumps(settings) if settings else "-",
                "seed": run.config.study.seed,
                "realizations": len(seconds),
                "cpu_median_s": float(np.median(seconds)),
                "cpu_total_s": float(np.sum(seconds)),
            }
        )
    return pd.DataFrame(rows)


def _consistency(run: Run, *, by_vehicle: bool = False) -> pd.DataFrame | None:
    if run.covariances is None:
        return None
    return consistency_table(run.truth, run.estimates, run.covariances, by_vehicle=by_vehicle)


def _summary(run: Run) -> pd.DataFrame | None:
    by_epoch = _consistency(run)
    return None if by_epoch is None else consistency_summary(by_epoch)


def _solved(make: Callable[[Run], pd.DataFrame | None]) -> Callable[[Run], pd.DataFrame | None]:
    """Table of estimates, which a run of ranges alone does not have."""
    return lambda run: make(run) if run.config.solves else None


TABLES: dict[str, Table] = {
    "ate_pooled": Table(
        "Position error by condition, pooled over vehicles, times and realizations",
        _solved(lambda run: error_table(run.truth, run.estimates)),
        f"condition failed_solves {_ERRORS}",
    ),
    "ate_per_vehicle": Table(
        "Position error by condition and vehicle",
        _solved(lambda run: error_table(run.truth, run.estimates, by=("vehicle",))),
        f"condition vehicle {_ERRORS}",
    ),
    "ping_error": Table(
        "Position error of vehicles under water at the pings, its distance from the estimate with straight ranges, and the lower bound"
        " of the RMSE. The bound holds on average over all noise: the RMSE of a few realizations can be below it by a few of its"
        " standard errors",
        _solved(lambda run: ping_error_table(run.truth, run.estimates, run.measurements, run.bounds)),
    ),
    "ate_difference": Table(
        "Difference of position error between conditions, 95 % intervals over realizations",
        _solved(lambda run: comparison_table(run.truth, run.estimates, root_seed=run.config.study.seed)),
        "condition baseline statistic realizations pooled_difference_m bootstrap_low_m bootstrap_high_m",
    ),
    "consistency": Table(
        "Consistency: sums over realizations of NEES and of range innovations by their degrees of freedom,"
        " and at how many epochs they are inside their 95 % bounds",
        _summary,
    ),
    "unknowns": Table(
        "Sound-speed modes and clocks: standard deviation before and after, the share of the prior variance that"
        " the measurements took away, and the errors",
        lambda run: None if run.unknowns is None else unknowns_table(run.unknowns),
    ),
    "attitude": Table(
        "Errors of attitudes about the horizontal axes and about the vertical",
        lambda run: (
            attitude_table(run.truth, run.estimates)
            if run.measurements.attitude_vehicle.size and run.config.solves
            else None
        ),
    ),
    "dropouts": Table(
        "Range attempts and dropouts by kind of link, and their causes",
        lambda run: dropout_table(run.measurements, run.truth),
        words={"percent": "dropouts [%]"},
        paper="Table IV",
    ),
    "range_error": Table(
        "Signed range error, refracted minus straight, by kind of link",
        lambda run: range_error_table(run.measurements, run.ranging_truth, run.truth),
        "category n mean_m sd_m skewness excess_kurtosis p1_m p5_m p95_m p99_m min_m max_m percent_beyond_3_sigma",
    ),
    "range_error_split": Table(
        "Range error split into reference speed and bending",
        lambda run: range_split_table(run.measurements, run.ranging_truth, run.truth),
    ),
    "region": Table("Region", lambda run: run.region.reset_index(), paper="Table I"),
    "timing": Table(
        "Mission timing", lambda run: settings_table(run.config, TIMING), by_row=True, paper="Table II"
    ),
    "noise": Table(
        "Sensor noise", lambda run: settings_table(run.config, NOISE), by_row=True, paper="Table III"
    ),
    "ate_per_realization": Table(
        "Position error by condition and realization",
        _solved(lambda run: error_table(run.truth, run.estimates, by=("realization",))),
        f"condition realization {_ERRORS}",
        folded=True,
    ),
    "consistency_per_epoch": Table("Consistency at each epoch", _consistency, folded=True),
    "consistency_per_vehicle": Table(
        "Consistency of each vehicle at each epoch",
        lambda run: _consistency(run, by_vehicle=True),
        folded=True,
    ),
    "coverage": Table(
        "Share of position errors within 1 and 3 sigma, with binomial bounds",
        lambda run: (
            None if run.covariances is None else coverage_table(run.truth, run.estimates, run.covariances)
        ),
        folded=True,
    ),
    "unknowns_directions": Table(
        "Combinations of modes and clocks that the measurements see, from best to least",
        lambda run: None if run.unknowns is None else directions_table(run.unknowns),
        folded=True,
    ),
    "bound": Table(
        "Least position error that is possible at each ping, without ranges and with them, and what the ranges of the ping"
        " alone do not see",
        _solved(lambda run: bound_table(run.truth, run.measurements)),
        folded=True,
    ),
    "costs": Table(
        "What each condition is, its seed and the CPU time of a solve on the machine that ran it; mantaray study run config.toml"
        " runs it again",
        _solved(lambda run: cost_table(run) if "solve_cpu_seconds" in run.manifest else None),
        folded=True,
    ),
    "solves": Table("Health of each solve", _solved(lambda run: solve_table(run.estimates)), folded=True),
}
"""By the name of the CSV file; whatever adds one adds it to every report."""
