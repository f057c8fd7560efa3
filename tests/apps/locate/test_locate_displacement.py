"""
Displacement of an array between two campaigns: by joint least squares, in any frame, from made-up
surveys, and by the command.
"""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pyproj
import pytest
from campaigns import make_campaign, profile_csv, write_garpos, write_table
from drifting import deep_water, drifting_survey
from refusals import refused
from scipy.stats import chi2

from pymantaray.apps.locate import (
    Campaign,
    LocateOptions,
    displacement_between,
    locate,
    read_campaign,
)
from pymantaray.apps.locate.write import campaign_features
from pymantaray.errors import LocateError
from pymantaray.jobs.keys import has_checksum, with_checksum

NONE = np.datetime64("NaT", "ns")
FLAT = LocateOptions(earth="flat")  # positions of made-up surveys are in metres
MOVED = np.array([0.35, -0.12, 0.05])  # m


def made_campaign(rng, names, positions, origin=None, source="made up"):
    """A campaign whose errors are drawn from a covariance with common errors of all nodes."""
    size = 3 * len(names)
    root = 0.02 * rng.normal(size=(size, size))
    root = np.column_stack([root, 0.1 * np.tile(np.eye(3), (len(names), 1))])
    error = root @ rng.normal(size=size + 3)
    return Campaign(names, positions + error.reshape(-1, 3), root @ root.T, origin, NONE, source)


def arrangement(rng, count):
    return rng.uniform([-800.0, -800.0, 2900.0], [800.0, 800.0, 3100.0], (count, 3))


def test_the_displacement_is_that_of_joint_least_squares(as_stored):
    """Unknown positions of all nodes and the displacement, solved together."""
    rng = np.random.default_rng(1)
    positions = arrangement(rng, 4)
    earlier = made_campaign(rng, ["A", "B", "C", "D"], positions)
    later = made_campaign(rng, ["E", "D", "B", "A"], positions[[2, 3, 1, 0]] + MOVED)
    found = displacement_between(later, earlier)
    assert found.nodes == ["D", "B", "A"]
    design = np.zeros((24, 15))  # positions of D, B, A, E, C, then the displacement
    order = {name: k for k, name in enumerate("DBAEC")}
    for row, name in enumerate([*earlier.names, *later.names]):
        columns = 3 * order[name] + np.arange(3)
        design[3 * row + np.arange(3), columns] = 1.0
    design = np.column_stack([design, np.zeros((24, 3))])
    design[12:, 15:] = np.tile(np.eye(3), (4, 1))
    data = np.concatenate([earlier.positions.ravel(), later.positions.ravel()])
    whole = np.zeros((24, 24))
    whole[:12, :12], whole[12:, 12:] = earlier.covariance, later.covariance
    weight = np.linalg.inv(whole)
    joint = np.linalg.inv(design.T @ weight @ design)
    np.testing.assert_allclose(found.value, (joint @ design.T @ weight @ data)[15:], atol=1e-8)
    np.testing.assert_allclose(found.covariance, joint[15:, 15:], rtol=1e-6, atol=1e-12)
    assert found.degrees == 6.0
    as_stored(found)


def test_a_campaign_in_another_frame_gives_the_same_displacement(as_stored):
    rng = np.random.default_rng(2)
    here = (38.0, 143.2)
    there = (38.3, 142.9)
    names = ["A", "B", "C"]
    earlier = made_campaign(rng, names, arrangement(rng, 3), here)
    later = made_campaign(rng, names, earlier.positions + MOVED, here)
    same = displacement_between(later, earlier)

    def plane(origin):
        lat, lon = origin
        return pyproj.Proj(f"+proj=sterea +lat_0={lat} +lon_0={lon} +ellps=WGS84")

    degrees = plane(here)(earlier.positions[:, 1], earlier.positions[:, 0], inverse=True)
    east, north = plane(there)(*degrees)
    # the direction of true north at the array, by 100 m on the ellipsoid
    lon, lat, _ = pyproj.Geod(ellps="WGS84").fwd(here[1], here[0], 0.0, 100.0)
    start, end = (np.array(plane(there)(*point)) for point in ((here[1], here[0]), (lon, lat)))
    angle = np.arctan2(*(end - start))
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turns = np.kron(np.eye(3), turn)
    moved = Campaign(
        names,
        np.column_stack([north, east, earlier.positions[:, 2]]),
        turns @ earlier.covariance @ turns.T,
        there,
        NONE,
        "other frame",
    )
    found = displacement_between(later, moved)
    np.testing.assert_allclose(found.value, same.value, atol=1e-4)
    np.testing.assert_allclose(found.covariance, same.covariance, rtol=1e-4, atol=1e-8)
    as_stored(found)


