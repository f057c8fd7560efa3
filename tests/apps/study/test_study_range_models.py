"""
Range models that trace rays, and the covariance of their travel times, in a front over a flat sea
bed.
"""

import numpy as np
import pytest
import xarray as xr
from factories import trajectories

from pymantaray.acoustics import Currents, Medium, find_eigenrays, quadrature
from pymantaray.apps.study.true_unknowns import true_amplitudes
from pymantaray.estimation import RangeEndpoints, RangeModel
from pymantaray.ocean import SoundSpeedCovariance
from pymantaray.range_models import eigenray_model
from pymantaray.range_models.eigenray_model import AdjustableEigenrays, EigenrayModel, pairs_of
from pymantaray.range_models.ray_uncertainty import RayUncertainty

NORTH, EAST, DEPTH = (
    np.linspace(-8e3, 8e3, 9),
    np.linspace(-8e3, 8e3, 9),
    np.linspace(0.0, 1200.0, 25),
)
FRONT = (
    1450.0
    + 0.016 * DEPTH
    + 8.0 * np.tanh(NORTH / 3e3)[:, None, None] * np.exp(-DEPTH / 200.0)
    + np.zeros((9, 9, 25))
)
SHAPES = np.stack([np.exp(-DEPTH / 250.0), np.cos(DEPTH / 200.0)])


def water(speed=FRONT, bed=1200.0, interpolation="smooth"):
    return Medium.from_grid(
        NORTH,
        EAST,
        DEPTH,
        speed,
        bathymetry=np.broadcast_to(bed, (9, 9)),
        interpolation=interpolation,
    )


def adjustable(interpolation="smooth"):
    return AdjustableEigenrays(
        EigenrayModel(water(interpolation=interpolation)), DEPTH, SHAPES, np.array([2.0, 1.0])
    )


def between(a, b):
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return RangeEndpoints(np.zeros(len(a)), a, b, np.full(len(a), 1450.0))


def both_ways(a, b):
    return between(np.concatenate([a, b]), np.concatenate([b, a]))


@pytest.fixture(scope="module")
def medium():
    return water()


@pytest.fixture(scope="module")
def ends():
    rng = np.random.default_rng(3)
    low, high = [-5e3, -5e3, 50.0], [5e3, 5e3, 1000.0]
    return rng.uniform(low, high, (8, 3)), rng.uniform(low, high, (8, 3))


@pytest.fixture(scope="module")
def links(ends):
    return between(*ends)


def test_travel_times_equal_the_solver_and_gradients_are_right(medium, ends):
    model = EigenrayModel(medium)
    a, b = ends
    found = model.predict(between(a, b))
    first = find_eigenrays(medium, a, b).first()
    np.testing.assert_array_equal(found.travel_time, first.travel_time)
    assert found.possible.all()
    # truncated at 2e-9, as its square; the integrator's tolerance leaves 1e-8 m over the step
    step = 5.0
    for k in range(3):
        e = np.eye(3)[k] * step
        for end, gradient in ((0, found.transmitter_gradient), (1, found.receiver_gradient)):
            ahead, behind = (
                model.predict(between(a + s * e * (end == 0), b + s * e * end)).travel_time
                for s in (1, -1)
            )
            np.testing.assert_allclose(
                gradient[:, k], (ahead - behind) / (2 * step), rtol=0, atol=3e-9
            )


def test_there_and_back_are_one_ray_solved_once(medium, ends, monkeypatch):
    solved = []

    def counted(medium, source, receiver, **options):
        solved.append(len(source))
        return find_eigenrays(medium, source, receiver, **options)

    monkeypatch.setattr(eigenray_model, "find_eigenrays", counted)
    a, b = ends
    model = EigenrayModel(medium)
    both = both_ways(a, b)
    found = model.predict(both)
    assert solved == [8]
    np.testing.assert_array_equal(found.travel_time[:8], found.travel_time[8:])
    np.testing.assert_array_equal(found.transmitter_gradient[:8], found.receiver_gradient[8:])
    np.testing.assert_array_equal(found.receiver_gradient[:8], found.transmitter_gradient[8:])
    model.predict(both)
    assert solved == [8]  # the start of the next realization
    model.predict(between(a + 1.0, b))
    model.predict(both)
    assert solved == [8, 8]


