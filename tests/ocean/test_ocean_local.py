"""
From latitude and longitude to the local frame and to the interpolant that rays see, against closed
forms and geodesics.
"""

import numpy as np
import pyproj
import pytest
from factories import QUICK
from hypothesis import given, settings, strategies as st
from refusals import refused
from scipy.interpolate import (
    BSpline,
    CubicHermiteSpline,
    RectBivariateSpline,
    RegularGridInterpolator,
    make_interp_spline,
)

from pymantaray.acoustics import Medium
from pymantaray.errors import GeometryError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.splines import AxisSpline
from pymantaray.ocean import assemble_ocean, check_ocean, to_local
from pymantaray.ocean.seawater import ocean_sound_speed, sound_speed
from pymantaray.ocean.window import Window, crop_around

GEOD = pyproj.Geod(ellps="WGS84")

LEVELS = [0.0, 100.0, *np.arange(200.0, 2_001.0, 200.0)]
DEPTH_SPLINE = (
    0.002  # m/s; twice what a natural cubic spline through these levels loses of isothermal water
)
PER_KELVIN = 4.6  # m/s; of sound speed near 3 degC


def nodes(local):
    """Latitude and longitude of a local data set's nodes, from its PROJ string alone."""
    north, east = np.meshgrid(local["north"], local["east"], indexing="ij")
    lon, lat = pyproj.Proj(local.attrs["proj_string"])(east, north, inverse=True)
    return lat, lon


@pytest.mark.parametrize("centre", [(78.0, 0.0), (45.0, 180.0), (-70.0, 150.0)], ids=str)
def test_currents_point_where_a_drifter_would_go(closed_form_ocean, centre, as_stored):
    """
    Off the centre meridian, moving along the geodesic must move the local point along the current.
    """
    u, v, seconds = 0.4, 0.3, 2_000.0
    ocean = closed_form_ocean(
        *centre,
        temperature=lambda z, _lat, _lon: 1.0 + 0 * z,
        u=lambda z, _lat, _lon: u + 0 * z,
        v=lambda z, _lat, _lon: v + 0 * z,
        n=(75, 237),
        depth=[0.0, 100.0],
    )
    local = to_local(ocean)
    lat, lon = nodes(local)
    azimuth = np.degrees(np.arctan2(u, v))
    lon_1, lat_1, _ = GEOD.fwd(
        lon, lat, np.full_like(lat, azimuth), np.full_like(lat, seconds * np.hypot(u, v))
    )
    frame = LocalFrame(local.attrs["centre_latitude_deg"], local.attrs["centre_longitude_deg"])
    north, east = frame.to_local(lat_1, lon_1)
    moved_north = (north - local["north"].values[:, None]) / seconds
    moved_east = (east - local["east"].values) / seconds
    scale = frame.scale_factor(*np.meshgrid(local["north"], local["east"], indexing="ij"))
    np.testing.assert_allclose(
        local["current_north"][..., 0] * scale, moved_north, rtol=0, atol=1e-4
    )
    np.testing.assert_allclose(local["current_east"][..., 0] * scale, moved_east, rtol=0, atol=1e-4)
    bearing = np.arctan2(local["current_east"], local["current_north"]).values
    turned = np.degrees(np.ptp(bearing))
    assert turned > 5.0, f"the convergence turns this vector by {turned} degrees over the domain"
    as_stored(local)


@pytest.mark.parametrize("region", ["beaufort_sea", "fram_strait"])
def test_the_default_domain_is_the_largest_rectangle_that_fits(region, request, as_stored):
    ocean = request.getfixturevalue(region)
    lat, lon = ocean["lat"].values, ocean["lon"].values
    window = Window(lat, lon, LocalFrame(0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1])))
    north, east = window.largest_rectangle()
    assert window.holds(north, east)
    assert not window.holds(north + 10.0, east + 10.0)
    for taller in np.linspace(0.5, 1.2, 29):
        assert not window.holds(north * taller, east / taller * 1.002), taller
    as_stored(ocean)


