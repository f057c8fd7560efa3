"""Sentence about the error of a flat Earth."""

import pytest

from pymantaray.geometry.sphere import flat_earth_note


@pytest.mark.parametrize(("longest", "farthest", "says"), [
    (30e3, 0.0, ("Links are up to 30.0 km long: on a flat Earth, their ranges are too long by up to"
                " about 4.0 m;")),
    (100.0, 2_000e3, ("2000.0 km from the centre of the frame, and links are up to 0.1 km long: on"
                     " a flat Earth, their ranges are too long by less than 0.1 m;")),
    (400e3, 0.0, "by up to about 9,600.0 m;"),
])  # fmt: skip
def test_the_error_is_a_number_that_is_not_zero(longest, farthest, says):
    assert says in flat_earth_note(longest, farthest)


def test_short_links_near_the_centre_need_no_note():
    assert flat_earth_note(15e3, 15e3) is None
