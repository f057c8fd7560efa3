"""Writer of MATLAB files (level 5), one structure per table."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.io import savemat

from pymantaray.errors import ExchangeError

_MAX_LETTERS = 63  # of a name in MATLAB
DATE_UNIT = "s since 1970-01-01 UTC"


def write_mat(tables: Mapping[str, pd.DataFrame], facts: Mapping[str, Any], path: Path) -> None:
    """
    Write tables with units in ``attrs`` as structures of columns, and facts as a structure ``run``.

    Text is a cell array. Dates are seconds for ``datetime(x, 'ConvertFrom', 'posixtime')``. The
    field ``units`` of a structure has the units of its columns.
    """
    content: dict[str, Any] = {"run": {_name(key): value for key, value in facts.items()}}
    for title, table in tables.items():
        units = dict(table.attrs.get("units", {}))
        columns: dict[str, Any] = {}
        for name, column in table.items():
            values = column.to_numpy()
            if values.dtype.kind == "M":
                values = values.astype("datetime64[us]").astype(np.int64) * 1e-6
                units[name] = DATE_UNIT
            elif values.dtype.kind not in "biuf":
                values = column.to_numpy(dtype=object)
            columns[_name(str(name))] = values
        if len(columns) < table.shape[1]:
            raise ExchangeError(f"mat: two columns of {title} have one name in MATLAB; rename one")
        columns["units"] = {_name(str(name)): unit for name, unit in units.items()}
        content[_name(title)] = columns
    savemat(
        str(path),
        content,
        appendmat=False,
        long_field_names=True,
        oned_as="column",
        do_compression=True,
    )


def _name(text: str) -> str:
    """Valid name in MATLAB: ASCII letters, digits and underscores, first a letter."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return (word if word[:1].isalpha() else f"x{word}")[:_MAX_LETTERS]
