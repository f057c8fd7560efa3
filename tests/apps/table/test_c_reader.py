"""
The C99 reader of travel-time tables: the same bits as Python's, and no access outside its bytes.
"""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from pages import DOCS, blocks_of
from table_reader import COMPILER, STRICT, bits_of, compiled, read

from pymantaray.apps.table import CellStatus, TravelTimeTable, save_table
from pymantaray.apps.table.file import c_header

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")


@pytest.mark.slow
def test_c_reader_returns_the_same_bits(
    table: TravelTimeTable, places: np.ndarray, tmp_path: Path
) -> None:
    save_table(table, tmp_path / "table.mtt")
    beyond = places * 1.2 - [10.0, 40.0, 400.0]  # some outside the limits
    four = np.column_stack([np.concatenate([places, beyond]), np.zeros(2 * len(places))])
    there, back = read(compiled(tmp_path, "-O2"), tmp_path / "table.mtt", four)
    np.testing.assert_array_equal(there, bits_of(table.travel_time(*four.T)))
    times = four[:, 2] / 1500.0
    np.testing.assert_array_equal(
        back, bits_of(table.horizontal_range(four[:, 0], four[:, 1], times))
    )


def test_the_program_of_the_page_prints_the_range_of_python(
    table: TravelTimeTable, tmp_path: Path
) -> None:
    page = (DOCS / "how-to" / "on-board.md").read_text(encoding="utf-8")
    (program,) = [block.text for block in blocks_of(page) if block.language == "c"]
    (tmp_path / "look_up.c").write_text(program)
    (tmp_path / "mantaray_table.h").write_text(c_header())
    save_table(table, tmp_path / "table.mtt")
    assert COMPILER is not None
    subprocess.run(
        [COMPILER, *STRICT, "look_up.c", "-o", "look_up", "-lm"], cwd=tmp_path, check=True
    )
    done = subprocess.run(["./look_up"], cwd=tmp_path, capture_output=True, text=True, check=True)
    found = table.horizontal_range(50.0, 100.0, 2.0)
    assert found.status[0] == CellStatus.DIRECT
    assert done.stdout == f"{found.horizontal_range[0]:.2f} m, {found.range_by_time[0]:.1f} m/s\n"


def test_flipped_bits_are_refused_by_their_checksum(table: TravelTimeTable, tmp_path: Path) -> None:
    program = compiled(tmp_path, "-O2")
    path = tmp_path / "table.mtt"
    save_table(table, path)
    content = path.read_bytes()
    for bit in np.random.default_rng(3).integers(8 * 88, 8 * len(content), 60):
        wrong = bytearray(content)
        wrong[bit // 8] ^= 1 << bit % 8
        path.write_bytes(wrong)
        done = subprocess.run([program, path, "0"], input=b"", capture_output=True, check=False)
        assert done.returncode == 10 + 5, bit  # MANTARAY_CHECKSUM


@pytest.mark.parametrize("number", [200, pytest.param(10_000, marks=pytest.mark.slow)])
def test_damaged_tables_and_wild_numbers_never_read_outside(
    table: TravelTimeTable, tmp_path: Path, number: int
) -> None:
    program = compiled(
        tmp_path, "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
    )
    save_table(table, tmp_path / "table.mtt")
    answer = subprocess.run(
        [program, tmp_path / "table.mtt", "fuzz", str(number)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr[-2000:]
    opened, copies = (int(word) for word in answer.stdout.split()[:2])
    assert copies == number
    assert 0.1 * number < opened < 0.9 * number, "some are refused, and some are read"
