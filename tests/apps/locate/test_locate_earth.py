"""
Surveys on the ellipsoid, with rays in geocentric coordinates that do not use the package, in the
files of every format: depths, positions and what is said about the Earth.
"""

from dataclasses import replace

import ellipsoid_rays
import numpy as np
import pytest
from refusals import refused
from scipy.stats import chi2

from pymantaray.acoustics import Medium
from pymantaray.apps.locate import LocateOptions, Node, Pattern, Survey, locate, read_survey
from pymantaray.apps.locate.fit_tests import HALVES
from pymantaray.errors import LocateError
from pymantaray.geometry import LocalFrame

DEPTH, RADIUS, PINGS, SHIP = 5000.0, 4000.0, 90, 5.0
TOLERANCE = 0.02  # m of depth, at 4 km and 5 km of depth
LEVELS = np.arange(0.0, 5601.0, 10.0)


class EllipsoidSurvey:
    """Pings of a ship over one node, with latitudes and longitudes, and their two-way times."""

    def __init__(self, lat, lon, geoid=0.0):
        self.origin = lat, lon
        k = np.arange(PINGS)
        angle, size = 6.0 * np.pi * k / PINGS, RADIUS * np.sqrt((k + 0.5) / PINGS)
        per_degree = 111.2e3
        self.lat = lat + size * np.cos(angle) / per_degree
        self.lon = lon + size * np.sin(angle) / per_degree / np.cos(np.radians(lat))
        self.node = lat + 700.0 / per_degree, lon - 0.004, DEPTH
        self.ship_points = ellipsoid_rays.ecef(self.lat, self.lon, np.full(PINGS, SHIP - geoid))
        self.node_point = ellipsoid_rays.ecef(*self.node[:2], DEPTH - geoid)

        def below_geoid(depth):
            return ellipsoid_rays.deep_water(depth + geoid)

        nodes = np.repeat(self.node_point[None], PINGS, axis=0)
        self.two_way = 2.0 * ellipsoid_rays.travel_times(self.ship_points, nodes, below_geoid)
        self.time = 20.0 * k

    def in_plane(self, points):
        """North, east and down in the tangent plane of the origin."""
        east, north, up = ellipsoid_rays.east_north_up(points, *self.origin).T
        return np.column_stack([north, east, -up])


def profile_file(folder, head="depth_m,sound_speed", sign=1.0, separator=","):
    speed, _ = ellipsoid_rays.deep_water(LEVELS)
    rows = [f"{sign * z:g}{separator}{c:.9f}" for z, c in zip(LEVELS, speed, strict=True)]
    path = folder / "profile.csv"
    path.write_text("\n".join([*([head] if head else []), *rows]) + "\n")
    return path


def own_table(survey, folder):
    rows = ["time,node,two_way_time_s,lat,lon,depth_m"]
    for values in zip(survey.time, survey.two_way, survey.lat, survey.lon, strict=True):
        time, two_way, lat, lon = values
        rows.append(f"{time:g},N1,{two_way:.9f},{lat:.10f},{lon:.10f},{SHIP}")
    path = folder / "pings.csv"
    path.write_text("\n".join(rows) + "\n")
    return [path, "--depth", "5030", "--profile", profile_file(folder)]


def obsrange(survey, folder):
    def angle(value, sides):
        return f"{int(abs(value))} {abs(value) % 1.0 * 60.0:.8f} {sides[int(value < 0.0)]}"

    rows = [
        "Site: N1",
        f"Drop Point (Latitude): {survey.origin[0]}",
        f"Drop Point (Longitude): {survey.origin[1]}",
        "Depth (meters): 5030",
        "",
    ]
    for k in range(PINGS):
        clock = f"2018:114:06:{k // 3:02d}:{20 * (k % 3):02d}"
        lat, lon = angle(survey.lat[k], "NS"), angle(survey.lon[k], "EW")
        time = f"{1e3 * survey.two_way[k]:.6f}"
        rows.append(f"{time} msec. Lat: {lat}  Lon: {lon}  Alt: 29 Time(UTC): {clock}")
    path = folder / "N1.txt"
    path.write_text("\n".join(rows) + "\n")
    return [path, "--transducer-depth", str(SHIP), "--profile", profile_file(folder)]


