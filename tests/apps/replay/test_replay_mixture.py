"""
Candidates merged from draws, their probabilities, and receptions that persist, against values
written out.
"""

import numpy as np
import pandas as pd
import pytest
from refusals import refused

from pymantaray.apps.replay import DetectionRule, PredictionOptions
from pymantaray.apps.replay.draws import MERGED, DrawnArrivals, merge_draws
from pymantaray.apps.replay.event_data import EventCandidates, Reception, passed
from pymantaray.apps.replay.mixture import coverage_table, first_detected, predict_mixture
from pymantaray.errors import ReplayError


def drawn(rows):
    event, draw, time, loss, surface = (np.array(x) for x in zip(*rows, strict=True))
    gradient = np.tile([7e-4, 0.0, 0.0], (event.size, 1))
    return DrawnArrivals(event, draw, time, loss, surface, np.zeros_like(surface), gradient)


def test_arrivals_of_draws_merge_by_bounces_and_time_in_any_order(as_stored):
    rows = [
        (0, 0, 1.0000, 60.0, 1),
        (0, 1, 1.0004, 60.0, 1),
        (0, 1, 1.0006, 60.0, 1),  # two of one draw add their power
        (0, 2, 1.0000 + 1.01 * MERGED, 70.0, 1),  # too late for the first candidate
        (0, 0, 1.0001, 62.0, 2),  # other bounces
        (3, 3, 2.0, 50.0, 0),
    ]
    table = merge_draws(drawn(rows), 4)
    assert table["event"].tolist() == [0, 0, 0, 3]
    assert table["surface_bounces"].tolist() == [2, 1, 1, 0]
    assert table["share"].tolist() == [0.25, 0.5, 0.25, 0.25]
    both = table.iloc[1]
    assert both["travel_time_s"] == pytest.approx(1.0 + 1e-3 / 3.0)
    assert both["spread_s"] == pytest.approx(np.std([0.0, 4e-4, 6e-4]))
    assert both["loss_db"] == pytest.approx(60.0 - 10.0 * np.log10(1.5))
    pd.testing.assert_frame_equal(merge_draws(drawn(rows[::-1]), 4), table)
    as_stored(table)


def test_the_first_candidate_has_the_probability_of_its_level():
    table = pd.DataFrame(
        {"event": [0, 0, 1], "loss_db": [66.0, 60.0, 80.0], "share": [1.0, 1.0, 0.3]}
    )
    weight = first_detected(table)
    late = 0.5 * 0.8413447460685429  # the earlier one is missed, and 6 dB above the limit
    np.testing.assert_allclose(weight[:2], [0.5 / (0.5 + late), late / (0.5 + late)], rtol=1e-6)
    assert weight[2] == pytest.approx(1.0)


def two_arrivals(measured, gap=60.0):
    """
    Events of one link, each with arrivals at 1 and 1.01 s, of which the first is the more probable.
    """
    n = len(measured)
    events = pd.DataFrame(
        {
            "source": "A",
            "receiver": "B",
            "pair": "A and B",
            "time_s": gap * np.arange(n),
            "measured_s": measured,
            "sigma_s": np.nan,
            "distance_m": 1450.0,
            "sound_speed_m_s": 1450.0,
        }
    )
    rows = {
        "event": np.repeat(np.arange(n), 2),
        "travel_time_s": np.tile([1.0, 1.01], n),
        "loss_db": np.tile([60.0, 62.0], n),
        "surface_bounces": np.tile([0, 1], n),
        "bottom_bounces": 0,
        "share": 1.0,
        "spread_s": 0.0,
    }
    return events, pd.DataFrame(rows)


def test_a_prediction_follows_the_previous_reception_never_its_own(as_stored):
    events, candidates = two_arrivals([1.01, 1.01, 1.0, 1.0, 5.0, 1.0])
    options = PredictionOptions()
    mixture = predict_mixture(events, candidates, options, persistence=600.0)
    second = mixture.probability[1::2]
    prior = first_detected(candidates)[1]
    stays = np.exp(-0.1)
    assert second[0] == pytest.approx(prior)
    assert second[1] == pytest.approx(stays + (1.0 - stays) * prior, abs=0.01)
    assert second[3] == pytest.approx((1.0 - stays) * prior, abs=0.01)
    # what no candidate explains, the fifth, changes nothing but the time since the arrival before
    assert second[5] == pytest.approx((1.0 - stays**2) * prior, abs=0.01)
    assert mixture.events["mixture_s"][1] == pytest.approx(1.01, abs=1e-3)
    free = predict_mixture(events, candidates, options)
    np.testing.assert_allclose(free.probability[1::2], prior)
    changed = predict_mixture(
        events.assign(measured_s=[1.01, 1.01, 1.0, 1.0, 5.0, 1.01]),
        candidates,
        options,
        persistence=600.0,
    )
    np.testing.assert_allclose(changed.probability, mixture.probability, atol=1e-3)
    as_stored([mixture, free])


