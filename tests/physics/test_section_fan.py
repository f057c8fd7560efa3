"""
Direct rays near thin filaments of warm and cold water, against `section_fan.SectionFan`,
brute-force fans of up to 1e5 rays.
"""

from pathlib import Path

import numpy as np
import pytest
from lost_rays import (
    GULF_STREAM,
    LEVEL,
    TIME,
    Fan,
    ends,
    gulf_stream,
    lost_of_a_fan,
    random_fans,
    several_extrema,
    without_partner,
)
from oracles import direct_travel_time_linear_gradient
from section_fan import SectionFan

from pymantaray.acoustics import Medium, find_eigenrays

FRONT_AND_EDDY = Path(__file__).parents[3] / "shared/data/reference/medium_e_front_eddy.npz"
# A thermocline with a filament at 125 m, as at the edge of the Gulf Stream: levels [m], and sound
# speed [m/s] every 4 km from -4 km on
LEVELS = [
    0,
    4,
    8,
    12,
    20,
    30,
    40,
    50,
    60,
    70,
    80,
    90,
    100,
    125,
    150,
    200,
    250,
    300,
    350,
    400,
    500,
    600,
    800,
    1000,
]
FILAMENT = """
1529.9 1529.8 1529.9 1529.9 1530.1 1530.4 1531.0 1531.5 1531.5 1531.0 1528.9 1527.2 1525.9 1522.0
1520.1 1519.9 1519.0 1511.8 1503.2 1496.3
1492.2 1488.3 1486.3 1484.9
1529.6 1529.3 1529.4 1529.6 1529.9 1530.3 1530.8 1530.8 1530.3 1529.8 1528.4 1526.7 1524.7 1521.8
1520.3 1519.0 1514.4 1504.3 1495.7 1491.8
1488.5 1486.1 1485.1 1484.3
1529.6 1529.1 1529.3 1529.5 1529.8 1530.2 1530.6 1529.9 1529.1 1528.2 1527.0 1525.1 1523.4 1522.5
1519.2 1512.7 1503.3 1491.8 1486.7 1484.8
1483.3 1482.7 1482.7 1484.0
1529.2 1528.6 1528.7 1528.9 1529.3 1529.8 1530.4 1530.0 1529.2 1527.6 1526.5 1525.2 1524.5 1524.9
1518.3 1510.9 1499.8 1491.9 1490.5 1490.9
1491.0 1491.6 1492.9 1496.3
1525.4 1525.0 1524.9 1524.9 1525.3 1526.7 1527.6 1526.8 1526.5 1525.1 1524.6 1524.0 1524.0 1524.2
1518.6 1515.1 1509.1 1507.1 1508.0 1509.2
1510.6 1512.1 1515.2 1518.8
"""


def filament():
    """Water that varies along north only, so that rays stay in their plane."""
    columns = np.array(FILAMENT.split(), dtype=float).reshape(5, len(LEVELS))
    axes = np.arange(-4e3, 13e3, 4e3), np.arange(-6e3, 7e3, 4e3)
    return Medium.from_grid(
        *axes, LEVELS, np.repeat(columns[:, None], 4, axis=1), bathymetry=2800.0
    )


def test_the_fan_finds_the_circular_arcs_of_a_constant_gradient():
    depth = np.linspace(0.0, 3000.0, 31)
    medium = Medium.from_profile(depth, 1450.0 + 0.05 * depth, bottom_depth=3000.0)
    source, receivers = (
        np.array([10.0, 20.0, 300.0]),
        np.array([[1500.0, 200.0], [3000.0, 450.0], [4500.0, 350.0]]),
    )
    rays = SectionFan(medium).eigenrays(source, 0.3, receivers, np.linspace(-0.3, 0.3, 6001))
    a, b = ends(source, 0.3, receivers)
    exact = direct_travel_time_linear_gradient(a, b, sound_speed_surface=1450.0, gradient=0.05)
    np.testing.assert_array_equal(rays.link, [0, 1, 2])
    np.testing.assert_allclose(rays.time, exact, rtol=0, atol=1e-8)
    np.testing.assert_array_less(np.abs(rays.spreading), 1.0)


@pytest.mark.slow
def test_rays_in_a_duct_beyond_a_crest_are_found():
    """
    Between two rays of the first fan, which both miss by hundreds of metres, a filament parts the
    rays and some enter the duct above it.
    """
    source = np.array([0.0, 0.0, 380.0])
    distance, depth = np.meshgrid(15.0 * np.arange(636, 660, 4), np.arange(86.0, 102.0, 4.0))
    receivers = np.column_stack([distance.ravel(), depth.ravel()])
    fan = SectionFan(filament())
    rays = fan.eigenrays(source, 0.0, receivers, np.linspace(-0.215, -0.195, 10_000))
    links = Fan(source, 0.0, receivers, rays)
    assert links.strong.sum() >= 6
    assert lost_of_a_fan(fan, links) == []


