"""The preset `survey`, and receivers that mistake arrivals, from the file to the estimates."""

import tomllib
from typing import get_args

import numpy as np
import pytest

from pymantaray.errors import StudyError
from pymantaray.records import RayStatus, SolveStatus
from pymantaray.sensing import Picker
from pymantaray.study import load_study, open_run, parse_study, preset_text, run_study, study_toml
from pymantaray.study.assemble import build_picker
from pymantaray.study.config import Condition, RangingSection
from pymantaray.study.config_estimators import RangeEstimatorSection

DETECTION = {"source_level_db": 165.0, "frequency_hz": 25e3, "bandwidth_hz": 4e3}
BOUNCES = {"max_surface_bounces": 1, "max_bottom_bounces": 1}
FIRST = {"mistaken": "first-detected"}


def short_survey(*, estimators=(), **study):
    """Two hours of the preset with a ping every half an hour: all AUVs turn at least once."""
    tree = tomllib.loads(preset_text("survey"))
    tree |= {"estimators": list(estimators)} if estimators else {}
    tree["study"] |= {"realizations": 1} | study
    tree["mission"] |= {"duration_h": 2.0, "ping_interval_h": 0.5, "physics_step_s": 0.5}
    return parse_study(tree, "survey")


@pytest.fixture(scope="module")
def survey_run(tmp_path_factory):
    config = short_survey(conditions=list(get_args(Condition)))
    return run_study(config, tmp_path_factory.mktemp("survey") / "run", workers=1)


def test_survey_is_a_driven_fleet_with_clocks_and_landmarks():
    config = load_study("survey")
    assert sorted(v.kind for v in config.fleet.vehicles) == ["station"] + 4 * ["waypoints"]
    assert len(config.landmarks) == 2
    assert (config.ranging.timing, config.ranging.mistaken) == ("one-way", "off")
    assert config.ranging.clock_offset_sigma > 0.0
    assert config.ranging.clock_skew_sigma > 0.0


def test_survey_mows_its_lawn(survey_run):
    truth, o = survey_run.truth, survey_run.measurements
    assert survey_run.manifest["outcome"]["stopped_vehicles"] == {}
    turned = 2.0 * np.linalg.norm(o.odometry_rotation[..., 1:], axis=-1).max(
        axis=1
    )  # sin of half the angle, twice
    assert turned[0] == 0.0
    assert (turned[1:] > 1.0).all()
    field = np.ptp(truth.position[1:], axis=1)
    assert (field[:, 1] > 2800.0).all()
    assert (field[:, 0] > 300.0).all()
    assert (field[:, 2] < 1.0).all()
    assert set(o.gnss_agent) == {0}
    floor = float(survey_run.ocean["sea_floor_depth"].min())
    assert (o.landmark_position[:, 2] > floor - 20.0).all()


def test_every_condition_solves_the_survey(survey_run):
    e, truth = survey_run.estimates, survey_run.truth
    assert list(e.condition) == list(get_args(Condition))
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
    """Every range model, belief, variance, loss, solver and start, as sections of a configuration."""
    exact = {"range_model": "eigenray", "belief": {"kind": "exact"}}
    errors = {"kind": "perturbed", "rms": 2.0, "horizontal_scale": 5e4, "down_to": 300.0}
    beliefs = {
        "exact": exact["belief"],
        "mean": {"kind": "mean"},
        "cast": {"kind": "cast"},
        "other-day": {"kind": "other-day", "days_earlier": 5.0},
        "perturbed": errors,
    }
    losses = ("none", "huber", "cauchy", "geman-mcclure", "gnc")
    sections = {
        "constant": {"range_model": "constant", "sound_speed": 1500.0},
        "mean-slowness": {"range_model": "mean-slowness", "belief": beliefs["mean"]},
        "reckoned": exact | {"start": "dead-reckoning"},
        "transmitter-incremental": {"range_model": "transmitter", "solver": "incremental"},
        "mean-modes": {"range_model": "eigenray", "belief": beliefs["mean"], "modes": {"count": 4}},
        "clocks": exact | {"clocks": {}},
    }
    for kind, belief in beliefs.items():
        sections[f"belief-{kind}"] = {"range_model": "eigenray", "belief": belief}
    for variance in ("per-link", "correlated"):
        sections[f"variance-{variance}"] = sections["belief-perturbed"] | {"variance": variance}
    for loss in losses:
        sections[f"transmitter-{loss}"] = {"range_model": "transmitter", "loss": loss}
        if loss != "none":
            sections[f"loss-{loss}"] = exact | {"loss": loss}
        if loss != "gnc":
            sections[f"incremental-{loss}"] = {"ranges": "straight", "solver": "incremental", "loss": loss}
    return [{"name": name} | section for name, section in sections.items()]