def test_the_domain_of_a_study_and_what_it_says_of_itself(fram_strait, as_stored):
    local = to_local(fram_strait, centre=(78.1, 0.5), half_extent=(40e3, 50e3))
    assert local["north"].values[[0, -1]] == pytest.approx([-40e3, 40e3])
    assert local["east"].values[[0, -1]] == pytest.approx([-50e3, 50e3])
    assert 0.0 in local["north"].values
    assert 0.0 in local["east"].values
    step = 0.04 * GEOD.inv(0.5, 77.6, 0.5, 78.6)[2]
    assert np.diff(local["north"])[0] == pytest.approx(step, rel=0.06)
    assert local["sound_speed"].dims == ("north", "east", "depth")
    assert local["sound_speed"].dtype == np.float64
    assert local.attrs["centre_latitude_deg"] == 78.1
    assert local.attrs["centre_longitude_deg"] == 0.5
    assert local.attrs["synthetic"] == 1
    assert local.attrs["time"] == "2014-07-15T00:00:00"
    frame = LocalFrame(78.1, 0.5)
    corner = float(frame.scale_factor(40e3, 50e3)) - 1.0
    assert local.attrs["scale_error_max"] == pytest.approx(corner, rel=0.05)
    assert not any(np.isnan(local[name]).any() for name in local.data_vars)
    as_stored(local)


def test_the_grid_points_used_are_enough_for_the_spline_through_all(fram_strait, as_stored):
    """The influence of a point n spacings away on a cubic spline is 0.268^n of its value."""
    local = to_local(fram_strait, centre=(78.1, 0.5), half_extent=(20e3, 20e3))
    surface = ocean_sound_speed(fram_strait)[0]
    assert np.isfinite(surface).all()
    whole = RectBivariateSpline(fram_strait["lat"], fram_strait["lon"], surface, s=0)
    np.testing.assert_allclose(
        local["sound_speed"][..., 0], whole.ev(*nodes(local)), rtol=0.0, atol=1e-9
    )
    as_stored(local)


