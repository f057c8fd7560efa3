"""Sound-speed modes and clocks as variables: consistent, seen where they can be, at their priors where not."""

from dataclasses import replace

import numpy as np
import pytest
from factories import far_from
from oracles import nonlinear_vector_factors
from scipy import stats

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    AdjustableModel,
    ClockPrior,
    Estimator,
    GraphSolver,
    MeanSlowness,
    Method,
    RangeLinks,
    TransmitterSpeed,
    build_graph,
    solve_conditions,
)
from pymantaray.estimation.build import timed_ranges
from pymantaray.estimation.range_models import BelievedRanges, Unknowns
from pymantaray.records import RangingTruth, SolveStatus
from pymantaray.sensing import Clocks, OneWay, TwoWay
from pymantaray.sensing.timing import clock_error

DEPTH = np.linspace(0.0, 6000.0, 13)
SPEED = 1450.0 + 15.0 * np.cos(DEPTH / 1000.0)
SHAPES = np.stack([np.ones_like(DEPTH), np.cos(DEPTH / 900.0)])
CLOCKS = ClockPrior(offset_sigma=5e-3, skew_sigma=1e-6)
STEP = 1e-3


class Adjustable:
    """Chords through a profile with two shapes of unknown amplitude."""

    def __init__(self, sigma=(3.0, 2.0), amplitudes=(0.0, 0.0)):
        self.amplitude_sigma = np.array(sigma)
        self.amplitudes = np.array(amplitudes, dtype=float)

    def predict(self, links):
        return MeanSlowness(DEPTH, SPEED + self.amplitudes @ SHAPES).predict(links)

    def adjusted(self, amplitudes):
        return Adjustable(self.amplitude_sigma, amplitudes)

    def sensitivity(self, links):
        change = [
            self.adjusted(self.amplitudes + STEP * e).predict(links).travel_time
            - self.adjusted(self.amplitudes - STEP * e).predict(links).travel_time
            for e in np.eye(2)
        ]
        return np.stack(change, axis=1) / (2.0 * STEP)


def measured(o, position, model, clocks=None, timing=None):
    """Measurements as they are in water where the model is right, between clocks, with the noise that they have."""
    place = np.concatenate([position, np.repeat(o.landmark_position[:, None], o.time.size, axis=1)])
    a, b = (place[end, o.range_sample] for end in (o.range_transmitter, o.range_receiver))
    c = o.transmitter_sound_speed
    time = model.predict(RangeLinks(o.time[o.range_sample], a, b, c)).travel_time
    noise = o.straight_range - np.linalg.norm(a - b, axis=1)
    true = RangingTruth(
        distance=np.linalg.norm(a - b, axis=1), sound_speed=c, travel_time=time, chord_travel_time=time
    )
    late = 0.0 if clocks is None else clock_error(o, true, clocks, timing or OneWay())
    return replace(o, refracted_range=c * time + noise + late)


def estimate(o, model, initial=None, **options):
    found = solve_conditions(
        o,
        [],
        estimators={"e": Estimator("refracted", "refracted", model, initial=initial, **options)},
        covariance_samples=np.array([o.time.size - 1]),
    )
    return found["e"]


def of(found, prefix):
    return np.array([name.startswith(prefix) for name in found.unknowns.name])


def off(a, b):
    return float(np.abs(a - b).max())


def test_water_and_clocks_are_found_with_the_poses(make_fleet):
    fleet = make_fleet(seed=2, gnss_every=5, n_landmarks=2)
    clocks = Clocks(offset=[4e-3, -7e-3, 2e-3], skew=[1e-6, -5e-7, 0.0])
    o = measured(fleet.noise_free, fleet.position, Adjustable(amplitudes=(2.5, -1.5)), clocks)
    found = estimate(o, Adjustable(), clocks=CLOCKS)
    u = found.unknowns
    assert found.status == SolveStatus.OK
    assert u.name[:3] == ("mode 1", "mode 2", "clock offset A")
    assert u.unit[:3] == ("m/s", "m/s", "s")
    truth = np.concatenate([[2.5, -1.5], clocks.offset, clocks.skew])
    sigma = np.sqrt(np.diagonal(u.covariance))
    # without noise only the priors are in the way
    assert np.all(np.abs(u.value - truth) < 0.2 * sigma)
    assert np.all(np.abs(u.value - truth)[:5] < 0.1 * np.abs(truth[:5]))
    ignored = estimate(o, Adjustable(sigma=(1e-6, 1e-6)))
    assert off(found.position, fleet.position) < 0.05 * off(ignored.position, fleet.position)


