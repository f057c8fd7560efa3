"""How results show themselves in a notebook: a title, a line of facts and short tables."""

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

_ROWS = 12  # of a table


def shown_html(title: str, facts: Mapping[str, object], tables: Mapping[str, "pd.DataFrame"]) -> str:
    """HTML of a result; of a long table the first and last rows are there, with their number."""
    told = " · ".join(f"{escape(name)}: {escape(str(value))}" for name, value in facts.items())
    parts = [f"<div><strong>{escape(title)}</strong><br>{told}"]
    for heading, table in tables.items():
        parts.append(f"<div>{escape(heading)}</div>" if heading else "")
        parts.append(
            table.to_html(
                index=False,
                na_rep="-",
                border=0,
                float_format="{:.6g}".format,
                max_rows=_ROWS,
                justify="left",
            )
        )
        if len(table) > _ROWS:
            parts.append(f"<div>{len(table):,} rows</div>")
    return "".join(parts) + "</div>"