def chessboard(lat, lon):
    """0 and 1 on squares of two by two grid points of HYCOM's grid."""
    rows, columns = np.round(lat / 0.04).astype(int), np.round(lon / 0.08).astype(int)
    return (rows // 2 + columns // 2) % 2


@pytest.mark.parametrize("kelvin", [2.0, 16.0])
def test_a_front_that_the_grid_does_not_resolve_is_linear(closed_form_ocean, kelvin, as_stored):
    """A chessboard of 2 K is splined through, one of 16 K is not."""
    ocean = closed_form_ocean(
        75.0,
        0.0,
        temperature=lambda _z, lat, lon: 3.0 + kelvin * chessboard(lat, lon),
        n=(21, 21),
        depth=[0.0, 100.0],
    )
    local = to_local(ocean, half_extent=(20e3, 20e3))
    surface = ocean_sound_speed(ocean)[0]
    places, axes = np.stack(nodes(local), axis=-1), (ocean["lat"].values, ocean["lon"].values)
    linear = RegularGridInterpolator(axes, surface)(places)
    spline = RectBivariateSpline(*axes, surface, s=0).ev(places[..., 0], places[..., 1])
    by_spline = kelvin == 2.0
    expected = spline if by_spline else linear
    np.testing.assert_allclose(local["sound_speed"][..., 0], expected, rtol=0.0, atol=1e-9)
    assert np.abs(spline - linear).max() > 0.5, "the difference is not visible"
    notes = [note for medium in (ocean, local) for note in Medium.from_dataset(medium).notes]
    found = [note for note in notes if note.startswith("along latitude and longitude the sound")]
    assert len(found) == (0 if by_spline else 2)
    as_stored(local)


def test_a_front_below_the_sea_bed_bounds_nothing(closed_form_ocean, as_stored):
    """Only the water counts: what is extended below the sea bed reaches no ray."""

    ocean = closed_form_ocean(
        75.0,
        0.0,
        temperature=lambda z, lat, lon: 3.0 + 16.0 * chessboard(lat, lon) * (z > 350.0),
        floor=lambda lat, _lon: np.where(lat > 75.0, 150.0, 1e4),
        n=(21, 21),
        depth=[0.0, 100.0, 200.0, 300.0, 400.0],
    )
    for lat, bounded in ((75.2, False), (74.8, True)):
        local = to_local(ocean, (lat, 0.0), (6e3, 10e3))
        assert ("sound_speed_bound" in local.attrs) == bounded
    as_stored(local)


@settings(QUICK)
@given(
    n=st.integers(1, 40),
    degree=st.sampled_from([1, 3]),
    seed=st.integers(0, 2**32 - 1),
)
def test_splines_along_an_axis_are_those_of_scipy(n, degree, seed):
    rng = np.random.default_rng(seed)
    points, values = np.cumsum(rng.uniform(0.1, 1.0, n)), rng.normal(size=(3, n, 2))
    spline = AxisSpline(points, degree)
    ours = spline.coefficients(values, axis=1)
    if n == 1:
        np.testing.assert_array_equal(ours, values)
        return
    theirs = make_interp_spline(points, values, k=min(degree, n - 1), axis=1)
    np.testing.assert_array_equal(spline.knots, theirs.t)
    size = np.abs(theirs.c).max()
    np.testing.assert_allclose(ours, np.moveaxis(theirs.c, 0, 1), rtol=0.0, atol=1e-12 * size)


def test_sound_speed_goes_on_rising_beneath_the_sea_bed(closed_form_ocean, as_stored):
    """
    Between the deepest valid level and the coarse floor there is water: its gradient is pressure's.
    """
    ocean = closed_form_ocean(
        78.0,
        0.0,
        temperature=lambda z, _lat, _lon: -1.0 + 0 * z,
        floor=lambda _lat, _lon: 3_200.0,
        n=(9, 9),
        depth=[0.0, 1_000.0, 3_000.0, 4_000.0],
    )
    local = to_local(ocean)
    np.testing.assert_allclose(local["sea_floor_depth"], 3_500.0)
    assert float(local["sea_floor_depth"].max()) <= 3_500.0
    gradient = np.diff(local["sound_speed"].values[4, 4]) / np.diff(local["depth"])
    assert gradient[-1] == pytest.approx(0.018, abs=0.003)  # s-1, of isothermal water
    as_stored(local)


@pytest.mark.parametrize(("options", "message"), [
    ({"half_extent": (300e3, 50e3)}, "does not fit into the data"),
    ({"half_extent": (0.0, 50e3)}, "both half sides must be positive"),
    ({"centre": (70.0, 0.0)}, "is not inside the data"),
    ({"equation": "guess"}, "'guess' is unknown"),
])  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(fram_strait, options, message):
    refused(OceanError, message, to_local, fram_strait, **options)


def globe(first_lon, lat):
    """Ocean around the globe on latitudes, with a temperature that is smooth on the sphere."""
    lon = first_lon + 2.0 * np.arange(180.0)
    grid = np.radians(lat)[:, None], np.radians(lon)
    temperature = 5.0 + 3.0 * np.cos(grid[0]) * np.cos(grid[1])
    shape = (2, *temperature.shape)
    fields = {"water_temp": np.broadcast_to(temperature, shape), "salinity": np.full(shape, 34.0)}
    fields |= {name: np.zeros(shape) for name in ("water_u", "water_v")}
    return assemble_ocean(
        {"depth": np.array([0.0, 100.0]), "lat": lat, "lon": lon},
        np.datetime64("2020-01-01"),
        fields,
        title="globe",
        source="test",
        synthetic=True,
    )


@pytest.mark.parametrize("first_lon", [-180.0, -179.0, 0.0, -358.0])
@pytest.mark.parametrize("centre", [(61.0, 180.0), (61.0, -0.5), (89.0, 1.0), (89.0, -179.9)])
def test_an_ocean_around_the_globe_has_no_seam(first_lon, centre, as_stored):
    ocean = globe(first_lon, np.linspace(60.0, 90.0, 301))
    half = (30e3, 60e3 if centre[0] > 80.0 else 200e3)
    cropped = crop_around(ocean, centre, half)
    for tolerance, water in ((1e-3, ocean), (0.05, cropped)):  # a few columns make a poorer spline
        local = to_local(water, centre, half)
        lat, lon = nodes(local)
        temperature = 5.0 + 3.0 * np.cos(np.radians(lat)) * np.cos(np.radians(lon))
        truth = sound_speed(temperature, 34.0, 0.0, lat, lon)
        np.testing.assert_allclose(local["sound_speed"][..., 0], truth, rtol=0.0, atol=tolerance)
    as_stored(local)


@pytest.mark.parametrize(("centre", "half", "message"), [
    ((89.9, 0.0), (20e3, 20e3), "contains a pole; set half_extent to at most"),
    ((90.0, 0.0), (20e3, 20e3), "is at a pole, where north has no direction"),
    ((61.0, 1e9), (20e3, 20e3), "longitude -720 to 720"),
])  # fmt: skip
def test_a_domain_with_a_pole_in_it_is_refused(centre, half, message, as_stored):
    ocean = globe(0.0, np.linspace(85.0, 90.0, 11))
    refused((OceanError, GeometryError), message, to_local, ocean, centre, half)
    assert check_ocean(ocean, centre=centre, half_extent=half).named("coverage") is not None
    as_stored(ocean)


def test_water_south_of_86_s_has_no_sound_speed(as_stored):
    ocean = globe(0.0, -np.arange(85.0, 89.1, 0.5)[::-1])
    message = "TEOS-10 has no sea water south of 86 S"
    refused(OceanError, message, to_local, ocean, (-88.0, 10.0), (5e3, 5e3))
    as_stored(ocean)


def interpolant(local, points):
    """
    Sound speed at points (n, 3), from the coefficients that the ray kernels take, by SciPy's
    splines.
    """
    medium = Medium.from_dataset(local)
    levels = medium.depth.size
    at = []
    for north, east, down in points:
        along_east = BSpline(medium.knots_north, medium.field, 3)(north)
        column = BSpline(medium.knots_east, along_east, 3)(east)
        at.append(float(CubicHermiteSpline(medium.depth, column[:levels], column[levels:])(down)))
    return np.array(at)


@settings(QUICK, max_examples=5)
@given(
    place=st.sampled_from(
        [(0.0, 20.0), (45.0, -30.0), (78.0, 179.97), (85.0, -179.5), (45.0, 180.0)]
    ),
    points_a_wave=st.sampled_from([10.0, 16.0, 40.0]),
    heading=st.floats(0.0, np.pi),
    phase=st.floats(0.0, 2.0 * np.pi),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_wave_survives_the_trip_to_the_interpolant(
    closed_form_ocean, place, points_a_wave, heading, phase, seed
):
    """
    A plane wave in degrees with p points a wavelength, amplitude 1 K.

    A cubic spline through samples h apart errs by (5/384) h^4 f'''' at most: 0.02 of the amplitude
    with 10 points a wave, 0.003 with 16, 1e-4 with 40. The wave passes two of them (to the nodes of
    the local grid, and between these), in two directions: four times that bounds it, with what the
    depth spline adds. UNESCO's equation, since TEOS-10's atlas of compositions has kinks, every 4
    degrees.
    """
    latitude, longitude = place
    step = np.array([0.04, 0.08])  # degrees, of the grid
    direction = np.array([np.cos(heading), np.sin(heading)])
    number = 2.0 * np.pi / points_a_wave * direction / step  # per degree, along lat and lon

    def temperature(_z, lat, lon):
        east = (lon - longitude + 180.0) % 360.0 - 180.0
        return 3.0 + np.cos(number[0] * (lat - latitude) + number[1] * east + phase)

    ocean = closed_form_ocean(
        latitude,
        longitude,
        temperature=temperature,
        depth=LEVELS,
        n=(41, 45),
        floor=lambda _lat, _lon: 1e4,
    )
    local = to_local(ocean, equation="unesco")
    half = np.array([local["north"].values[-1], local["east"].values[-1]])
    rng = np.random.default_rng(seed)
    points = np.column_stack(
        [rng.uniform(-0.75, 0.75, (20, 2)) * half, rng.uniform(0.0, 2_000.0, 20)]
    )
    lon, lat = pyproj.Proj(local.attrs["proj_string"])(points[:, 1], points[:, 0], inverse=True)
    expected = sound_speed(
        temperature(points[:, 2], lat, lon), 34.0, points[:, 2], lat, lon, equation="unesco"
    )
    error = np.abs(interpolant(local, points) - expected)
    sample = 5.0 / 384.0 * (2.0 * np.pi / points_a_wave) ** 4
    assert error.max() < 4.0 * sample * PER_KELVIN + DEPTH_SPLINE, (
        error.max(),
        sample * PER_KELVIN,
    )
