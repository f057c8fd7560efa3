"""Tables of text: the same cells and lines whatever separates them and wherever they come from."""

import os
from pathlib import Path

import pytest
from refusals import refused

from pymantaray.errors import RecordError
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.text_table import read_text_table

ROWS = [["name", "depth (m)"], ["a", "1.5"], ["b", "2"]]


@pytest.mark.parametrize("separator", [",", "; ", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_cells_and_their_lines(tmp_path, separator, encoding):
    head, *rows = (separator.join(row) for row in ROWS)
    text = f"# 74° N\n{head}\n\n{rows[0]}{separator}\r\n  # a remark\n{rows[1]}\n"
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    table = read_text_table(tmp_path / "a.csv")
    assert [list(table.frame.columns), *table.frame.to_numpy().tolist()] == ROWS
    assert table.frame.index.tolist() == [4, 6]
    assert table.comments == ["# 74° N", "  # a remark"]
    assert table.numbers(["depth (m)"]).tolist() == [[1.5], [2.0]]
    with pytest.raises(
        RecordError, match=r"a\.csv, line 4: name is 'a'; it must be a finite number"
    ):
        table.numbers(["name"])


REFUSED = {  # a file's content, its size or a name
    "has one line, 'depth'; a table needs a header with names of columns, and rows": "depth\n",
    "is empty; a table needs a header": "",
    "a.csv, line 3: 4 cells, but the header has 3; check the separators": "x,y,z\n1,2,3\n1,2,3,4\n",
    "a.csv: 3,000 columns; at most 2,000 are read": (
        f"{','.join(f'c{k}' for k in range(3000))}\n{'1,' * 3000}\n"
    ),
    "2 lines give 1 rows; close all quotes|not a readable table": 'x,y\n"1,2\n3,4\n',
    "a.csv: a binary file, not a text table": b"\x80\x04\x95\0pickle",
    "more than 200,000,000 bytes; use a smaller": 200_000_001,
    "/dev/zero: not a regular file; name a text table": Path("/dev/zero"),
    "/: is a folder; name a text table": Path("/"),
    "cannot be read: .*embedded null": Path("a\0b.csv"),
    "none.csv: no such file": Path("none.csv"),
    r"\.csv: no such file": Path(os.fsdecode(b"\xff.csv")),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_no_table_is_refused_before_its_numbers_are_asked_for(tmp_path, message):
    case = REFUSED[message]
    path = case if isinstance(case, Path) else tmp_path / "a.csv"
    if isinstance(case, int):
        with path.open("wb") as file:
            file.truncate(case)
    elif not isinstance(case, Path):
        path.write_bytes(case if isinstance(case, bytes) else case.encode())
    refused(RecordError, message, read_text_table, path)


@pytest.mark.parametrize(
    "cell", ["2263-05-01T00:00:00Z", "9999-01-01", "1600-01-01", "2018-13-45", "2018-02-30"]
)
def test_dates_that_nanoseconds_cannot_hold_are_no_dates(tmp_path, cell):
    (tmp_path / "a.csv").write_text(f"time,x\n2018-01-01,1\n2261-12-31T23:59:59Z,2\n{cell},3\n")
    table = read_text_table(tmp_path / "a.csv")
    refused(
        RecordError,
        f"line 4: time is '{cell}'; all cells must be seconds, or all must be dates",
        table.times,
        "time",
    )
    invalid = InvalidLines()
    times = table.readable(invalid, times=["time"]).times("time")
    assert times.astype("datetime64[D]").astype(str).tolist() == ["2018-01-01", "2261-12-31"]
    assert len(invalid) == 1


@pytest.mark.parametrize(
    ("units", "titles"),
    [
        ("UTC,,ft,degree_F", ["time", "vehicle", "depth [ft]", "temperature [degree_F]"]),
        ("s,,(feet),[degC]", ["time [s]", "vehicle", "depth [feet]", "temperature [degC]"]),
        ("UTC,,m,1", ["time", "vehicle", "depth [m]", "temperature [1]"]),
        ("2020-03-01,A,5,6", ["time", "vehicle", "depth", "temperature"]),
        ("2020-03-01,m,nan,", ["time", "vehicle", "depth", "temperature"]),
        ("?,m,NaN,", ["time", "vehicle", "depth", "temperature"]),
        ("?,m,-.5,", ["time", "vehicle", "depth", "temperature"]),
        ("?,A,none,", ["time", "vehicle", "depth", "temperature"]),
    ],
)
def test_a_row_of_units_below_the_header_is_part_of_it(tmp_path, units, titles):
    path = tmp_path / "erddap.csv"
    path.write_text(f"time,vehicle,depth,temperature\n{units}\n2020-03-02,A,1,50\n")
    frame = read_text_table(path).frame
    assert frame.columns.tolist() == titles
    assert len(frame) == (1 if "[" in "".join(titles) else 2)
    assert frame.index[-1] == 3


def test_units_without_rows_are_no_row_of_units(tmp_path):
    """The row is refused as one with a wrong number."""
    path = tmp_path / "empty.csv"
    path.write_text("time,depth\ns,m\n")
    with pytest.raises(RecordError, match="line 2: time is 's'"):
        read_text_table(path).numbers(["time"])
