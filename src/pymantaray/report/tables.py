"""Tables of a run: what is in each, in the order of the report, and writing them whole."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pymantaray.errors import ReportError
from pymantaray.evaluation import (
    comparison_table,
    dropout_table,
    error_table,
    range_error_table,
    range_split_table,
)
from pymantaray.evaluation.consistency import consistency_summary, consistency_table
from pymantaray.evaluation.coverage import coverage_table
from pymantaray.evaluation.unknowns import directions_table, unknowns_table
from pymantaray.records import Estimates, SolveStatus
from pymantaray.study.store import Run


def make_tables(run: Run) -> dict[str, pd.DataFrame]:
    """
    All tables of a run.

    Parameters
    ----------
    run : Run

    Returns
    -------
    dict of str to pandas.DataFrame
        ``ate_pooled``, ``ate_difference`` (paired confidence intervals between conditions),
        ``ate_per_agent``, ``ate_per_realization``, ``dropouts``, ``range_error``, ``range_error_split``,
        ``region`` and ``solves`` (health of each solve); with covariances ``consistency``,
        ``consistency_per_epoch``, ``consistency_per_agent`` and ``coverage``; where modes or clocks are
        estimated ``unknowns`` and ``unknowns_directions``. Units are in the names of columns or properties.

    Raises
    ------
    EvaluationError
        If truth, measurements and estimates do not fit together.
    """
    truth, measurements, estimates = run.truth, run.measurements, run.estimates
    more: dict[str, pd.DataFrame] = {}
    if run.covariances is not None:
        known = (truth, estimates, run.covariances)
        by_epoch, by_agent = consistency_table(*known), consistency_table(*known, by_agent=True)
        more = {
            "consistency": consistency_summary(by_epoch),
            "consistency_per_epoch": by_epoch,
            "consistency_per_agent": by_agent,
            "coverage": coverage_table(*known),
        }
    if run.unknowns is not None:
        more["unknowns"] = unknowns_table(run.unknowns)
        more["unknowns_directions"] = directions_table(run.unknowns)
    return {
        **more,
        "ate_pooled": error_table(truth, estimates),
        "ate_difference": comparison_table(truth, estimates, root_seed=run.config.study.seed),
        "ate_per_agent": error_table(truth, estimates, by=("agent",)),
        "ate_per_realization": error_table(truth, estimates, by=("realization",)),
        "dropouts": dropout_table(measurements, truth),
        "range_error": range_error_table(measurements, run.ranging_truth, truth),
        "range_error_split": range_split_table(measurements, run.ranging_truth, truth),
        "region": run.region.reset_index(),
        "solves": solve_table(estimates),
    }


def solve_table(estimates: Estimates) -> pd.DataFrame:
    """
    Health of every solve.

    Parameters
    ----------
    estimates : Estimates

    Returns
    -------
    pandas.DataFrame
        One row for each condition and realization: ``status`` (name of the `SolveStatus`), ``iterations``,
        ``initial_cost``, ``final_cost``, ``expected_cost`` (half the degrees of freedom),
        ``gradient_norm``, ``gated_links``; costs are without units.
    """
    rows: list[dict[str, Any]] = []
    for c, r in np.ndindex(estimates.solve_status.shape):
        rows.append(
            {
                "condition": str(estimates.condition[c]),
                "realization": int(estimates.realization[r]),
                "status": SolveStatus(int(estimates.solve_status[c, r])).name,
                "iterations": int(estimates.iterations[c, r]),
                "initial_cost": float(estimates.initial_cost[c, r]),
                "final_cost": float(estimates.final_cost[c, r]),
                "expected_cost": float(estimates.expected_cost[c, r]),
                "gradient_norm": float(estimates.gradient_norm[c, r]),
                "gated_links": int(estimates.gated_links[c, r]),
            }
        )
    columns = ["condition", "realization", "status", "iterations"]
    costs = ["initial_cost", "final_cost", "expected_cost", "gradient_norm"]
    return pd.DataFrame(rows, columns=[*columns, *costs, "gated_links"])


def write_table(table: pd.DataFrame, path: Path) -> None:
    """
    Write a table as CSV with all its digits, whole or not at all.

    Parameters
    ----------
    table : pandas.DataFrame
        Without its index.
    path : pathlib.Path
        Its folder is made if it is not there.

    Raises
    ------
    ReportError
        If the file cannot be written.
    """
    write_text(table.to_csv(index=False, lineterminator="\n"), path)


def write_text(text: str, path: Path) -> None:
    """
    Write a text file under a temporary name, then rename.

    Parameters
    ----------
    text : str
    path : pathlib.Path
        Its folder is made if it is not there.

    Raises
    ------
    ReportError
        If the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, encoding="utf-8", newline="")
        temporary.replace(path)
    except OSError as error:
        raise ReportError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)
