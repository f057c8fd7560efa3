"""The local frame against the ellipsoid itself: distances, bearings, convergence and scale."""

import numpy as np
import pyproj
import pytest

from pymantaray.errors import GeometryError
from pymantaray.geometry import LocalFrame

CENTRES = [(74.5, -140.0), (78.0, 0.0), (35.0, -75.0), (-60.0, 179.9), (0.0, 0.0), (90.0, 0.0)]
GEOD = pyproj.Geod(ellps="WGS84")


def around(n=7, reach=3e5, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-reach, reach, (2, n))


@pytest.mark.parametrize("centre", CENTRES)
def test_round_trip_within_a_micrometre(centre):
    frame = LocalFrame(*centre)
    north, east = around()
    back = frame.to_local(*frame.to_geodetic(north, east))
    np.testing.assert_allclose(back, (north, east), rtol=0, atol=1e-6)
    np.testing.assert_allclose(frame.to_local(*centre), (0.0, 0.0), rtol=0, atol=1e-6)


@pytest.mark.parametrize("shape", [(), (3,), (2, 4)])
def test_leading_axes_are_kept_and_broadcast(shape):
    frame = LocalFrame(78.0, 0.0)
    place = np.full(shape, 1e4), np.full(shape, -2e4)
    latitude, longitude = frame.to_geodetic(*place)
    assert latitude.shape == longitude.shape == shape
    assert frame.convergence(latitude, longitude).shape == frame.scale_factor(*place).shape == shape
    assert frame.to_local(78.0, longitude)[0].shape == shape


def test_any_window_of_longitudes_gives_results_near_the_centre():
    frame = LocalFrame(74.5, 220.0)
    assert frame.longitude_deg == -140.0
    np.testing.assert_allclose(
        frame.to_local(75.0, 222.0), frame.to_local(75.0, -138.0), rtol=0, atol=1e-6
    )
    _, longitude = LocalFrame(-60.0, 179.9).to_geodetic([0.0, 0.0], [-1e5, 1e5])
    assert 175.0 < longitude[0] < 179.9 < longitude[1] < 185.0


@pytest.mark.parametrize("centre", CENTRES)
def test_distances_and_bearings_at_the_centre_equal_the_ellipsoid(centre):
    frame = LocalFrame(*centre)
    bearing_deg = np.arange(0.0, 360.0, 30.0)
    longitude, latitude, _ = GEOD.fwd(
        np.full(12, centre[1]), np.full(12, centre[0]), bearing_deg, np.full(12, 1000.0)
    )
    north, east = frame.to_local(latitude, longitude)
    np.testing.assert_allclose(north, 1000.0 * np.cos(np.radians(bearing_deg)), rtol=0, atol=1e-4)
    np.testing.assert_allclose(east, 1000.0 * np.sin(np.radians(bearing_deg)), rtol=0, atol=1e-4)


@pytest.mark.parametrize("centre", CENTRES[:4])
def test_convergence_and_scale_carry_vectors_from_the_ellipsoid(centre):
    """
    A short step on the ellipsoid, of any bearing, is turned by the convergence and stretched by the
    scale.
    """
    frame = LocalFrame(*centre)
    north, east = around()
    latitude, longitude = frame.to_geodetic(north, east)
    step = 10.0  # m
    for bearing_deg in (0.0, 77.0, 190.0):
        there = GEOD.fwd(longitude, latitude, np.full(7, bearing_deg), np.full(7, step))
        n1, e1 = frame.to_local(there[1], there[0])
        g, k = frame.convergence(latitude, longitude), frame.scale_factor(north, east)
        v_north, v_east = np.cos(np.radians(bearing_deg)), np.sin(np.radians(bearing_deg))
        expected_north = k * (v_north * np.cos(g) - v_east * np.sin(g))
        expected_east = k * (v_north * np.sin(g) + v_east * np.cos(g))
        np.testing.assert_allclose((n1 - north) / step, expected_north, rtol=0, atol=2e-6)
        np.testing.assert_allclose((e1 - east) / step, expected_east, rtol=0, atol=2e-6)


def test_scale_is_one_at_the_centre_and_grows_with_squared_distance():
    """
    Stereographic on a sphere: k = 1 + d^2 / 4 R^2, with Gauss' radius; no direction is preferred.
    """
    frame = LocalFrame(74.5, -140.0)
    assert float(frame.scale_factor(0.0, 0.0)) == pytest.approx(1.0, rel=0, abs=1e-9)
    meridian = GEOD.a * (1 - GEOD.es) / (1 - GEOD.es * np.sin(np.radians(74.5)) ** 2) ** 1.5
    normal = GEOD.a / np.sqrt(1 - GEOD.es * np.sin(np.radians(74.5)) ** 2)
    for bearing in np.radians([0.0, 90.0, 180.0, 230.0]):
        distance = np.array([1e5, 2e5, 3e5])
        excess = frame.scale_factor(distance * np.cos(bearing), distance * np.sin(bearing)) - 1.0
        np.testing.assert_allclose(excess, distance**2 / (4 * meridian * normal), rtol=1e-3)


@pytest.mark.parametrize(("latitude", "longitude"), [(90.1, 0.0), (np.nan, 0.0), (0.0, np.inf)])
def test_impossible_centre_is_refused(latitude, longitude):
    with pytest.raises(
        GeometryError, match="both must be finite, latitude must be -90 to 90 and longitude"
    ) as error:
        LocalFrame(latitude, longitude)
    assert "\n" not in str(error.value)
