"""Laws of the synthetic oceans, recomputed from their finished fields by finite differences."""

import gsw
import numpy as np
import pytest

from pymantaray.geometry import LocalFrame
from pymantaray.ocean import synthetic_ocean
from pymantaray.ocean.synthetic import REGIONS, beaufort
from pymantaray.ocean.synthetic.geostrophy import eddy_fields

DAY = 86_400.0
OMEGA, RADIUS = 7.292115e-5, 6_371_000.0  # s-1, m


@pytest.mark.parametrize("region", ["beaufort_sea", "fram_strait"])
@pytest.mark.parametrize("component", ["water_u", "water_v"])
def test_vertical_shear_is_the_thermal_wind_of_the_density(region, component, request):
    """
    d(rho f v)/dz = g d(rho)/dx and d(rho f u)/dz = -g d(rho)/dy between all neighbouring levels.

    Density by gsw, gravity by gsw at the latitude, neighbours on either side; points with water two levels
    beneath them and beneath their neighbours.
    """
    ocean = request.getfixturevalue(region)
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
    rms = np.sqrt(np.average((ours - theirs) ** 2, weights=weight) / np.average(theirs**2, weights=weight))
    assert rms < 0.05, rms


def test_one_eddy_s_field_at_a_later_time_is_the_field_moved():
    eddy = next(e for e in beaufort.EDDIES if abs(e.north) < 60e3 and abs(e.east) < 150e3)
    grid = REGIONS["beaufort"].grid()
    days = 9.0
    shift = np.array([eddy.drift_north, eddy.drift_east]) * days * DAY
    later = eddy_fields([eddy], days * DAY, grid, beaufort.HALF_BOX)
    moved_grid = type(grid)(grid.depth, grid.lat, grid.lon, grid.north - shift[0], grid.east - shift[1])
    before = eddy_fields([eddy], 0.0, moved_grid, beaufort.HALF_BOX)
    for a, b in zip(later, before, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    assert np.abs(later[0] - eddy_fields([eddy], 0.0, grid, beaufort.HALF_BOX)[0]).max() > 5.0  # m


def test_the_finished_temperature_travels_with_the_eddies():
    """Seen from its own centre, the cold core of an eddy is the same 12 days later, elsewhere."""
    days = 12.0
    frame = LocalFrame(74.5, -140.0)
    before, after = synthetic_ocean("beaufort"), synthetic_ocean("beaufort", "2014-07-27T12:00")
    followed = 0
    for eddy in beaufort.EDDIES:
        start, end = (eddy.centre(t, beaufort.HALF_BOX) for t in (0.0, days * DAY))
        inside = all(abs(n) < 120e3 and abs(e) < 240e3 for n, e in (start, end))
        alone = all(
            np.hypot(*np.subtract(other.centre(t, beaufort.HALF_BOX), eddy.centre(t, beaufort.HALF_BOX)))
            > 60e3
            for other in beaufort.EDDIES
            if other is not eddy
            for t in (0.0, days * DAY)
        )
        if not (inside and alone and np.hypot(*np.subtract(end, start)) > 2.0 * eddy.radius):
            continue
        first, second, left = (
            core(o, frame, w, eddy) for o, w in ((before, start), (after, end), (after, start))
        )
        size = np.sqrt(np.mean(first**2))
        if size < 0.05:  # too weak against the slope of the region's own water
            continue
        assert np.sqrt(np.mean((second - first) ** 2)) < 0.15 * size, eddy
        assert np.sqrt(np.mean((left - first) ** 2)) > 0.5 * size, eddy
        followed += 1
    assert followed >= 2


def core(ocean, frame, where, eddy):
    """Temperature at the core's depth on circles around a place, against the circle of three radii. [K]"""
    bearing = np.radians(np.arange(0.0, 360.0, 30.0))
    circles = eddy.radius * np.array([0.0, 0.5, 1.0, 1.5, 3.0])[:, None]
    lat, lon = frame.to_geodetic(where[0] + circles * np.cos(bearing), where[1] + circles * np.sin(bearing))
    level = ocean["water_temp"].interp(depth=eddy.core_depth)
    found = level.interp(lat=(("r", "b"), lat), lon=(("r", "b"), lon)).values
    return found[:-1] - found[-1].mean()
