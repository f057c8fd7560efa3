"""Nested results in one file come back with types and digits, or are refused in one line."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest

from pymantaray.errors import RecordError
from pymantaray.estimation import GraphValues
from pymantaray.records import SolveStatus
from pymantaray.records.nested import from_bytes, to_bytes


class Pair(NamedTuple):
    first: Any
    second: Any


@dataclass(frozen=True)
class Part:
    number: float
    content: Any


TYPES = Pair, Part, GraphValues, SolveStatus


def test_parts_come_back_with_their_types_and_digits():
    record = GraphValues(np.ones((2, 3)) / 3.0, np.eye(4)[:2], np.empty((0, 3)))
    parts = {"of / two": Part(np.float64(0.1), record), "b": Part(float("nan"), None)}
    value = Pair(parts, (SolveStatus.FAILED, np.array([True, False]), np.arange(3), "a b", (1,)))
    back = from_bytes(to_bytes(value), *TYPES)
    assert type(back) is Pair
    assert list(back.first) == ["of / two", "b"]
    one, other = back.first.values()
    assert one.number == 0.1
    assert np.isnan(other.number)
    assert other.content is None
    for name in ("position", "quaternion", "landmark_position"):
        np.testing.assert_array_equal(getattr(one.content, name), getattr(record, name))
    status, mask, index, text, single = back.second
    assert status is SolveStatus.FAILED
    assert mask.tolist() == [True, False]
    assert mask.dtype == bool
    assert index.dtype == np.arange(3).dtype
    assert (text, single) == ("a b", (1,))


def test_other_types_are_refused():
    content = to_bytes(Pair(1.0, np.zeros(2)))
    with pytest.raises(RecordError, match="not a result: KeyError 'Pair'"):
        from_bytes(content, Part)