def test_current_makes_one_way_earlier_and_the_other_later_by_as_much(medium, ends):
    a, b = ends
    both = both_ways(a, b)
    still = EigenrayModel(medium).predict(both).travel_time
    moved = EigenrayModel(medium, currents=Currents.uniform(0.3, -0.1)).predict(both).travel_time
    np.testing.assert_allclose(moved[:8] - still[:8], still[8:] - moved[8:], rtol=0, atol=1e-15)
    along = (b - a) @ [0.3, -0.1, 0.0]
    np.testing.assert_allclose(moved[:8] - still[:8], -along / 1460.0**2, rtol=0.03, atol=1e-8)


def test_what_the_ocean_does_not_allow_is_not_possible():
    ridge = np.where(NORTH == 0.0, 300.0, 1200.0)[:, None]
    model = EigenrayModel(water(np.broadcast_to(1450.0 + 0.016 * DEPTH, (9, 9, 25)), bed=ridge))
    a = np.tile([-4e3, 0.0, 800.0], (4, 1))
    b = np.array([[4e3, 0.0, 800.0], [-4e3, 3e3, 800.0], [9e3, 0.0, 50.0], [-4e3, 0.0, 1300.0]])
    found = model.predict(between(a, b))
    # behind the ridge, beside it, outside the domain, and below the sea bed
    assert found.possible.tolist() == [False, True, False, False]
    assert np.isnan(found.travel_time[[0, 2, 3]]).all()


def test_an_estimate_above_the_surface_counts_as_at_the_surface(medium):
    a, b = np.array([[0.0, 0.0, -0.03]]), np.array([[900.0, 300.0, 700.0]])
    at_surface = find_eigenrays(medium, [[0.0, 0.0, 0.0]], b).first().travel_time
    model = EigenrayModel(medium)
    for links in (between(a, b), between(b, a)):
        found = model.predict(links)
        assert found.possible.all()
        np.testing.assert_allclose(found.travel_time, at_surface, rtol=0, atol=1e-9)


def brute_force(model, covariance, links):
    """The double integral by its definition, point by point."""
    pairs = pairs_of(links, model.medium)
    paths, _ = model.paths(pairs)
    points = quadrature(paths)
    weight = points.weight * np.sum(points.slowness**2, axis=1)
    n = pairs.source.shape[0]
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            p, q = points.arrival == i, points.arrival == j
            c = covariance(points.position[p][:, None], points.position[q][None])
            out[i, j] = weight[p] @ c @ weight[q]
    return out[np.ix_(pairs.pair, pairs.pair)]


def gaussian(rms, vertical_scale, horizontal_scale):
    """Covariance of a Gaussian process with a Gaussian correlation in depth too."""
    correlation = np.exp(-0.5 * ((DEPTH[:, None] - DEPTH) / vertical_scale) ** 2)
    return SoundSpeedCovariance(DEPTH, rms[:, None] * correlation * rms, horizontal_scale)


@pytest.mark.parametrize("scale", [2500.0, 20e3, np.inf], ids=["short", "long", "everywhere"])
def test_covariance_is_the_double_integral_along_the_rays(medium, links, scale):
    covariance = gaussian(2.0 * np.exp(-DEPTH / 300.0), 150.0, scale)
    model = EigenrayModel(medium)
    (found,) = RayUncertainty(model, covariance).covariances(links, np.zeros(8, dtype=int))
    expected = brute_force(model, covariance, links)
    typical = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / typical, expected / typical, rtol=0, atol=2e-3)
    assert (expected / typical)[0, 1:].max() > 0.01  # links that share water
    assert np.linalg.eigvalsh(found).min() > -1e-12 * found.max()


