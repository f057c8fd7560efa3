"""CSV tables with an apostrophe before text that a spreadsheet would execute as a formula."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

_FORMULA = tuple("=+-@\t\n")


def csv_text(table: "pd.DataFrame", *, float_format: str | None = None) -> str:
    """Convert a table to CSV, with an apostrophe before text that begins like a formula."""
    output = table.copy(deep=False)
    for k, dtype in enumerate(table.dtypes):
        cells = table.iloc[:, k]
        if dtype.kind not in "biufcmM" and any(
            guard_formula(cell) is not cell for cell in cells.unique()
        ):
            output.isetitem(k, cells.map(guard_formula).tolist())
    output.columns = [guard_formula(title) for title in table.columns]
    return output.to_csv(index=False, lineterminator="\n", float_format=float_format)


def read_csv(path: Path) -> "pd.DataFrame":
    """Read a table from a file of `csv_text`."""
    import pandas as pd

    table = pd.read_csv(path)
    for k, dtype in enumerate(table.dtypes):
        if dtype.kind not in "biufcmM":
            table.isetitem(k, table.iloc[:, k].map(unguard_formula).tolist())
    return table.rename(columns=unguard_formula)


def guard_formula(cell: Any) -> Any:
    """
    Add an apostrophe to text that a spreadsheet would interpret as a formula.

    Numbers as text are unchanged.
    """
    if not isinstance(cell, str) or len(cell) < 2 or is_number(cell):
        return cell
    if "\r" in cell:  # the writer does not quote it, and a reader would start a new row
        cell = cell.replace("\r\n", "\n").replace("\r", "\n")
    return f"'{cell}" if cell.lstrip(" '").startswith(_FORMULA) else cell


def unguard_formula(cell: Any) -> Any:
    """Remove the apostrophe of `guard_formula`."""
    if isinstance(cell, str) and cell.startswith("'"):
        text = cell.removeprefix("'")
        if guard_formula(text) == cell:
            return text
    return cell


def is_number(cell: str) -> bool:
    """Return True if text is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
