"""
Arrivals taken for the direct one: with what probability, by which draw, and what the range becomes.
"""

from dataclasses import replace

import numpy as np
import pytest
from factories import HIDDEN, assert_same, range_fleet, ridged
from hypothesis import given, settings, strategies as st
from refusals import refused
from scipy.stats import norm

from pymantaray.acoustics import Currents, Medium, Sonar
from pymantaray.errors import SensingError
from pymantaray.records import RayStatus
from pymantaray.sensing import (
    Candidates,
    ClockModel,
    Detector,
    NoiseModel,
    OneWay,
    Picker,
    TwoWay,
    assemble,
    draw_picks,
    find_candidates,
    perturb,
)
from pymantaray.sensing.picking import range_on_picks
from pymantaray.sensing.schedule import chances

C = 1480.0
BOUNCES = {"max_surface_bounces": 1, "max_bottom_bounces": 1}
ONE_WAY = OneWay()
CURRENT = Currents.uniform(0.3, -0.4)
RIDGED = ridged(speed=C)


def sonar(source_level_db, spread_db=6.0):
    """Figure of merit: the source level less 100 dB."""
    return Sonar(
        source_level_db=source_level_db,
        frequency_hz=25e3,
        bandwidth_hz=1e3,
        noise=60.0,
        spread_db=spread_db,
    )


CERTAIN = Picker("first-detected", sonar(400.0))
RULES = ("first-detected", "strongest-detected")
BARE = Picker("first-detected", below_strongest_db=6.0), Picker("strongest-detected")
# in steps of 2^-10 dB, so that 30 dB more leaves the differences as they are
losses = st.lists(
    st.integers(40 << 10, 120 << 10).map(lambda n: n / 1024.0), min_size=1, max_size=6
)


@given(losses, st.sampled_from([*BARE, *(Picker(rule, sonar(180.0)) for rule in RULES)]))
@settings(max_examples=60)
def test_something_is_taken_unless_nothing_is_heard(loss, picker):
    """Without a sonar something always is, and only relative levels count."""
    link, time = np.zeros(len(loss)), np.arange(len(loss))
    taken = picker.probabilities(loss, link, time)
    assert (taken >= 0.0).all()
    missed = (
        0.0 if picker.sonar is None else np.prod(1.0 - picker.sonar.detection_probability(loss))
    )
    assert taken.sum() == pytest.approx(1.0 - missed, abs=1e-9)
    if picker.sonar is None:
        louder = picker.probabilities(np.add(loss, 30.0), link, time)
        np.testing.assert_allclose(louder, taken, rtol=0, atol=1e-9)


def test_of_two_arrivals_both_rules_are_closed_forms():
    time = [0.0, 1.0]
    loud = Picker("strongest-detected").probabilities([70.0, 67.0], [0, 0], time)
    np.testing.assert_allclose(
        loud, norm.cdf([-3.0 / np.sqrt(72.0), 3.0 / np.sqrt(72.0)]), rtol=1e-9
    )
    modem = sonar(170.0)
    p = norm.cdf([0.0, 0.5])
    first = Picker("first-detected", modem).probabilities([70.0, 67.0], [0, 0], time)
    np.testing.assert_allclose(first, [p[0], (1.0 - p[0]) * p[1]], rtol=1e-9)
    bare = Picker("first-detected", below_strongest_db=3.0).probabilities(
        [70.0, 67.0], [0, 0], time
    )
    none = (1.0 - p[0]) * (1.0 - p[1])  # then the stronger is taken
    np.testing.assert_allclose(bare, [p[0], (1.0 - p[0]) * p[1] + none], rtol=1e-9)


@pytest.mark.parametrize("rule", RULES)
def test_probabilities_are_shares_of_simulated_receptions(rule):
    """Levels drawn one by one, and the receiver's rule applied to each ping."""
    loss, n = np.array([75.0, 66.0, 72.0, 69.0]), 40000
    modem = sonar(168.0)
    level = modem.figure_of_merit_db - loss + 6.0 * np.random.default_rng(5).standard_normal((n, 4))
    heard = level > 0.0
    pick = np.argmax(heard, axis=1) if rule == "first-detected" else np.argmax(level, axis=1)
    share = np.bincount(pick[heard.any(axis=1)], minlength=4) / n
    p = Picker(rule, modem).probabilities(loss, np.zeros(4), np.arange(4))
    assert (np.abs(share - p) < 4.0 * np.sqrt(p * (1.0 - p) / n)).all()


