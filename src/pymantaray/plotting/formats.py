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


def checked_formats(formats: Sequence[str]) -> Sequence[str]:
    """Formats of a report; raise an error for an unknown one."""
    for name in formats:
        if name not in FORMATS:
            raise ReportError(f"format {name!r}: unknown; allowed: {', '.join(FORMATS)}")
    return formats
