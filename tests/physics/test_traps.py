"""The traps that a two-point solver falls into, each by name and against a truth of its own."""

from typing import NamedTuple

import numpy as np
import pytest
from oracles import direct_travel_time_linear_gradient, sheet_under

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.errors import AcousticsError
from pymantaray.records import RayStatus

LEVELS = np.array([0.0, 50, 100, 150, 200, 300, 400, 600, 900, 1300, 2000, 3000])
SPEEDS = np.array([1480.0, 1462, 1455, 1461, 1457, 1471, 1496, 1516, 1510, 1560, 1600, 1660])
SOURCE_DEPTH, SOURCE_SPEED = 110.0, 1456.2  # near the axis of the upper duct
BOTTOM = 3000.0


class Loop(NamedTuple):
    """A ray that leaves a depth of piecewise linear water, turns once and is back at that depth."""

    distance: float
    travel_time: float


def loop(ray_parameter, depth, *, levels=LEVELS, speeds=SPEEDS):
    """
    Downward loop by circular arcs, layer by layer; None where the ray does not turn in the water.
    """
    a = ray_parameter
    distance = time = 0.0
    z = depth
    while z < levels[-1]:
        k = np.searchsorted(levels, z, side="right") - 1
        g = (speeds[k + 1] - speeds[k]) / (levels[k + 1] - levels[k])
        c0, c1 = speeds[k] + g * (z - levels[k]), speeds[k + 1]
        turns = a * c1 >= 1.0
        if turns:
            c1 = 1.0 / a
        w0, w1 = np.sqrt(1.0 - (a * c0) ** 2), np.sqrt(max(1.0 - (a * c1) ** 2, 0.0))
        distance += (w0 - w1) / (a * g)
        time += (np.log(c1 * (1.0 + w0)) - np.log(c0 * (1.0 + w1))) / g
        if turns:
            return Loop(2.0 * distance, 2.0 * time)
        z = levels[k + 1]
    return None


def layered(interpolation="linear"):
    return Medium.from_profile(LEVELS, SPEEDS, bottom_depth=BOTTOM, interpolation=interpolation)


def assert_loop_is_found(turning_speed, **options):
    """The eigenray that turns where the sound speed is this is among the arrivals, at its time."""
    a = 1.0 / turning_speed
    exact = loop(a, SOURCE_DEPTH)
    launch = np.arccos(a * SOURCE_SPEED)
    ends = [0.0, 0.0, SOURCE_DEPTH], [exact.distance, 0.0, SOURCE_DEPTH]
    arrivals = find_eigenrays(layered(), *ends, spreading_cutoff_db=None, **options)
    gap = np.abs(arrivals.launch_angle - launch) + np.abs(arrivals.travel_time - exact.travel_time)
    assert gap.min() < 1e-7, (exact, launch, arrivals.launch_angle, arrivals.travel_time)


@pytest.mark.parametrize(
    "turning_speed", [1463.0, 1480.0, 1514.0, 1530.0, 1570.0, 1599.0, *SPEEDS[[5, 6, 7, 9]]]
)
def test_snell_bound_does_not_stop_at_the_first_level(turning_speed):
    """
    Rays that turn in fast water below slower water, at 240 m to 2,000 m, some exactly on a level,
    from a duct whose rim is 1461 m/s.
    """
    assert_loop_is_found(turning_speed)
    assert_loop_is_found(turning_speed, canonical=False)


@pytest.mark.parametrize("distance", [500.0, 1500.0, 3000.0])
def test_steep_sign_changes_are_not_dropped(distance):
    """
    Along a sound-speed maximum the miss jumps from far above to far below: one ray, straight along
    the ridge.

    With c = c0 - k (z - z0)^2 neighbouring rays part as sinh(kappa r) / kappa, kappa^2 = 2 k / c0.
    """
    ridge, curvature, c0 = 500.0, 2e-3, 1480.0
    depth = np.linspace(0.0, 1000.0, 201)
    speed = c0 - np.minimum(curvature * (depth - ridge) ** 2, 60.0)
    medium = Medium.from_profile(depth, speed, bottom_depth=1000.0)
    arrivals = find_eigenrays(
        medium, [0.0, 0.0, ridge], [0.0, distance, ridge], spreading_cutoff_db=None
    )
    along = np.abs(arrivals.launch_angle) < 1e-6
    assert along.sum() == 1
    np.testing.assert_allclose(arrivals.travel_time[along], distance / c0, rtol=0, atol=1e-9)
    kappa = np.sqrt(2.0 * curvature / c0)
    expected = 10.0 * np.log10(np.sinh(kappa * distance) / (kappa * distance))
    np.testing.assert_allclose(arrivals.spreading_db[along], expected, atol=0.05)


