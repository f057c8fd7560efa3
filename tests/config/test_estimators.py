"""What an estimator gets of the keys of its condition."""

from types import SimpleNamespace

import numpy as np
import pytest

from pymantaray.apps.study import open_run
from pymantaray.config.door.estimators import EstimatorFactory, build_condition
from pymantaray.config.estimators import ConditionSection
from pymantaray.estimation import LOSSES, ConstantSpeed, Method
from pymantaray.estimation.ranges.range_models import RangeEndpoints
from pymantaray.geometry.sphere import EarthSphere
from pymantaray.range_models.eigenray_model import EigenrayModel

CONSTANT = {"kind": "constant", "sound_speed": 1450.0}
EXACT = {"kind": "eigenray", "belief": "exact"}
ON_LINE = {"kind": "fixed-lag", "lag_h": 8.0, "incremental": True}
ERRORS = {"kind": "correlated", "rms": 1.0, "horizontal_scale": 1e4}


@pytest.fixture(scope="module")
def factory(tiny_run_folder):
    return EstimatorFactory(open_run(tiny_run_folder))


def made(factory, **keys):
    return factory.estimator(ConditionSection.model_validate({"name": "own", **keys}), 0)


@pytest.mark.parametrize(
    ("keys", "name", "expected"),
    [
        ({"ranges": "none"}, "ranges", None),
        ({"ranges": "straight"}, "ranges", "straight"),
        ({"ranges": "straight", "links": "all"}, "links", "all"),
        ({"scale_sigma": 1e-3}, "scale_sigma", 1e-3),
        ({"bias_sigma": 2.0}, "bias_sigma", 2.0),
        ({"range_sigma": 3.0}, "range_sigma", 3.0),
        ({"directions": "mean"}, "mean_of_directions", True),
        ({"ranges": "none", "solver": "dead-reckoning"}, "dead_reckoned", True),
        ({"start": "dead-reckoning"}, "initial", None),
        ({"loss": "huber"}, "method", Method(LOSSES["huber"])),
        ({"solver": "kalman-filter"}, "method", Method(kalman=True)),
        ({"solver": ON_LINE}, "method", Method(lag=28_800.0, incremental=True)),
        ({"clocks": {"offset_sigma": 0.5, "skew_sigma": 2e-6}}, "clocks", (0.5, 2e-6, None)),
    ],
)
def test_a_key_of_a_condition_reaches_its_estimator(factory, keys, name, expected):
    assert getattr(made(factory, **keys), name) == expected
    assert getattr(made(factory), name) is not expected


def test_a_range_model_reaches_its_estimator_and_no_other(factory):
    assert made(factory).model is None
    assert isinstance(made(factory, range_model=CONSTANT).model, ConstantSpeed)
    assert made(factory, range_model=EXACT).uncertainty is None
    believing = made(factory, range_model=EXACT, variance=ERRORS)
    assert isinstance(believing.model, EigenrayModel)
    assert believing.correlated
    assert believing.uncertainty is not None


@pytest.mark.parametrize("clocks", [None, {"offset_sigma": 0.5, "skew_sigma": 2e-6}])
def test_a_condition_says_if_it_estimates_clocks(clocks):
    section = ConditionSection.model_validate({"name": "own", "clocks": clocks})
    assert build_condition(section).estimates_clocks is (clocks is not None)


def test_settings_of_a_condition_are_keys_that_its_name_lacks():
    def settings(**keys):
        return build_condition(ConditionSection.model_validate(keys)).settings

    assert settings(name="straight") == {}
    assert settings(name="own", ranges="straight", links="all") == {
        "ranges": "straight",
        "links": "all",
    }


def test_an_estimator_of_all_realizations_has_no_model(tiny, tiny_run_folder):
    config = tiny(conditions=["straight", {"name": "rays", "range_model": EXACT}])
    factory = EstimatorFactory(
        SimpleNamespace(config=config, truth=open_run(tiny_run_folder).truth)
    )
    assert factory.without_model("straight").ranges == "straight"
    assert factory.without_model("rays") is None


def test_straight_ranges_on_a_sphere_are_chords_and_rays_are_not(tiny, tiny_run_folder):
    run = open_run(tiny_run_folder)
    known = {"truth": run.truth, "ocean": run.ocean, "ocean_in": run.ocean_in}
    config = tiny(acoustics={"earth": "sphere"})
    factory = EstimatorFactory(SimpleNamespace(config=config, **known))
    a, b = np.zeros((1, 3)), np.array([[4e3, 0.0, 900.0]])
    links = RangeEndpoints(np.zeros(1), a, b, np.array([1450.0]))
    chord = EarthSphere.at_latitude(74.5).straight_distance(a, b)
    for keys in ({}, {"range_model": CONSTANT}):
        found = made(factory, **keys).model.predict(links).travel_time
        np.testing.assert_allclose(found, chord / 1450.0, rtol=1e-12)
    assert isinstance(made(factory, range_model=EXACT).model, EigenrayModel)
    assert made(factory, ranges="none").model is None


@pytest.mark.parametrize(("keys", "right"), [
    ({"ranges": "straight"}, True),
    ({"ranges": "refracted"}, False),
    ({"range_model": EXACT}, True),
    ({"range_model": EXACT, "variance": ERRORS}, False),
    ({"range_model": EXACT, "range_sigma": 3.0}, False),
    ({"range_model": CONSTANT}, False),
])  # fmt: skip
def test_a_cost_has_bounds_where_every_assumption_holds(factory, keys, right):
    assert made(factory, **keys).model_is_right is right
