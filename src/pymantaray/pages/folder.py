"""Files of a report in a folder."""

from collections.abc import Mapping
from pathlib import Path

from pymantaray.plotting.formats import FIGURES

PAGE = "index.html"
TABLES = "tables"
PARTS = (TABLES, FIGURES, PAGE)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files of a report, by their names, into an empty folder."""
    from pymantaray.records import whole_file

    for part in PARTS[:-1]:
        (folder / part).mkdir()
    for name, content in files.items():
        with whole_file(folder / name) as file:
            file.write_bytes(content)
