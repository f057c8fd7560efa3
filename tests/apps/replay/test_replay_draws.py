"""
Predictions from draws of rough ice: the same ice in both directions, what is refused, and the
suggestion to allow reflections.
"""

from dataclasses import replace

import numpy as np
import pytest
from arctic import BOTTOM, DEPTH, cast
from refusals import refused

from pymantaray import Water
from pymantaray.acoustics import BoundarySurface, Medium
from pymantaray.apps.replay import Events, PredictionOptions, replay_events
from pymantaray.errors import ReplayError
from pymantaray.geometry.roughness import Roughness
from pymantaray.sensing import ReceptionOptions

ENDS = np.array([[72.0, -145.0, 90.0], [72.0135, -145.0, 90.0]])


def both_ways():
    """One event in each direction between two nodes 1.5 km apart."""
    return Events(
        time=[0.0, 60.0],
        source=["A", "B"],
        receiver=["B", "A"],
        source_position=ENDS,
        receiver_position=ENDS[::-1],
        travel_time=[1.05, 1.05],
        geographic=True,
    )


def water(slope=0.5, bounces=3):
    rough = None if slope is None else Roughness(np.radians(slope), 20.0)
    ice = BoundarySurface(1.5, roughness=rough)
    medium = Medium.from_profile(DEPTH, cast(), bottom_depth=BOTTOM, ice_draft=ice)
    return Water(medium, reception=ReceptionOptions(max_surface_bounces=bounces), uniform=True)


def test_candidates_of_draws_are_the_same_in_both_directions(as_stored):
    replay, again = (
        replay_events(both_ways(), water(), "persist", options=PredictionOptions(2))
        for _ in range(2)
    )
    np.testing.assert_array_equal(again.events["predicted_s"], replay.events["predicted_s"])
    forth, back = (replay.candidates[replay.candidates["event"] == k] for k in range(2))
    assert len(forth) >= 2
    for name in ("travel_time_s", "loss_db", "share", "spread_s"):
        np.testing.assert_allclose(forth[name], back[name], rtol=1e-9, atol=1e-12)
    assert forth["share"].between(0.5 - 1e-9, 1.0).all()
    assert forth["probability"].sum() == pytest.approx(1.0)
    assert replay.events["predicted_s"].isin(replay.candidates["travel_time_s"]).all()
    assert {"coverage", "candidates"} <= set(replay.tables)
    assert replay.tables["candidates"].frame["event"].min() == 1
    as_stored([replay.events, replay.candidates, replay.more])


def test_draws_of_smooth_ice_are_refused():
    options = PredictionOptions(3)
    refused(
        ReplayError,
        "draws: the ice is smooth",
        replay_events,
        both_ways(),
        water(None),
        options=options,
    )


def test_without_reflections_and_few_predictions_some_are_suggested(as_stored):
    shadowed = replace(
        both_ways(),
        source_position=ENDS - [0.0, 0.0, 70.0],
        receiver_position=ENDS[::-1] - [0.0, 0.0, 60.0],
    )
    known = replay_events(shadowed, water(None, 7)).events["predicted_s"].notna().all()
    hint = replay_events(shadowed, water(None, 0)).notes
    assert known
    assert len(hint) == 1
    assert "0 % of the events are predicted" in hint[0]
    assert "with `max_surface_bounces=7`, 2 of 2 of the other events have an arrival" in hint[0]
    assert replay_events(shadowed, water(None, 7)).notes == ()
    as_stored(hint)
