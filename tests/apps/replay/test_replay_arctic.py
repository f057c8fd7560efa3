"""
A made-up campaign under rough ice, of which the prediction knows neither ice nor errors, is
predicted as the rule promises.
"""

import numpy as np
import pytest
from arctic import write_campaign

from pymantaray import open_waters
from pymantaray.apps.replay import PredictionOptions, read_events, replay_events

pytestmark = pytest.mark.slow


def sizes(replay):
    """Sizes of the residuals of all events, infinite without a prediction. [m]"""
    size = replay.events["residual_m"].abs()
    return size.fillna(np.inf).to_numpy()


@pytest.mark.filterwarnings("ignore:.* have more eigenrays than are")
def test_draws_and_persistence_predict_a_campaign_under_ice(tmp_path):
    write_campaign(tmp_path, events=500, epochs=1)
    events = read_events(tmp_path / "events.csv")
    water = {"bathymetry": 2680.0, "thin": 0.1, "max_surface_bounces": 7, "ice": 1.5}
    rough = open_waters(tmp_path / "cast.csv", ice_slope_deg=0.5, ice_length=20.0, **water)
    flat = replay_events(events, open_waters(tmp_path / "cast.csv", **water))
    drawn = replay_events(events, rough, "persist", options=PredictionOptions(16))
    assert drawn.events["predicted_s"].notna().all()
    assert np.median(sizes(drawn)) <= min(np.median(sizes(flat)), 1.75)
    assert np.quantile(sizes(drawn), 0.9) <= 5.5
    coverage = drawn.more["coverage"].set_index("group")
    assert 88.0 <= coverage.loc["odd hours", "within_95"] <= 99.0
