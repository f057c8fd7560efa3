"""
Outer iterations, and water and clocks as unknowns: exact where they believe right, equal to vector
factors, consistent, gated.
"""

from dataclasses import replace

import factories
import numpy as np
import pytest
from factories import far_from
from oracles import nonlinear_vector_factors
from scipy import stats

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    ClockPrior,
    ConstantSpeed,
    Estimator,
    GraphSolver,
    MeanSlowness,
    Method,
    RangeEndpoints,
    TransmitterSpeed,
    build_graph,
    collect_estimates,
    dead_reckon,
    solve_conditions,
)
from pymantaray.estimation.graph.build import timed_ranges
from pymantaray.estimation.ranges.range_models import (
    ModelRanges,
    RangeModel,
    RangeUnknowns,
    TravelTimeUncertainty,
)
from pymantaray.records import RangingTruth, RayStatus, SolveStatus
from pymantaray.sensing import Clocks, OneWay, TwoWay
from pymantaray.sensing.timing import clock_error

DEPTH = np.linspace(0.0, 6000.0, 13)
SPEED = 1450.0 + 15.0 * np.cos(DEPTH / 1000.0)
SHAPES = np.stack([np.ones_like(DEPTH), np.cos(DEPTH / 900.0)])
CLOCKS = ClockPrior(offset_sigma=5e-3, skew_sigma=1e-6)
STEP = 1e-3
WATER = MeanSlowness([0.0, 2000.0, 3000.0, 6000.0], [1450.0, 1470.0, 1455.0, 1500.0])


class Adjustable(RangeModel):
    """
    Chords through a profile with two shapes of unknown amplitude.

    Two links have another first arrival, 20 ms later, as soon as the first amplitude is above a
    limit.
    """

    def __init__(self, sigma=(3.0, 2.0), amplitudes=(0.0, 0.0), limit=np.inf):
        self.amplitude_sigma, self.limit = np.array(sigma), limit
        self.amplitudes = np.array(amplitudes, dtype=float)

    def predict(self, links):
        first = MeanSlowness(DEPTH, SPEED + self.amplitudes @ SHAPES).predict(links)
        late = np.where(
            np.arange(links.time.size) < 2, 0.02 * (self.amplitudes[0] > self.limit), 0.0
        )
        return first._replace(travel_time=first.travel_time + late)

    def adjusted(self, amplitudes):
        return Adjustable(self.amplitude_sigma, amplitudes, self.limit)

    def sensitivity(self, links):
        times = [
            [
                self.adjusted(self.amplitudes + step * e).predict(links).travel_time
                for step in (STEP, -STEP)
            ]
            for e in np.eye(2)
        ]
        return np.stack([ahead - behind for ahead, behind in times], axis=1) / (2.0 * STEP)


def measured(o, position, model, clocks=None):
    """
    Measurements as they are in water where the model is right, between clocks, with the noise that
    they have.
    """
    place = np.concatenate([position, np.repeat(o.landmark_position[:, None], o.time.size, axis=1)])
    a, b = (place[end, o.range_sample] for end in (o.range_transmitter, o.range_receiver))
    c, distance = o.transmitter_sound_speed, np.linalg.norm(a - b, axis=1)
    time = model.predict(RangeEndpoints(o.time[o.range_sample], a, b, c)).travel_time
    true = RangingTruth(distance=distance, sound_speed=c, travel_time=time, chord_travel_time=time)
    late = 0.0 if clocks is None else clock_error(o, true, clocks, OneWay())
    return replace(o, refracted_range=c * time + o.straight_range - distance + late)


def estimate(o, model, initial=None, **options):
    e = Estimator("refracted", "refracted", model, initial=initial, **options)
    return solve_conditions(o, {"e": e}, covariance_samples=np.array([o.time.size - 1]))["e"]


class HeardWithin(RangeModel):
    """The same water in which nothing is heard beyond some distance."""

    def __init__(self, reach):
        self.reach = reach

    def predict(self, links):
        near = np.linalg.norm(links.receiver - links.transmitter, axis=1) <= self.reach
        return WATER.predict(links)._replace(possible=near)


def lengths(o, position):
    """Distances between transmitters and receivers that are no landmarks."""
    a, b = (position[end, o.range_sample] for end in (o.range_transmitter, o.range_receiver))
    return np.linalg.norm(a - b, axis=1)


