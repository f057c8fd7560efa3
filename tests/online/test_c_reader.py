"""The C99 reader of travel-time tables: the same bits as Python's, and no access outside its bytes."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pages import DOCS, blocks_of

from pymantaray.online import CellStatus, TableRanges, TravelTimeTable, save_table
from pymantaray.online.file import c_header

COMPILER = shutil.which("gcc") or shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")
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


def _compile(folder: Path, *options: str) -> Path:
    """Compile the reading program with the header that users get."""
    (folder / "mantaray_table.h").write_text(c_header())
    program = folder / "read_table"
    source = Path(__file__).with_name("read_table.c")
    assert COMPILER is not None
    command = [COMPILER, *STRICT, *options, "-I", str(folder), str(source), "-o", str(program), "-lm"]
    subprocess.run(command, check=True)
    return program


def _read(program: Path, table: Path, places: np.ndarray) -> subprocess.CompletedProcess[str]:
    text = "\n".join(" ".join(float(x).hex() for x in row) for row in places)
    return subprocess.run(
        [program, table, "0"], input=text, capture_output=True, text=True, check=False, timeout=120
    )


def _expected(ranges: TableRanges) -> np.ndarray:
    """Rows of the reading program: bits of all columns."""
    return np.column_stack(
        [np.where(np.isnan(getattr(ranges, name)), np.nan, getattr(ranges, name)) for name in COLUMNS]
    )


def test_c_reader_returns_the_same_bits(table: TravelTimeTable, places: np.ndarray, tmp_path: Path) -> None:
    save_table(table, tmp_path / "table.mtt")
    beyond = places * 1.2 - [10.0, 40.0, 400.0]  # some outside the limits
    four = np.column_stack([np.concatenate([places, beyond]), np.zeros(2 * len(places))])
    answer = _read(_compile(tmp_path, "-O2"), tmp_path / "table.mtt", four)
    rows = np.array(
        [[int(word) for word in line.split()] for line in answer.stdout.splitlines()], dtype=np.uint64
    )
    for first, ranges in (
        (0, table.travel_time(*four.T)),
        (1, table.horizontal_range(four[:, 0], four[:, 1], four[:, 2] / 1500.0)),
    ):
        found = rows[first::2]
        np.testing.assert_array_equal(found[:, 0], ranges.status)
        np.testing.assert_array_equal(found[:, 1], ranges.surface_bounces)
        np.testing.assert_array_equal(found[:, 3:].view(np.float64), _expected(ranges))


def test_the_program_of_the_page_prints_the_range_of_python(table: TravelTimeTable, tmp_path: Path) -> None:
    page = (DOCS / "how-to" / "travel-time-table.md").read_text(encoding="utf-8")
    (program,) = [block.text for block in blocks_of(page) if block.language == "c"]
    (tmp_path / "look_up.c").write_text(program)
    (tmp_path / "mantaray_table.h").write_text(c_header())
    save_table(table, tmp_path / "table.mtt")
    assert COMPILER is not None
    subprocess.run([COMPILER, *STRICT, "look_up.c", "-o", "look_up", "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run(["./look_up"], cwd=tmp_path, capture_output=True, text=True, check=True)
    found = table.horizontal_range(50.0, 100.0, 2.0)
    assert found.status[0] == CellStatus.DIRECT
    assert done.stdout == f"{found.horizontal_range[0]:.2f} m, {found.range_by_time[0]:.1f} m/s\n"


@pytest.mark.parametrize("number", [500, pytest.param(50_000, marks=pytest.mark.slow)])
def test_damaged_tables_and_wild_numbers_never_read_outside(
    table: TravelTimeTable, tmp_path: Path, number: int
) -> None:
    program = _compile(tmp_path, "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    save_table(table, tmp_path / "table.mtt")
    answer = subprocess.run(
        [program, tmp_path / "table.mtt", "fuzz", str(number)], capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stderr[-2000:]
    opened, copies = (int(word) for word in answer.stdout.split()[:2])
    assert copies == number
    assert 0.1 * number < opened < 0.9 * number, "some are refused, and some are read"