@pytest.mark.parametrize(
    ("source", "receiver", "angle", "number"),
    [
        pytest.param(
            [49821.543288630244, 26064.982854520356, 89.66851972644768],
            [47284.78094194165, 36502.273530692604, 85.45893625771431],
            0.0170151,
            1,
            id="moved",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            [42209.788845901836, 56347.65732484137, 208.08994724186832],
            [36234.8739175217, 47635.5669890449, 79.19226908935822],
            -0.0303585,
            2,
            id="pair",
        ),
    ],
)
def test_rays_beside_a_crest_are_found(source, receiver, angle, number):
    """
    One whose angle changes by 1.7e-4 rad out of the plane, 5e-5 rad from the crest's, and a strong
    pair in a narrow bracket of weak rays.
    """
    if not FRONT_AND_EDDY.is_file():
        pytest.skip(f"no reference medium at {FRONT_AND_EDDY}")
    grid = np.load(FRONT_AND_EDDY)
    axes = (grid[name] for name in ("north", "east", "depth", "sound_speed"))
    fan = SectionFan(Medium.from_grid(*axes, bathymetry=grid["bathymetry"]))
    source, receiver = np.array(source), np.array(receiver)
    away = receiver[:2] - source[:2]
    place, azimuth = np.array([np.hypot(*away), receiver[2]]), np.arctan2(away[1], away[0])
    rays = fan.near(source, azimuth, place, angle)
    found = find_eigenrays(fan.medium, source, receiver)
    strong = rays.spreading < 15.0
    assert strong.sum() == number
    alone = without_partner(
        rays.time[strong],
        rays.spreading[strong],
        found.travel_time,
        found.spreading_db,
        TIME,
        LEVEL,
    )
    assert alone == []


@pytest.mark.parametrize(
    ("source", "receiver"),
    [
        pytest.param(
            [93877.84447704168, 38179.85281815238, 41.262875209448524],
            [84706.73398182588, 34781.390246162104, 121.57259980072116],
            id="alone",
        ),
        pytest.param(
            [88211.17998727452, 31070.718299819186, 73.54449462426636],
            [81923.78402036997, 26353.718887234085, 84.11269335400382],
            id="among-others",
        ),
        pytest.param(
            [93000.25049432114, 31099.34211540306, 52.22617526552291],
            [88465.84056424974, 40121.63792656285, 14.596772984951365],
            id="from-below",
        ),
    ],
)
def test_no_ray_beside_a_crest_is_stronger_than_its_neighbours_allow(source, receiver):
    """
    Its slope may be an error: with a smaller tolerance, such a ray of 7 to 14 dB has 26 dB or more
    and is no arrival.
    """
    if not FRONT_AND_EDDY.is_file():
        pytest.skip(f"no reference medium at {FRONT_AND_EDDY}")
    grid = np.load(FRONT_AND_EDDY)
    axes = (grid[name] for name in ("north", "east", "depth", "sound_speed"))
    medium = Medium.from_grid(*axes, bathymetry=grid["bathymetry"])
    found, fine = (
        find_eigenrays(medium, source, receiver, tolerance=tolerance) for tolerance in (1e-3, 1e-5)
    )
    np.testing.assert_allclose(found.travel_time, fine.travel_time, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.spreading_db, fine.spreading_db, rtol=0, atol=0.1)


def medium_6():
    """Water in which the miss bends little between two rays that a filament parts."""
    source, azimuth = (
        np.array([3752.8639981400083, 11916.414029087264, 310.9472190273418]),
        1.4150185072200883,
    )
    receivers = np.array([[9765.0, 374.92078676026586]])
    fan = SectionFan(several_extrema(6))
    return fan, Fan(
        source, azimuth, receivers, fan.near(source, azimuth, receivers[0], -0.020868, n_rays=801)
    )


def test_a_ray_between_two_whose_misses_hardly_bend_is_found():
    fan, links = medium_6()
    assert links.strong.sum() == 1
    assert lost_of_a_fan(fan, links) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gulf stream", 6])
def test_a_fan_of_32768_rays_finds_none_that_the_solver_loses(name):
    """
    In the Gulf Stream file and in a medium with several extrema of the sound speed: a fan of 480
    links to 30 km each.
    """
    if name == "gulf stream" and not GULF_STREAM.is_file():
        pytest.skip(f"no Gulf Stream file at {GULF_STREAM}")
    fan = SectionFan(gulf_stream() if name == "gulf stream" else several_extrema(name))
    fans = list(random_fans(fan, 1, n_rays=32_768))
    assert sum(links.strong.sum() for links in fans) > 50
    assert [ray for links in fans for ray in lost_of_a_fan(fan, links)] == []
