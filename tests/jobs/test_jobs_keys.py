"""Keys of tasks: every value and the content of every file counts, names of files do not."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import JobError
from pymantaray.jobs.keys import (
    CHECKSUM,
    FileChecksums,
    digest,
    file_stamp,
    has_checksum,
    sha256,
    values_of,
    with_checksum,
)


class Pair(NamedTuple):
    """Two values."""

    one: float
    other: np.ndarray


def test_values_are_plain_and_other_objects_are_refused():
    tree = {"pair": Pair(math.inf, np.array([1, 2])), "at": np.datetime64("2020-01-02"), "no": None}
    expected = {"pair": {"one": "inf", "other": [1, 2]}, "at": "2020-01-02", "no": None}
    assert values_of(tree) == expected
    with pytest.raises(TypeError, match="of type set"):
        values_of({1})


def test_a_digest_has_contents_of_files_and_not_their_names():
    def key(kind="task", name="a.nc", content="1234", value=1.0):
        return digest(kind, {"file": name, "value": value}, {name: content})

    assert key() == key(name="elsewhere/b.nc")
    others = [key(kind="other"), key(content="1235"), key(value=2.0)]
    assert len({key(), *others}) == 4
    assert digest("task", {}, {"a": "1"}) != digest("task", {}, {"a": "2"})


def test_a_file_that_changes_has_another_checksum(tmp_path):
    known = FileChecksums()
    path = tmp_path / "a.csv"
    path.write_text("1")
    first = known.of([str(path)])
    assert first == known.of([str(path)]) == {str(path): sha256(path)}
    path.write_text("2")
    assert known.of([str(path)]) != first
    assert file_stamp(tmp_path) != file_stamp(path)
    refused(
        JobError, "none.csv: cannot be read: No such file", known.of, [str(tmp_path / "none.csv")]
    )


def test_a_tree_with_its_checksum_shows_any_change():
    tree = with_checksum({"a": np.float64(0.5), "b": [1, 2]})
    assert has_checksum(tree)
    assert type(tree["a"]) is float
    assert not has_checksum({**tree, "b": [2, 1]})
    assert not has_checksum({name: value for name, value in tree.items() if name != CHECKSUM})
