"""What a run came to, as small tables on the terminal, and warnings of what went wrong in it."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pymantaray.evaluation import dropout_table, error_table, range_error_table
from pymantaray.study.store import TABLES, Run

_COMPARED = {
    "range_drop_category_compare": "Ranges not heard",
    "range_error": "Refracted minus straight range, all links",
    "range_error_split": "Its parts, mean",
    "ate_pooled": "Trajectory error, all vehicles and realizations, no alignment",
}


def print_summary(run: Run) -> None:
    """
    Print dropouts, range errors and trajectory errors of a run, and warn of unhealthy parts.

    Parameters
    ----------
    run : Run
    """
    console = Console()
    config = run.config
    ocean = "synthetic ocean" if run.synthetic else "ocean from files"
    console.print(
        f"\n[bold]{config.study.name}[/bold]: {config.mission.duration_h:g} h, {len(config.fleet.vehicles)} vehicles,"
        f" {config.study.realizations} realization{'' if config.study.realizations == 1 else 's'}, {ocean}"
    )
    console.print(_ranges(run))
    console.print(_errors(run))
    for line in warnings(run):
        console.print(f"[yellow]warning:[/yellow] {escape(line)}")


def print_tables(folder: Path) -> None:
    """
    Print the tables of a comparison that sets numbers side by side.

    Parameters
    ----------
    folder : pathlib.Path
        Where `pymantaray.report.write_comparison` wrote them.
    """
    console = Console()
    for name, title in _COMPARED.items():
        frame = pd.read_csv(folder / TABLES / f"{name}.csv")
        numbers = frame.select_dtypes("number").columns
        labels = [str(column) for column in frame.columns if column not in numbers]
        table = _table(title, *labels, right=[str(column) for column in numbers])
        for row in frame.to_dict("records"):
            shown = ("-" if pd.isna(row[column]) else f"{row[column]:.2f}" for column in numbers)
            table.add_row(*(escape(str(row[column])) for column in labels), *shown)
        console.print(table)


def warnings(run: Run) -> list[str]:
    """
    Say which solves failed their health gate and which vehicles stopped.

    Parameters
    ----------
    run : Run

    Returns
    -------
    list of str
        One line each; empty if all went well.
    """
    outcome = run.manifest["outcome"]
    lines = [
        f"vehicle {name} stopped after {stop['time_s'] / 3600.0:.1f} h: {stop['status']}"
        for name, stop in outcome["stopped_vehicles"].items()
    ]
    by_kind: dict[tuple[str, str], list[int]] = {}
    for solve in outcome["unhealthy_solves"]:
        by_kind.setdefault((solve["condition"], solve["status"]), []).append(solve["realization"])
    lines.extend(
        f"condition {condition}: {len(which)} of {run.config.study.realizations} solves {status},"
        f" realizations {', '.join(map(str, which))}"
        for (condition, status), which in by_kind.items()
    )
    return lines


def _table(title: str, *left: str, right: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE, pad_edge=False)
    for name in left:
        table.add_column(escape(name), no_wrap=True)
    for name in right:
        table.add_column(escape(name), justify="right")
    return table


def _ranges(run: Run) -> Table:
    table = _table(
        "Refracted minus straight range",
        "links",
        right=("tried", "lost %", "mean [m]", "sd [m]", "1 % [m]", "99 % [m]"),
    )
    dropouts = dropout_table(run.measurements, run.truth).to_dict("records")
    errors = range_error_table(run.measurements, run.ranging_truth, run.truth).to_dict("records")
    for dropout, error in zip(dropouts, errors, strict=True):
        table.add_row(
            str(dropout["category"]),
            f"{dropout['attempts']}",
            f"{dropout['percent']:.1f}",
            f"{error['mean_m']:+.2f}",
            f"{error['sd_m']:.2f}",
            f"{error['p1_m']:+.1f}",
            f"{error['p99_m']:+.1f}",
        )
    return table


def _errors(run: Run) -> Table:
    table = _table(
        "Trajectory error, all vehicles and realizations, no alignment",
        "condition",
        right=("solves", "failed", "mean [m]", "median [m]", "RMSE [m]", "95 % [m]"),
    )
    for row in error_table(run.truth, run.estimates).to_dict("records"):
        table.add_row(
            str(row["condition"]),
            f"{row['solves']}",
            f"{row['failed_solves']}",
            *(f"{row[column]:.2f}" for column in ("mean_m", "median_m", "rmse_m", "p95_m")),
        )
    return table
