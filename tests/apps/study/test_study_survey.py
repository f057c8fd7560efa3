"""The preset `survey`: a driven fleet, every condition and every estimator on it."""

import tomllib

import numpy as np
import pytest

from pymantaray.apps.study import run_study
from pymantaray.apps.study.mission import simulate_fleet
from pymantaray.config import load_study, parse_study, preset_text
from pymantaray.config.door.fleet import build_fleet
from pymantaray.config.door.ocean import mission_ocean
from pymantaray.estimation import CONDITIONS
from pymantaray.estimation.solvers.losses import LOSSES
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import SolveStatus


def short_survey(conditions):
    """Two hours of the preset with a ping every half an hour: all AUVs turn at least once."""
    tree = tomllib.loads(preset_text("survey"))
    tree["conditions"] = conditions
    tree["study"] |= {"realizations": 1}
    tree["mission"] |= {"duration_h": 2.0, "ping_interval_h": 0.5, "physics_step_s": 0.5}
    return parse_study(tree, "survey")


@pytest.fixture(scope="module")
def survey_run(tmp_path_factory):
    config = short_survey(list(CONDITIONS))
    return run_study(config, tmp_path_factory.mktemp("survey") / "run", workers=1)


def test_survey_is_a_driven_fleet_with_clocks_and_landmarks():
    config = load_study("survey")
    assert sorted(v.kind for v in config.fleet.vehicles) == ["station"] + 4 * ["waypoints"]
    assert len(config.landmarks) == 2
    assert (config.ranging.timing, config.ranging.mistaken) == ("one-way", "none")
    assert config.noise.clock_offset_sigma > 0.0
    assert config.noise.clock_skew_sigma > 0.0


@pytest.mark.slow
def test_survey_mows_its_lawn(survey_run, as_stored):
    outcome = survey_run.manifest["outcome"]
    as_stored({"outcome": outcome, "truth": survey_run.truth, "ranges": survey_run.measurements})
    as_stored({n: survey_run.tables[n].frame for n in ("ate_pooled", "ping_error")}, name="tables")
    truth, o = survey_run.truth, survey_run.measurements
    assert survey_run.manifest["outcome"]["stopped_vehicles"] == {}
    # sin of half the angle, twice
    turned = 2.0 * np.linalg.norm(o.odometry_rotation[..., 1:], axis=-1).max(axis=1)
    assert turned[0] == 0.0
    assert (turned[1:] > 1.0).all()
    field = np.ptp(truth.position[1:], axis=1)
    assert (field[:, 1] > 2800.0).all()
    assert (field[:, 0] > 300.0).all()
    assert (field[:, 2] < 1.0).all()
    assert set(o.gnss_vehicle) == {0}
    floor = float(survey_run.ocean["sea_floor_depth"].min())
    assert (o.landmark_position[:, 2] > floor - 20.0).all()


def test_every_condition_solves_the_survey(survey_run):
    e, truth = survey_run.estimates, survey_run.truth
    assert list(e.condition) == list(CONDITIONS)
    assert (e.solve_status == SolveStatus.OK).all()
    error = np.linalg.norm(e.position - truth.position, axis=-1)[:, 0, 1:].mean(axis=(1, 2))
    by = dict(zip(e.condition, error, strict=True))
    assert max(by["straight"], by["straight-all"]) < by["refracted"]
    assert by["straight"] < by["odometry"]


@pytest.mark.slow
def test_the_whole_survey_runs_healthy(tmp_path):
    run = run_study(load_study("survey", realizations=2), tmp_path / "run", workers=1)
    assert run.manifest["outcome"]["unhealthy_solves"] == []
    assert run.manifest["outcome"]["stopped_vehicles"] == {}
    assert run.manifest["outcome"]["links"]["OK"] > 800


def every_estimator():
    """
    Every range model, belief, variance, loss, solver and start, as sections of a configuration.
    """
    exact = {"range_model": {"kind": "eigenray", "belief": "exact"}}
    errors = {"kind": "perturbed", "rms": 2.0, "horizontal_scale": 5e4, "down_to": 300.0}
    beliefs = {
        "exact": "exact",
        "mean": "mean",
        "cast": "cast",
        "other-day": {"kind": "other-day", "days_earlier": 5.0},
        "perturbed": errors,
    }
    losses = ("none", "huber", "cauchy", "geman-mcclure", "tukey", "welsch", "gnc")
    sections = {
        "constant": {"range_model": {"kind": "constant", "sound_speed": 1500.0}},
        "mean-slowness": {"range_model": {"kind": "mean-slowness", "belief": "mean"}},
        "reckoned": exact | {"start": "dead-reckoning"},
        "transmitter-incremental": {"range_model": "transmitter", "solver": "incremental"},
        "mean-modes": {
            "range_model": {"kind": "eigenray", "belief": "mean", "modes": {"count": 4}}
        },
        "clocks": exact | {"clocks": {}},
        "fixed-lag": {"ranges": "straight", "solver": {"kind": "fixed-lag", "lag_h": 1.0}},
    }
    for kind, belief in beliefs.items():
        sections[f"belief-{kind}"] = {"range_model": {"kind": "eigenray", "belief": belief}}
    for variance in ("per-link", "correlated"):
        sections[f"variance-{variance}"] = sections["belief-perturbed"] | {"variance": variance}
    for loss in losses:
        sections[f"transmitter-{loss}"] = {"range_model": "transmitter", "loss": loss}
        if loss != "none":
            sections[f"loss-{loss}"] = exact | {"loss": loss}
        if loss == "none" or LOSSES[loss].incremental:
            sections[f"incremental-{loss}"] = {
                "ranges": "straight",
                "solver": "incremental",
                "loss": loss,
            }
    return [{"name": name} | section for name, section in sections.items()]


