"""Rays on a spherical Earth, against the ray equations in the plane through the Earth's centre."""

import math
from dataclasses import replace

import numpy as np
import pyproj
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from pymantaray import open_water
from pymantaray.acoustics import Medium, find_eigenrays, quadrature, trace_paths
from pymantaray.apps.replay import Events, replay_events
from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.apps.study.mission import earth_note, simulate_mission
from pymantaray.config.door.study import build_study
from pymantaray.config.load import load_study
from pymantaray.errors import AcousticsError
from pymantaray.geometry import EarthSphere, LocalFrame

EARTH = EarthSphere.at_latitude(78.0)
LEVELS = np.linspace(0.0, 3000.0, 601)
KM = 1e3


def duct(depth):
    """Sound speed of an Arctic duct: a minimum near 150 m above a steady increase. [m/s]"""
    return 1449.0 + 0.0165 * depth - 7.0 * np.exp(-(((depth - 150.0) / 130.0) ** 2))


PROFILE = CubicSpline(LEVELS, duct(LEVELS), bc_type="natural")
SLOPE = PROFILE.derivative()


def polar_ray(angle, source_depth, receiver_depth, ends_at):
    """
    Miss in depth [m] of a ray at a receiver, and travel time [s] to the receiver by the ray and its
    wavefront there.
    """

    def rates(_, y):
        r = math.hypot(y[0], y[1])
        c, slope = float(PROFILE(EARTH.radius - r)), float(SLOPE(EARTH.radius - r))
        return [c * y[2], c * y[3], slope * y[0] / (r * c**2), slope * y[1] / (r * c**2), 1.0 / c]

    def arrived(_, y):
        return math.atan2(y[0], y[1]) - ends_at

    arrived.terminal = True
    c = float(PROFILE(source_depth))
    start = [0.0, EARTH.radius - source_depth, math.cos(angle) / c, -math.sin(angle) / c, 0.0]
    ray = solve_ivp(
        rates, (0.0, 1.2 * EARTH.radius * ends_at), start, "DOP853", events=arrived,
        rtol=1e-12, atol=[1e-5, 1e-5, 1e-17, 1e-17, 1e-12],
    )  # fmt: skip
    x, y, p, q, time = ray.y_events[0][0]
    r = math.hypot(x, y)
    miss = EARTH.radius - r - receiver_depth
    return miss, time + (p * x + q * y) / r * miss


def sphere_medium(**options):
    return Medium.from_profile(LEVELS, duct(LEVELS), bottom_depth=3000.0, earth=EARTH, **options)


@pytest.mark.parametrize(
    "distance", [10 * KM, *(pytest.param(d, marks=pytest.mark.slow) for d in (30 * KM, 100 * KM))]
)
def test_eigenrays_on_a_sphere_equal_those_in_polar_coordinates(distance):
    source, receiver = (
        np.array([[0.0, 0.0, 50.0]]),
        np.array([[0.0, EARTH.frame_distance(distance), 90.0]]),
    )
    arrivals = find_eigenrays(
        sphere_medium(), source, receiver, spreading_cutoff_db=None, tolerance=1e-4
    )
    assert arrivals.link.size >= 2
    for row in range(2):
        miss, time = polar_ray(arrivals.launch_angle[row], 50.0, 90.0, distance / EARTH.radius)
        assert abs(miss) < 0.01 * (distance / (10 * KM))  # m
        assert abs(arrivals.travel_time[row] - time) * 1450.0 < 2e-4  # m


@pytest.mark.parametrize(("distance", "error"), [(10 * KM, 0.15), (23 * KM, 1.7), (30 * KM, 3.8)])
def test_flat_earth_makes_ranges_too_long(distance, error):
    source, receiver = (
        np.array([[0.0, 0.0, 300.0]]),
        np.array([[0.0, EARTH.frame_distance(distance), 400.0]]),
    )
    round_, flat = sphere_medium(), Medium.from_profile(LEVELS, duct(LEVELS), bottom_depth=3000.0)
    excess = {}
    for medium, end in ((round_, receiver), (flat, np.array([[0.0, distance, 400.0]]))):
        time = find_eigenrays(medium, source, end).first().travel_time[0]
        excess[medium] = 1445.0 * time - medium.straight_distance(source, end)[0]
    assert excess[flat] - excess[round_] == pytest.approx(error, rel=0.05)  # m


