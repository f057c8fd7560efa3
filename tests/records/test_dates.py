"""Seconds between instants, against the calendar of Python."""

import datetime as dt

import numpy as np
import pytest

from pymantaray.records.dates import seconds_since


@pytest.mark.parametrize(("first", "last"), [
    ("1700-01-02T00:00:00", "2261-12-30T12:00:00.25"),
    ("2261-12-30T12:00:00.25", "1700-01-02T00:00:00"),
    ("1969-12-31T23:59:59.5", "2020-01-01T00:00:00.125"),
])  # fmt: skip
def test_spans_longer_than_292_years_are_right(first, last):
    start, times = np.datetime64(first, "ns"), np.array([first, last], dtype="datetime64[ns]")
    span = dt.datetime.fromisoformat(last) - dt.datetime.fromisoformat(first)
    assert seconds_since(times, start).tolist() == [0.0, span.total_seconds()]
