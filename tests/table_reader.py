"""
The C99 reader of travel-time tables: compile the reading program, run it, and put Python's results
into the same form.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np

from pymantaray.apps.table import TableRanges
from pymantaray.apps.table.file import c_header

COMPILER = shutil.which("gcc") or shutil.which("cc")
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
COLUMNS = (
    "horizontal_range",
    "travel_time",
    "range_by_time",
    "range_by_source_depth",
    "range_by_receiver_depth",
    "range_by_scale",
    "range_sigma",
)


def compiled(folder: Path, *options: str) -> Path:
    """Compile the reading program with the header that users get."""
    (folder / "mantaray_table.h").write_text(c_header())
    program = folder / "read_table"
    source = Path(__file__).parent / "apps" / "table" / "read_table.c"
    assert COMPILER is not None
    command = [
        COMPILER,
        *STRICT,
        *options,
        "-I",
        str(folder),
        str(source),
        "-o",
        str(program),
        "-lm",
    ]
    subprocess.run(command, check=True)
    return program


def read(program: Path, table: Path, four: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Rows of `travel_time`, and of `horizontal_range` at ranges / 1500 s, as bits; the columns of
    ``four`` are depths, range and bearing.
    """
    text = "\n".join(" ".join(float(x).hex() for x in row) for row in four)
    answer = subprocess.run(
        [program, table, "0"], input=text, capture_output=True, text=True, check=True, timeout=120
    )
    rows = np.array(
        [[int(word) for word in line.split()] for line in answer.stdout.splitlines()],
        dtype=np.uint64,
    )
    return rows[::2], rows[1::2]


def bits_of(ranges: TableRanges) -> np.ndarray:
    """Rows of the reading program from Python's results."""
    whole = [ranges.status, ranges.surface_bounces, ranges.bottom_bounces]
    # any NaN becomes the one that C's macro is
    floats = [np.where(np.isnan(x), np.nan, x) for x in (getattr(ranges, name) for name in COLUMNS)]
    return np.column_stack(
        [np.asarray(x).astype(np.uint64) for x in whole]
        + [x.astype(np.float64).view(np.uint64) for x in floats]
    )