def test_straight_distance_and_chord_time_are_those_through_the_earth():
    frame = pyproj.Proj(f"+proj=stere +lat_0=90 +lon_0=0 +k_0=1 +R={EARTH.radius!r}")
    source, receiver = np.array([[31e3, -20e3, 90.0]]), np.array([[-12e3, 44e3, 800.0]])
    points = []
    for north, east, depth in np.vstack([source, receiver]):
        longitude, latitude = np.radians(frame(east, north, inverse=True))
        up = [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
        points.append((EARTH.radius - depth) * np.array(up))
    length = np.linalg.norm(points[1] - points[0])
    medium = sphere_medium()
    assert medium.straight_distance(source, receiver)[0] == pytest.approx(length, abs=1e-6)
    share, weight = np.polynomial.legendre.leggauss(400)
    chord = points[0] + 0.5 * (share[:, None] + 1.0) * (points[1] - points[0])
    slowness = 1.0 / PROFILE(EARTH.radius - np.linalg.norm(chord, axis=1))
    time = find_eigenrays(medium, source, receiver).chord_travel_time[0]
    assert time == pytest.approx(0.5 * length * (weight @ slowness), abs=1e-9)


def test_slowness_is_the_gradient_by_the_positions_in_the_frame():
    medium = sphere_medium()
    source, receiver = np.array([[1e3, 2e3, 100.0]]), np.array([[9e3, 7e3, 400.0]])
    arrivals = find_eigenrays(medium, source, receiver, tolerance=1e-5)
    for axis in range(3):
        step = np.zeros((1, 3))
        step[0, axis] = 2.0
        times = [
            find_eigenrays(medium, source, receiver + s * step, tolerance=1e-5).travel_time[0]
            for s in (1, -1)
        ]
        gradient = (times[0] - times[1]) / 4.0
        assert gradient == pytest.approx(arrivals.receiver_slowness[0, axis], abs=3e-9)


def test_paths_on_a_sphere_start_and_end_at_the_ends():
    medium = sphere_medium()
    source, receiver = np.array([[0.0, 0.0, 100.0]]), np.array([[9e3, 7e3, 400.0]])
    arrivals = find_eigenrays(medium, source, receiver)
    paths = trace_paths(medium, source, receiver, arrivals)
    first = paths.position[paths.arrival == 0]
    np.testing.assert_allclose(first[[0, -1], 2], [100.0, 400.0], atol=2e-3)
    np.testing.assert_allclose(first[[0, -1], :2], [[0.0, 0.0], [9e3, 7e3]], atol=0.05)
    points = quadrature(paths)
    own = points.arrival == 0
    time = np.sum(points.weight[own] * np.linalg.norm(points.slowness[own], axis=1))
    assert time == pytest.approx(arrivals.travel_time[0], rel=1e-6)


def test_sound_speed_on_a_sphere_is_the_profile():
    depth = np.array([0.0, 37.0, 512.5, 2900.0])
    position = np.column_stack([np.zeros((4, 2)), depth])
    np.testing.assert_allclose(sphere_medium().sound_speed_at(position), PROFILE(depth), rtol=1e-9)


def test_surface_distances_are_those_of_the_ellipsoid_in_the_arctic():
    frame, geod = LocalFrame(78.0, 5.0), pyproj.Geod(ellps="WGS84")
    near, far = np.array([[2e3, -3e3, 0.0]]), np.array([[21e3, 18e3, 0.0]])
    (lat0, lon0), (lat1, lon1) = (frame.to_geodetic(*x[0, :2]) for x in (near, far))
    geodesic = geod.inv(lon0, lat0, lon1, lat1)[2]
    assert EARTH.surface_distance(near, far)[0] == pytest.approx(geodesic, abs=2e-3)


def test_a_sphere_needs_a_geographic_position():
    water = open_water("synthetic:fram", half_extent=20e3, earth="sphere")
    assert water.at_start[0].earth == EarthSphere.at_latitude(78.0)
    local = water.local.drop_attrs()
    with pytest.raises(
        AcousticsError, match="no geographic position; give its latitude and longitude as `centre`"
    ):
        Medium.from_dataset(local, earth="sphere")


def test_replayed_distances_are_those_of_geocentric_coordinates(tmp_path):
    (tmp_path / "cast.csv").write_text(
        "# lat 78.0, lon 5.0\ndepth,sound_speed\n"
        + "".join(f"{z},{duct(z)}\n" for z in range(0, 1001, 50))
    )
    ends = np.array([[78.0, 5.0, 100.0], [78.1, 5.8, 400.0]])
    to_geocentric = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978")
    places = np.stack(to_geocentric.transform(ends[:, 0], ends[:, 1], -ends[:, 2]), axis=-1)
    true = np.linalg.norm(places[1] - places[0])
    events = Events([0.0], ["A"], ["B"], ends[:1], ends[1:], [true / 1450.0], geographic=True)
    found, notes = {}, {}
    for earth in ("sphere", "flat"):
        result = replay_events(
            events, open_water(str(tmp_path / "cast.csv"), bathymetry=1000.0, earth=earth)
        )
        found[earth], notes[earth] = result.events["distance_m"][0], result.notes
    assert found["sphere"] == pytest.approx(true, abs=2e-3)
    assert found["flat"] - true > 0.5
    assert notes["sphere"] == ()
    assert notes["flat"][0].startswith("Links are up to 21.6 km long: on a flat Earth")


def test_replays_far_from_the_centre_of_the_frame_have_a_note():
    notes = {}
    water = open_water("synthetic:fram", half_extent=20e3)
    for north in (12e3, 17e3):
        lat, lon = water.frame.to_geodetic(np.array([north, north - 2e3]), np.zeros(2))
        ends = np.column_stack([lat, lon, [100.0, 200.0]])
        events = Events([0.0], ["A"], ["B"], ends[:1], ends[1:], [1.4], geographic=True)
        notes[north] = [note for note in replay_events(events, water).notes if "flat Earth" in note]
    assert notes[12e3] == []
    assert (
        "extend to 17.0 km from the centre of the frame, and links are up to 2.0 km long"
        in notes[17e3][0]
    )


@pytest.mark.slow
def test_study_with_a_sphere_measures_ranges_through_the_earth():
    missions = {
        earth: simulate_mission(
            build_study(load_study("quick", **{"acoustics.earth": earth})),
            Stopwatch(),
            lambda *_: None,
        )
        for earth in ("flat", "sphere")
    }
    flat, sphere = (missions[earth].ranging_truth for earth in ("flat", "sphere"))
    shorter = flat.distance - sphere.distance
    assert np.nanmax(shorter) == pytest.approx(
        2375.0 / EARTH.radius * 11994.0, rel=0.02
    )  # m; the longest link is at 2375 m
    earlier = flat.travel_time - sphere.travel_time
    assert np.nanmax(earlier) > 0.0
    heard = np.isfinite(earlier)
    np.testing.assert_allclose(1450.0 * earlier[heard], shorter[heard], atol=0.4)


def test_trajectories_far_from_the_centre_of_a_frame_have_a_warning():
    config = load_study("quick", **{"mission.physics_step_s": 1.0, "mission.duration_h": 8.0})
    mission = simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
    truth, ranges = mission.truth, mission.ranging_truth
    assert earth_note(build_study(config), truth, ranges) is None
    extent = np.hypot(truth.position[..., 0], truth.position[..., 1]).max()
    away = replace(truth, position=truth.position + np.array([15e3 + extent, 0.0, 0.0]))
    note = earth_note(build_study(config), away, ranges)
    farthest = 1e-3 * np.hypot(away.position[..., 0], away.position[..., 1]).max()
    assert note.startswith(
        f"Trajectories extend to {farthest:.1f} km from the centre of the frame, and links are up"
        " to 12.0 km"
    )
    assert note.endswith("use `earth='sphere'` (in a study: acoustics.earth).")
    assert (
        earth_note(build_study(config.with_(**{"acoustics.earth": "sphere"})), away, ranges) is None
    )
