"""Tables of text: the same cells and lines whatever separates them and wherever they come from."""

import os
import threading

import pytest

from pymantaray.errors import RecordError
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
    with pytest.raises(RecordError, match=r"a\.csv, line 4: every one of name needs a number; name is 'a'"):
        table.numbers(["name"])


def test_a_pipe_is_read_as_a_file_is(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=(tmp_path / "pipe").write_text, args=("x y\n1 2\n",))
    writer.start()
    assert read_text_table(tmp_path / "pipe").numbers(["y", "x"]).tolist() == [[2.0, 1.0]]
    writer.join()