def test_live_windows_between_rays_lost_to_the_surface_are_found():
    """
    From 1 m deep, flat downward rays come back to the surface; steeper ones pass the rim, loop
    below and arrive.
    """
    levels = np.array([0.0, 40.0, 80.0, 300.0, 1500.0, BOTTOM])
    speeds = np.array([1450.0, 1454.0, 1451.0, 1453.0, 1480.0, 1505.0])
    medium = Medium.from_profile(levels, speeds, bottom_depth=BOTTOM, interpolation="linear")
    for turning in np.linspace(1454.05, 1478.0, 25):
        a = 1.0 / turning
        exact = loop(a, 1.0, levels=levels, speeds=speeds)
        ends = [0.0, 0.0, 1.0], [0.0, exact.distance, 1.0]
        arrivals = find_eigenrays(medium, *ends, spreading_cutoff_db=None)
        launch = np.arccos(a * (1450.0 + 0.1))
        gap = np.abs(arrivals.launch_angle - launch) + np.abs(
            arrivals.travel_time - exact.travel_time
        )
        assert gap.min(initial=np.inf) < 1e-7, (turning, exact, arrivals.launch_angle)
        # flatter and steeper neighbours that end at the same range come by way of the surface
        assert (arrivals.launch_angle > 0.0).all()


@pytest.mark.parametrize(
    "interpolation", ["linear", pytest.param("smooth", marks=pytest.mark.slow)]
)
def test_rays_do_not_tunnel_through_peaks_of_the_sea_bed(interpolation):
    """
    Straight rays over random peaks and saddles: blocked where they dip into the bilinear bed, and
    only there.
    """
    rng = np.random.default_rng(12)
    north, east = np.linspace(0.0, 10e3, 11), np.linspace(0.0, 8e3, 6)
    bathymetry = rng.uniform(50.0, 2000.0, (11, 6))
    c = np.full((11, 6, 2), 1500.0)
    medium = Medium.from_grid(
        north, east, [0.0, 3e3], c, bathymetry=bathymetry, interpolation=interpolation
    )
    n = 200
    ends = [
        np.column_stack([rng.uniform(0.0, (10e3, 8e3), (n, 2)), rng.uniform(5.0, 900.0, n)])
        for _ in "ab"
    ]
    share = np.linspace(0.0, 1.0, 20_001)[:, None]
    heights = []
    for start, end in zip(*ends, strict=True):
        points = start + share * (end - start)
        heights.append(sheet_under(north, east, bathymetry, points)[0] - points[:, 2])
    heights = np.array(heights)
    clearance, inside = heights.min(axis=1), heights[:, [0, -1]].min(axis=1) > 1e-3
    status = find_eigenrays(medium, *ends).first().status
    expected = np.where(clearance > 0.0, RayStatus.OK, RayStatus.BLOCKED)
    doubtful = np.abs(clearance) < 1e-3
    wrong = np.flatnonzero(inside & ~doubtful & (status != expected))
    assert np.count_nonzero(inside & (clearance > 0)) > 30
    assert np.count_nonzero(inside & (clearance < 0)) > 30
    assert wrong.size == 0, [(ends[0][i], ends[1][i], clearance[i], status[i]) for i in wrong]


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
@pytest.mark.parametrize("inset", [500.0, 1234.0, 3000.0])
def test_rays_do_not_tunnel_through_a_ridge_inside_a_cell(interpolation, inset):
    """
    Along the diagonal of a cell the bilinear bed is a parabola with its crest between the edges.
    """
    axis = np.array([0.0, 20e3])
    bed, c = [[2000.0, 100.0], [100.0, 2000.0]], np.full((2, 2, 2), 1500.0)
    medium = Medium.from_grid(
        axis, axis, [0.0, 3e3], c, bathymetry=bed, interpolation=interpolation
    )
    ends = np.array([inset, 19e3 - 0.3 * inset])
    place = np.column_stack([ends, ends])
    crest = 1050.0  # 2000 ((1 - t)^2 + t^2) + 200 t (1 - t) at t = 1/2
    for depth, status in (
        (crest - 0.01, RayStatus.OK),
        (crest + 0.01, RayStatus.BLOCKED),
        (crest + 1.0, RayStatus.BLOCKED),
    ):
        first = find_eigenrays(medium, [*place[0], depth], [*place[1], depth]).first()
        assert first.status[0] == status, depth - crest


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_source_exactly_on_a_level_is_the_limit_from_both_sides(interpolation):
    medium = layered(interpolation)
    n = LEVELS.size - 2
    source = np.column_stack([np.zeros((n, 2)), LEVELS[1:-1]])
    receiver = source + np.array([700.0, 0.0, 33.0])
    nudge = np.array([0.0, 0.0, 1e-6])
    at, above, below = (
        find_eigenrays(medium, source + shift, receiver, tolerance=1e-6).first()
        for shift in (0 * nudge, -nudge, nudge)
    )
    assert (at.status == RayStatus.OK).all()
    for other, sign in ((above, 1.0), (below, -1.0)):
        moved = (
            other.travel_time - sign * nudge[2] * at.source_slowness[:, 2]
        )  # dt/dz is minus the slowness
        np.testing.assert_allclose(at.travel_time, moved, rtol=0, atol=1e-11)


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_root_tolerance_scales_with_range(interpolation):
    """1 cm to 40 km: the relative error of the travel time is that of a sum of rounded steps."""
    g, c0, bottom = 0.016, 1450.0, 6000.0
    depth = np.linspace(0.0, bottom, 61)
    medium = Medium.from_profile(
        depth, c0 + g * depth, bottom_depth=bottom, interpolation=interpolation
    )
    distance = np.array([1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3, 1e4, 4e4])
    source = np.tile([0.0, 0.0, 1000.0], (distance.size, 1))
    receiver = source + np.column_stack([0.6 * distance, 0.8 * distance, 0.05 * distance])
    arrivals = find_eigenrays(medium, source, receiver, spreading_cutoff_db=None)
    exact = direct_travel_time_linear_gradient(source, receiver, sound_speed_surface=c0, gradient=g)
    assert np.array_equal(arrivals.link, np.arange(distance.size))
    relative = np.abs(arrivals.travel_time / exact - 1.0)
    assert (relative < 3e-9).all(), relative
    unit = (receiver - source) / np.linalg.norm(receiver - source, axis=1)[:, None]
    cosine = np.sum(arrivals.source_slowness * unit, axis=1) * arrivals.source_sound_speed
    np.testing.assert_allclose(cosine[:5], 1.0, atol=1e-6)  # short rays point along the chord


