"""Files of a report in a folder."""

from collections.abc import Mapping
from pathlib import Path

PAGE = "index.html"
TABLES = "tables"
FIGURES = "figures"
PARTS = (TABLES, FIGURES, PAGE)
FIGURE_KINDS = ("png", "pdf", "svg")
ONE_COLUMN = "84mm"
FORMATS = (*FIGURE_KINDS, "tex", ONE_COLUMN)
"""
Formats for a paper, of figures and of tables; `ONE_COLUMN`: PDF of the figures that are too wide or
too dense for one column, laid out for its width.
"""


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files of a report, by their names, into an empty folder."""
    from pymantaray.records import whole_file

    for part in PARTS[:-1]:
        (folder / part).mkdir()
    for name, content in files.items():
        with whole_file(folder / name) as file:
            file.write_bytes(content)