@pytest.mark.parametrize("start", ["truth", "dead-reckoning"])
def test_outer_iterations_and_vector_factors_reach_the_same_optimum(make_fleet, start):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    clocks = Clocks(offset=[4e-3, -7e-3, 2e-3], skew=[1e-6, -5e-7, 0.0])
    o = measured(fleet.noisy, fleet.position, Adjustable(amplitudes=(2.5, -1.5)), clocks)
    initial = fleet.truth if start == "truth" else fleet.reckoned
    graph, timed = build_graph(o, "refracted"), timed_ranges(o, "refracted", "refracted")
    unknowns = Unknowns(Adjustable(), timed, graph.pose_agent, list("ABC"), clocks=CLOCKS)
    believed = BelievedRanges(Adjustable(), timed, unknowns=unknowns)
    outer = GraphSolver().solve(graph, initial, believed=believed)
    vector = nonlinear_vector_factors(graph, believed, initial)
    assert outer.status == SolveStatus.OK
    assert off(outer.position, vector.position) < 1e-3
    assert outer.final_cost == pytest.approx(vector.final_cost, rel=1e-6)
    sigma = outer.unknowns.prior_sigma
    assert off(outer.unknowns.value / sigma, vector.unknowns) < 1e-3
    assert off(outer.unknowns.covariance / sigma[:, None] / sigma, vector.unknowns_covariance) < 1e-3


