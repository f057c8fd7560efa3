"""Times of an instrument to itself, against depth over sound speed."""

import numpy as np
import pytest
from refusals import refused

from pymantaray import Water
from pymantaray.acoustics import BoundarySurface, Medium
from pymantaray.apps.replay import Events, PredictionOptions, replay_events, write_replay
from pymantaray.errors import ReplayError
from pymantaray.geometry.roughness import Roughness
from pymantaray.sensing import ReceptionOptions

DEPTH = np.array([0.0, 1000.0, 2700.0])
SPEED, BOTTOM, DRAFT = 1450.0, 2680.0, 2.0
TOP = 2.0 * (2000.0 - DRAFT) / SPEED
BED = 2.0 * (BOTTOM - 2000.0) / SPEED


def water(surface=1, bottom=0, slope=None):
    rough = None if slope is None else Roughness(np.radians(slope), 20.0)
    ice = BoundarySurface([[DRAFT]], roughness=rough)
    medium = Medium.from_profile(DEPTH, np.full(3, SPEED), bottom_depth=BOTTOM, ice_draft=ice)
    return Water(medium, reception=ReceptionOptions(15.0, surface, bottom), uniform=True)


def events(geographic=True, times=(TOP, TOP, 0.24, 0.24)):
    """Two echoes of A, and a time in each direction between A and B at the same depth."""
    a, b = [72.0, -145.0, 2000.0], [72.0, -145.01, 2000.0]
    if not geographic:
        a, b = [50.0, 60.0, 2000.0], [50.0, -285.0, 2000.0]
    return Events(
        time=60.0 * np.arange(4),
        source=["A", "A", "A", "B"],
        receiver=["A", "A", "B", "A"],
        source_position=[a, a, a, b],
        receiver_position=[a, a, b, a],
        travel_time=times,
        geographic=geographic,
    )


@pytest.mark.parametrize("rule", ["within:6", "first", "persist"])
@pytest.mark.parametrize("geographic", [True, False])
def test_an_echo_of_the_surface_takes_twice_the_way(rule, geographic, as_stored):
    replay = replay_events(events(geographic), water(), rule)
    table = replay.events
    np.testing.assert_allclose(table["predicted_s"][:2], TOP, atol=1e-7)
    assert (table["surface_bounces"][:2] == 1).all()
    assert (table["distance_m"][:2] == 0.0).all()
    assert (table["predicted_s"][2:] < 0.25).all()
    assert not table["gross"].any()
    assert table["loss_db"][0] == pytest.approx(20.0 * np.log10(2.0 * 1998.0), abs=0.1)
    if rule == "persist":
        as_stored([replay.events, replay.candidates])


def test_an_echo_of_the_sea_bed_is_the_first_one(as_stored):
    table = replay_events(events(times=(BED, BED, 0.24, 0.24)), water(1, 1)).events
    np.testing.assert_allclose(table["predicted_s"][:2], BED, atol=1e-7)
    assert table["bottom_bounces"].tolist()[:2] == [1, 1]
    as_stored(table)


@pytest.mark.slow
def test_echoes_under_rough_ice_and_learned_water(tmp_path):
    rough = water(slope=0.5)
    drawn = replay_events(events(), rough, options=PredictionOptions(8))
    np.testing.assert_allclose(drawn.events["predicted_s"][:2], TOP, atol=1e-7)
    assert drawn.more["draws"]["groups"].tolist() == [4]
    learned = replay_events(events(), rough, options=PredictionOptions(learn="causal"))
    assert learned.events["predicted_s"].notna().all()
    write_replay(learned, tmp_path / "out")


def test_candidates_of_learning_contain_what_was_learned():
    learned, plain = (
        replay_events(events(), water(), "persist", options=PredictionOptions(learn=how))
        for how in ("causal", None)
    )
    parts = learned.events.filter(regex="^learned_").sum(axis=1).to_numpy()
    assert np.abs(parts).max() > 1e-6
    moved = learned.candidates["travel_time_s"] - plain.candidates["travel_time_s"]
    np.testing.assert_allclose(moved, parts[plain.candidates["event"]], rtol=0, atol=1e-12)


def test_echoes_do_not_change_clocks_or_baselines(as_stored):
    with_echoes = events(times=(TOP + 0.01, TOP, 0.241, 0.239))
    replay = replay_events(with_echoes, water())
    clocks = replay.clocks.set_index("node")["offset_s"]
    assert clocks["B"] - clocks["A"] == pytest.approx(1e-3, abs=1e-9)
    assert (replay.baselines["median_size_m"].fillna(0.0) < 10.0).all()
    as_stored([replay.clocks, replay.baselines])


def test_echoes_without_reflections_or_at_two_places_are_refused():
    refused(
        ReplayError, "echoes, but no reflections are allowed", replay_events, events(), water(0)
    )
    moved = [[72.0, -145.0, 2000.0]] * 2
    other = [[72.1, -145.0, 2000.0]] * 2
    refused(
        ReplayError,
        "event 1 is A and A; allowed: two nodes, or one node at one position",
        Events,
        np.zeros(2),
        ["A"] * 2,
        ["A"] * 2,
        moved,
        other,
        [1.0, 1.0],
        geographic=True,
    )
