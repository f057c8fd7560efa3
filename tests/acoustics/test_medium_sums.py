"""
Sums of a medium and products of profiles and horizontal fields, against media of the same sound
speed.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium
from pymantaray.errors import AcousticsError
from pymantaray.geometry.sphere import EarthSphere
from tests.refusals import refused

NORTH, EAST = np.linspace(-3e3, 3e3, 7), np.linspace(-2e3, 2e3, 6)


def medium(depth, extra=0.0, **options):
    rng = np.random.default_rng(3)
    speed = (
        1460.0 + 0.016 * depth + rng.normal(0.0, 0.5, (NORTH.size, EAST.size, depth.size)) + extra
    )
    return Medium.from_grid(NORTH, EAST, depth, speed, bathymetry=900.0, **options)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@pytest.mark.parametrize("earth", [None, EarthSphere.at_latitude(75.0)])
@pytest.mark.parametrize("first", [0.0, 12.0])
def test_a_sum_is_the_medium_of_the_summed_sound_speed(interpolation, earth, first):
    """Rounding of 1500 m/s is 2e-13 m/s; splines amplify it a few times."""
    depth = first + np.array([0.0, 10.0, 25.0, 60.0, 150.0, 400.0, 1000.0])
    base = medium(depth, interpolation=interpolation, earth=earth)
    rng = np.random.default_rng(4)
    profiles, fields = (
        rng.normal(0.0, 0.5, (2, depth.size)),
        rng.normal(0.0, 1.0, (2, NORTH.size, EAST.size)),
    )
    extra = sum(f[:, :, None] * p for f, p in zip(fields, profiles, strict=True))
    expected = medium(depth, extra, interpolation=interpolation, earth=earth)
    added = (
        base.depth.size - depth.size
    )  # levels up to the surface, with the value of the first level
    got = base.plus(np.pad(profiles, ((0, 0), (added, 0)), mode="edge"), fields)
    np.testing.assert_allclose(got.sound_speed, expected.sound_speed, rtol=0, atol=1e-11)
    np.testing.assert_allclose(got.field, expected.field, rtol=0, atol=1e-10)
    for one, other in zip(got.domain(), expected.domain(), strict=True):
        if not isinstance(one, tuple):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-10)
    assert not got.sound_speed.flags.writeable
    assert not got.field.flags.writeable
    place = np.array([[100.0, -300.0, 77.0], [-2e3, 1.5e3, 300.0]])
    np.testing.assert_allclose(
        got.sound_speed_at(place), expected.sound_speed_at(place), rtol=0, atol=1e-10
    )


def test_a_sum_knows_whether_it_is_uniform():
    base = Medium.from_grid(
        NORTH,
        EAST,
        [0.0, 1e3],
        np.full((7, 6, 2), 1480.0),
        bathymetry=900.0,
        interpolation="linear",
    )
    ones = np.ones((1, 7, 6))
    assert base.plus([[0.0, 1.0]], ones).layered
    varying = base.plus([[0.0, 1.0]], 1e-3 * ones * EAST)
    assert not varying.uniform
    assert not varying.layered


@pytest.mark.parametrize(("profiles", "fields", "message"), [
    ([[1.0, 2.0]], np.ones((1, 7, 6)), "profiles: shape"),
    (np.zeros((1, 7)), np.ones((2, 7, 6)), "fields: shape"),
    (np.full((1, 7), np.nan), np.ones((1, 7, 6)), "profiles"),
    (np.full((1, 7), 2e3), np.ones((1, 7, 6)), "it must be 1000 to 2500 m/s"),
])  # fmt: skip
def test_a_wrong_sum_is_refused_in_one_line(profiles, fields, message):
    base = medium(np.array([0.0, 10.0, 25.0, 60.0, 150.0, 400.0, 1000.0]))
    refused(AcousticsError, message, base.plus, profiles, fields)
