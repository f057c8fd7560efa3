"""Eigenrays with sound-speed modes of unknown amplitude: sensitivities, adjusted media, and what is true of them."""

import tomllib

import numpy as np
import pytest
import xarray as xr

from pymantaray.acoustics import Medium
from pymantaray.errors import OceanError
from pymantaray.estimation import AdjustableModel
from pymantaray.estimation.range_models import RangeLinks
from pymantaray.records import Trajectories
from pymantaray.study import parse_study, preset_text, run_study
from pymantaray.study.beliefs import Beliefs
from pymantaray.study.config_estimators import ModesSection
from pymantaray.study.range_models.adjustable_eigenrays import AdjustableEigenrays
from pymantaray.study.range_models.eigenray_model import EigenrayModel
from pymantaray.study.true_unknowns import true_amplitudes

NORTH, EAST, DEPTH = np.linspace(-8e3, 8e3, 9), np.linspace(-8e3, 8e3, 9), np.linspace(0.0, 1200.0, 25)
SHAPES = np.stack([np.exp(-DEPTH / 250.0), np.cos(DEPTH / 200.0)])
SIGMA = np.array([2.0, 1.0])
EXACT = {"kind": "exact"}
OFFSET = 1e-3


def water(interpolation="smooth"):
    warm = 8.0 * np.tanh(NORTH / 3e3)[:, None, None] * np.exp(-DEPTH / 200.0)
    speed = 1450.0 + 0.016 * DEPTH + warm + np.zeros((9, 9, 25))
    bed = np.full((9, 9), 1200.0)
    return Medium.from_grid(NORTH, EAST, DEPTH, speed, bathymetry=bed, interpolation=interpolation)


def rays(interpolation="smooth"):
    return AdjustableEigenrays(EigenrayModel(water(interpolation)), DEPTH, SHAPES, SIGMA)


@pytest.fixture(scope="module")
def links():
    rng = np.random.default_rng(3)
    a, b = (rng.uniform([-5e3, -5e3, 50.0], [5e3, 5e3, 1000.0], (8, 3)) for _ in range(2))
    return RangeLinks(np.zeros(8), a, b, np.full(8, 1450.0))


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_sensitivities_are_finite_differences_of_travel_times_in_adjusted_water(links, interpolation):
    model = rays(interpolation)
    assert isinstance(model, AdjustableModel)
    about = np.array([0.7, -0.4])
    here, step = model.adjusted(about), 0.01
    found = here.sensitivity(links)
    for k, e in enumerate(np.eye(2)):
        ahead, behind = (model.adjusted(about + s * step * e).predict(links).travel_time for s in (1, -1))
        # some 1e-3 s² m⁻¹ each; the second difference of a ray that bends leaves 1e-4 of that
        np.testing.assert_allclose(found[:, k], (ahead - behind) / (2 * step), rtol=3e-4, atol=1e-9)
    assert np.abs(found).max() > 1e-4


def test_adjusted_water_is_the_sum_and_amplitudes_count_from_the_belief(links):
    model = rays()
    there = model.adjusted(np.array([1.0, 2.0]))
    by_hand = Medium.from_grid(
        NORTH,
        EAST,
        DEPTH,
        water().sound_speed + SHAPES[0] + 2.0 * SHAPES[1],
        bathymetry=np.full((9, 9), 1200.0),
    )
    expected = EigenrayModel(by_hand).predict(links).travel_time
    np.testing.assert_allclose(there.predict(links).travel_time, expected, rtol=1e-14)
    again = there.adjusted(np.array([1.0, 2.0]))
    assert again is there
    back = there.adjusted(np.zeros(2))
    np.testing.assert_array_equal(back.predict(links).travel_time, model.predict(links).travel_time)


def test_link_without_a_ray_has_no_sensitivity(links):
    beyond = links._replace(receiver=links.receiver + np.array([0.0, 0.0, 5000.0]))
    model = rays()
    assert not model.predict(beyond).possible.any()
    np.testing.assert_array_equal(model.sensitivity(beyond), 0.0)