@pytest.mark.slow
def test_every_estimator_solves_the_survey(tmp_path):
    estimators = every_estimator()
    for field in ("range_model", "variance", "loss", "solver", "start", "ranges"):
        kinds = get_args(RangeEstimatorSection.model_fields[field].annotation)
        default = RangeEstimatorSection.model_fields[field].default
        assert {e.get(field, default) for e in estimators} == set(kinds)
    config = short_survey(conditions=["no-ranges", "straight", "refracted"], estimators=estimators)
    run = run_study(config, tmp_path / "run", workers=1)
    e = run.estimates
    assert run.manifest["outcome"]["unhealthy_solves"] == []
    assert (e.gated_links == 0).all()
    auvs = (e.position - run.truth.position)[:, 0, 1:]
    rms = dict(zip(e.condition, np.sqrt(np.mean(np.sum(auvs**2, axis=-1), axis=(1, 2))), strict=True))
    at = {name: e.position[i, 0] for i, name in enumerate(e.condition)}
    # one optimum, however it is found
    for one, other in (
        ("transmitter-none", "refracted"),
        ("transmitter-incremental", "refracted"),
        ("reckoned", "belief-exact"),
        ("incremental-none", "straight"),
    ):
        assert np.abs(at[one] - at[other]).max() < 0.02, (one, other)
    # who knows the ocean, or nearly so, does as well as in a straight world; who does not pays for it
    for name in (
        "belief-exact",
        "belief-cast",
        "belief-other-day",
        "belief-perturbed",
        "variance-per-link",
        "variance-correlated",
        "mean-modes",
        "clocks",
        "loss-huber",
        "loss-cauchy",
        "loss-geman-mcclure",
        "loss-gnc",
        "incremental-huber",
        "incremental-cauchy",
        "incremental-geman-mcclure",
    ):
        assert rms[name] == pytest.approx(rms["straight"], rel=0.1), name
    assert 1.2 * rms["straight"] < rms["mean-slowness"] < rms["refracted"] < rms["constant"]


def test_sections_become_a_picker(tiny_tree, tmp_path):
    ranging = FIRST | {"below_strongest_db": 9.0}
    config = parse_study(tiny_tree | {"ranging": ranging})
    assert build_picker(config.ranging, None) == Picker("first-detected", below_strongest_db=9.0)
    (tmp_path / "config.toml").write_text(study_toml(config))
    assert load_study(tmp_path / "config.toml") == config
    assert build_picker(RangingSection(mistaken="strongest-detected"), None) == Picker("strongest-detected")


def erring(tree, **ranging):
    tree["study"].update(conditions=["odometry", "straight", "refracted"], realizations=4)
    return parse_study(
        tree | {"acoustics": BOUNCES, "ranging": FIRST | ranging, "detection": DETECTION}, "tiny"
    )


@pytest.fixture(scope="module")
def erring_run(make_tiny_tree, tmp_path_factory):
    return run_study(erring(make_tiny_tree()), tmp_path_factory.mktemp("erring") / "run", workers=1)


def test_mistakes_are_counted_and_become_ranges(erring_run, tiny_run):
    run, o = erring_run, erring_run.measurements
    outcome = run.manifest["outcome"]
    drawn = [run.mistaken(r) for r in range(4)]
    expected = outcome["expected_mistaken"]
    assert 3.0 < expected < o.range_status.size
    spread = np.sqrt(expected)  # no more than independent attempts have
    assert abs(np.mean([m.sum() for m in drawn]) - expected) < 4.0 * spread / 2.0
    time = run.ranging_truth.travel_time
    np.testing.assert_array_equal(time, tiny_run.ranging_truth.travel_time)
    for realization, mistaken in enumerate(drawn):
        noisy = run.noisy_measurements(realization)
        assert (noisy.range_status[mistaken] == RayStatus.OK).all()
        right = (noisy.range_status == RayStatus.OK) & ~mistaken
        late = noisy.refracted_range - run.ranging_truth.refracted_range
        assert np.abs(late[right]).max() < 5.0  # the noise has a sigma of 1 m
        assert (late[mistaken & np.isfinite(late)] > -5.0).all()
        assert np.isfinite(noisy.refracted_range[mistaken]).all()
    lost = [np.count_nonzero(run.noisy_measurements(r).range_status == RayStatus.UNHEARD) for r in range(4)]
    assert np.mean(lost) == pytest.approx(outcome["expected_unheard"], rel=0.4)


def test_results_do_not_depend_on_the_number_of_workers(erring_run, make_tiny_tree, tmp_path):
    two = run_study(erring(make_tiny_tree()), tmp_path / "run", workers=2)
    np.testing.assert_array_equal(two.estimates.position, erring_run.estimates.position)
    np.testing.assert_array_equal(two.candidates.probability, erring_run.candidates.probability)
    np.testing.assert_array_equal(open_run(two.path).mistaken(3), erring_run.mistaken(3))
    assert np.unique([erring_run.mistaken(r).sum() for r in range(4)]).size > 1


def test_without_mistakes_there_is_no_file_and_none_is_mistaken(tiny_run):
    assert tiny_run.candidates is None
    assert not (tiny_run.path / "candidates.nc").exists()
    assert not tiny_run.mistaken(0).any()
    assert "expected_mistaken" not in tiny_run.manifest["outcome"]
    with pytest.raises(StudyError, match="realization 2: the run has 0 to 1"):
        tiny_run.mistaken(2)
