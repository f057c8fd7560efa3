"""
Laws that the synthetic regions obey: grid, stability, thermal wind, drift, sea bed; real casts at
their places.
"""

import gsw
import numpy as np
import pytest
from refusals import refused
from scipy.interpolate import RegularGridInterpolator

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import open_ocean, read_cast, synthetic_ocean, to_local
from pymantaray.ocean.seawater import density_fall, ocean_sound_speed
from pymantaray.ocean.synthetic import HYCOM_DEPTHS, REGIONS, beaufort
from pymantaray.ocean.synthetic.geostrophy import GRAVITY, coriolis, geostrophic_currents

DAY = 86_400.0
OMEGA, RADIUS = 7.292115e-5, 6_371_000.0  # s-1, m


@pytest.fixture(params=["beaufort", "fram"])
def region(request):
    return request.param


@pytest.fixture
def ocean(region, request):
    return request.getfixturevalue({"beaufort": "beaufort_sea", "fram": "fram_strait"}[region])


def test_the_grid_is_hycom_s(region, ocean):
    n_lon, n_lat, lat_0, lon_0 = {
        "beaufort": (251, 76, 74.5, -140.0),
        "fram": (237, 75, 78.0, 0.0),
    }[region]
    assert dict(ocean.sizes) == {"depth": 40, "lat": n_lat, "lon": n_lon}
    np.testing.assert_allclose(np.diff(ocean["lat"]), 0.04, atol=1e-9)
    np.testing.assert_allclose(np.diff(ocean["lon"]), 0.08, atol=1e-9)
    assert float(ocean["lat"].mean()) == pytest.approx(lat_0)
    assert float(ocean["lon"].mean()) == pytest.approx(lon_0)


def test_the_levels_are_those_of_hycom_s_files(gulf_stream_files):
    np.testing.assert_array_equal(open_ocean(gulf_stream_files)["depth"], HYCOM_DEPTHS)


def test_density_rises_with_depth_everywhere(ocean):
    assert np.isfinite(ocean["water_temp"].values).sum() > 4e5
    assert not (density_fall(ocean) > 0.0).any()


@pytest.mark.parametrize("component", ["water_u", "water_v"])
def test_vertical_shear_is_the_thermal_wind_of_the_density(ocean, component):
    """
    d(rho f v)/dz = g d(rho)/dx and d(rho f u)/dz = -g d(rho)/dy between all neighbouring levels.

    Density by gsw, gravity by gsw at the latitude, neighbours on either side; points with water two
    levels beneath them and beneath their neighbours.
    """
    depth, lat, lon = (ocean[name].values for name in ("depth", "lat", "lon"))
    middle = float(lat.mean())
    p = gsw.p_from_z(-depth, middle)[:, None, None]
    SA = gsw.SA_from_SP(ocean["salinity"].values, p, float(lon.mean()), middle)
    rho = gsw.rho(SA, gsw.CT_from_t(SA, ocean["water_temp"].values, p), p)
    f = 2.0 * OMEGA * np.sin(np.radians(lat))[:, None]
    gravity = gsw.grav(lat, 0.0)[:, None]
    inner = (slice(None), slice(1, -1), slice(1, -1))
    if component == "water_v":
        metres = RADIUS * np.cos(np.radians(lat[1:-1]))[:, None] * np.radians(lon[2:] - lon[:-2])
        slope = (rho[:, 1:-1, 2:] - rho[:, 1:-1, :-2]) / metres
    else:
        metres = RADIUS * np.radians(lat[2:] - lat[:-2])[:, None]
        slope = -(rho[:, 2:, 1:-1] - rho[:, :-2, 1:-1]) / metres
    momentum = (rho * f * ocean[component].values)[inner]
    shear = np.diff(momentum, axis=0) / np.diff(depth)[:, None, None]
    wind = gravity[1:-1] * 0.5 * (slope[1:] + slope[:-1])
    away = np.isfinite(wind[2:]) & np.isfinite(shear[2:])  # two more levels of water beneath
    ours, theirs = shear[:-2][away], wind[:-2][away]
    assert ours.size > 3e5
    # each pair of levels counts by its thickness: shear times thickness is a change of current
    weight = np.broadcast_to(np.diff(depth)[:-2, None, None], away.shape)[away]
    rms = np.sqrt(
        np.average((ours - theirs) ** 2, weights=weight) / np.average(theirs**2, weights=weight)
    )
    assert rms < 0.05, rms


