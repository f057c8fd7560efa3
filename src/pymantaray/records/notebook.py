"""HTML of a result for a notebook: a title, a line of facts and tables."""

from collections.abc import Mapping, Sequence
from html import escape

from pymantaray.records.result_table import ResultTable


def notebook_html(title: str, facts: Mapping[str, object], tables: Sequence[ResultTable]) -> str:
    """Title, facts by name and tables as HTML; long tables show their first rows."""
    words = " · ".join(f"{escape(name)}: {escape(str(value))}" for name, value in facts.items())
    bodies = "".join(table._repr_html_() for table in tables)
    return f"<div><strong>{escape(title)}</strong><br>{words}{bodies}</div>"
