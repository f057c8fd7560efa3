"""
Mixtures of candidate rays: gradients, candidates of both timings, and a study whose receivers take
the wrong arrival.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.errors import StudyError
from pymantaray.estimation import MixtureOptions, RangeEndpoints
from pymantaray.range_models.candidate_rays import CandidateRays
from pymantaray.sensing import OneWay, Picker, ReceptionOptions, TwoWay

DEPTH = np.linspace(0.0, 1000.0, 21)
BOUNCED = ReceptionOptions(spreading_cutoff_db=40.0, max_surface_bounces=2, max_bottom_bounces=1)
STEP = 0.5  # m
MULTIPATH = {
    "study": {"realizations": 1},
    "acoustics": {"max_surface_bounces": 2, "max_bottom_bounces": 1},
    "ranging": {"mistaken": "strongest-detected"},
}


@pytest.fixture(scope="module")
def medium():
    speed = 1450.0 + 0.016 * DEPTH + 4.0 * np.exp(-DEPTH / 100.0)
    return Medium.from_profile(DEPTH, speed, bottom_depth=1000.0, interpolation="smooth")


@pytest.fixture(scope="module")
def links():
    rng = np.random.default_rng(5)
    a = rng.uniform([-3e3, -3e3, 100.0], [3e3, 3e3, 900.0], (5, 3))
    b = rng.uniform([-3e3, -3e3, 100.0], [3e3, 3e3, 900.0], (5, 3))
    return RangeEndpoints(np.zeros(5), a, b, np.full(5, 1460.0))


def rays(medium, timing=None, **options):
    return CandidateRays(medium, BOUNCED, timing or OneWay(), MixtureOptions(), **options)


def test_candidates_are_the_eigenrays_of_each_link_by_direction(medium, links, as_stored):
    found = rays(medium).candidates(links)
    as_stored(found)
    back = rays(medium).candidates(
        links._replace(transmitter=links.receiver, receiver=links.transmitter)
    )
    expected = find_eigenrays(
        medium,
        links.transmitter,
        links.receiver,
        max_surface_bounces=2,
        max_bottom_bounces=1,
        spreading_cutoff_db=40.0,
    )
    assert expected.link.size > 4 * links.time.size
    np.testing.assert_array_equal(found.row, expected.link)
    np.testing.assert_allclose(found.travel_time, expected.travel_time, atol=1e-7)
    np.testing.assert_array_equal(found.surface_bounces, expected.surface_bounces)
    np.testing.assert_array_equal(found.bottom_bounces, expected.bottom_bounces)
    np.testing.assert_allclose(back.travel_time, found.travel_time, atol=1e-12)
    np.testing.assert_allclose(back.transmitter_gradient, found.receiver_gradient)


def test_gradients_of_candidates_equal_differences(medium, links):
    model = rays(medium)
    found = model.candidates(links)
    for end, gradient in (
        ("transmitter", found.transmitter_gradient),
        ("receiver", found.receiver_gradient),
    ):
        for axis in np.eye(3):
            ahead, behind = (
                model.candidates(links._replace(**{end: getattr(links, end) + sign * STEP * axis}))
                for sign in (1.0, -1.0)
            )
            np.testing.assert_array_equal(ahead.family, found.family)
            difference = (ahead.travel_time - behind.travel_time) / (2.0 * STEP)
            np.testing.assert_allclose(
                difference, gradient @ axis, atol=3e-8
            )  # of slownesses of 7e-4 s/m


def test_reflected_times_expanded_about_images_follow_the_rays(medium, links):
    model = rays(medium)
    found = model.candidates(links)
    expansion = found_expansion(found, links)
    shift = np.random.default_rng(7).normal(0.0, 20.0, (2, 5, 3))
    moved = links._replace(
        transmitter=links.transmitter + shift[0], receiver=links.receiver + shift[1]
    )
    there = model.candidates(moved)
    np.testing.assert_array_equal(there.family, found.family)
    residual, _, _ = expansion(moved.transmitter[found.row], moved.receiver[found.row], np.empty(0))
    first = 1460.0 * (
        found.travel_time
        + np.sum(found.transmitter_gradient * shift[0][found.row], axis=1)
        + np.sum(found.receiver_gradient * shift[1][found.row], axis=1)
    )
    error, linear = (np.abs(r - 1460.0 * there.travel_time) for r in (residual, first))
    assert linear.max() > 0.2  # m; what the curvature has to explain
    assert error.max() < 0.25 * linear.max()


def found_expansion(found, links):
    from pymantaray.estimation.ranges.expansion import Expansion

    of_candidates = RangeEndpoints(*(column[found.row] for column in links))
    n = found.row.size
    return Expansion(found.prediction, of_candidates, np.zeros(n), np.empty(0), np.empty((n, 0)))


def test_weights_are_those_of_the_receiver_or_equal(medium, links):
    equal, known = (
        rays(medium).candidates(links),
        rays(medium, picker=Picker("strongest-detected")).candidates(links),
    )
    count = np.bincount(equal.row)
    np.testing.assert_allclose(equal.weight, 1.0 / count[equal.row])
    np.testing.assert_allclose(np.bincount(known.row, known.weight), 1.0, atol=1e-12)
    assert np.ptp(known.weight) > 0.05
    heaviest = rays(medium, picker=Picker("strongest-detected")).predict(links)
    for row in range(5):
        mine = np.flatnonzero(known.row == row)
        assert heaviest.travel_time[row] == known.travel_time[mine[np.argmax(known.weight[mine])]]


def test_two_way_candidates_are_all_combinations_of_ping_and_answer(medium, links):
    one, two = (
        rays(medium).candidates(links),
        rays(medium, TwoWay(turn_around=0.2)).candidates(links),
    )
    count = np.bincount(one.row)
    np.testing.assert_array_equal(np.bincount(two.row), count**2)
    for row in range(5):
        times = one.travel_time[one.row == row]
        expected = np.sort(0.5 * (times[:, None] + times).ravel())
        np.testing.assert_allclose(np.sort(two.travel_time[two.row == row]), expected, atol=1e-9)


def test_ocean_error_spreads_travel_times_in_proportion(medium, links):
    found = rays(medium, sound_speed_sigma=0.5).candidates(links)
    np.testing.assert_allclose(found.sigma, 0.5 * found.travel_time / 1460.0)


@pytest.mark.parametrize("extra", [{"loss": "huber"}, {"range_sigma": "fitted"}], ids=str)
def test_mixture_with_a_loss_or_a_fitted_sigma_is_refused(tiny, extra):
    condition = {"name": "m", "range_model": {"kind": "mixture", "belief": "exact"}} | extra
    with pytest.raises(
        StudyError, match=r"remove loss and range_sigma = \"fitted\"|range_sigma \"fitted\" is for"
    ) as caught:
        tiny(conditions=[condition])
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_mixture_keeps_metres_where_direct_arrivals_lose_kilometres(
    run_tiny,
):
    start = {"start": "dead-reckoning"}
    run = run_tiny(
        **MULTIPATH
        | {
            "conditions": [
                {"name": "eigenray", "range_model": {"kind": "eigenray", "belief": "exact"}}
                | start,
                {"name": "mixture", "range_model": {"kind": "mixture", "belief": "exact"}} | start,
            ]
        }
    )
    assert run.manifest["outcome"]["expected_mistaken"] > 0.4 * run.measurements.range_status.size
    pings = np.unique(run.measurements.range_sample)
    error = np.linalg.norm(run.estimates.position - run.truth.position, axis=-1)[..., pings]
    eigenray, mixture = np.sqrt(np.mean(error**2, axis=(1, 2, 3)))
    assert mixture < 2.0  # of sound paths that are longer by up to 10 km
    assert not eigenray < 100.0 * mixture  # NaN if not usable


@pytest.mark.slow
def test_near_the_surface_a_mixture_is_as_good_as_from_the_truth(run_tiny):
    """
    The direct arrival and its surface reflection are metres apart, so some wrong picks fit as well
    as the right ones, also from the truth; 1.9 times the error of straight ranges, with vehicles at
    the surface (theory/mistaken-arrivals).
    """
    mixture = {"range_model": {"kind": "mixture", "belief": "exact"}}
    run = run_tiny(
        **MULTIPATH
        | {"study": {"realizations": 2}}
        | {
            "conditions": [
                "straight",
                {"name": "reckoned", "start": "dead-reckoning"} | mixture,
                {"name": "true-start", "start": "truth"} | mixture,
            ]
        }
    )
    pings = np.unique(run.measurements.range_sample)
    error = np.linalg.norm(run.estimates.position - run.truth.position, axis=-1)[..., pings]
    straight, reckoned, true_start = np.sqrt(np.mean(error**2, axis=(1, 2, 3)))
    assert reckoned == pytest.approx(true_start, rel=0.05)
    assert reckoned < (1.9 + 2 * 0.54) * straight
    cost = run.estimates.final_cost
    assert (cost[1] < cost[2] + 1.0).all()