def test_geostrophic_currents_of_a_uniform_slope_have_closed_form():
    """
    Density that changes linearly eastward by depth-independent b: v(z) = g b (D - z) / (rho f).
    """
    depth, lat, lon = (
        np.array([0.0, 100.0, 400.0, 1e3]),
        np.linspace(74.0, 75.0, 9),
        np.linspace(0.0, 2.0, 11),
    )
    b = 1e-6  # kg m-4
    x = RADIUS * np.radians(lon) * np.cos(np.radians(lat))[:, None]
    density = np.broadcast_to(1_027.0 + b * x, (4, 9, 11))
    _, v = geostrophic_currents(density, depth, lat, lon, np.zeros((9, 11)))
    expected = -GRAVITY * b * (1_000.0 - depth)[:, None, None] / (density * coriolis(lat)[:, None])
    np.testing.assert_allclose(v, expected, rtol=1e-9, atol=1e-12)
    # a slope of the reference surface adds g/f times the slope at every level
    _, tilted = geostrophic_currents(density, depth, lat, lon, 1e-7 * x)
    np.testing.assert_allclose(
        tilted - v, GRAVITY * 1e-7 / coriolis(lat)[:, None] + 0 * v, rtol=1e-3
    )


def test_currents_flow_both_ways_in_fram_strait(fram_strait):
    upper = fram_strait["water_v"].sel(depth=slice(0.0, 300.0)).mean(["depth", "lat"])
    west, east = upper.sel(lon=slice(-6.0, -3.0)).min(), upper.sel(lon=slice(4.0, 9.0)).max()
    assert float(west) < -0.08
    assert float(east) > 0.08
    cold = fram_strait["water_temp"].sel(depth=50.0, lon=slice(-9.0, -6.5)).max()
    warm = fram_strait["water_temp"].sel(depth=50.0, lon=slice(8.0, 9.0)).min()
    assert float(cold) < -1.0
    assert float(warm) > 3.0


def test_the_beaufort_gyre_turns_clockwise_and_weakens_with_depth(beaufort_sea):
    v = (
        beaufort_sea["water_v"]
        .sel(lat=slice(74.0, 75.0), lon=slice(-141.0, -139.0))
        .mean(["lat", "lon"])
    )
    profile = v.sel(depth=[0.0, 100.0, 250.0, 1_000.0]).values
    assert np.all(profile < 0.0), "east of the gyre's centre the flow is southward"
    assert np.all(np.diff(profile) > 0.0)
    assert -0.05 < profile[0] < -0.01


def test_the_layers_of_the_beaufort_sea_are_there(beaufort_sea):
    column = beaufort_sea.sel(lat=74.5, lon=-140.0, method="nearest")
    temperature = column["water_temp"]
    pacific = temperature.sel(depth=slice(45.0, 80.0))
    winter = temperature.sel(depth=slice(125.0, 225.0))
    atlantic = temperature.sel(depth=slice(300.0, 700.0))
    assert float(temperature.sel(depth=slice(0.0, 35.0)).max()) < -1.0
    assert float(pacific.max()) > -0.3
    assert float(winter.min()) < -1.3
    assert float(atlantic.max()) == pytest.approx(0.7, abs=0.1)
    assert float(column["salinity"].sel(depth=0.0)) < 28.0
    # below 2,700 m the water is homogeneous: in-situ temperature rises adiabatically
    assert float(temperature.sel(depth=3_000.0)) > float(temperature.sel(depth=2_500.0))


def test_currents_have_the_size_of_real_ones(region, ocean):
    speed = np.hypot(ocean["water_u"], ocean["water_v"])
    assert 0.05 < float(speed.max()) < 0.6
    assert float(speed.sel(depth=2_000.0).max()) < 0.15
    assert 0.003 < float(speed.sel(depth=slice(0.0, 300.0)).median()) < 0.1