def test_a_changed_arrangement_widens_the_standard_deviations(as_stored):
    rng = np.random.default_rng(3)
    names = ["A", "B", "C"]
    positions = arrangement(rng, 3)
    earlier = made_campaign(rng, names, positions)
    positions[1] += [1.0, 0.0, 0.0]
    found = displacement_between(made_campaign(rng, names, positions), earlier)
    assert found.probability < 1e-3
    assert found.widening == pytest.approx(np.sqrt(found.chi_square / found.degrees))
    assert "arrangement" in found.notes[0]
    as_stored(found)


def test_a_rigid_array_has_the_displacement_of_its_shift():
    """Both campaigns know the shape without error, so only three combinations are uncertain."""
    rng = np.random.default_rng(4)
    positions = arrangement(rng, 3)
    one = np.tile(np.eye(3), (3, 1))
    first, second = np.diag([1.0, 2.0, 3.0]) * 1e-8, np.eye(3) * 1e-8
    earlier = Campaign(["A", "B", "C"], positions, one @ first @ one.T, None, NONE, "one")
    later = Campaign(["A", "B", "C"], positions + MOVED, one @ second @ one.T, None, NONE, "two")
    found = displacement_between(later, earlier)
    np.testing.assert_allclose(found.value, MOVED, atol=1e-9)
    np.testing.assert_allclose(found.covariance, first + second, atol=1e-16)
    assert found.degrees == 0.0


def test_campaigns_without_common_nodes_or_frames_are_refused():
    rng = np.random.default_rng(5)
    one = made_campaign(rng, ["A"], arrangement(rng, 1))
    other = made_campaign(rng, ["B"], arrangement(rng, 1))
    geographic = made_campaign(rng, ["A"], arrangement(rng, 1), (1.0, 2.0), "geographic")
    refused(LocateError, "nodes of the same names", displacement_between, one, other)
    refused(LocateError, "without latitude and longitude", displacement_between, one, geographic)


def test_an_earlier_campaign_is_earlier_and_of_the_same_place(as_stored):
    rng = np.random.default_rng(6)
    now, before = (made_campaign(rng, ["A"], np.array([[0.0, 0.0, 1000.0]])) for _ in range(2))
    now = replace(now, epoch=np.datetime64("2020-01-01", "ns"))
    for day, years in (("2018-01-01", 730 / 365.25), ("2019-12-31", 1 / 365.25)):
        found = displacement_between(now, replace(before, epoch=np.datetime64(day, "ns")))
        assert found.years == pytest.approx(years)
    future = replace(before, epoch=np.datetime64("2021-01-01", "ns"))
    refused(LocateError, "exchange the two campaigns", displacement_between, now, future)
    far = replace(before, positions=before.positions + np.array([2e5, 0.0, 0.0]))
    refused(LocateError, "nodes are 2e.05 m from those", displacement_between, now, far)
    as_stored([found, found.as_dict(), found.table])
    as_stored(campaign_features(replace(now, origin=(38.0, 143.2))), name="features")


def file_of(**changes):
    """Text of a file with a campaign of one node, some of its values changed."""
    campaign = {
        "names": ["A"],
        "axes": ["north", "east", "depth"],
        "positions_m": [[0, 0, 1]],
        "covariance_m2": np.eye(3).tolist(),
        "origin_deg": None,
        "epoch_utc": None,
    }
    return json.dumps({"campaign": campaign | changes})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        ("[]", "no positions with a joint covariance"),
        ('{"campaign": {"names": ["A"]}}', "no positions with a joint covariance"),
        (file_of(covariance_m2=[[1]]), "must be of the same nodes"),
        (file_of(covariance_m2=np.diag([1, 1, -1]).tolist()), "positive semidefinite"),
        (file_of(covariance_m2=np.diag([1, 1, -3e-9]).tolist()), "positive semidefinite"),
        (file_of(names="A"), "no positions with"),
        (file_of(axes=["east", "north", "up"]), "no positions with"),
        (file_of(positions_m=[[10**400, 0, 0]]), "no positions with"),
        (file_of(positions_m=[[True, False, True]]), "no positions with"),
        (file_of(positions_m=[["1", "2", "3"]]), "no positions with"),
        (file_of(positions_m=[[1e308, 0, 0]]), "within 1e.06 m"),
        (file_of(positions_m=[[-1e308, 0, 0]]), "within 1e.06 m"),
        (file_of(covariance_m2=np.full((3, 3), -1e308).tolist()), "within 1e.06 m"),
        (file_of(origin_deg=[60, 1e9]), "no positions with"),
        (file_of(origin_deg=[60, 10, 5]), "no positions with"),
        (file_of(epoch_utc="9999-12-31"), "allowed: 1678 to 2261"),
        (file_of(epoch_utc="1600-01-01"), "allowed: 1678 to 2261"),
        (file_of(epoch_utc="today"), "is not an instant"),
        (file_of(epoch_utc=5), "is not an instant"),
        (json.dumps(with_checksum(json.loads(file_of())) | {"usable": 0}), "damaged: its content"),
    ],
)
def test_a_file_without_a_campaign_is_refused_in_one_line(tmp_path, text, message):
    file = tmp_path / "location.json"
    file.write_text(text)
    refused(LocateError, message, read_campaign, file)


