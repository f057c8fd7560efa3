"""Page of a sweep, with an interactive plot of all results over all swept fields."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd

from pymantaray.apps.study.page import SYNTHETIC_NOTE
from pymantaray.apps.study.references import MANTARAY
from pymantaray.apps.sweep.keys import SWEEP
from pymantaray.apps.sweep.results import point_table
from pymantaray.config.settings import key_heading
from pymantaray.pages.page import Page, origin_table, table_explorer

_NO_RESULTS = ("point", "status", "error", "condition", "key")


def write_sweep_page(
    table: pd.DataFrame,
    fields: Sequence[str],
    folder: str | Path,
    *,
    title: str,
    notes: Sequence[str] = (),
    synthetic: bool = False,
    origin: Mapping[str, Any] = MappingProxyType({}),
) -> Path:
    """
    Write the page of a sweep into a folder.

    Parameters
    ----------
    table : pandas.DataFrame
        Table from `pymantaray.apps.sweep.SweepResults.table`.
    fields : sequence of str
        Swept columns.
    folder : str or pathlib.Path
        Folder with ``table.csv``.
    title : str
        Name of the sweep.
    notes : sequence of str
        Notes of the readers of its points, `SweepResults.notes`.
    synthetic : bool
        True if the ocean of some point is synthetic, `SweepResults.synthetic`.
    origin : mapping
        Versions and definition for the provenance and the citation, `SweepResults.origin`.

    Returns
    -------
    pathlib.Path
        ``index.html``, one file with all its scripts and data.

    Raises
    ------
    WriteError
        If the page cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.sweep`:

    >>> from pymantaray.apps.sweep import write_sweep_page
    >>> table = results.table()
    >>> table.to_csv("table.csv", index=False)
    >>> write_sweep_page(table, ["noise.range_sigma"], ".", title="Range noise").name
    'index.html'
    """
    numbers = [
        str(name)
        for name in table.columns
        if name not in (*_NO_RESULTS, *fields) and pd.api.types.is_numeric_dtype(table[name])
    ]
    first = [name for name in ("rmse_m", "mean_m") if name in numbers]
    numbers = [*first, *(name for name in numbers if name not in first)]
    several = [name for name in fields if table[name].nunique() > 1]
    states = table.groupby("point")["status"].first().value_counts()
    failures = table.loc[table["status"] == "failed"].groupby("error")["point"].nunique()
    explorer = table_explorer(
        table,
        numbers,
        several,
        [*(["condition"] if "condition" in table else []), *several],
        labels=key_heading,
    )
    page = Page(
        title=f"Sweep over {title}",
        facts=[
            (
                f"{len(states.index) and int(states.sum())} points:"
                f" {', '.join(f'{n} {state}' for state, n in states.items())}"
            )
        ],
        notes=[
            *([SYNTHETIC_NOTE] if synthetic else []),
            *notes,
            *(f"{count} failed: {line}" for line, count in failures.items()),
        ],
        explorer=explorer,
        tables=[point_table(table, fields)],
        made=["Repeat with: mantaray sweep run sweep.toml"] if origin else [],
        origin=[origin_table(dict(origin), "Sweep", SWEEP)] if origin else [],
        citation=_citation(title, len(table["point"].unique()), origin) if origin else None,
        cite="Cite this sweep",
    )
    return page.write(folder)


def _citation(title: str, points: int, origin: Mapping[str, Any]) -> tuple[str, str]:
    """Citation of a sweep, as text and as BibTeX."""
    versions = ", ".join(origin.get("versions", [])) or "unknown"
    words = f"Sweep over {title}, {points} points, made with MantaRay, version {versions}."
    fields = {name: value for name, value in MANTARAY.fields.items() if name != "url"}
    fields |= {"version": versions, "note": f"sweep over {title}, {points} points"}
    return words, replace(MANTARAY, fields=fields).bibtex
