"""Outer iterations: exact in the water they believe, equal to vector factors, gated, and settled or not."""

from dataclasses import replace

import numpy as np
import pytest
from factories import far_from
from oracles import nonlinear_vector_factors

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    ConstantSpeed,
    Estimator,
    GraphSolver,
    MeanSlowness,
    RangeLinks,
    build_graph,
    collect_estimates,
    dead_reckon,
    solve_conditions,
)
from pymantaray.estimation.build import timed_ranges
from pymantaray.estimation.range_models import BelievedRanges
from pymantaray.records import RayStatus, SolveStatus

WATER = MeanSlowness([0.0, 2000.0, 3000.0, 6000.0], [1450.0, 1470.0, 1455.0, 1500.0])


def ranged_in(model, o, position):
    """Measurements as they are in water where the model is right, with the noise that they have."""
    place = np.concatenate([position, np.repeat(o.landmark_position[:, None], o.time.size, axis=1)])
    a, b = (place[end, o.range_sample] for end in (o.range_transmitter, o.range_receiver))
    c = o.transmitter_sound_speed
    time = model.predict(RangeLinks(o.time[o.range_sample], a, b, c)).travel_time
    noise = o.straight_range - np.linalg.norm(a - b, axis=1)
    return replace(o, refracted_range=c * time + noise)


class Reach:
    """The same water in which nothing is heard beyond some distance."""

    def __init__(self, reach):
        self.reach = reach

    def predict(self, links):
        near = np.linalg.norm(links.receiver - links.transmitter, axis=1) <= self.reach
        return WATER.predict(links)._replace(possible=near)


class Moody:
    """Water that changes at every question: in what is possible, or in its travel times."""

    def __init__(self, *, flicker=False, drift=0.0):
        self.flicker, self.drift, self.count = flicker, drift, 0

    def predict(self, links):
        self.count += 1
        found = WATER.predict(links)
        possible = found.possible.copy()
        if self.flicker and self.count % 2:
            possible[:7] = False
        return found._replace(travel_time=found.travel_time + self.drift * self.count, possible=possible)


def estimate(o, model, initial=None, **options):
    return solve_conditions(
        o, [], estimators={"e": Estimator("refracted", "refracted", model, initial=initial, **options)}
    )["e"]


def off(a, b):
    return float(np.abs(a - b).max())


def test_right_model_leads_from_dead_reckoning_to_the_truth(make_fleet):
    fleet = make_fleet(seed=2, gnss_every=10, n_landmarks=2)
    exact = ranged_in(WATER, fleet.noise_free, fleet.position)
    start = dead_reckon(fleet.noisy)
    assert off(start[0], fleet.position) > 20.0
    found = estimate(exact, WATER, start)
    assert found.status == SolveStatus.OK
    assert found.expansions >= 2
    assert off(found.position, fleet.position) < 1e-3
    assert off(found.landmark_position, fleet.noise_free.landmark_position) < 1e-3
    wrong = estimate(exact, ConstantSpeed(1480.0), start)
    assert off(wrong.position, fleet.position) > 1.0


@pytest.mark.parametrize("start", ["truth", "dead-reckoning"])
def test_outer_iterations_and_vector_factors_reach_the_same_optimum(make_fleet, start):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    initial = fleet.truth if start == "truth" else fleet.reckoned
    graph = build_graph(o, "refracted")
    believed = BelievedRanges(WATER, timed_ranges(o, "refracted", "refracted"))
    outer = GraphSolver().solve(graph, initial, believed=believed)
    vector = nonlinear_vector_factors(graph, believed, initial)
    assert outer.status == SolveStatus.OK
    assert off(outer.position, vector.position) < 1e-3
    assert off(outer.landmark_position, vector.landmark_position) < 1e-3
    assert outer.final_cost == pytest.approx(vector.final_cost, rel=1e-6)
    assert outer.initial_cost == pytest.approx(vector.initial_cost, rel=1e-6)


def test_one_constant_speed_in_water_that_has_it_is_the_straight_condition(make_fleet):
    fleet = make_fleet(seed=5, gnss_every=10)
    o = replace(fleet.noisy, transmitter_sound_speed=np.full(fleet.noisy.range_sigma.size, 1480.0))
    o = replace(o, refracted_range=o.straight_range)
    estimators = {"constant": Estimator("refracted", "refracted", ConstantSpeed(1480.0))}
    found = solve_conditions(o, ["straight"], estimators=estimators)
    np.testing.assert_array_equal(found["constant"].position, found["straight"].position)
    assert list(found) == ["straight", "constant"]


def test_constant_speed_as_a_distance_and_as_a_model_agree(make_fleet):
    fleet = make_fleet(seed=6, gnss_every=10)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    model = ConstantSpeed(1460.0)
    asked = GraphSolver().solve(
        build_graph(o, "refracted"),
        fleet.reckoned,
        believed=BelievedRanges(model, timed_ranges(o, "refracted", "refracted")),
        model_is_right=False,
    )
    stock = estimate(o, model)
    assert off(asked.position, stock.position.reshape(-1, 3)) < 1e-3
    assert asked.final_cost == pytest.approx(stock.final_cost, rel=1e-6)