@pytest.mark.parametrize(
    "region", ["beaufort", pytest.param("fram", marks=pytest.mark.slow)], indirect=True
)
def test_floats_drift_in_a_week_but_stay(ocean):
    """
    Frozen currents at the paper's depths: a few to some tens of kilometres, inside the domain.
    """
    local = to_local(ocean)
    axes = (local["north"].values, local["east"].values)
    for depth in (250.0, 500.0, 1_000.0, 1_500.0, 2_000.0, 2_500.0):
        level = local.sel(depth=depth)
        field = RegularGridInterpolator(
            axes, np.stack([level["current_north"], level["current_east"]], -1)
        )
        start = np.array([[n, e] for n in (-6e3, 0.0, 6e3) for e in (-6e3, 0.0, 6e3)])
        position = start.copy()
        for _ in range(7 * 24):
            position += 3_600.0 * field(position)
        drift = np.linalg.norm(position - start, axis=1)
        assert np.all(drift > 500.0)
        assert np.all(drift < 60e3), (depth, drift)


def test_the_sea_bed_is_deep_under_the_fleet_and_has_structure(region, ocean, as_stored):
    definition = REGIONS[region]
    grid = definition.grid()
    floor = definition.floor(grid)
    near = np.hypot(grid.north, grid.east) < 40e3
    assert floor[near].min() > 3_000.0
    assert floor.min() < 2_000.0
    dry = ~np.isfinite(ocean["water_temp"].values)
    np.testing.assert_array_equal(dry, grid.depth[:, None, None] > floor)
    local = to_local(ocean, half_extent=(30e3, 30e3))
    np.testing.assert_allclose(local["sea_floor_depth"], 3_500.0)
    as_stored(local)


LATER = "2014-07-27T12:00"


@pytest.fixture(scope="module")
def later_beaufort_sea():
    return synthetic_ocean("beaufort", LATER)


@pytest.fixture
def later(region, request):
    """The ocean of a region twelve days later."""
    if region == "fram":
        return synthetic_ocean("fram", LATER)
    return request.getfixturevalue("later_beaufort_sea")


@pytest.mark.parametrize(
    "region", ["beaufort", pytest.param("fram", marks=pytest.mark.slow)], indirect=True
)
def test_the_same_time_gives_the_same_ocean_and_another_moves_it(region, ocean, later):
    again = synthetic_ocean(region, np.datetime64("2014-07-15T00:00"))
    np.testing.assert_array_equal(again["water_temp"], ocean["water_temp"])
    np.testing.assert_array_equal(again["water_u"], ocean["water_u"])
    change = np.abs(later["water_temp"] - ocean["water_temp"]).sel(depth=60.0)
    assert float(change.max()) > 0.3
    assert float(change.median()) < 0.1, "most of the region is not reached by an eddy or a front"


def test_a_changed_ocean_does_not_change_the_next(as_stored):
    one = synthetic_ocean("fram")
    one["water_temp"][:] = 20.0
    assert float(synthetic_ocean("fram")["water_temp"].max()) < 10.0
    as_stored(one)


def test_eddies_turn_clockwise_and_are_where_their_drift_takes_them(
    beaufort_sea, later_beaufort_sea
):
    """The currents around the Beaufort Sea's eddies move with their drift velocity."""
    days = 12.0
    frame = LocalFrame(74.5, -140.0)
    before, after = beaufort_sea, later_beaufort_sea
    followed = 0
    for eddy in beaufort.EDDIES:
        start, end = (eddy.centre(t, beaufort.HALF_BOX) for t in (0.0, days * DAY))
        inside = all(abs(n) < 125e3 and abs(e) < 240e3 for n, e in (start, end))
        if not inside or np.hypot(end[0] - start[0], end[1] - start[1]) < 3.0 * eddy.radius:
            continue
        here, there = (swirl(before, frame, where, eddy) for where in (start, end))
        left, arrived = (swirl(after, frame, where, eddy) for where in (start, end))
        assert min(here, arrived) > 0.03, (eddy, here, arrived)
        assert max(abs(there), abs(left)) < 0.2 * min(here, arrived), (eddy, there, left)
        followed += 1
    assert followed >= 2