def gnatss(survey, folder, geoid=0.0):
    stamps, positions = [], []
    since = np.datetime64("2023-06-26T00:00:00") - np.datetime64("2000-01-01T12:00:00")
    midnight = float(since / np.timedelta64(1, "s"))
    for k, point in enumerate(survey.ship_points):
        stamps.append(
            f"26-JUN-23 00:{k // 3:02d}:{20 * (k % 3):02d}.00 {1e6 * survey.two_way[k]:.3f}"
        )
        start = midnight + 20.0 * k
        xyz = " ".join(f"{x:.6f}" for x in point)
        positions += [f"{start + wait:.7f} {xyz}" for wait in (0.0, survey.two_way[k])]
    (folder / "pxp_tt").write_text("\n".join(stamps) + "\n")
    (folder / "positions").write_text("\n".join(positions) + "\n")
    profile_file(folder, head="", sign=-1.0, separator=" ")
    lat, lon = survey.origin
    path = folder / "config.yaml"
    path.write_text(
        f"solver:\n  transponders:\n  - lat: {lat}\n    lon: {lon}\n    height: {geoid - 5030.0}\n"
        f"  geoid_undulation: {geoid}\n  array_center: {{lat: {lat}, lon: {lon}}}\n"
        "  input_files:\n    sound_speed: {path: profile.csv}\n    travel_times: {path: pxp_tt}\n"
        "    gps_solution: {path: positions}\n"
    )
    return [path, "--horizontal-sigma", "2000"]


def garpos(survey, folder):
    profile_file(folder, head="depth,speed")
    rows = [",MT,TT,ST,RT,ant_e0,ant_n0,ant_u0,flag"]
    for k, (north, east, down) in enumerate(survey.in_plane(survey.ship_points)):
        start = 30000.0 + survey.time[k]
        rows.append(
            f"{k},N1,{survey.two_way[k]:.9f},{start:.6f},{start + survey.two_way[k]:.6f},"
            f"{east:.6f},{north:.6f},{-down:.6f},False"
        )
    (folder / "pings.csv").write_text("\n".join(rows) + "\n")
    path = folder / "SITE-initcfg.ini"
    path.write_text(
        "[Obs-parameter]\nDate(UTC) = 2019-03-15\nSoundSpeed = profile.csv\n[Data-file]\n"
        f"datacsv = pings.csv\n[Site-parameter]\nLatitude0 = {survey.origin[0]}\nLongitude0 ="
        f" {survey.origin[1]}\nHeight0 = 43\nStations = N1\n[Model-parameter]\n"
        "N1_dPos = 0 0 -5030 2000 2000 100\n"
    )
    return [path]


ROUNDING = "candidates|probability|chi_square|variance_factor"
"""What residuals without noise leave to rounding."""
WRITERS = {"table": own_table, "obsrange": obsrange, "gnatss": gnatss, "garpos": garpos}


@pytest.fixture(scope="module", params=[
    pytest.param((0.5, -30.0), id="equator", marks=pytest.mark.slow),
    pytest.param((62.0, 179.99), id="date line"),
])  # fmt: skip
def survey(request):
    return EllipsoidSurvey(*request.param)


@pytest.mark.parametrize(("kind", "model"), [
    ("obsrange", "auto"),
    *(
        pytest.param(kind, "auto", marks=pytest.mark.slow)
        for kind in WRITERS
        if kind != "obsrange"
    ),
    pytest.param("table", "known", marks=pytest.mark.slow),
    pytest.param("garpos", "scale", marks=pytest.mark.slow),
])  # fmt: skip
def test_depths_of_every_format_are_true_on_the_ellipsoid(told, survey, tmp_path, kind, model):
    done = told(
        "locate", *WRITERS[kind](survey, tmp_path), "--sound-speed", model, without=ROUNDING
    )
    (node,) = done["nodes"]
    truth = survey.node[2]
    if kind == "garpos":
        truth = survey.in_plane(survey.node_point[None])[0, 2]
    assert node["depth"] == pytest.approx(truth, abs=TOLERANCE), node
    found = ellipsoid_rays.ecef(node["lat"], node["lon"], survey.node[2])
    assert np.linalg.norm(found - survey.node_point) < 0.02
    assert done["earth"].startswith("Earth: sphere of 6,3")
    assert ("tangent plane" in done["earth"]) == (kind == "garpos")
    assert done["n_used"] == PINGS


def test_heights_above_a_geoid_are_no_curvature(told, tmp_path):
    raised = EllipsoidSurvey(35.0, 139.0, geoid=38.0)
    done = told(
        "locate", *gnatss(raised, tmp_path, geoid=38.0), "--sound-speed", "scale", without=ROUNDING
    )
    assert done["nodes"][0]["depth"] == pytest.approx(DEPTH, abs=TOLERANCE)