def test_a_campaign_has_the_values_of_its_file(tmp_path):
    covariance = np.diag([4.0, 1.0, 9.0, 1.0, 1.0, -1e-9])  # rounding, less than 1e-9 of the trace
    values = {
        "names": ["A", "B"],
        "positions_m": [[1, 2, 3], [4, -5, 6.5]],
        "covariance_m2": covariance.tolist(),
        "origin_deg": [38, 143.25],
        "epoch_utc": "2020-01-02T03:04:05",
    }
    file = tmp_path / "location.json"
    file.write_text(json.dumps(with_checksum(json.loads(file_of(**values)))))
    for path in (file, tmp_path):
        campaign = read_campaign(path)
        assert campaign.names == ["A", "B"]
        np.testing.assert_array_equal(campaign.positions, values["positions_m"])
        np.testing.assert_array_equal(campaign.covariance, covariance)
        assert campaign.origin == (38.0, 143.25)
        assert campaign.epoch == np.datetime64("2020-01-02T03:04:05", "ns")
        assert campaign.source == str(file)
    file.write_text(file_of())
    unknown = read_campaign(file)
    assert (unknown.origin, np.isnat(unknown.epoch)) == (None, True)


@pytest.mark.slow
def test_the_command_prints_and_writes_the_displacement(mantaray, told, tmp_path):
    truth = make_campaign(3).truth
    earlier = make_campaign(3, truth=truth, prior_sigma=(20.0, 20.0, 20.0))
    later = make_campaign(4, truth=truth + MOVED, prior_sigma=(20.0, 20.0, 20.0))
    options = ("--sound-speed", "time", "--correlation", "none")
    first = write_garpos(earlier, tmp_path / "earlier")
    second = write_garpos(later, tmp_path / "later")
    done = mantaray("locate", first, *options, "--out", tmp_path / "first")
    assert done.code == 0, done.err
    printed = told("locate", second, *options, "--with", tmp_path / "first")["displacement"]
    error = np.array(printed["displacement_m"]) - MOVED
    covariance = np.array(printed["covariance_m2"])
    assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.999, 3)
    np.testing.assert_allclose(printed["sigma_m"], np.sqrt(np.diag(covariance)))
    file = tmp_path / "first" / "location.json"
    done = mantaray("locate", second, *options, "--with", file, "--out", tmp_path / "second")
    assert done.code == 0, done.err
    assert "Displacement of the nodes since the earlier campaign" in done.out
    assert "Displacement" in (tmp_path / "second" / "index.html").read_text()
    written = json.loads((tmp_path / "second" / "location.json").read_text())
    assert has_checksum(written)
    np.testing.assert_allclose(written["displacement"]["displacement_m"], printed["displacement_m"])
    pings, nodes = write_table(later, tmp_path)
    water = ("--profile", profile_csv(tmp_path))
    done = mantaray("locate", pings, "--nodes", nodes, *water, "--with", file)
    assert done.code == 2
    assert done.err.count("\n") == 1


@cache
def normalized_error(seed):
    """Squared error of the displacement between two surveys in drifting water, normalized."""
    medium = deep_water()
    first = drifting_survey(seed, nodes=3, hours=12.0, pings=900)
    second = drifting_survey(
        seed + 10_000,
        nodes=3,
        hours=10.0,
        pings=900,
        depth=first.depth,
        truth=first.truth,
        displacement=MOVED,
    )
    earlier, later = (locate(survey.survey, medium, FLAT) for survey in (first, second))
    names = earlier.survey.names
    campaign = Campaign(names, earlier.positions, earlier.covariance, None, NONE, "earlier")
    found = later.since(campaign).displacement
    error = found.value - MOVED
    return error @ np.linalg.solve(found.covariance, error)


@pytest.mark.slow
def test_the_displacement_is_true_within_its_covariance():
    assert normalized_error(1) < chi2.ppf(0.999, 3)


@pytest.mark.slow
def test_regions_of_the_displacement_cover_the_truth():
    """
    Ten pairs of surveys in drifting water; half of the covariance is beyond the bounds.

    Of 300 pairs the 95 % regions cover 92 %, so they are a little too small.
    """
    squares = np.array([normalized_error(seed) for seed in range(10)])
    low, high = chi2.ppf([0.001, 0.999], 3 * 10) / 10.0
    assert low <= np.mean(squares) <= high, np.sort(squares)
