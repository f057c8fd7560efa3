"""
CSV tables that a spreadsheet does not execute: text that looks like a formula has an apostrophe
before it.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

_FORMULA = tuple("=+-@\t\n")


def csv_text(table: "pd.DataFrame", *, float_format: str | None = None) -> str:
    """
    Convert a table with its header to CSV, with an apostrophe before text that begins like a
    formula.
    """
    shown = table.copy(deep=False)
    for k, dtype in enumerate(table.dtypes):
        cells = table.iloc[:, k]
        if dtype.kind not in "biufcmM" and any(
            guarded(cell) is not cell for cell in cells.unique()
        ):
            shown.isetitem(k, cells.map(guarded).tolist())
    shown.columns = [guarded(title) for title in table.columns]
    return shown.to_csv(index=False, lineterminator="\n", float_format=float_format)


def read_csv(path: Path) -> "pd.DataFrame":
    """Read a table from a file of `csv_text`."""
    import pandas as pd

    table = pd.read_csv(path)
    for k, dtype in enumerate(table.dtypes):
        if dtype.kind not in "biufcmM":
            table.isetitem(k, table.iloc[:, k].map(unguarded).tolist())
    return table.rename(columns=unguarded)


def guarded(cell: Any) -> Any:
    """
    Add an apostrophe to a cell or title that a spreadsheet would interpret as a formula; numbers as
    text are unchanged.
    """
    if not isinstance(cell, str) or len(cell) < 2 or is_number(cell):
        return cell
    if "\r" in cell:  # the writer does not quote it, and a reader would start a new row
        cell = cell.replace("\r\n", "\n").replace("\r", "\n")
    return f"'{cell}" if cell.lstrip(" '").startswith(_FORMULA) else cell


def unguarded(cell: Any) -> Any:
    """Remove the apostrophe of `guarded`."""
    return (
        cell[1:]
        if isinstance(cell, str) and cell[:1] == "'" and guarded(cell[1:]) == cell
        else cell
    )


def is_number(cell: str) -> bool:
    """Return True if text is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
