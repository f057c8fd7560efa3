"""Numbers that a refusal compares look as different as they are."""

import numpy as np
import pytest

from pymantaray.quantities.checks import distinct_digits


@pytest.mark.parametrize("exponent", range(-8, 9, 4))
def test_different_numbers_look_different_and_equal_ones_equal(exponent):
    rng = np.random.default_rng(3)
    for one in rng.uniform(1.0, 9.0, 200) * 10.0**exponent:
        for far in (0.0, 2.0**-52, 1e-12, 1e-7, 1e-3):
            other = np.nextafter(one, np.inf) if far == 2.0**-52 else one * (1.0 + far)
            first, second = distinct_digits(one, other)
            assert (first == second) == (one == other)
            assert (float(first) < float(second)) == (one < other)


def test_six_digits_serve_where_they_tell():
    assert distinct_digits(2000.0, 1999.99, 3.0) == ["2000", "1999.99", "3"]
    assert distinct_digits(2000.0, 1999.9999) == ["2000", "1999.9999"]
    assert distinct_digits(2000.0, 2000.0) == ["2000", "2000"]