def test_errors_of_unknowns_and_positions_have_the_covariances_that_are_given(make_fleet):
    rng = np.random.default_rng(0)
    of_unknowns, of_positions, of_ranges = [], [], []
    for seed in range(25):
        fleet = make_fleet(seed=100 + seed, gnss_every=10, n_landmarks=1, n_times=21)
        clocks = Clocks(
            offset=rng.normal(0, CLOCKS.offset_sigma, 3), skew=rng.normal(0, CLOCKS.skew_sigma, 3)
        )
        amplitudes = rng.normal(0, [3.0, 2.0])
        # the landmark of `noisy` is surveyed with an error: ranges are measured from where it is
        o = measured(fleet.noise_free, fleet.position, Adjustable(amplitudes=amplitudes), clocks)
        noise = fleet.noisy.straight_range - fleet.noise_free.straight_range
        o = replace(fleet.noisy, refracted_range=o.refracted_range + noise)
        found = estimate(o, Adjustable(), clocks=CLOCKS)
        u = found.unknowns
        error = (u.value - np.concatenate([amplitudes, clocks.offset, clocks.skew])) / u.prior_sigma
        of_unknowns.append(
            error @ np.linalg.solve(u.covariance / u.prior_sigma[:, None] / u.prior_sigma, error)
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
        offsets = found.unknowns.covariance[np.ix_(of(found, "clock offset"), of(found, "clock offset"))]
        left.append(np.sqrt(common @ offsets @ common) / CLOCKS.offset_sigma)
        apart = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
        assert np.sqrt(apart @ offsets @ apart) < 0.1 * CLOCKS.offset_sigma
    assert left[0] == pytest.approx(1.0, abs=1e-4)
    assert left[1] < 0.1


def test_two_way_ranges_say_nothing_of_offsets(make_fleet):
    fleet = make_fleet(seed=5, gnss_every=5, n_landmarks=1)
    o = measured(fleet.noisy, fleet.position, Adjustable())
    found = estimate(o, Adjustable(), clocks=CLOCKS._replace(turn_around=0.5))
    u = found.unknowns
    offset = of(found, "clock offset")
    np.testing.assert_allclose(np.sqrt(np.diagonal(u.covariance))[offset], CLOCKS.offset_sigma, rtol=1e-9)
    np.testing.assert_allclose(u.value[offset], 0.0, atol=1e-12)


@pytest.mark.parametrize("timing", [OneWay(), TwoWay(turn_around=0.5)], ids=["one-way", "two-way"])
def test_clocks_act_on_predictions_as_they_do_on_measurements(make_fleet, timing):
    fleet = make_fleet(seed=6, n_landmarks=1)
    o = fleet.noise_free
    clocks = Clocks(offset=[4e-3, -7e-3, 2e-3], skew=[1e-6, -5e-7, 3e-7])
    timed = timed_ranges(o, "refracted", "refracted")
    graph = build_graph(o, "refracted")
    prior = CLOCKS._replace(turn_around=getattr(timing, "turn_around", None))
    unknowns = Unknowns(TransmitterSpeed(), timed, graph.pose_agent, list("ABC"), clocks=prior)
    place = np.concatenate([o.first_position[:0], fleet.position.reshape(-1, 3), o.landmark_position])
    links = RangeLinks(timed.time, place[timed.transmitter], place[timed.receiver], timed.sound_speed)
    u = np.concatenate([clocks.offset, clocks.skew]) / unknowns.sigma
    rows = np.arange(timed.time.size)
    right, _ = unknowns.predict(links, rows, 0.0 * u)
    found, by_u = unknowns.predict(links, rows, u)
    time = np.array(right.travel_time)
    true = RangingTruth(
        distance=o.straight_range,
        sound_speed=o.transmitter_sound_speed,
        travel_time=time,
        chord_travel_time=time,
    )
    expected = clock_error(o, true, clocks, timing) / o.transmitter_sound_speed
    np.testing.assert_allclose(found.travel_time - right.travel_time, expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(by_u @ u, expected, rtol=1e-9, atol=1e-15)
    some = np.array([3, 7])
    few = RangeLinks(*(column[some] for column in links))
    np.testing.assert_array_equal(unknowns.predict(few, some, u)[0].travel_time, found.travel_time[some])


def test_start_far_away_falls_back_on_damping_and_finds_the_same_optimum(make_fleet, damped):
    fleet = make_fleet(seed=3, gnss_every=10, n_landmarks=1)
    o = measured(fleet.noisy, fleet.position, Adjustable(amplitudes=(2.5, -1.5)))
    near = estimate(o, Adjustable(), fleet.start, clocks=CLOCKS)
    assert not damped
    far = estimate(o, Adjustable(), far_from(fleet), clocks=CLOCKS)
    assert damped
    assert near.status == far.status == SolveStatus.OK
    assert off(far.position, near.position) < 1e-3
    assert (
        off(far.unknowns.value / far.unknowns.prior_sigma, near.unknowns.value / near.unknowns.prior_sigma)
        < 1e-3
    )


def test_robust_loss_finds_the_water_in_spite_of_outliers(make_fleet):
    fleet = make_fleet(seed=12, gnss_every=5, n_landmarks=2)
    o = measured(fleet.noise_free, fleet.position, Adjustable(amplitudes=(2.5, -1.5)))
    wrong = np.zeros(o.range_status.size)
    wrong[::9] = 200.0
    o = replace(o, refracted_range=o.refracted_range + wrong)
    plain, robust = (
        estimate(o, Adjustable(), fleet.start, method=Method(loss)) for loss in (None, LOSSES["cauchy"])
    )
    assert robust.usable
    sigma = np.sqrt(np.diagonal(robust.unknowns.covariance))
    assert np.all(sigma > np.sqrt(np.diagonal(plain.unknowns.covariance)))  # of outliers it does not count
    assert np.all(np.abs(robust.unknowns.value - [2.5, -1.5]) < 3.0 * sigma)
    assert off(robust.unknowns.value, [2.5, -1.5]) < 0.2
    assert off(plain.unknowns.value, [2.5, -1.5]) > 2.0 * off(robust.unknowns.value, [2.5, -1.5])


def test_clocks_whose_prior_is_zero_are_known(make_fleet):
    fleet = make_fleet(seed=5, gnss_every=5, n_landmarks=1)
    clocks = Clocks(offset=[0.0] * 3, skew=[4e-6, -2e-6, 1e-6])
    o = measured(fleet.noisy, fleet.position, Adjustable(), clocks)
    skews = estimate(o, TransmitterSpeed(), clocks=ClockPrior(0.0, 5e-6)).unknowns
    assert skews.name == ("clock skew A", "clock skew B", "clock skew C")
    offsets = estimate(o, TransmitterSpeed(), clocks=ClockPrior(1e-2, 0.0)).unknowns
    assert offsets.name == ("clock offset A", "clock offset B", "clock offset C")


def test_same_input_gives_the_same_to_the_last_digit(make_fleet):
    fleet = make_fleet(seed=11, gnss_every=10)
    o = measured(fleet.noisy, fleet.position, Adjustable(amplitudes=(1.0, 1.0)))
    a, b = (estimate(o, Adjustable(), clocks=CLOCKS) for _ in range(2))
    np.testing.assert_array_equal(a.position, b.position)
    np.testing.assert_array_equal(a.unknowns.value, b.unknowns.value)


def test_bad_priors_are_refused_by_name(make_fleet):
    fleet = make_fleet(seed=11)
    o = fleet.noisy
    assert isinstance(Adjustable(), AdjustableModel)
    with pytest.raises(EstimationError, match="prior sigma of clock skew A is -1e-08 1; needs a positive"):
        estimate(o, Adjustable(), clocks=ClockPrior(1e-3, -1e-8))
    with pytest.raises(EstimationError, match="prior sigma of mode 2 is nan m/s"):
        estimate(o, Adjustable(sigma=(1.0, np.nan)))
    timed = timed_ranges(o, "refracted", "refracted")
    with pytest.raises(EstimationError, match="neither modes nor clocks"):
        Unknowns(
            TransmitterSpeed(), timed, build_graph(o).pose_agent, list("ABC"), clocks=ClockPrior(0.0, 0.0)
        )


class TwoFamilies(Adjustable):
    """Water in which two links have another first arrival, 20 ms later, as soon as the first amplitude is above a limit."""

    limit = np.inf

    def predict(self, links):
        found = super().predict(links)
        later = found.travel_time.copy()
        later[:2] += 0.02 * (self.amplitudes[0] > self.limit)
        return found._replace(travel_time=later)

    def adjusted(self, amplitudes):
        other = TwoFamilies(self.amplitude_sigma, amplitudes)
        other.limit = self.limit
        return other


def test_links_whose_arrival_comes_and_goes_with_the_water_are_gated(make_fleet):
    fleet = make_fleet(seed=15, gnss_every=5, n_landmarks=1)
    o = measured(fleet.noise_free, fleet.position, Adjustable(amplitudes=(1.0, 0.5)))
    # measured half-way between both arrivals: each pulls the water to where the other one is first
    late = np.where(np.arange(o.range_status.size) < 2, 0.01, 0.0)
    o = replace(o, refracted_range=o.refracted_range + o.transmitter_sound_speed * late)

    def with_limit(limit):
        model = TwoFamilies()
        model.limit = limit
        return estimate(o, model, fleet.start)

    always, never = with_limit(-np.inf), with_limit(np.inf)
    ends = always.unknowns.value[0], never.unknowns.value[0]
    assert ends[0] < ends[1]
    assert never.gated_links == always.gated_links == 0
    found = with_limit(0.5 * (ends[0] + ends[1]))
    assert found.usable
    assert found.gated_links == 2
    assert ends[0] < found.unknowns.value[0] < ends[1]