def swirl(ocean, frame, where, eddy):
    """Mean clockwise current on the circle of an eddy's radius, at the depth of its core. [m/s]"""
    bearing = np.radians(np.arange(0.0, 360.0, 15.0))
    lat, lon = frame.to_geodetic(
        where[0] + eddy.radius * np.cos(bearing), where[1] + eddy.radius * np.sin(bearing)
    )
    level = ocean.sel(depth=eddy.core_depth, method="nearest")
    axes = (level["lat"].values, level["lon"].values)
    u, v = (
        RegularGridInterpolator(axes, level[name].values)((lat, lon))
        for name in ("water_u", "water_v")
    )
    outward = bearing - frame.convergence(lat, lon)  # true bearing of the radius
    return float(np.mean(u * np.cos(outward) - v * np.sin(outward)))


@pytest.mark.parametrize("days", [9.0, 365.0])
def test_eddies_drift_and_return_on_the_other_side_of_the_box(days):
    for eddy in beaufort.EDDIES:
        place = np.array(eddy.centre(days * DAY, beaufort.HALF_BOX))
        moved = np.array(
            [eddy.north + eddy.drift_north * days * DAY, eddy.east + eddy.drift_east * days * DAY]
        )
        turns = (place - moved) / (2.0 * np.array(beaufort.HALF_BOX))
        np.testing.assert_allclose(turns, np.round(turns), rtol=0, atol=1e-9)
        assert np.all(np.abs(place) <= beaufort.HALF_BOX)


def test_unknown_regions_and_times_are_refused():
    refused(
        OceanError,
        r"'baltic' is unknown; available: beaufort, fram",
        open_ocean,
        "synthetic:baltic",
    )
    refused(OceanError, "not an instant", synthetic_ocean, "fram", "soon")


def model(ocean, depth, position):
    """Sound speed of an ocean along a vertical line, linear between its points. [m/s]"""
    axes = tuple(ocean[name].values for name in ("depth", "lat", "lon"))
    line = np.column_stack(
        [depth, np.full_like(depth, position[0]), np.full_like(depth, position[1])]
    )
    return RegularGridInterpolator(axes, ocean_sound_speed(ocean), bounds_error=False)(line)


@pytest.mark.parametrize(("name", "span"), [
    ("beaufort_axctd_20140724_74N140W", (0.0, 1_000.0)),  # nine days after the paper's date
    ("beaufort_axctd_20140724_75N140W", (0.0, 1_000.0)),
    ("beaufort_ctd_1997_canada_basin", (1_000.1, 2_900.0)),
])  # fmt: skip
def test_the_beaufort_sea_is_within_2_m_s_rms_of_the_casts(
    shared_data, beaufort_sea, name, span, as_stored
):
    cast = read_cast(shared_data / "casts" / f"{name}.csv")
    error = model(beaufort_sea, cast.depth, (cast.lat, cast.lon)) - cast.sound_speed()
    part = (cast.depth >= span[0]) & (cast.depth <= span[1])
    assert cast.depth[part & np.isfinite(error)].max() > 0.99 * span[1]
    assert np.sqrt(np.nanmean(error[part] ** 2)) < 2.0
    as_stored(cast)


def test_fram_strait_lies_within_the_casts_envelope_widened_by_2_m_s(shared_data, fram_strait):
    levels = np.concatenate([np.arange(100.0, 1_000.0, 20.0), np.arange(1_000.0, 2_600.0, 100.0)])
    casts = [
        read_cast(path) for path in sorted((shared_data / "casts").glob("fram_bottle_1982_*.csv"))
    ]
    assert len(casts) == 4
    curves = np.array([np.interp(levels, c.depth, c.sound_speed(), right=np.nan) for c in casts])
    low, high = np.nanmin(curves, axis=0) - 2.0, np.nanmax(curves, axis=0) + 2.0
    for c in casts:
        speed = model(fram_strait, levels, (c.lat, c.lon))
        wet = np.isfinite(speed)
        assert wet.sum() > 50
        assert np.all(speed[wet] >= low[wet])
        assert np.all(speed[wet] <= high[wet])
