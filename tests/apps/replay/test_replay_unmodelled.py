"""
A campaign whose ice, thin layers and some arrivals no draw has, is predicted not worse than by the
last measured times, for each time since them.
"""

import numpy as np
import pytest
from unmodelled_campaign import make_campaign

from pymantaray import open_waters
from pymantaray.apps.replay import PredictionOptions, read_events, replay_events
from pymantaray.apps.replay.baselines import last_measured

pytestmark = pytest.mark.slow
ROWS = {"all": (0.0, 1e9), "1 min": (0.0, 60.0), "10 min": (60.0, 600.0), "hours": (600.0, 1e9)}


@pytest.fixture(scope="module")
def replays(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unmodelled")
    table, cast = make_campaign(7, events=700, hours=8.0, epoch=1200.0)
    table.to_csv(folder / "events.csv", index=False)
    cast.to_csv(folder / "cast.csv", index=False)
    ice = {"ice": 1.5, "ice_slope_deg": 0.5, "ice_length": 20.0, "max_surface_bounces": 7}
    waters = open_waters(folder / "cast.csv", bathymetry=2680.0, thin=0.1, **ice)
    events = read_events(folder / "events.csv")
    return {
        how: replay_events(events, waters, options=PredictionOptions(16, learn=how))
        for how in ("causal", "smooth")
    }


def excess(size, other, level, rng):
    """Difference of quantiles of paired errors, and its standard error by the bootstrap."""
    resampled = rng.integers(0, size.size, (400, size.size))
    off = np.quantile(size[resampled], level, axis=1) - np.quantile(other[resampled], level, axis=1)
    return np.quantile(size, level) - np.quantile(other, level), off.std()


@pytest.mark.parametrize("how", ["causal", "smooth"])
def test_no_horizon_is_worse_than_the_last_time(replays, how):
    events = replays[how].events
    last = last_measured(events)
    speed = (events["residual_m"] / events["residual_s"]).median()
    persistence = ((events["measured_s"] - last["predicted_s"]).abs() * speed).to_numpy()
    inside = events["measured_s"].between(events["low_s"], events["high_s"]).to_numpy()
    rng = np.random.default_rng(1)
    for name, (low, high) in ROWS.items():
        row = last["elapsed_s"].between(low, high, inclusive="left").to_numpy()
        assert row.sum() > 40, name
        size = events["residual_m"].abs().to_numpy()[row]
        for level in (0.5, 0.9):
            more, error = excess(size, persistence[row], level, rng)
            assert more < 2.0 * error, (name, level)
        assert abs(inside[row].mean() - 0.95) < 0.02 + 2.0 * np.sqrt(0.05 * 0.95 / row.sum()), name


def test_smooth_predictions_are_not_worse_than_causal_ones(replays):
    causal, smooth = (replays[how].events for how in ("causal", "smooth"))
    assert smooth["log_likelihood"].mean() > causal["log_likelihood"].mean()
    sizes = (table["residual_m"].abs().to_numpy() for table in (smooth, causal))
    more, error = excess(*sizes, 0.5, np.random.default_rng(2))
    assert more < 2.0 * error


def test_arrivals_that_no_draw_has_are_named(replays):
    events = replays["causal"].events
    assert 0 < events["not_modelled"].sum() < 0.5 * len(events)
    assert events.loc[events["not_modelled"], "surface_bounces"].isna().all()
    horizons = replays["causal"].tables["horizons"].frame.set_index("since_last")
    assert horizons.loc["all", "not_modelled"] == pytest.approx(
        100.0 * events["not_modelled"].mean()
    )