@pytest.mark.slow
def test_sigma_and_intervals_come_back_from_drawn_errors():
    rng = np.random.default_rng(3)
    n, sigma = 4000, 2e-3
    events, candidates = two_arrivals(1.0 + rng.normal(0.0, sigma, n), gap=10.0)
    candidates = candidates[candidates["travel_time_s"] == 1.0].reset_index(drop=True)
    mixture = predict_mixture(events, candidates, PredictionOptions())
    assert mixture.unexplained == pytest.approx(sigma, rel=0.3)
    table = events.assign(
        predicted_s=1.0,
        prediction_sigma_s=mixture.events["sigma_s"],
        low_s=mixture.events["low_s"],
        high_s=mixture.events["high_s"],
        log_likelihood=mixture.events["log_likelihood"],
    )
    table["residual_s"] = table["measured_s"] - 1.0
    table["residual_m"] = 1450.0 * table["residual_s"]
    coverage = coverage_table(table, seed=1).set_index("group")
    assert coverage["within_95"].between(90.0, 99.0).all()
    assert coverage.loc["odd hours", "median_size_m"] == pytest.approx(
        0.6745 * 1450.0 * sigma, rel=0.1
    )
    assert coverage["within_95_low"].isna().all(), "one pair has no interval"
    assert coverage.loc["all", "varying_m"] == pytest.approx(1450.0 * sigma, rel=0.1)
    assert coverage.loc["all", "pair_m"] < 0.3
    own = predict_mixture(events, candidates, PredictionOptions(1, 2.0, 1.0))
    known = np.hypot(np.sqrt(2.0) * 2.0 / 1450.0, 1.0 / 1450.0)
    assert np.sqrt(own.sigma[0] ** 2 - own.unexplained**2) == pytest.approx(known, rel=1e-6)


def test_coverage_has_an_interval_over_pairs_and_parts_of_residuals(as_stored):
    """
    Twenty pairs with constant errors of 3 m and others of 1 m; in five pairs all events are
    outside.
    """
    rng = np.random.default_rng(2)
    pairs, n = 20, 100
    pair = np.repeat([f"pair {k:02d}" for k in range(pairs)], n)
    residual = np.repeat(rng.normal(0.0, 3.0, pairs), n) + rng.normal(0.0, 1.0, pair.size)
    outside = np.repeat(np.arange(pairs) < 5, n)
    table = pd.DataFrame(
        {"pair": pair, "time_s": np.tile(np.arange(n) * 70.0, pairs), "residual_m": residual}
    )
    table = table.assign(
        residual_s=residual / 1450.0, measured_s=1.0, low_s=np.where(outside, 2.0, 0.0), high_s=3.0
    )
    row = (
        coverage_table(table.assign(prediction_sigma_s=1e-3, log_likelihood=0.0), seed=1)
        .set_index("group")
        .loc["all"]
    )
    assert row["within_95"] == 75.0
    error = 100.0 * np.sqrt(
        0.25 * 0.75 / pairs
    )  # of a share of independent pairs, not of 2,000 events
    assert row["within_95_low"] == pytest.approx(75.0 - 1.96 * error, abs=6.0)
    assert row["within_95_high"] == pytest.approx(75.0 + 1.96 * error, abs=6.0)
    assert row["varying_m"] == pytest.approx(1.0, rel=0.1)
    assert row["pair_m"] == pytest.approx(3.0, rel=0.5)
    as_stored(row.to_dict())


def test_waves_spread_the_times_of_surface_reflections(as_stored):
    """Pierson and Moskowitz: 0.0053 U^2 is the rms height for the wind at 19.5 m."""
    events, candidates = two_arrivals([1.01] * 3)
    calm, windy = (
        predict_mixture(events, candidates, PredictionOptions(1, 0.0, 0.0, u)) for u in (0.0, 10.0)
    )
    extra = np.sqrt((windy.sigma**2 - windy.unexplained**2) - (calm.sigma**2 - calm.unexplained**2))
    height = 0.00534 * (1.026 * 10.0) ** 2
    sine = np.sqrt(1.0 - 1.0 / 1.01**2)
    np.testing.assert_allclose(extra[1::2], 2.0 * height * sine / 1450.0, rtol=0.02)
    np.testing.assert_allclose(extra[::2], 0.0, atol=1e-9)
    as_stored(windy)


def test_words_of_the_rule_and_options_that_are_none_are_refused():
    assert str(DetectionRule.parse("persist")) == "persist:10"
    assert DetectionRule.parse("persist:2.5").persist_min == 2.5
    refused(ReplayError, "MINUTES above 0", DetectionRule.parse, "persist:0")
    refused(
        ReplayError, "draws is 0; allowed are whole numbers from 1 to 1000", PredictionOptions, 0
    )
    refused(ReplayError, "position_sigma is -1 m", PredictionOptions, 1, -1.0)


def test_a_receiver_stays_with_an_arrival_of_the_same_bounces():
    """
    Two candidates at the delay of the one before: a match of other bounces has a tenth of the
    weight.
    """
    before = Reception(0.0, np.array([0.5]), np.array([64.0]), np.array([1.0]))
    delay, bounces = np.array([0.5, 0.5, 0.9]), np.array([64.0, 128.0, 64.0])
    prior = np.array([0.2, 0.3, 0.5])
    event = EventCandidates(60.0, delay, bounces, prior, np.zeros(3), np.nan)
    weight = passed([before], event, prior)[0]
    expected = (np.array([1.0, 0.1, 0.0]) + 1e-3 * prior) / (1.1 + 1e-3)
    np.testing.assert_allclose(weight, expected, rtol=1e-9)
    assert weight.sum() == pytest.approx(1.0)