def test_a_flat_earth_raises_the_far_pings_by_their_sagitta(told, survey, tmp_path):
    """The known water leaves no other unknown: the fit lowers the node by the mean of r² / 2R."""
    words = own_table(survey, tmp_path)
    done = told("locate", *words, "--sound-speed", "scale", "--earth", "flat", without=ROUNDING)
    error = done["nodes"][0]["depth"] - DEPTH
    assert error > 1.0  # with one factor of sound speed, the error is larger than r² / 2R at most
    assert done["earth"].startswith("Earth: flat, as requested; a curved sea surface is lower by")


RADIUS_OF_EARTH, SPEED = 6371e3, 1500.0
KNOWN = LocateOptions(speed_model="known", correlation="none")
PRIOR = np.array([30.0, 20.0, 10.0])  # m


def slant_range(ship, node, *, on_sphere):
    """Straight distance of positions north, east along the surface, and depth below it."""
    across = np.hypot(*(ship - node)[:, :2].T)
    if on_sphere:
        first, second = RADIUS_OF_EARTH - ship[:, 2], RADIUS_OF_EARTH - node[2]
        chord = 4.0 * first * second * np.sin(0.5 * across / RADIUS_OF_EARTH) ** 2
        return np.sqrt((first - second) ** 2 + chord)
    return np.hypot(across, ship[:, 2] - node[2])


def metres(shape="rose", *, on_sphere, radius=2500.0, sigma=1e-4, faster=0.0):
    """Survey in metres in water of one speed, the true position of its node, and its medium."""
    rng = np.random.default_rng(11)
    ship = np.column_stack([Pattern(shape, radius, 90).points(), np.full(90, 5.0)])
    truth = np.array([100.0, -60.0, 0.8 * radius])
    time = 2.0 * slant_range(ship, truth, on_sphere=on_sphere) / SPEED / (1.0 + faster)
    time += rng.normal(0.0, sigma, 90)
    node = Node("N1", tuple(truth + PRIOR * rng.normal(size=3)), tuple(PRIOR))
    survey = Survey((node,), np.zeros(90, int), 20.0 * np.arange(90.0), time, ship, ship)
    water = Medium.from_profile([0.0, 6000.0], [SPEED, SPEED], bottom_depth=6000.0)
    return survey, truth, water


def nees(located, truth):
    error = located.positions[0] - truth
    return error @ np.linalg.solve(located.covariance, error)


@pytest.mark.parametrize("truth", ["flat", "sphere"])
def test_pings_in_known_water_tell_the_earth_of_metres(truth):
    survey, position, water = metres(on_sphere=truth == "sphere")
    found = locate(survey, water, KNOWN)
    assert found.earths[truth] > 0.999
    assert sum(found.earths.values()) == pytest.approx(1.0)
    name = {"flat": "flat", "sphere": "sphere of 6,371 km"}[truth]
    assert found.earth.startswith(f"Earth: {name}, which the pings prefer to")
    assert nees(found, position) < chi2.ppf(0.999, 3)
    # as if it had been stated, which is obeyed
    right, wrong = (
        locate(survey, water, replace(KNOWN, earth=earth))
        for earth in (truth, "flat" if truth == "sphere" else "sphere")
    )
    np.testing.assert_allclose(found.positions, right.positions, atol=1e-3)
    np.testing.assert_allclose(found.covariance, right.covariance, rtol=0.01)
    assert right.earths == wrong.earths == {}
    error = wrong.positions[0, 2] - position[2]
    assert abs(error) > 10.0 * right.nodes["sigma_depth_m"][0]


@pytest.mark.parametrize("truth", ["flat", "sphere"])
def test_an_earth_that_the_pings_do_not_tell_is_in_the_sigma(truth):
    """In water of unknown speed, a plane has a node that is deeper by D² / 2R, and faster water."""
    survey, position, water = metres(on_sphere=truth == "sphere", faster=7e-4)
    scale = replace(KNOWN, speed_model="scale")
    found = locate(survey, water, scale)
    assert 0.3 < found.earths["sphere"] < 0.7
    deeper = position[2] ** 2 / (2.0 * RADIUS_OF_EARTH)
    assert found.earth.startswith("Earth: flat or sphere, averaged (probability of the sphere 0.")
    assert f"on the sphere, depths are {-deeper:+.2g} m" in found.earth
    assert nees(found, position) < chi2.ppf(0.99, 3)
    alone = locate(survey, water, replace(scale, earth=truth))
    added = found.nodes["sigma_depth_m"][0] ** 2 - alone.nodes["sigma_depth_m"][0] ** 2
    assert added == pytest.approx((0.5 * deeper) ** 2, rel=0.1)
    # the Earth below both halves is the same
    halves, of_one = (located.tests[-1] for located in (found, alone))
    assert halves.name == HALVES
    assert halves.chi_square == pytest.approx(of_one.chi_square, rel=2e-3)


