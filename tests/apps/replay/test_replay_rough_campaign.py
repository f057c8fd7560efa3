"""
A campaign on rough ice, with drifting clocks and one wrong position, comes back with its parameters
and honest intervals.
"""

import json
import runpy
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from pymantaray import open_waters
from pymantaray.apps.replay import PredictionOptions, correct_events, read_events, replay_events

pytestmark = pytest.mark.slow
EXAMPLE = Path(__file__).parents[3] / "examples" / "replay_campaign.py"
OPTIONS = PredictionOptions(8)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Events, water, truth, and the replay of the even hours."""
    folder = tmp_path_factory.mktemp("rough")
    runpy.run_path(str(EXAMPLE))["main"](str(folder), "rough")
    ice = {"ice": 1.5, "ice_slope_deg": 0.5, "ice_length": 20.0, "max_surface_bounces": 7}
    waters = open_waters(folder / "cast.csv", bathymetry=3000.0, **ice)
    events = read_events(folder / "events.csv")
    even = np.floor(events.time / 3600.0) % 2 == 0
    columns = {f.name: getattr(events, f.name) for f in fields(events)}
    known = replace(
        events,
        **{
            name: column[even]
            for name, column in columns.items()
            if isinstance(column, np.ndarray) and column.size
        },
    )
    result = replay_events(known, waters, "persist", options=OPTIONS)
    return (
        events,
        waters,
        json.loads((folder / "truth.json").read_text()),
        replace(result, clock_drift=True),
    )


def test_even_hours_return_the_clocks_and_the_wrong_position(fitted):
    _, _, truth, result = fitted
    clocks = result.clocks.set_index("node")
    drift = np.array([truth["drift"][name] for name in clocks.index])
    late = clocks["mean_time_s"].iloc[0] - truth["mean_time_s"]
    offset = np.array([truth["offset_s"][name] for name in clocks.index]) + drift * late
    for true, name, error in (
        (offset, "offset_s", "standard_error_s"),
        (drift, "drift", "standard_error_drift"),
    ):
        off = (clocks[name] - (true - true.mean())) / clocks[error]
        assert np.abs(off).max() < 3.5
    nodes = result.nodes.set_index("node")
    assert list(nodes.index[nodes["suspect"]]) == [truth["wrong_camp"]]
    row = nodes.loc[truth["wrong_camp"]]
    miss = np.hypot(*(row[["north_m", "east_m"]].to_numpy(dtype=float) - truth["wrong_by_m"]))
    assert miss < 3.5 * row["standard_error_m"]


def test_intervals_cover_the_odd_hours_after_the_correction(fitted):
    events, waters, _, result = fitted
    scored = replay_events(correct_events(events, result), waters, "persist", options=OPTIONS)
    odd = scored.more["coverage"].set_index("group").loc["odd hours"]
    assert odd["events"] == odd["predicted"] == events.time.size // 2
    assert 90.0 <= odd["within_95"] <= 97.0
    assert odd["within_95_low"] <= odd["within_95"] <= odd["within_95_high"]
    assert odd["median_size_m"] < 1.0
    print(scored.more["coverage"].to_string())


def test_learning_clocks_that_drift_fast_is_as_good_as_the_last_times(fitted):
    """Clocks that gain up to 17 ms in a day, and a node that is 8 m from its stated position."""
    events, waters, *_ = fitted
    options = replace(OPTIONS, learn="causal")
    rows = replay_events(events, waters, "persist", options=options).tables["horizons"].frame
    row = rows.set_index("since_last").loc["10 to 60 min"]
    assert row["median_size_m"] < row["last_median_m"]
    assert row["q90_size_m"] < 1.2 * row["last_q90_m"]
    assert 93.0 < row["within_95"] < 97.0
    assert rows.set_index("since_last").loc["first of a way", "within_95"] > 70.0


def test_the_error_due_to_draws_is_near_the_spread_over_sets(fitted):
    """
    16 sets of eight draws, none in two sets, predict two hours of events.

    A jackknife tends to be too large: its bound above is wider.
    """
    events, waters, _, result = fitted
    early = events.time < 7200.0
    columns = {f.name: getattr(events, f.name) for f in fields(events)}
    arrays = {
        name: column[early]
        for name, column in columns.items()
        if isinstance(column, np.ndarray) and column.size
    }
    some = correct_events(replace(events, **arrays), result)
    tables = []
    for number in range(16):
        surface = waters[0].medium.surface
        rough = surface.roughness.with_draw(4 * number)
        medium = replace(waters[0].medium, surface=surface.with_roughness(rough))
        replay = replay_events(some, replace(waters[0], medium=medium), "persist", options=OPTIONS)
        tables.append(replay.more["draws"].iloc[0])
    for name in ("median", "q90"):
        true = np.std([row[f"{name}_size_m"] for row in tables], ddof=1)
        stated = np.sqrt(np.mean([row[f"{name}_error_m"] ** 2 for row in tables]))
        print(name, true, stated)
        assert true / 1.5 < stated < 2.0 * true