def test_epochs_are_apart_and_both_ways_of_a_link_are_one(medium, ends):
    a, b = ends
    model = EigenrayModel(medium)
    covariance = gaussian(np.ones(DEPTH.size), 100.0, 5e3)
    links = between(np.concatenate([a[:4], b[:4], a[4:]]), np.concatenate([b[:4], a[:4], b[4:]]))
    first, second = RayUncertainty(model, covariance).covariances(links, np.repeat([0, 1], [8, 4]))
    assert first.shape == (8, 8)
    assert second.shape == (4, 4)
    np.testing.assert_array_equal(first[:4], first[4:])
    np.testing.assert_array_equal(first[:4, :4], first[:4, 4:])


def test_link_without_a_ray_has_no_variance_and_no_sensitivity(medium):
    covariance = gaussian(np.ones(DEPTH.size), 100.0, 5e3)
    links = between([[0, 0, 100.0], [0, 0, 100.0]], [[0, 9e3, 100.0], [0, 3e3, 100.0]])
    (found,) = RayUncertainty(EigenrayModel(medium), covariance).covariances(
        links, np.zeros(2, dtype=int)
    )
    assert found[0].tolist() == [0.0, 0.0]
    assert found[1, 1] > 0.0
    by_amplitude = adjustable().sensitivity(links)
    assert by_amplitude[0].tolist() == [0.0, 0.0]
    assert by_amplitude[1].all()


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_sensitivities_are_finite_differences_of_travel_times(links, interpolation):
    model = adjustable(interpolation)
    assert isinstance(model, RangeModel)
    about = np.array([0.7, -0.4])
    here, step = model.adjusted(about), 0.01
    found = here.sensitivity(links)
    for k, e in enumerate(np.eye(2)):
        ahead, behind = (
            model.adjusted(about + s * step * e).predict(links).travel_time for s in (1, -1)
        )
        # some 1e-3 s² m⁻¹ each; the second difference of a ray that bends leaves 1e-4 of that
        np.testing.assert_allclose(found[:, k], (ahead - behind) / (2 * step), rtol=3e-4, atol=1e-9)
    assert np.abs(found).max() > 1e-4


def test_adjusted_water_is_the_belief_plus_its_modes(links, as_stored):
    model = adjustable()
    there = model.adjusted(np.array([1.0, 2.0]))
    by_hand = water(FRONT + SHAPES[0] + 2.0 * SHAPES[1])
    expected = EigenrayModel(by_hand).predict(links).travel_time
    np.testing.assert_allclose(there.predict(links).travel_time, expected, rtol=1e-14)
    again = there.adjusted(np.array([1.0, 2.0]))
    assert again is there
    back = there.adjusted(np.zeros(2))
    np.testing.assert_array_equal(back.predict(links).travel_time, model.predict(links).travel_time)
    as_stored(there.predict(links))


def test_true_amplitudes_are_those_of_the_water_near_the_fleet(as_stored):
    def local(amplitudes):
        speed = 1450.0 + np.zeros((9, 9, 25)) + amplitudes @ SHAPES
        speed[5:] += 3.0  # elsewhere
        return xr.Dataset(
            {"sound_speed": (("north", "east", "depth"), speed)},
            coords={"north": NORTH, "east": EAST, "depth": DEPTH},
        )

    fleet = trajectories(np.tile([[[-7e3, 0.0, 100.0]]], (2, 4, 1)))
    true, believed = local(np.array([1.5, -0.5])), local(np.array([0.5, 0.25]))
    found = true_amplitudes(adjustable(), true, believed, fleet)
    assert found == pytest.approx({"mode 1": 1.0, "mode 2": -0.75}, abs=1e-9)
    as_stored(found)