def test_true_amplitudes_are_those_of_the_difference_where_the_fleet_is():
    def local(amplitudes):
        speed = 1450.0 + np.zeros((9, 9, 25)) + amplitudes @ SHAPES
        speed[5:] += 3.0  # elsewhere
        return xr.Dataset(
            {"sound_speed": (("north", "east", "depth"), speed)},
            coords={"north": NORTH, "east": EAST, "depth": DEPTH},
        )

    n = 4
    place = np.tile([[[-7e3, 0.0, 100.0]]], (2, n, 1))
    fleet = Trajectories(
        name=np.array(["A", "B"]),
        role=np.array(["station", "station"]),
        time=np.arange(n) * 60.0,
        position=place,
        quaternion=np.tile([1.0, 0, 0, 0], (2, n, 1)),
        status=np.zeros((2, n), dtype=int),
    )
    true, believed = local(np.array([1.5, -0.5])), local(np.array([0.5, 0.25]))
    found = true_amplitudes(rays(), true, believed, fleet)
    assert found == pytest.approx({"mode 1": 1.0, "mode 2": -0.75}, abs=1e-9)


def a_day(*estimators, **ranging):
    tree = tomllib.loads(preset_text("quick"))
    tree["study"] |= {"realizations": 2, "conditions": ["straight"]}
    tree["ocean"] |= {"half_extent_north": 15000.0, "half_extent_east": 15000.0}
    tree["mission"]["physics_step_s"] = 1.0
    tree["ranging"] = ranging
    tree["estimators"] = [{"name": f"e{i}", "range_model": "eigenray", **e} for i, e in enumerate(estimators)]
    return parse_study(tree)


@pytest.fixture(scope="module")
def joint():
    mean = {"belief": {"kind": "mean"}}
    return a_day(
        mean | {"modes": {"count": 3, "rms": 1.0, "down_to": 300.0}},
        {"belief": EXACT, "clocks": {}},
        mean,
        clock_offset_sigma=OFFSET,
        clock_skew_sigma=1e-8,
    )


@pytest.fixture(scope="module")
def run(joint, tmp_path_factory):
    return run_study(joint, tmp_path_factory.mktemp("runs") / "joint", workers=1)


def test_study_finds_water_and_clocks_and_keeps_the_truth_beside_them(run):
    u, n = run.unknowns, run.truth.name.size
    assert u.condition.tolist() == ["e0", "e1"]
    assert u.name[:3].tolist() == ["mode 1", "mode 2", "mode 3"]
    assert np.isfinite(u.prior_sigma).sum(axis=1).tolist() == [3, 2 * n]
    assert np.isnan(u.value[1, :, :3]).all()
    assert np.isnan(u.covariance[1, :, :3]).all()
    truth = u.truth[1, :, 3:]
    sigma = np.sqrt(np.diagonal(u.covariance[1], axis1=1, axis2=2))[:, 3:]
    assert 0.3 < np.std(truth[:, :n]) / OFFSET < 3.0
    assert np.all(np.abs(u.value[1, :, 3:] - truth) < 5.0 * sigma)
    # of clocks only the differences are seen: no landmark keeps the time
    offsets = u.covariance[1, 0, 3 : 3 + n, 3 : 3 + n] / OFFSET**2
    mean = np.full(n, 1.0 / n)
    assert mean @ offsets @ mean == pytest.approx(1.0 / n, rel=1e-3)
    apart = np.eye(n)[0] - np.eye(n)[1]
    assert apart @ offsets @ apart < 0.05 * 2.0  # of two offsets' prior
    wrong = run.config.estimators[0].modes.model_copy(update={"count": 99})
    with pytest.raises(OceanError, match="count is 99, but there are"):
        Beliefs(run).modes(wrong)


def test_modes_of_casts_are_scaled_as_those_of_the_ocean(run, tmp_path):
    z = np.arange(0.0, 1001.0, 5.0)
    files = []
    for i, warm in enumerate((0.0, 1.0, 2.5)):
        file = tmp_path / f"cast{i}.csv"
        temperature = -1.0 + warm * np.exp(-z / 150.0)
        rows = "\n".join(f"{d:g},{t:.5f},34.5" for d, t in zip(z, temperature, strict=True))
        file.write_text(f"# lat 75.0, lon -140.0\ndepth_m,temperature_c,salinity\n{rows}\n")
        files.append(str(file))
    depth, shapes, sigma = Beliefs(run).modes(
        ModesSection.model_validate({"count": 1, "rms": 2.0, "down_to": 300.0, "casts": files})
    )
    assert shapes.shape == (1, depth.size)
    fine = np.linspace(0.0, 300.0, 301)
    assert sigma[0] * np.sqrt(np.mean(np.interp(fine, depth, shapes[0]) ** 2)) == pytest.approx(2.0, rel=0.05)
    # warmest at the top, as the casts differ
    assert np.argmax(shapes[0]) == 0