def unheard(o, lost):
    """The same measurements less some links."""
    return replace(o, range_status=np.where(lost, RayStatus.SHADOW, o.range_status))


class Moody(RangeModel):
    """Water that changes at every question: in what is possible, or in its travel times."""

    def __init__(self, *, flicker=False, drift=0.0):
        self.flicker, self.drift, self.count = flicker, drift, 0

    def predict(self, links):
        self.count += 1
        found = WATER.predict(links)
        possible = found.possible.copy()
        if self.flicker and self.count % 2:
            possible[:7] = False
        return found._replace(
            travel_time=found.travel_time + self.drift * self.count, possible=possible
        )


def off(a, b):
    return float(np.abs(a - b).max())


def test_right_model_leads_from_dead_reckoning_to_the_truth(make_fleet):
    fleet = make_fleet(seed=2, gnss_every=10, n_landmarks=2)
    exact = measured(fleet.noise_free, fleet.position, WATER)
    start = dead_reckon(fleet.noisy)
    assert off(start[0], fleet.position) > 20.0
    found = estimate(exact, WATER, start)
    assert found.status == SolveStatus.OK
    assert found.expansions >= 2
    assert off(found.position, fleet.position) < 1e-3
    assert off(found.landmark_position, fleet.noise_free.landmark_position) < 1e-3
    wrong = estimate(exact, ConstantSpeed(1480.0), start)
    assert off(wrong.position, fleet.position) > 1.0


def test_constant_speed_as_a_distance_and_as_a_model_agree(make_fleet):
    fleet = make_fleet(seed=6, gnss_every=10)
    o = measured(fleet.noisy, fleet.position, WATER)
    model = ConstantSpeed(1460.0)
    asked = GraphSolver().solve(
        build_graph(o, "refracted"),
        fleet.reckoned,
        model_ranges=ModelRanges(model, timed_ranges(o, "refracted", "refracted")),
        model_is_right=False,
    )
    stock = estimate(o, model)
    assert off(asked.position, stock.position.reshape(-1, 3)) < 1e-3
    assert asked.final_cost == pytest.approx(stock.final_cost, rel=1e-6)