@pytest.mark.slow
def test_every_estimator_solves_the_survey(tmp_path):
    estimators = every_estimator()
    config = short_survey(["odometry", "no-ranges", "straight", "refracted", *estimators])
    for field, kinds in (
        ("loss", {"none", "huber", "cauchy", "geman-mcclure", "tukey", "welsch", "gnc"}),
        ("start", {None, "dead-reckoning"}),
        ("ranges", {"none", "straight", "refracted"}),
    ):
        assert {getattr(c, field) for c in config.conditions} == kinds
    for field, kinds in (
        ("range_model", {"transmitter", "constant", "mean-slowness", "eigenray"}),
        ("variance", {"fixed", "per-link", "correlated"}),
        ("solver", {"batch", "incremental", "fixed-lag", "dead-reckoning"}),
    ):
        assert {getattr(c, field).kind for c in config.conditions} == kinds
    run = run_study(config, tmp_path / "run", workers=1)
    e = run.estimates
    assert run.manifest["outcome"]["unhealthy_solves"] == []
    assert (e.gated_links == 0).all()
    auvs = (e.position - run.truth.position)[:, 0, 1:]
    rms = dict(
        zip(e.condition, np.sqrt(np.mean(np.sum(auvs**2, axis=-1), axis=(1, 2))), strict=True)
    )
    at = {name: e.position[i, 0] for i, name in enumerate(e.condition)}
    # one optimum, however it is found
    for one, other in (
        ("transmitter-none", "refracted"),
        ("transmitter-incremental", "refracted"),
        ("reckoned", "belief-exact"),
        ("incremental-none", "straight"),
    ):
        assert np.abs(at[one] - at[other]).max() < 0.02, (one, other)
    # who knows the ocean, or nearly so, does as well as in a straight world; who does not pays for
    # it
    does_not = {"odometry", "no-ranges", "refracted", "constant", "mean-slowness", "belief-mean"}
    for name in rms.keys() - does_not:
        if not name.startswith("transmitter"):
            assert rms[name] == pytest.approx(rms["straight"], rel=0.1), name
    assert 1.2 * rms["straight"] < rms["mean-slowness"] < rms["refracted"] < rms["constant"]


def test_the_current_carries_vehicles_and_buoys_on_request(survey_run, as_stored):
    """
    Over ground they move as they do through the water and with the current, which here hardly
    varies.
    """
    tree = short_survey(["straight"]).model_dump(exclude_none=True)
    for vehicle in tree["fleet"]["vehicles"]:
        vehicle |= {"current": True} if vehicle["kind"] == "waypoints" else {}
    tree["fleet"]["vehicles"] += (
        {"name": "Buoy", "kind": "drifting", "north": 0.0, "east": 0.0},
        {"name": "Drogue", "kind": "drifting", "north": 0.0, "east": 0.0, "drogue_depth": 400.0},
    )
    config = parse_study(tree)
    ocean = mission_ocean(config)
    truth = simulate_fleet(build_fleet(config), ocean)
    as_stored(truth)
    assert truth.role.tolist() == ["station"] + 4 * ["waypoints"] + 2 * ["drifting"]
    hours = truth.time[-1]
    for row, depth in ((5, 0.5), (6, 400.0)):
        at = ocean.local.interp(north=0.0, east=0.0, depth=depth)
        current = np.array([at["current_north"], at["current_east"]])
        way = truth.position[row, -1] - truth.position[row, 0]
        np.testing.assert_allclose(way[:2], hours * current, rtol=0.1, atol=10.0)
        assert way[2] == 0.0
    early = slice(0, 60)  # 20 min, before the first turn
    for row in range(1, 5):
        forward = np.einsum(
            "tij,j->ti", matrix_from_quaternion(truth.quaternion[row, early]), [1.5, 0.0, 0.0]
        )
        at = ocean.local.interp(
            dict(zip(("north", "east", "depth"), truth.position[row, 0], strict=True))
        )
        current = np.array([at["current_north"], at["current_east"], 0.0])
        speed = np.gradient(truth.position[row, early], truth.time[early], axis=0)[1:-1]
        np.testing.assert_allclose(speed, forward[1:-1] + current, rtol=0, atol=0.01)
    before = np.linalg.norm(truth.position[1:5] - survey_run.truth.position[1:], axis=-1)
    assert before[:, -1].min() > 5.0
