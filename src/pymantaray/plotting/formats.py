"""Formats of the figures and tables of a report, for the command line, which does not draw."""

from collections.abc import Sequence

from pymantaray.errors import ReportError

FIGURES = "figures"
"""Folder of the figures of a report."""
FIGURE_KINDS = ("png", "pdf", "svg")
ONE_COLUMN = "84mm"
FORMATS = (*FIGURE_KINDS, "tex", ONE_COLUMN)
"""
Formats for a paper, of figures and of tables; `ONE_COLUMN`: PDF of the figures in a layout for one
column of a journal.
"""
FIGURE_FORMATS = (*FIGURE_KINDS, ONE_COLUMN)
"""Formats of figures without tables."""
PRINTED = 300.0
"""Dots per inch of a paper."""


def checked_formats(formats: Sequence[str], allowed: Sequence[str] = FORMATS) -> Sequence[str]:
    """Formats of a report; raise an error for an unknown one."""
    for name in formats:
        if name not in allowed:
            raise ReportError(f"format {name!r}: unknown; allowed: {', '.join(allowed)}")
    return formats