def test_links_do_not_mix_and_the_order_of_rows_does_not_matter():
    rng = np.random.default_rng(2)
    link, loss, time = np.repeat([7, 3, 90], [3, 1, 4]), rng.uniform(60, 80, 8), rng.random(8)
    shuffled = rng.permutation(8)
    for picker in (CERTAIN, *BARE):
        whole = picker.probabilities(loss, link, time)
        again = picker.probabilities(loss[shuffled], link[shuffled], time[shuffled])
        np.testing.assert_allclose(again, whole[shuffled], rtol=0, atol=1e-14)
        for one in np.unique(link):
            rows = link == one
            alone = picker.probabilities(loss[rows], link[rows], time[rows])
            np.testing.assert_allclose(alone, whole[rows], rtol=0, atol=1e-14)


def test_without_spread_the_picks_are_certain():
    loss, time = [90.0, 70.0, 60.0, 60.0, np.nan], [0.0, 1.0, 2.0, 3.0, -1.0]
    step = sonar(175.0, spread_db=0.0)
    first = Picker("first-detected", step).probabilities(loss, np.zeros(5), time)
    np.testing.assert_array_equal(first, [0, 1, 0, 0, 0])
    strongest = Picker("strongest-detected", step).probabilities(loss, np.zeros(5), time)
    np.testing.assert_array_equal(strongest, [0, 0, 1, 0, 0])
    deaf = Picker("strongest-detected", sonar(150.0, spread_db=0.0))
    assert not deaf.probabilities(loss, np.zeros(5), time).any()


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth("ABC")


def mission(truth, water, picker, timing=ONE_WAY, **options):
    """Noise-free measurements and candidates; the picker's sonar is the detector's."""
    detector = None if picker.sonar is None else Detector(picker.sonar)
    ranging = range_fleet(
        truth, [HIDDEN], water, timing=timing, detector=detector, **BOUNCES, **options
    )
    measurements = assemble(truth, [HIDDEN], ranging, NoiseModel())
    return ranging, measurements, find_candidates(ranging, truth, picker, timing=timing)


