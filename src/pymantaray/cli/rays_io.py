"""Tables of `mantaray rays`: links in, results out, whole or not at all."""

import io
import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pymantaray.errors import AcousticsError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr
    from numpy.typing import NDArray

SOURCE, RECEIVER = (
    [f"{end}_{axis}" for axis in ("north", "east", "depth")] for end in ("source", "receiver")
)
_DIGITS = "%.12g"


class Table(NamedTuple):
    """A CSV file as text: its rows, the line of the file that each stands in, and its comment lines."""

    path: Path
    text: "pd.DataFrame"
    line: list[int]
    comments: list[str]

    def numbers(self, columns: list[str]) -> "NDArray[np.float64]":
        """
        Columns as numbers.

        Parameters
        ----------
        columns : list of str

        Returns
        -------
        ndarray, shape (n_rows, n_columns)

        Raises
        ------
        AcousticsError
            If a cell is no finite number; the message names its line.
        """
        import numpy as np
        import pandas as pd

        values = np.empty((len(self.text), len(columns)))
        for k, name in enumerate(columns):
            values[:, k] = pd.to_numeric(self.text[name], errors="coerce")
        wrong = np.argwhere(~np.isfinite(values))
        if wrong.size:
            row, k = wrong[0]
            found = self.text[columns[k]].iloc[row]
            raise AcousticsError(
                f"{self.path}, line {self.line[row]}: every one of {', '.join(columns)} needs a number;"
                f" {columns[k]} is {found!r}"
            )
        return values


def read_table(path: Path) -> Table:
    """
    Read a CSV file; empty lines and lines that begin with ``#`` are no rows.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    Table

    Raises
    ------
    AcousticsError
        If the file is unreadable or has no rows.
    """
    import pandas as pd

    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        numbered = [(i, line) for i, line in enumerate(lines, 1) if line.strip(" \t,")]
        rows = [(i, line) for i, line in numbered if not line.startswith("#")]
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
            frame = pd.read_csv(
                io.StringIO("\n".join(line for _, line in rows)),
                dtype=str,
                keep_default_na=False,
                index_col=False,
                skipinitialspace=True,
            )
    except pd.errors.ParserWarning:
        raise AcousticsError(f"{path}: not a readable table: rows have more cells than its header") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error).partition("\n")[0]
        raise AcousticsError(f"{path}: not a readable table: {reason}") from None
    if frame.empty:
        raise AcousticsError(f"{path}: has a header and no rows")
    frame.columns = frame.columns.str.strip()
    comments = [line for _, line in numbered if line.startswith("#")]
    return Table(path, frame.fillna(""), [i for i, _ in rows[1:]], comments)


def require_columns(table: Table, columns: list[str], hint: str = "") -> None:
    """
    Refuse a table that lacks a column.

    Parameters
    ----------
    table : Table
    columns : list of str
    hint : str
        End of the message.

    Raises
    ------
    AcousticsError
        With the columns that are there.
    """
    missing = [name for name in columns if name not in table.text]
    if missing:
        raise AcousticsError(
            f"{table.path}: lacks {', '.join(missing)}; found {', '.join(table.text.columns)}{hint}"
        )


def read_links(path: Path) -> "tuple[Table, NDArray[np.float64], NDArray[np.float64]]":
    """
    Ends of links from a table.

    Parameters
    ----------
    path : pathlib.Path
        CSV with a column for each coordinate of each end.

    Returns
    -------
    table : Table
    source, receiver : ndarray, shape (n_links, 3)
        North, east, down. [m]

    Raises
    ------
    AcousticsError
        If the file is unreadable, empty, or lacks a column or a number.
    """
    table = read_table(path)
    require_columns(table, SOURCE + RECEIVER)
    values = table.numbers(SOURCE + RECEIVER)
    return table, values[:, :3].copy(), values[:, 3:].copy()


def sidecar(out: Path) -> Path:
    """
    File beside a table that says how it was made.

    Parameters
    ----------
    out : pathlib.Path

    Returns
    -------
    pathlib.Path
    """
    return out.with_name(out.name + ".json")


def write_table(frame: "pd.DataFrame", out: Path, record: dict[str, Any] | None = None) -> None:
    """
    Write a table as CSV and how it was made as JSON beside it.

    Parameters
    ----------
    frame : pandas.DataFrame
    out : pathlib.Path
    record : dict, optional
        For the JSON; none is written without.

    Raises
    ------
    WriteError
        If it cannot be written.
    """
    from pymantaray.records import whole_file

    with whole_file(out) as table:
        frame.to_csv(table, index=False, float_format=_DIGITS)
        if record is not None:
            with whole_file(sidecar(out)) as beside:
                beside.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def write_dataset(dataset: "xr.Dataset", out: Path, record: dict[str, Any]) -> None:
    """
    Write a record's data set as NetCDF, with how it was made in the attribute ``made_by``.

    Parameters
    ----------
    dataset : xarray.Dataset
    out : pathlib.Path
    record : dict

    Raises
    ------
    WriteError
        If it cannot be written.
    """
    from pymantaray.records import write_netcdf

    write_netcdf(dataset.assign_attrs(made_by=json.dumps(record)), out)
