"""
Predictions from draws of rough ice: the same ice in both directions, ice that changes by drift and
time, mirror images, what is refused, and the suggestion to allow reflections.
"""

from dataclasses import replace

import numpy as np
import pytest
from arctic import BOTTOM, DEPTH, cast
from refusals import refused

from pymantaray import Water
from pymantaray.acoustics import BoundarySurface, Medium
from pymantaray.apps.replay import Events, PredictionOptions, replay_events
from pymantaray.apps.replay.compare import jackknife_error
from pymantaray.apps.replay.shared_links import ice_stretches
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


def drifting(times, north, *, geographic=True):
    """Events from A to B at some times, both moved north. [s, m]"""
    moved = np.array([[x / (111_600.0 if geographic else 1.0), 0.0, 0.0] for x in north])
    ends = ENDS if geographic else np.array([[0.0, 0.0, 90.0], [1506.0, 0.0, 90.0]])
    return Events(
        time=times,
        source=["A"] * len(times),
        receiver=["B"] * len(times),
        source_position=ends[0] + moved,
        receiver_position=ends[1] + moved,
        travel_time=[1.05] * len(times),
        geographic=geographic,
    )


def candidates_of(events, **options):
    """Times, losses and reflections of the candidates of each event."""
    table = replay_events(events, water(), "persist", **options).candidates
    columns = ["travel_time_s", "loss_db", "surface_bounces"]
    return [table.loc[table["event"] == k, columns].to_numpy() for k in range(events.time.size)]


@pytest.mark.parametrize("geographic", [True, False])
def test_ice_changes_with_a_drift_by_its_length_and_with_an_hour(geographic):
    """The first three events share ice; drifts and an hour change reflections alone."""
    times, north = [0.0, 60.0, 1800.0, 120.0, 3700.0], [2.0, 5.0, 3.0, 31.0, 2.0]
    same, also, later, moved, next_hour = candidates_of(
        drifting(times, north, geographic=geographic)
    )
    np.testing.assert_allclose(also, same, rtol=1e-7)
    np.testing.assert_allclose(later, same, rtol=1e-7)
    direct = same[same[:, 2] == 0]
    for other in (moved, next_hour):
        np.testing.assert_allclose(other[other[:, 2] == 0], direct, rtol=1e-6)
        assert other.shape != same.shape or np.abs(other - same)[:, 0].max() > 2e-6


def test_ice_of_an_hour_lies_over_ground_for_all_pairs():
    """The distance of nodes on the tile is that over ground; a full hour moves all by the same."""
    ice = Roughness(0.01, 20.0)
    events = drifting([0.0, 10.0, 20.0, 3600.0], [0.0, 45.0, 47.0, 45.0], geographic=False)
    rows = np.arange(4)
    stretch, place = ice_stretches(events, rows, 0 * rows, events.source_position, ice)
    assert stretch.tolist() == [0, 1, 1, 2]
    np.testing.assert_allclose(place[1] - place[0], [46.0, 0.0])
    np.testing.assert_allclose(place[1], place[2])
    shift = np.mod(place[3] - place[1] + [1.0, 0.0], ice.side) / ice.length
    assert 10.0 < shift.min() < shift.max() < ice.side / ice.length - 10.0
    _, other_pair = ice_stretches(events, rows, 0 * rows + 7, events.source_position, ice)
    np.testing.assert_array_equal(other_pair, place)


def test_candidates_depend_neither_on_the_order_nor_on_threads():
    times, north = [0.0, 900.0, 4000.0, 4100.0], [0.0, 50.0, 7.0, 8.0]
    events, turned = drifting(times, north), drifting(times[::-1], north[::-1])
    one, other = candidates_of(events), candidates_of(turned)
    single = water()
    single = replace(single, reception=single.reception._replace(threads=1))
    alone = replay_events(events, single, "persist").candidates["travel_time_s"]
    for first, second in zip(one, other[::-1], strict=True):
        np.testing.assert_allclose(second, first, rtol=1e-12)
    np.testing.assert_array_equal(alone, np.concatenate(one)[:, 0])


def test_a_draw_and_its_mirror_image_cancel_to_first_order():
    """Under ice that is almost smooth, times of one draw err 10 times as much as those of both."""
    nearly, events = water(slope=0.002, bounces=1), both_ways()
    truth = replay_events(events, water(0.0, 1), "persist").candidates["travel_time_s"]
    errors = []
    for draws in (1, 2):
        options = PredictionOptions(draws)
        table = replay_events(events, nearly, "persist", options=options).candidates
        errors.append(np.abs(table["travel_time_s"] - truth).max())
    assert errors[0] > 10.0 * errors[1]
    rough = Roughness(0.01, 20.0, draw=3)
    upside_down = rough.with_draw(-4).elevation_at([0.0, 30.0], [5.0, 70.0])
    np.testing.assert_array_equal(upside_down, -rough.elevation_at([0.0, 30.0], [5.0, 70.0]))


def test_the_jackknife_of_a_mean_is_its_standard_error():
    values = np.random.default_rng(4).normal(size=(8, 2))
    without = (values.sum(axis=0) - values) / 7
    expected = values.std(axis=0, ddof=1) / np.sqrt(8)
    np.testing.assert_allclose(jackknife_error(without), expected)
    assert np.isnan(jackknife_error(np.array([[1.0], [np.inf], [2.0], [1.5]]))).all()


def test_eight_draws_have_a_standard_error_of_the_median():
    events = drifting([0.0, 600.0, 3700.0, 7300.0], [0.0, 40.0, 80.0, 120.0])
    few, enough = (
        replay_events(events, water(), "persist", options=PredictionOptions(n)) for n in (7, 8)
    )
    assert "draws" not in few.more
    row = enough.more["draws"].iloc[0]
    assert (row["draws"], row["groups"]) == (8, 4)
    sizes = enough.events["residual_m"].abs()
    assert sizes.min() <= row["median_size_m"] <= row["q90_size_m"] <= sizes.max()
    assert np.isfinite(row[["median_error_m", "q90_error_m"]].to_numpy()).all()


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