def test_gated_links_are_counted_and_do_as_if_never_measured(make_fleet):
    fleet = make_fleet(seed=7, n_agents=4, gnss_every=10)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    place = fleet.position
    distance = np.linalg.norm(
        place[o.range_transmitter, o.range_sample] - place[o.range_receiver, o.range_sample], axis=1
    )
    ordered = np.sort(distance)
    k = int(np.argmax(np.diff(ordered)[ordered.size // 4 : -5])) + ordered.size // 4
    reach = 0.5 * (ordered[k] + ordered[k + 1])  # in the widest gap, which no estimate crosses
    found = estimate(o, Reach(reach), fleet.start)
    assert found.gated_links == np.count_nonzero(distance > reach) > 0
    assert collect_estimates(o, [{"e": found}]).gated_links.tolist() == [[found.gated_links]]
    without = replace(o, range_status=np.where(distance > reach, RayStatus.SHADOW, o.range_status))
    plain = estimate(without, WATER, fleet.start)
    assert plain.gated_links == 0
    assert off(found.position, plain.position) < 1e-4
    assert found.expected_cost == plain.expected_cost
    assert found.initial_cost == pytest.approx(plain.initial_cost, rel=1e-9)


def test_link_becomes_possible_again_where_the_estimate_has_moved(make_fleet):
    fleet = make_fleet(seed=7, n_agents=4, gnss_every=3)
    o = ranged_in(WATER, fleet.noise_free, fleet.position)
    place = fleet.position
    distance = np.linalg.norm(
        place[o.range_transmitter, o.range_sample] - place[o.range_receiver, o.range_sample], axis=1
    )
    far = fleet.position + 0.2 * (fleet.position - fleet.position.mean(axis=0)) * [1.0, 1.0, 0.0]
    apart = np.linalg.norm(
        far[o.range_transmitter, o.range_sample] - far[o.range_receiver, o.range_sample], axis=1
    )
    reach = float(distance.max()) + 1.0
    assert np.count_nonzero(apart > reach) > 3
    found = estimate(o, Reach(reach), (far, fleet.quaternion))
    assert found.gated_links == 0
    assert off(found.position, fleet.position) < 1e-3
    # links that were not possible at the start count there as they end, which is exactly as measured
    near = replace(o, range_status=np.where(apart > reach, RayStatus.SHADOW, o.range_status))
    of_near = estimate(near, WATER, (far, fleet.quaternion)).initial_cost
    assert found.initial_cost == pytest.approx(of_near, rel=1e-6)


def test_start_far_away_falls_back_on_damping_and_finds_the_same_optimum(make_fleet, damped):
    fleet = make_fleet(seed=3, gnss_every=10)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    near = estimate(o, WATER, fleet.start)
    assert not damped
    far = estimate(o, WATER, far_from(fleet))
    assert damped
    assert near.status == far.status == SolveStatus.OK
    assert off(far.position, near.position) < 1e-3


def test_link_that_comes_and_goes_is_gated_for_good(make_fleet):
    fleet = make_fleet(seed=8, gnss_every=10)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    found = estimate(o, Moody(flicker=True))
    assert found.status == SolveStatus.OK
    assert found.gated_links == 7


def test_model_that_never_settles_is_not_converged(make_fleet):
    fleet = make_fleet(seed=8, gnss_every=10)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    found = estimate(o, Moody(drift=1e-3))
    assert found.status == SolveStatus.NOT_CONVERGED
    assert np.isnan(found.position).all()


class Shared:
    """Every link of an epoch carries one and the same error."""

    def __init__(self, sigma):
        self.sigma = sigma

    def covariances(self, _links, epoch):
        counts = np.bincount(epoch)
        return [np.full((n, n), self.sigma**2) for n in counts]


def test_error_that_all_links_share_costs_little_once_that_is_known(make_fleet):
    fleet = make_fleet(seed=10, n_agents=4, gnss_every=10)
    o = ranged_in(WATER, fleet.noise_free, fleet.position)
    late = 5e-3 * np.sin(o.range_sample)  # s, 7 m; the same for all links of a ping
    o = replace(o, refracted_range=o.refracted_range + o.transmitter_sound_speed * late)
    truth = fleet.position, fleet.quaternion
    naive = estimate(o, WATER, truth)
    known = estimate(o, WATER, truth, uncertainty=Shared(5e-3), correlated=True)
    apart = estimate(o, WATER, truth, uncertainty=Shared(5e-3), correlated=False)
    error = [off(s.position, fleet.position) for s in (known, apart, naive)]
    assert error[0] < 0.5 * error[1]
    assert error[1] < error[2]
    # the cost is the Mahalanobis distance of what was added, less what the poses take up
    assert known.final_cost < 0.01 * naive.final_cost


def test_same_input_gives_the_same_to_the_last_digit(make_fleet):
    fleet = make_fleet(seed=11, gnss_every=10)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    np.testing.assert_array_equal(estimate(o, WATER).position, estimate(o, WATER).position)


def test_bad_requests_are_refused(make_fleet):
    fleet = make_fleet(seed=11)
    o = ranged_in(WATER, fleet.noisy, fleet.position)
    with pytest.raises(EstimationError, match="'straight' has the name of a condition"):
        solve_conditions(o, ["straight"], estimators={"straight": Estimator("refracted", "refracted", WATER)})
    graph = build_graph(o, "refracted")
    ranges = timed_ranges(o, "refracted", "refracted")
    less = ranges._replace(**{name: getattr(ranges, name)[1:] for name in ranges._fields})
    with pytest.raises(EstimationError, match="do not join the variables of the graph's"):
        GraphSolver().solve(graph, fleet.truth, believed=BelievedRanges(WATER, less))
    with pytest.raises(EstimationError, match="sound speed at the transmitter of range 0 is 0 m/s"):
        estimate(replace(o, transmitter_sound_speed=0.0 * o.transmitter_sound_speed), WATER)