def test_gated_links_are_counted_and_do_as_if_never_measured(make_fleet):
    fleet = make_fleet(seed=7, n_vehicles=4, gnss_every=10)
    o = measured(fleet.noisy, fleet.position, WATER)
    distance = lengths(o, fleet.position)
    ordered = np.sort(distance)
    k = int(np.argmax(np.diff(ordered)[ordered.size // 4 : -5])) + ordered.size // 4
    reach = 0.5 * (ordered[k] + ordered[k + 1])  # in the widest gap, which no estimate crosses
    found = estimate(o, HeardWithin(reach), fleet.start)
    assert found.gated_links == np.count_nonzero(distance > reach) > 0
    assert collect_estimates(o, [{"e": found}]).gated_links.tolist() == [[found.gated_links]]
    plain = estimate(unheard(o, distance > reach), WATER, fleet.start)
    assert plain.gated_links == 0
    assert off(found.position, plain.position) < 1e-4
    assert found.expected_cost == plain.expected_cost
    assert found.initial_cost == pytest.approx(plain.initial_cost, rel=1e-9)


def test_link_becomes_possible_again_where_the_estimate_has_moved(make_fleet):
    fleet = make_fleet(seed=7, n_vehicles=4, gnss_every=3)
    o = measured(fleet.noise_free, fleet.position, WATER)
    far = fleet.position + 0.2 * (fleet.position - fleet.position.mean(axis=0)) * [1.0, 1.0, 0.0]
    apart = lengths(o, far)
    reach = float(lengths(o, fleet.position).max()) + 1.0
    assert np.count_nonzero(apart > reach) > 3
    found = estimate(o, HeardWithin(reach), (far, fleet.quaternion))
    assert found.gated_links == 0
    assert off(found.position, fleet.position) < 1e-3
    # links that were not possible at the start count there as they end, which is exactly as
    # measured
    of_near = estimate(unheard(o, apart > reach), WATER, (far, fleet.quaternion)).initial_cost
    assert found.initial_cost == pytest.approx(of_near, rel=1e-6)


def test_an_unsteady_link_is_gated_and_a_restless_model_not_converged(
    make_fleet,
):
    fleet = make_fleet(seed=8, gnss_every=10)
    o = measured(fleet.noisy, fleet.position, WATER)
    flickered = estimate(o, Moody(flicker=True))
    assert (flickered.status, flickered.gated_links) == (SolveStatus.OK, 7)
    drifted = estimate(o, Moody(drift=1e-3))
    assert drifted.status == SolveStatus.NOT_CONVERGED
    assert np.isnan(drifted.position).all()


class Shared(TravelTimeUncertainty):
    """Every link of an epoch carries one and the same error."""

    def __init__(self, sigma):
        self.sigma = sigma

    def covariances(self, _links, epoch):
        return [np.full((n, n), self.sigma**2) for n in np.bincount(epoch)]


def test_error_that_all_links_share_costs_little_once_that_is_known(make_fleet):
    fleet = make_fleet(seed=10, n_vehicles=4, gnss_every=10)
    o = measured(fleet.noise_free, fleet.position, WATER)
    late = 5e-3 * np.sin(o.range_sample)  # s, 7 m; the same for all links of a ping
    o = replace(o, refracted_range=o.refracted_range + o.transmitter_sound_speed * late)
    naive = estimate(o, WATER, fleet.start)
    known, apart = (
        estimate(o, WATER, fleet.start, uncertainty=Shared(5e-3), correlated=c)
        for c in (True, False)
    )
    error = [off(s.position, fleet.position) for s in (known, apart, naive)]
    assert error[0] < 0.5 * error[1]
    assert error[1] < error[2]
    # the cost is the Mahalanobis distance of what was added, less what the poses take up
    assert known.final_cost < 0.01 * naive.final_cost


def test_bad_requests_are_refused(make_fleet):
    fleet = make_fleet(seed=11)
    o = measured(fleet.noisy, fleet.position, WATER)
    graph = build_graph(o, "refracted")
    ranges = timed_ranges(o, "refracted", "refracted")
    less = ranges._replace(**{name: getattr(ranges, name)[1:] for name in ranges._fields})
    with pytest.raises(EstimationError, match="do not join the variables of the graph's"):
        GraphSolver().solve(graph, fleet.truth, model_ranges=ModelRanges(WATER, less))
    with pytest.raises(EstimationError, match="sound speed at the transmitter of range 0 is 0 m/s"):
        estimate(replace(o, transmitter_sound_speed=0.0 * o.transmitter_sound_speed), WATER)


BOTH = pytest.mark.parametrize("joint", [False, True], ids=["water", "water and clocks"])
MIXED = Clocks(offset=[4e-3, -7e-3, 2e-3], skew=[1e-6, -5e-7, 0.0])


def known_or_joint(fleet, joint):
    """
    Measurements, the model that is believed, and the clocks' prior; with unknowns or without any.
    """
    if not joint:
        return measured(fleet.noisy, fleet.position, WATER), WATER, None
    true = Adjustable(amplitudes=(2.5, -1.5))
    return measured(fleet.noisy, fleet.position, true, MIXED), Adjustable(), CLOCKS


@BOTH
@pytest.mark.parametrize("start", ["truth", "reckoned"])
def test_outer_iterations_and_vector_factors_reach_the_same_optimum(make_fleet, start, joint):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    o, model, clocks = known_or_joint(fleet, joint)
    graph, timed = build_graph(o, "refracted"), timed_ranges(o, "refracted", "refracted")
    unknowns = (
        RangeUnknowns(model, timed, graph.pose_vehicle, list("ABC"), clocks=clocks)
        if joint
        else None
    )
    believed = ModelRanges(model, timed, unknowns=unknowns)
    outer = GraphSolver().solve(graph, getattr(fleet, start), model_ranges=believed)
    vector = nonlinear_vector_factors(graph, believed, getattr(fleet, start))
    assert outer.status == SolveStatus.OK
    assert off(outer.position, vector.position) < 1e-3
    assert off(outer.landmark_position, vector.landmark_position) < 1e-3
    assert outer.final_cost == pytest.approx(vector.final_cost, rel=1e-6)
    if joint:
        sigma = outer.unknowns.prior_sigma
        assert off(outer.unknowns.value / sigma, vector.unknowns) < 1e-3
        assert (
            off(outer.unknowns.covariance / sigma[:, None] / sigma, vector.unknowns_covariance)
            < 1e-3
        )
    else:
        assert outer.initial_cost == pytest.approx(vector.initial_cost, rel=1e-6)


@BOTH
def test_a_start_far_away_is_damped_to_the_same_optimum(make_fleet, damped, joint):
    fleet = make_fleet(seed=3, gnss_every=10, n_landmarks=1)
    o, model, clocks = known_or_joint(fleet, joint)
    near = estimate(o, model, fleet.start, clocks=clocks)
    assert not damped
    far = estimate(o, model, far_from(fleet, 9), clocks=clocks)
    assert damped
    assert near.status == far.status == SolveStatus.OK
    assert off(far.position, near.position) < 1e-3
    if joint:
        assert (
            off((far.unknowns.value - near.unknowns.value) / far.unknowns.prior_sigma, 0.0) < 1e-3
        )


def test_errors_have_the_covariances_that_are_given(make_fleet):
    rng = np.random.default_rng(0)
    of_unknowns, of_positions, of_ranges = [], [], []
    for seed in range(16):
        fleet = make_fleet(seed=100 + seed, gnss_every=10, n_landmarks=1, n_times=21)
        clocks = Clocks(*(rng.normal(0, sigma, 3) for sigma in CLOCKS[:2]))
        amplitudes = rng.normal(0, [3.0, 2.0])
        # the landmark of `noisy` is surveyed with an error: ranges are measured from where it is
        o = measured(fleet.noise_free, fleet.position, Adjustable(amplitudes=amplitudes), clocks)
        noise = fleet.noisy.straight_range - fleet.noise_free.straight_range
        o = replace(fleet.noisy, refracted_range=o.refracted_range + noise)
        found = estimate(o, Adjustable(), clocks=CLOCKS)
        u = found.unknowns
        assert (u.name[:3], u.unit[:3]) == (
            ("mode 1", "mode 2", "clock offset A"),
            ("m/s", "m/s", "s"),
        )
        error = (u.value - np.concatenate([amplitudes, clocks.offset, clocks.skew])) / u.prior_sigma
        of_unknowns.append(
            error @ np.linalg.solve(u.covariance / np.outer(u.prior_sigma, u.prior_sigma), error)
        )
        e = (found.position - fleet.position)[:, -1].ravel()
        of_positions.append(e @ np.linalg.solve(found.covariances.position[0].reshape(9, 9), e))
        of_ranges.append((found.covariances.range_nis[0], found.covariances.range_dimension[0]))
    for values, dimension in ((of_unknowns, 8), (of_positions, 9)):
        low, high = stats.chi2.ppf([0.005, 0.995], dimension * len(values))
        assert low < sum(values) < high
    nis, dimension = np.sum(of_ranges, axis=0)
    low, high = stats.chi2.ppf([0.005, 0.995], dimension)
    assert low < nis < high


def test_time_that_all_clocks_share_is_seen_only_against_a_landmark(make_fleet):
    common = np.full(3, 1.0 / np.sqrt(3.0))
    left = []
    for n_landmarks in (0, 1):
        fleet = make_fleet(seed=5, gnss_every=5, n_landmarks=n_landmarks)
        o = measured(fleet.noisy, fleet.position, Adjustable())
        found = estimate(o, Adjustable(), clocks=CLOCKS)
        offsets = found.unknowns.covariance[2:5, 2:5]
        left.append(np.sqrt(common @ offsets @ common) / CLOCKS.offset_sigma)
        apart = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
        assert np.sqrt(apart @ offsets @ apart) < 0.1 * CLOCKS.offset_sigma
    assert left[0] == pytest.approx(1.0, abs=1e-4)
    assert left[1] < 0.1


def test_two_way_ranges_say_nothing_of_offsets(make_fleet):
    fleet = make_fleet(seed=5, gnss_every=5, n_landmarks=1)
    o = measured(fleet.noisy, fleet.position, Adjustable())
    u = estimate(o, Adjustable(), clocks=CLOCKS._replace(turn_around=0.5)).unknowns
    sigma = np.sqrt(np.diagonal(u.covariance))
    np.testing.assert_allclose(sigma[2:5], CLOCKS.offset_sigma, rtol=1e-9)
    np.testing.assert_allclose(u.value[2:5], 0.0, atol=1e-12)


@pytest.mark.parametrize("timing", [OneWay(), TwoWay(turn_around=0.5)], ids=["one-way", "two-way"])
def test_clocks_act_on_predictions_as_they_do_on_measurements(make_fleet, timing):
    fleet = make_fleet(seed=6, n_landmarks=1)
    o = fleet.noise_free
    clocks = Clocks(offset=[4e-3, -7e-3, 2e-3], skew=[1e-6, -5e-7, 3e-7])
    timed, graph = timed_ranges(o, "refracted", "refracted"), build_graph(o, "refracted")
    prior = CLOCKS._replace(turn_around=getattr(timing, "turn_around", None))
    unknowns = RangeUnknowns(
        TransmitterSpeed(), timed, graph.pose_vehicle, list("ABC"), clocks=prior
    )
    place = np.concatenate([fleet.position.reshape(-1, 3), o.landmark_position])
    links = timed.links(place[timed.transmitter], place[timed.receiver])
    u = np.concatenate([clocks.offset, clocks.skew]) / unknowns.sigma
    rows = np.arange(timed.time.size)
    right, found = (unknowns.predict(links, rows, v)[0].travel_time for v in (0.0 * u, u))
    true = RangingTruth(
        o.straight_range, o.transmitter_sound_speed, np.array(right), np.array(right)
    )
    expected = clock_error(o, true, clocks, timing) / o.transmitter_sound_speed
    np.testing.assert_allclose(found - right, expected, rtol=1e-9, atol=1e-15)
    by_u = unknowns.predict(links, rows, u)[1]
    np.testing.assert_allclose(by_u @ u, expected, rtol=1e-9, atol=1e-15)


def test_robust_loss_finds_the_water_in_spite_of_outliers(make_fleet):
    fleet = make_fleet(seed=12, gnss_every=5, n_landmarks=2)
    o = measured(fleet.noise_free, fleet.position, Adjustable(amplitudes=(2.5, -1.5)))
    o = replace(
        o,
        refracted_range=o.refracted_range
        + np.where(np.arange(o.range_status.size) % 9, 0.0, 200.0),
    )
    plain, robust = (
        estimate(o, Adjustable(), fleet.start, method=Method(loss))
        for loss in (None, LOSSES["cauchy"])
    )
    assert robust.usable
    sigma = np.sqrt(np.diagonal(robust.unknowns.covariance))
    assert np.all(
        sigma > np.sqrt(np.diagonal(plain.unknowns.covariance))
    )  # of outliers it does not count
    assert np.all(np.abs(robust.unknowns.value - [2.5, -1.5]) < 3.0 * sigma)
    assert off(robust.unknowns.value, [2.5, -1.5]) < 0.2
    assert off(plain.unknowns.value, [2.5, -1.5]) > 2.0 * off(robust.unknowns.value, [2.5, -1.5])


def test_clocks_whose_prior_is_zero_are_known(make_fleet):
    fleet = make_fleet(seed=5, gnss_every=5, n_landmarks=1)
    clocks = Clocks(offset=[0.0] * 3, skew=[4e-6, -2e-6, 1e-6])
    o = measured(fleet.noisy, fleet.position, Adjustable(), clocks)
    for prior, what in ((ClockPrior(0.0, 5e-6), "skew"), (ClockPrior(1e-2, 0.0), "offset")):
        names = estimate(o, TransmitterSpeed(), clocks=prior).unknowns.name
        assert names == tuple(f"clock {what} {vehicle}" for vehicle in "ABC")


def test_a_shared_factor_and_biases_of_pairs_are_estimated(make_fleet):
    fleet = make_fleet(seed=5, gnss_every=5, n_landmarks=2)
    o = fleet.noise_free
    pair = o.range_transmitter * 100 + o.range_receiver
    code, which = np.unique(pair, return_inverse=True)
    bias = np.linspace(-30.0, 30.0, code.size)[which]
    long = 1.02 * o.straight_range + bias
    there = estimate(
        replace(o, refracted_range=long), TransmitterSpeed(), scale_sigma=0.1, bias_sigma=100.0
    )
    assert off(there.position, fleet.position) < 0.5, "priors pull a little"
    assert there.unknowns.name == ("scale",)
    sigma = np.sqrt(there.unknowns.covariance[0, 0])
    assert abs(there.unknowns.value[0] - 0.02) < 3.0 * sigma < 0.03
    exact = replace(o, refracted_range=1.02 * o.straight_range)
    scaled = estimate(exact, TransmitterSpeed(), scale_sigma=10.0)
    assert off(scaled.position, fleet.position) < 1e-3
    assert scaled.unknowns.value[0] == pytest.approx(0.02, abs=1e-6)
    alone = estimate(exact, TransmitterSpeed(), bias_sigma=100.0)
    assert alone.unknowns is None, "biases are not told"
    with pytest.raises(EstimationError, match="prior sigma of a bias is -1 m"):
        estimate(exact, TransmitterSpeed(), bias_sigma=-1.0)


def test_both_directions_of_a_pair_take_their_mean_and_its_variance(make_fleet):
    fleet = make_fleet(seed=5, gnss_every=5, dropouts=0.2)
    o = fleet.noise_free
    later = np.where(o.range_transmitter < o.range_receiver, 40.0, -40.0)
    ends = np.sort(np.stack([o.range_transmitter, o.range_receiver]), axis=0)
    key = o.range_sample * 100 + ends[0] * 10 + ends[1]
    heard = np.isfinite(o.refracted_range)
    both = np.bincount(key[heard], minlength=key.max() + 1)[key] == 2
    o = replace(
        o, refracted_range=o.straight_range + np.where(both, later, 0.0) + 0.0 * o.refracted_range
    )
    plain, mean = (
        solve_conditions(o, {"e": Estimator("refracted", mean_of_directions=a)})["e"]
        for a in (False, True)
    )
    assert off(mean.position, fleet.position) < 1e-3
    assert mean.final_cost < 1e-6 < plain.final_cost
    samples = {"covariance_samples": np.array([20])}
    straight = solve_conditions(fleet.noise_free, ["straight"], fleet.start, **samples)[
        "straight"
    ].covariances
    own = solve_conditions(o, {"e": Estimator("refracted", mean_of_directions=True)}, **samples)[
        "e"
    ].covariances
    np.testing.assert_allclose(own.position, straight.position, rtol=1e-3, atol=1e-6)


def test_a_fitted_sigma_meets_the_expected_cost(
    make_fleet,
):
    fleet = make_fleet(seed=7, gnss_every=10)
    o, rng = fleet.noisy, np.random.default_rng(1)
    wild = replace(
        o, refracted_range=o.straight_range + 25.0 * rng.standard_normal(o.range_sigma.size)
    )
    wide = replace(wild, range_sigma=np.full_like(o.range_sigma, 10.0))
    one = solve_conditions(wild, {"e": Estimator("refracted", range_sigma=10.0)})["e"]
    other = solve_conditions(wide, ["refracted"])["refracted"]
    np.testing.assert_array_equal(one.position, other.position)
    fitted = solve_conditions(wild, {"e": Estimator("refracted", range_sigma="fitted")})["e"]
    assert fitted.final_cost == pytest.approx(fitted.expected_cost, rel=1e-2)
    n = o.range_sigma.size
    assert fitted.unknowns.value[0] == pytest.approx(25.0, rel=5.0 / np.sqrt(2.0 * n))
    honest = solve_conditions(o, {"e": Estimator("straight", range_sigma="fitted")})["e"]
    assert 1.0 <= honest.unknowns.value[0] < 1.2, "no smaller than it is measured with"


def test_a_sigma_is_fitted_with_other_unknowns_too(make_fleet):
    fleet = make_fleet(seed=7, gnss_every=10)
    o, rng = fleet.noise_free, np.random.default_rng(1)
    noisy = 1.03 * o.straight_range + 25.0 * rng.standard_normal(o.range_sigma.size)
    wild = replace(factories.add_noise(o, 4), refracted_range=noisy)
    both = Estimator("refracted", model=TransmitterSpeed(), range_sigma="fitted", scale_sigma=0.1)
    end = solve_conditions(wild, {"e": both})["e"]
    assert end.final_cost == pytest.approx(end.expected_cost, rel=1e-2)
    assert end.unknowns.name == ("range sigma", "scale")
    sigma, scale = end.unknowns.value
    assert sigma == pytest.approx(25.0, rel=5.0 / np.sqrt(2.0 * o.range_sigma.size))
    assert scale == pytest.approx(0.03, abs=4.0 * np.sqrt(end.unknowns.covariance[1, 1]))
    assert np.isnan(end.unknowns.covariance[0]).all()
    biased = replace(both, scale_sigma=None, bias_sigma=50.0)
    end = solve_conditions(wild, {"e": biased})["e"]
    assert end.final_cost == pytest.approx(end.expected_cost, rel=1e-2)
    assert end.unknowns.name == ("range sigma",)


def test_a_fit_begins_with_the_solution_without_a_fit(make_fleet):
    fleet = make_fleet(seed=7, gnss_every=10)
    o, rng = fleet.noisy, np.random.default_rng(1)
    wild = replace(
        o, refracted_range=o.straight_range + 25.0 * rng.standard_normal(o.range_sigma.size)
    )

    class CountingSolver(GraphSolver):
        count = 0

        def solve(self, *arguments, **options):
            self.count += 1
            return super().solve(*arguments, **options)

    model = TransmitterSpeed()
    for plain in (
        Estimator("refracted"),
        Estimator("refracted", model=model, scale_sigma=0.1, mean_of_directions=True),
        Estimator("refracted", model=model, initial=(fleet.truth.position, fleet.truth.quaternion)),
    ):
        fitted = replace(plain, range_sigma="fitted")
        other = replace(plain, range_sigma=3.0)
        alone, together = CountingSolver(), CountingSolver()
        one = solve_conditions(wild, {"fitted": fitted}, solver=alone)
        one |= solve_conditions(wild, {"plain": plain}, solver=alone)
        one |= solve_conditions(wild, {"other": other}, solver=alone)
        both = solve_conditions(
            wild, {"plain": plain, "other": other, "fitted": fitted}, solver=together
        )
        # from dead reckoning, both calls without a fit also solve the graph without ranges
        saved = 1 if plain.initial else 2
        assert together.count == alone.count - saved
        for name, solution in one.items():
            np.testing.assert_array_equal(both[name].position, solution.position, err_msg=name)
            assert both[name].final_cost == solution.final_cost


def test_a_sigma_that_no_cost_can_meet_is_not_fitted(make_fleet):
    fleet = make_fleet(seed=7, gnss_every=10)
    wrong = replace(
        fleet.noisy, depth=fleet.noisy.depth + 5.0 * np.sin(np.arange(fleet.noisy.depth.shape[1]))
    )
    fitted, plain = (
        solve_conditions(wrong, {"e": Estimator("refracted", range_sigma=sigma)})["e"]
        for sigma in ("fitted", None)
    )
    assert fitted.unknowns is None
    np.testing.assert_allclose(fitted.position, plain.position, rtol=0, atol=1e-3)


def test_bad_priors_are_refused_by_name(make_fleet):
    fleet = make_fleet(seed=11)
    o = fleet.noisy
    with pytest.raises(
        EstimationError, match="prior sigma of clock skew A is -1e-08 1; it must be positive"
    ):
        estimate(o, Adjustable(), clocks=ClockPrior(1e-3, -1e-8))
    with pytest.raises(EstimationError, match="prior sigma of mode 2 is nan m/s"):
        estimate(o, Adjustable(sigma=(1.0, np.nan)))
    with pytest.raises(EstimationError, match="neither modes, scale, clocks nor biases"):
        estimate(o, TransmitterSpeed(), clocks=ClockPrior(0.0, 0.0))


def test_links_whose_arrival_comes_and_goes_with_the_water_are_gated(make_fleet):
    fleet = make_fleet(seed=15, gnss_every=5, n_landmarks=1)
    o = measured(fleet.noise_free, fleet.position, Adjustable(amplitudes=(1.0, 0.5)))
    # measured half-way between both arrivals: each pulls the water to where the other one is first
    late = np.where(np.arange(o.range_status.size) < 2, 0.01, 0.0)
    o = replace(o, refracted_range=o.refracted_range + o.transmitter_sound_speed * late)

    always, never = (
        estimate(o, Adjustable(limit=limit), fleet.start) for limit in (-np.inf, np.inf)
    )
    ends = always.unknowns.value[0], never.unknowns.value[0]
    assert ends[0] < ends[1]
    assert never.gated_links == always.gated_links == 0
    found = estimate(o, Adjustable(limit=0.5 * (ends[0] + ends[1])), fleet.start)
    assert found.usable
    assert found.gated_links == 2
    assert ends[0] < found.unknowns.value[0] < ends[1]
