"""
Interactive plot of any number of a table over any of its fields, on pages of sweeps, comparisons
and replays.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pymantaray.pages.page import Explorer, as_json
from pymantaray.plotting import style
from pymantaray.records.result_table import heading

_ROWS = 20_000  # rows in the plot, at equal spacing in the table


def table_explorer(
    table: pd.DataFrame,
    up: Sequence[str],
    across: Sequence[str],
    each: Sequence[str],
    *,
    labels: Callable[[str], str] = heading,
    lines: bool = True,
) -> Explorer | None:
    """
    Interactive plot of a table; None if the table has no numbers for it.

    ``up`` are columns for the vertical axis, ``across`` columns for the horizontal axis, and
    ``each`` columns that can divide the rows into series; the first of ``each`` is the initial
    choice. ``labels`` gives the heading of a column.
    """
    up = [name for name in up if pd.to_numeric(table[name], errors="coerce").notna().any()]
    if not len(table) or not up or not across:
        return None
    if len(table) > _ROWS:
        table = table.iloc[np.unique(np.linspace(0, len(table) - 1, _ROWS).round().astype(int))]
    names = list(dict.fromkeys([*up, *across, *each]))
    content = as_json(
        {
            "columns": {name: _values(table[name], number=name in up) for name in names},
            "labels": {name: labels(name) for name in names},
            "up": up,
            "across": list(across),
            "each": list(each),
            "first": each[0] if each else "",
            "lines": lines,
            "colours": style.vehicle_colours(11),
            "own": _condition_colours(table),
        }
    )
    return Explorer("table", content)


def _condition_colours(table: pd.DataFrame) -> dict[str, str]:
    """Colour of each condition, as on all figures."""
    if "condition" not in table:
        return {}
    return {
        name: colour
        for name, (colour, _) in style.condition_looks(list(table["condition"].unique())).items()
    }


def _values(column: "pd.Series[Any]", *, number: bool) -> list[object]:
    """Numbers with six digits, other values as text."""
    values = pd.to_numeric(column, errors="coerce")
    if number or values.notna().all():
        return [float(f"{value:.6g}") for value in values]
    return ["" if value is None else str(value) for value in column]