def test_a_survey_without_a_visible_curvature_is_flat():
    survey, _, water = metres(on_sphere=True, radius=300.0)
    found = locate(survey, water, replace(KNOWN, speed_model="scale"))
    assert found.earths == {}
    assert "earth" not in found.candidates
    assert found.earth.startswith("Earth: flat, because positions are north and east")


@pytest.mark.slow
def test_metres_without_a_latitude_have_the_earth_of_the_pings(told, survey, tmp_path):
    """North and east along the ground, as on a map plane, with depths below the sea surface."""
    lat, lon = survey.origin
    frame = LocalFrame(lat, lon)  # of scale 1 within 1e-7
    north, east = frame.to_local(survey.lat, survey.lon)
    rows = ["time,node,two_way_time_s,north_m,east_m,depth_m"]
    for values in zip(survey.time, survey.two_way, north, east, strict=True):
        rows.append("{:g},N1,{:.9f},{:.6f},{:.6f},5".format(*map(float, values)))
    path = tmp_path / "pings.csv"
    path.write_text("\n".join(rows) + "\n")
    profile = profile_file(tmp_path)
    words = ("locate", path, "--depth", "5030", "--profile", profile, "--sound-speed", "known")
    found, flat, sphere = (
        told(*words, *earth, without=ROUNDING)
        for earth in ((), ("--earth", "flat"), ("--earth", "sphere"))
    )
    assert found["earth"].startswith("Earth: sphere of 6,371 km, which the pings prefer to flat")
    assert "state `earth='flat'` or `earth='sphere'` if it is known" in found["earth"]
    assert found["earths"]["sphere"] > 0.999
    assert sphere["earth"] == "Earth: sphere of 6,371 km, as requested"
    for located in (found, sphere):
        assert located["nodes"][0]["depth"] == pytest.approx(DEPTH, abs=TOLERANCE)
    assert abs(flat["nodes"][0]["depth"] - DEPTH) > 0.3


@pytest.mark.slow
def test_page_and_files_state_the_earth(mantaray, survey, tmp_path):
    words = own_table(survey, tmp_path)
    mantaray("locate", *words, "--sound-speed", "scale", "--out", tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    assert "because positions are geographic and depths are below the sea surface" in page


@pytest.mark.slow
def test_python_has_the_default_of_the_command(survey, tmp_path):
    read = read_survey(garpos(survey, tmp_path)[0])
    depth, speed = read.profile
    flat = Medium.from_profile(depth, speed, bottom_depth=5600.0, interpolation="linear")
    options = LocateOptions(speed_model="known", correlation="none")
    located = locate(read, flat, options)
    truth = survey.in_plane(survey.node_point[None])[0]
    np.testing.assert_allclose(located.positions[0], truth, atol=TOLERANCE)
    moved = read.in_frame(LocalFrame(survey.origin[0] + 0.01, survey.origin[1]))
    assert moved.depth_reference == "surface"
    assert locate(moved, flat, options).positions[0, 2] == pytest.approx(DEPTH, abs=TOLERANCE)


@pytest.mark.slow
def test_derivatives_of_a_tangent_plane_are_those_of_the_times(survey, tmp_path):
    from pymantaray.apps.locate.earth import medium_on_earth
    from pymantaray.apps.locate.travel_times import predict

    read = read_survey(garpos(survey, tmp_path)[0])
    depth, speed = read.profile
    medium, *_ = medium_on_earth(
        read,
        Medium.from_profile(depth, speed, bottom_depth=5600.0, interpolation="linear"),
        "auto",
    )
    position = survey.in_plane(survey.node_point[None])
    legs = predict(read, medium, position, np.zeros(3))
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 0.5
        ends = [predict(read, medium, position + sign * step, np.zeros(3)) for sign in (1.0, -1.0)]
        slope = ends[0].travel_time - ends[1].travel_time
        np.testing.assert_allclose(legs.node_gradient[:, axis], slope, rtol=0.0, atol=3e-9)


def test_a_tangent_plane_without_its_origin_is_refused():
    survey = Survey(
        nodes=(Node("N1", (0.0, 0.0, 100.0)),),
        node=[0, 0],
        time=[0.0, 1.0],
        travel_time=[0.2, 0.2],
        transmit_position=[[10.0, 0.0, 1.0], [0.0, 10.0, 1.0]],
        receive_position=[[10.0, 0.0, 1.0], [0.0, 10.0, 1.0]],
        depth_reference="plane",
    )
    medium = Medium.from_profile([0.0, 200.0], [1500.0, 1500.0], bottom_depth=200.0)
    refused(LocateError, "state its frame", locate, survey, medium)
