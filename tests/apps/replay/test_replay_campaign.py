"""A campaign of known truth comes back with its own parameters, within their errors."""

import numpy as np
import pytest

from pymantaray.apps.replay import replay_events
from pymantaray.apps.replay.page import (
    coverage_bars,
    residual_histograms,
    residuals_over_range,
    residuals_over_time,
)


@pytest.fixture(scope="module")
def replay(campaign):
    return replay_events(campaign.events, campaign.waters)


def offsets_in_errors(replay, truth):
    clocks = replay.clocks.set_index("node")
    true = np.array([truth["offset_s"][name] for name in clocks.index])
    return (clocks["offset_s"] - (true - true.mean())) / clocks["standard_error_s"]


@pytest.mark.slow
def test_clocks_and_noise_come_back_within_their_errors(replay, campaign):
    off = offsets_in_errors(replay, campaign.truth)
    assert np.abs(off).max() < 3.5
    left = replay.taken["taken_residual_s"].dropna()
    sigma = campaign.truth["sigma_s"]
    assert left.std() == pytest.approx(sigma, abs=4.0 * sigma / np.sqrt(2.0 * left.size))


@pytest.mark.slow
def test_events_without_a_ray_stay_in_the_table_and_in_the_count(replay, campaign):
    events, every = replay.events, replay.summary.iloc[0]
    lost = events[events["status"] != "ok"]
    assert len(events) == campaign.truth["events"] == every["events"]
    assert len(lost) == campaign.truth["without_a_ray"] == every["events"] - every["predicted"]
    assert lost["predicted_s"].isna().all()
    assert lost["residual_s"].isna().all()
    assert {"shadow", "weak"} == set(lost["status"])
    assert every["percent"] == pytest.approx(100.0 * every["predicted"] / every["events"])
    for by, part in replay.summary.groupby("by"):
        assert part["events"].sum() == len(events), by
        assert part[["shadow", "weak"]].to_numpy().sum() == len(lost), by


@pytest.mark.slow
def test_what_is_reciprocal_leaves_nothing(replay):
    table = replay.reciprocity
    assert (table["matched"] > 4).all()
    off = table["left_s"] / table["standard_error_s"]
    assert np.sqrt((off**2).mean()) < 2.0
    assert np.abs(table["mean_s"]).max() > 1e-3  # the clocks'


def test_each_event_is_replayed_in_its_nearest_cast(short_campaign, as_stored):
    """The casts are those of the start and of the end."""
    told = []
    replay = replay_events(
        short_campaign.events, short_campaign.waters, progress=lambda *of: told.append(of)
    )
    done, totals = zip(*told, strict=True)
    assert sorted(done) == [*done]
    assert done[0] < done[-1] == totals[0] == totals[-1] == len(replay.events)
    second = replay.events["cast"] == "second"
    np.testing.assert_array_equal(second, short_campaign.events.time > 60.0)
    as_stored(replay, without="explorer")
    events, summary = replay.events, replay.summary
    figures = [
        residuals_over_range(events, summary, "range"),
        residuals_over_time(events, "time"),
        residual_histograms(events, replay.taken, "histogram"),
        coverage_bars(summary, "coverage"),
    ]
    as_stored(figures, name="figures")


@pytest.mark.slow
def test_an_hour_gives_back_the_switching(make_campaign, tmp_path):
    campaign = make_campaign(tmp_path, 3600.0)
    replay = replay_events(campaign.events, campaign.waters)
    assert np.abs(offsets_in_errors(replay, campaign.truth)).max() < 3.5
    np.testing.assert_array_equal(replay.events["cast"] == "second", campaign.events.time > 1800.0)
    switching = replay.switching.iloc[0]
    share = campaign.truth["share_of_first"]
    independent = 2.0 * share * (1.0 - share)
    assert switching["independent_rate"] == pytest.approx(independent, abs=0.06)
    true = independent * (1.0 - np.exp(-45.0 / campaign.truth["correlation_s"]))
    assert switching["rate_low"] < true < switching["rate_high"]
    assert switching["correlation_s"] == pytest.approx(campaign.truth["correlation_s"], rel=0.35)