def test_missing_values_are_data_and_stay_in_their_row():
    """
    Equal places, a place in the air and a shadow between good links change nothing about these.
    """
    medium = layered("smooth")
    good = np.array([[0.0, 0.0, 700.0], [3e3, 1e3, 900.0]])
    odd = [
        ([5.0, 5.0, 50.0], [5.0, 5.0, 50.0], RayStatus.OK),
        ([0.0, 0.0, -1.0], [1e3, 0.0, 50.0], RayStatus.OUTSIDE),
        ([0.0, 0.0, 1.0], [60e3, 0.0, 1.0], None),
    ]
    source = np.array([good[0], odd[0][0], good[0], odd[1][0], good[0], odd[2][0], good[0]])
    receiver = np.array([good[1], odd[0][1], good[1], odd[1][1], good[1], odd[2][1], good[1]])
    arrivals = find_eigenrays(medium, source, receiver)
    first = arrivals.first()
    alone = find_eigenrays(medium, *good).first()
    for i in (0, 2, 4, 6):
        for name in vars(alone):
            assert np.array_equal(getattr(first, name)[i], getattr(alone, name)[0]), (i, name)
    assert first.status[1] == RayStatus.OK
    assert first.travel_time[1] == 0.0
    assert np.isnan(arrivals.source_slowness[arrivals.link == 1]).all()
    assert first.status[3] == RayStatus.OUTSIDE
    assert np.isnan(first.chord_travel_time[3])
    missing = first.status != RayStatus.OK
    for name in ("travel_time", "source_slowness", "receiver_slowness"):
        assert np.isnan(getattr(first, name)[missing]).all()
    proper = np.isin(arrivals.link, [1], invert=True)
    for name in ("travel_time", "launch_angle", "arrival_angle", "spreading_db", "source_slowness"):
        assert np.isfinite(getattr(arrivals, name)[proper]).all(), name
    with pytest.raises(AcousticsError, match="1 coordinates are not finite"):
        find_eigenrays(medium, [np.nan, 0.0, 50.0], good[1])
