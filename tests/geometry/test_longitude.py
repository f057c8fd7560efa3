"""Longitudes of any convention."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pymantaray.geometry.longitude import contiguous, eastward, whole_turns, wrap_longitude


@pytest.mark.parametrize("about", [0.0, -170.0, 359.5])
def test_a_wrapped_longitude_is_the_same_meridian_and_near(about):
    lon = np.linspace(-720.0, 720.0, 1441)
    turned = wrap_longitude(lon, about)
    assert np.all((turned >= about - 180.0) & (turned < about + 180.0))
    np.testing.assert_allclose((turned - lon + 1.0) % 360.0, 1.0, atol=1e-9)
    np.testing.assert_allclose([x - whole_turns(x, about) for x in lon], turned, atol=1e-9)


def test_the_east_side_lies_east_of_the_west_side():
    assert eastward(170.0, -170.0) == 190.0
    assert eastward(-10.0, 10.0) == 10.0


@given(
    start=st.floats(-180.0, 360.0),
    step=st.floats(0.01, 1.0),
    n=st.integers(4, 200),
    turn=st.integers(0, 300),
)
@settings(max_examples=50)
def test_any_window_less_than_a_circle_becomes_contiguous(start, step, n, turn):
    true = start + step * np.arange(n)
    written = np.roll((true + 180.0) % 360.0 - 180.0, turn % n)
    order, lon = contiguous(written)
    np.testing.assert_allclose(np.diff(lon), step, atol=1e-9)
    np.testing.assert_allclose((lon - written[order] + 1.0) % 360.0, 1.0, atol=1e-9)
    assert -180.0 <= 0.5 * (lon[0] + lon[-1]) < 180.0 + 1e-9


def test_an_axis_that_is_in_a_row_keeps_every_digit():
    lon = np.round(np.arange(-1.2, 3.0, 0.08), 6)
    for turns in (0.0, 360.0):  # as a file from 0 to 360 has them, the sum of both rounded once
        _, rising = contiguous(lon + turns)
        np.testing.assert_array_equal(rising, (lon + turns) - turns)
