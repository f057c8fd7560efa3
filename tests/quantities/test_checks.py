"""Numbers that a refusal compares look as different as they are."""

import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import MantaRayError
from pymantaray.quantities.checks import (
    check_magnitudes,
    check_number,
    checked_array,
    distinct_digits,
)


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


@pytest.mark.parametrize("value", ["x", None, [], 1j, 10**400, [1.0, 2.0]])
def test_what_is_no_number_is_refused_with_its_name(value):
    refused(
        MantaRayError, "depth is .* must be a number", check_number, MantaRayError, "depth", value
    )
    values = [value, 1.0]
    refused(
        MantaRayError,
        "place: (not an array|.*not finite)",
        checked_array,
        MantaRayError,
        "place",
        values,
        (2,),
    )


def test_numbers_whose_squares_leave_no_digits_are_refused():
    check_magnitudes(MantaRayError, "sigma", 0.0, 1e-18, 1.0, 1e12)
    for value in (-1.0, 1e-300, 1e-19, 1e13, 1e300, np.inf, np.nan):
        refused(
            MantaRayError,
            "sigma is .* m; allowed are 0, and 1e-18 to 1e.12",
            check_magnitudes,
            MantaRayError,
            "sigma",
            value,
            unit="m",
        )


def test_values_that_do_not_rise_are_refused_after_the_last_that_did():
    for values in ([0.0, 2.0, 2.0, 1.0], [0.0, 2.0, 1.0]):
        arguments = (checked_array, MantaRayError, "depth", values, (None,))
        refused(MantaRayError, "depth: values do not increase after 2;", *arguments, rising=True)
    assert checked_array(MantaRayError, "depth", [0.0, 1e-9], (None,), rising=True).size == 2