@pytest.mark.parametrize("currents", [None, CURRENT])
@pytest.mark.parametrize("timing", [ONE_WAY, TwoWay(1.5)])
def test_with_certain_detection_the_first_arrival_is_always_taken(truth, timing, currents):
    """The same as ranging on the first of all arrivals, hidden links by their bounce included."""
    _, o, candidates = mission(truth, RIDGED, CERTAIN, timing, currents=currents)
    rows = draw_picks(o, candidates, root_seed=1, realization=0)
    taken = range_on_picks(o, candidates, rows)
    first = range_fleet(
        truth, [HIDDEN], RIDGED, timing=timing, arrival="first", currents=currents, **BOUNCES
    )
    assert (first.status != o.range_status).any()
    np.testing.assert_array_equal(taken.range_status, first.status)
    time = np.append(candidates.travel_time, np.nan)[rows]
    np.testing.assert_allclose(time, first.truth.travel_time, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        taken.refracted_range, first.truth.refracted_range, rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(taken.straight_range, o.straight_range)


@pytest.mark.parametrize("timing", [ONE_WAY, TwoWay(1.5)])
def test_where_mistakes_have_probability_zero_all_is_as_without_them(truth, timing):
    ranging, o, candidates = mission(truth, RIDGED, Picker("strongest-detected"), timing)
    certain = replace(candidates, probability=candidates.direct)
    options = {"timing": timing, "clocks": ClockModel(1e-3, 1e-6), "ranging_truth": ranging.truth}
    one, other = (
        perturb(o, root_seed=1, realization=2, **options, detection=c) for c in (certain, None)
    )
    assert_same(one, other)
    assert certain.expected_mistaken == 0.0
    assert candidates.expected_mistaken > 1.0


@pytest.mark.parametrize("timing", [ONE_WAY, TwoWay(1.5)])
def test_without_other_arrivals_the_outcome_is_that_of_detection(truth, timing):
    water = Medium.from_profile([0.0, 4000.0], [C, C], bottom_depth=3000.0, interpolation="linear")
    modem = sonar(170.0)
    ranging = range_fleet(truth, [HIDDEN], water, timing=timing, detector=Detector(modem))
    o = assemble(truth, [HIDDEN], ranging, NoiseModel())
    candidates = find_candidates(ranging, truth, Picker("first-detected", modem), timing=timing)
    options = {"root_seed": 3, "realization": 1, "timing": timing}
    plain = perturb(o, **options, detection=ranging.probability)
    assert {RayStatus.OK, RayStatus.UNHEARD} == set(plain.range_status)
    assert_same(perturb(o, **options, detection=candidates), plain)


def test_mistakes_come_in_the_place_of_what_was_not_heard(truth):
    """In water of constant sound speed the direct arrival is the first: heard is heard."""
    ranging, o, candidates = mission(truth, RIDGED, Picker("first-detected", sonar(168.0)))
    gained = 0
    for realization in range(20):
        without = perturb(o, root_seed=3, realization=realization, detection=ranging.probability)
        with_them = perturb(o, root_seed=3, realization=realization, detection=candidates)
        heard = without.range_status == RayStatus.OK
        np.testing.assert_array_equal(
            with_them.refracted_range[heard], without.refracted_range[heard]
        )
        more = ~heard & (with_them.range_status == RayStatus.OK)
        longer = with_them.refracted_range[more] - with_them.straight_range[more]
        assert (longer > 20.0).all()  # they have bounced
        gained += more.sum()
    assert gained > 50


@pytest.mark.parametrize("timing", [ONE_WAY, TwoWay(1.5)])
def test_each_candidate_is_taken_as_often_as_its_probability_says(truth, timing):
    _, o, candidates = mission(truth, RIDGED, Picker("first-detected", sonar(170.0)), timing)
    n = 200
    taken = np.concatenate(
        [draw_picks(o, candidates, root_seed=9, realization=r) for r in range(n)]
    )
    count = np.bincount(taken[taken >= 0], minlength=candidates.attempt.size)
    p = candidates.probability
    assert (np.abs(count - n * p) < 5.0 * np.sqrt(n * p * (1.0 - p)) + 1.0).all()
    mistaken = count[candidates.direct == 0].sum() / n
    assert candidates.expected_mistaken == pytest.approx(mistaken, rel=0.05)
    nothing = np.ones(o.range_status.size) - np.bincount(candidates.attempt, p, o.range_status.size)
    assert np.count_nonzero(taken < 0) / n == pytest.approx(nothing.sum(), rel=0.05)


def test_candidates_are_the_arrivals_of_the_link_in_both_directions(truth):
    ranging, o, candidates = mission(truth, RIDGED, BARE[1])
    pings = np.bincount(ranging.arrivals.link)  # landmarks only listen
    assert candidates.attempt.size == np.sum(pings * np.where(ranging.links.second == 3, 1, 2))
    direct, ok = candidates.direct == 1, o.range_status == RayStatus.OK
    np.testing.assert_array_equal(candidates.attempt[direct], np.flatnonzero(ok))
    np.testing.assert_array_equal(candidates.travel_time[direct], ranging.truth.travel_time[ok])
    np.testing.assert_array_equal(candidates.bounces == 0, direct)
    assert 0 < ok.sum() < ok.size


@pytest.mark.parametrize("timing", [ONE_WAY, TwoWay(1.0)])
def test_the_direct_candidate_comes_first_even_if_it_is_later(truth, timing):
    """
    A surface duct can do that; here each link's direct arrival and the next one exchange their
    travel times.
    """
    ranging, _, _ = mission(truth, RIDGED, BARE[1])
    receptions = ranging.receptions
    direct, time = np.flatnonzero(receptions.selected), receptions.travel_time.copy()
    time[direct], time[direct + 1] = time[direct + 1], time[direct].copy()
    other = ranging._replace(receptions=replace(receptions, travel_time=time))
    found = find_candidates(other, truth, BARE[1], timing=timing)
    rows = np.flatnonzero(found.direct)
    assert rows.size > 5
    np.testing.assert_array_equal(rows, np.searchsorted(found.attempt, found.attempt[rows]))
    assert (found.travel_time[rows + 1] < found.travel_time[rows]).any()


def test_what_is_stopped_has_no_candidates(truth):
    status = truth.status.copy()
    status[1] = 1
    _, o, candidates = mission(replace(truth, status=status), RIDGED, BARE[1])
    silent = np.flatnonzero(o.range_status == RayStatus.STOPPED)
    assert silent.size
    assert not np.isin(candidates.attempt, silent).any()
    noisy = perturb(o, root_seed=1, realization=0, detection=candidates)
    assert (noisy.range_status[silent] == RayStatus.STOPPED).all()


PICKERS = {
    "rule 'loudest'; allowed are first-detected, strongest-detected": ("loudest", None),
    "below_strongest_db is None; first-detected without a sonar needs it": ("first-detected", None),
    r"below_strongest_db is 3\.0": ("strongest-detected", 3.0),
}


@pytest.mark.parametrize("message", PICKERS)
def test_rules_without_the_threshold_that_they_need_are_refused(message):
    rule, below = PICKERS[message]
    refused(SensingError, message, Picker, rule, below_strongest_db=below)


def test_candidates_that_do_not_fit_are_refused(truth):
    ranging, _, candidates = mission(truth, RIDGED, BARE[1])
    with pytest.raises(
        SensingError, match="a picker with a sonar needs ranges that were measured with a det"
    ):
        find_candidates(ranging, truth, CERTAIN)
    refused(
        SensingError,
        r"candidates of attempt \d+; the measurements have 2",
        candidates.picks,
        [0.5, 0.5],
    )


@pytest.fixture(scope="module")
def many_pings(make_measurements):
    """
    12,000 attempts every 200 s, each with two candidates that are taken in the shares of a
    campaign.
    """
    o = make_measurements("AB", n_time=6001, landmarks=(), epochs=np.arange(1, 6001))
    attempt = np.repeat(np.arange(o.range_status.size), 2)
    first = np.tile([1, 0], o.range_status.size)
    share = np.where(first == 1, SHARE, 1.0 - SHARE)
    return o, Candidates(attempt, np.ones(attempt.size), share, first, np.zeros(attempt.size))


SHARE = 0.5 * (
    1.0 + np.sqrt(1.0 - 2.0 * 0.39)
)  # two candidates that switch in 0.39 of independent pings
STAYS = 1.0 - 0.065 / 0.39  # and in 0.065 of those 200 s apart


def test_a_pick_stays_as_long_as_its_correlation_time_says(many_pings):
    """
    Within one interval 0.065 switch where 0.39 would independently; k intervals later 0.39 (1 -
    stays^k).
    """
    o, candidates = many_pings
    draw = {"root_seed": 4, "realization": 0}
    second = draw_picks(o, candidates, **draw, correlation_time=-200.0 / np.log(STAYS)) % 2
    independent = draw_picks(o, candidates, **draw) % 2
    for sender in (0, 1):
        rows = o.range_transmitter == sender
        for lag in (1, 3, 20):
            rate = np.mean(second[rows][lag:] != second[rows][:-lag])
            assert rate == pytest.approx(
                0.39 * (1.0 - STAYS**lag), abs=0.012 if lag == 1 else 0.04
            ), lag
        assert np.mean(np.diff(independent[rows]) != 0) == pytest.approx(0.39, abs=0.03)
    worth = o.range_status.size * (1.0 - STAYS) / (1.0 + STAYS)  # independent draws
    assert np.mean(second) == pytest.approx(
        1.0 - SHARE, abs=4.0 * np.sqrt(SHARE * (1.0 - SHARE) / worth)
    )


def test_a_persistent_pick_was_drawn_for_its_pair(many_pings):
    o, _ = many_pings
    fresh = chances(o, root_seed=4, realization=1)
    held = chances(o, root_seed=4, realization=1, correlation_time=1e3)
    for sender in (0, 1):
        rows = o.range_transmitter == sender
        assert held[rows][0] == fresh[rows][0]
        stayed = held[rows][1:] == held[rows][:-1]
        np.testing.assert_array_equal(held[rows][1:][~stayed], fresh[rows][1:][~stayed])
        assert np.mean(stayed) == pytest.approx(np.exp(-0.2), abs=0.02)
    sparse = replace(o, time=1e6 * np.arange(o.time.size))
    np.testing.assert_array_equal(
        chances(sparse, root_seed=4, realization=1, correlation_time=1e3), fresh
    )
    refused(
        SensingError,
        "correlation_time is -1 s; it must be finite and zero or positive",
        chances,
        o,
        root_seed=1,
        realization=0,
        correlation_time=-1.0,
    )
