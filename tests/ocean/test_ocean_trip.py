"""From the geographic grid through the local frame to the interpolant that rays see: properties, with bounds."""

import numpy as np
import pyproj
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline, CubicHermiteSpline

from pymantaray.acoustics import Medium
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import to_local
from pymantaray.ocean.seawater import sound_speed

GEOD = pyproj.Geod(ellps="WGS84")
LEVELS = [0.0, 100.0, *np.arange(200.0, 2_001.0, 200.0)]
DEPTH_SPLINE = (
    0.002  # m/s; what a natural cubic spline through these levels loses of isothermal water, doubled
)
PER_KELVIN = 4.6  # m/s; of sound speed near 3 degC
QUICK = settings(
    max_examples=5,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    phases=[Phase.explicit, Phase.generate],
)


def interpolant(local, points):
    """Sound speed at points (n, 3), from the coefficients that the ray kernels take, by SciPy's splines."""
    medium = Medium.from_dataset(local)
    levels = medium.depth.size
    at = []
    for north, east, down in points:
        along_east = BSpline(medium.knots_north, medium.field, 3)(north)
        column = BSpline(medium.knots_east, along_east, 3)(east)
        at.append(float(CubicHermiteSpline(medium.depth, column[:levels], column[levels:])(down)))
    return np.array(at)


@pytest.mark.parametrize("latitude", [0.0, 45.0, 78.0, 85.0])
@QUICK
@given(
    longitude=st.sampled_from([20.0, -30.0, 179.97, -179.5, 180.0]),
    points_a_wave=st.sampled_from([10.0, 16.0, 40.0]),
    heading=st.floats(0.0, np.pi),
    phase=st.floats(0.0, 2.0 * np.pi),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_wave_survives_the_trip_to_the_interpolant(
    closed_form_ocean, latitude, longitude, points_a_wave, heading, phase, seed
):
    """
    A plane wave in degrees with p points a wavelength, amplitude 1 K.

    A cubic spline through samples h apart errs by (5/384) h^4 f'''' at most: 0.02 of the amplitude with 10
    points a wave, 0.003 with 16, 1e-4 with 40. The wave passes two of them (to the nodes of the local grid, and
    between these), in two directions: four times that bounds it, with what the depth spline adds.
    """
    step = np.array([0.04, 0.08])  # degrees, of the grid
    direction = np.array([np.cos(heading), np.sin(heading)])
    number = 2.0 * np.pi / points_a_wave * direction / step  # per degree, along lat and lon

    def temperature(_z, lat, lon):
        east = (lon - longitude + 180.0) % 360.0 - 180.0
        return 3.0 + np.cos(number[0] * (lat - latitude) + number[1] * east + phase)

    ocean = closed_form_ocean(
        latitude, longitude, temperature=temperature, depth=LEVELS, n=(41, 45), floor=lambda _lat, _lon: 1e4
    )
    local = to_local(ocean)
    half = np.array([local["north"].values[-1], local["east"].values[-1]])
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-0.75, 0.75, (20, 2)) * half, rng.uniform(0.0, 2_000.0, 20)])
    lon, lat = pyproj.Proj(local.attrs["proj_string"])(points[:, 1], points[:, 0], inverse=True)
    expected = sound_speed(temperature(points[:, 2], lat, lon), 34.0, points[:, 2], lat, lon)
    error = np.abs(interpolant(local, points) - expected)
    sample = 5.0 / 384.0 * (2.0 * np.pi / points_a_wave) ** 4
    assert error.max() < 4.0 * sample * PER_KELVIN + DEPTH_SPLINE, (error.max(), sample * PER_KELVIN)


def wide_ocean(closed_form_ocean, u, v):
    return closed_form_ocean(
        78.0,
        0.0,
        temperature=lambda z, _lat, _lon: 1.0 + 0 * z,
        u=lambda z, _lat, _lon: u + 0 * z,
        v=lambda z, _lat, _lon: v + 0 * z,
        n=(151, 561),
        depth=[0.0, 100.0],
    )


@pytest.mark.parametrize(("u", "v"), [(0.5, 0.0), (0.0, 0.5), (-0.3, 0.4)])
@pytest.mark.parametrize("side", [-20.0, 20.0])
def test_currents_point_where_they_should_twenty_degrees_off_the_centre_meridian(
    closed_form_ocean, u, v, side
):
    local = to_local(wide_ocean(closed_form_ocean, u, v), half_extent=(100e3, 480e3))
    frame = LocalFrame(78.0, 0.0)
    north, east = frame.to_local(78.0, side)
    current = [
        float(local[f"current_{axis}"].isel(depth=0).interp(north=north, east=east))
        for axis in ("north", "east")
    ]
    assert np.hypot(*current) == pytest.approx(np.hypot(u, v), rel=1e-4)
    # the geodesic a kilometre along the current, seen in the frame
    true = np.degrees(np.arctan2(u, v))
    lon, lat, _ = GEOD.fwd(side, 78.0, true, 1_000.0)
    moved = np.array(frame.to_local(lat, lon)) - [north, east]
    bearing, expected = (
        np.degrees(np.arctan2(current[1], current[0])),
        np.degrees(np.arctan2(moved[1], moved[0])),
    )
    assert (bearing - expected + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.02)
    # meridians converge by nearly sin(latitude) times the longitude: east of the centre true north lies to the left
    turned = (bearing - true + 180.0) % 360.0 - 180.0
    assert turned == pytest.approx(-side * np.sin(np.radians(78.0)), abs=0.3)


def test_without_the_rotation_the_current_would_be_twenty_degrees_off(closed_form_ocean):
    """Guards the sign above: a northward current east of the centre has a westward part in the frame."""
    local = to_local(wide_ocean(closed_form_ocean, 0.0, 0.5), half_extent=(100e3, 480e3))
    east_side = local.sel(east=450e3, north=78e3, method="nearest").isel(depth=0)
    assert float(east_side["current_east"]) < -0.15
    assert float(east_side["current_north"]) > 0.4
