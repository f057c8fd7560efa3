"""
Nodes and clocks of a replay: smoothed positions, consistency, drifts, gross errors, unknown clocks
and baselines.
"""

import dataclasses
import itertools

import numpy as np
import pandas as pd
import pytest

from pymantaray import Water
from pymantaray.acoustics import Medium
from pymantaray.apps.replay import (
    Events,
    correct_events,
    replay_events,
    smooth_positions,
    write_replay,
)
from pymantaray.apps.replay.baselines import BY_DEPTHS, CONSTANT, LAST, baseline_table
from pymantaray.apps.replay.clocks import (
    clock_errors,
    clock_table,
    find_gross_errors,
    gross_note,
    known_clocks,
    unknown_clocks_note,
)
from pymantaray.apps.replay.consistency import node_table
from pymantaray.apps.replay.positions import _smooth
from pymantaray.errors import ReplayError

PLACES = {
    "A": (0.0, 0.0), "B": (1500.0, 200.0), "C": (-1400.0, 2700.0),
    "D": (3200.0, 3160.0), "E": (-3300.0, -4600.0), "F": (1800.0, -2500.0),
}  # fmt: skip
SPEED = 1440.0


def table_of(ways, m, *, step=45.0, late=lambda *_: 0.0, noise=0.0, seed=4):
    """Events between the nodes, predicted exactly except for what ``late`` and noise add [s]."""
    rng = np.random.default_rng(seed)
    rows = []
    for i, (a, b) in itertools.product(range(m), ways):
        (n0, e0), (n1, e1) = PLACES[a], PLACES[b]
        distance, bearing = np.hypot(n1 - n0, e1 - e0), np.degrees(np.arctan2(e1 - e0, n1 - n0))
        residual = late(a, b, step * i) + noise * rng.standard_normal()
        rows.append((step * i, a, b, " and ".join(sorted((a, b))), distance, bearing, residual))
    columns = ["time_s", "source", "receiver", "pair", "distance_m", "bearing_deg", "residual_s"]
    table = pd.DataFrame(rows, columns=columns).assign(sigma_s=np.nan)
    table["predicted_s"] = table["chord_s"] = table["distance_m"] / SPEED
    table["measured_s"] = table["predicted_s"] + table["residual_s"]
    table["residual_m"] = table["residual_s"] * SPEED
    return table.assign(source_depth_m=30.0, receiver_depth_m=30.0)


ALL = list(itertools.permutations(PLACES, 2))


def no_clocks(events):
    return pd.DataFrame({"taken_residual_s": events["residual_s"]})


def events_at(time, north, east):
    """Events from one moving node to a fixed one."""
    n = time.size
    source = np.column_stack([north, east, np.full(n, 30.0)])
    receiver = np.tile([5000.0, 0.0, 30.0], (n, 1))
    names = np.full(n, "A"), np.full(n, "B")
    return Events(time, *names, source, receiver, np.full(n, 3.0), geographic=False)


def test_smoother_is_the_conditional_mean_of_a_random_walk_with_drift(as_stored):
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(10.0, 90.0, 40))
    time -= time[0]
    reading = 700.0 + 0.1 * time + rng.normal(0.0, 3.0, 40)
    sigma, walk = 3.0, 0.2
    shared = 1e4**2 + 2.0**2 * np.outer(time, time) + walk**2 * np.minimum.outer(time, time)
    mean = reading[0] + shared @ np.linalg.solve(
        shared + sigma**2 * np.eye(40), reading - reading[0]
    )
    np.testing.assert_allclose(_smooth(time, reading, sigma, walk).position, mean, atol=1e-4)
    as_stored(_smooth(time, reading, sigma, walk))


@pytest.mark.parametrize("walk", [0.02, pytest.param(0.3, marks=pytest.mark.slow)])
def test_smoothed_positions_are_nearer_to_the_truth_and_tell_the_walk(walk, as_stored):
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 24 * 3600.0, 120.0)
    true = np.cumsum(np.sqrt(120.0) * walk * rng.standard_normal((time.size, 2)), axis=0)
    true += np.outer(time, [0.05, -0.12])
    events = events_at(time, *(true + rng.normal(0.0, 4.0, true.shape)).T)
    smooth = smooth_positions(events, 4.0)
    before, after = (
        np.sqrt(np.mean((e.source_position[:, :2] - true) ** 2)) for e in (events, smooth.events)
    )
    assert after < 0.7 * before
    row = smooth.nodes.set_index("node").loc["A"]
    assert row["walk_m_per_sqrt_s"] == pytest.approx(walk, rel=0.3)
    assert row["innovation_ratio"] == pytest.approx(1.0, abs=0.1)
    np.testing.assert_array_equal(smooth.events.source_position[:, 2], 30.0)
    np.testing.assert_allclose(smooth.events.receiver_position, events.receiver_position, atol=1e-6)
    as_stored([smooth.nodes, smooth.events])


def test_geographic_positions_are_smoothed_in_metres(short_campaign, as_stored):
    rng = np.random.default_rng(1)
    moved = {
        f"{end}_position": getattr(short_campaign.events, f"{end}_position")
        for end in ("source", "receiver")
    }
    noisy = dataclasses.replace(
        short_campaign.events,
        **{
            k: v + rng.normal(0.0, 1.0, v.shape) * [4 / 111e3, 4 / 34e3, 0.0]
            for k, v in moved.items()
        },
    )
    smooth = smooth_positions(noisy, 4.0).events
    scale = np.array([111e3, 34e3])
    for name, true in moved.items():
        before, after = (
            np.sqrt(np.mean(((getattr(e, name) - true)[:, :2] * scale) ** 2))
            for e in (noisy, smooth)
        )
        assert after < 0.6 * before
    as_stored(smooth)


def test_one_gross_position_does_not_move_the_frame_of_others(short_campaign):
    events, rng = short_campaign.events, np.random.default_rng(2)
    gross, noisy = events.source_position.copy(), events.receiver_position.copy()
    noisy[:, :2] += rng.normal(0.0, 1e-4, noisy[:, :2].shape)
    events = dataclasses.replace(events, receiver_position=noisy)
    gross[0, 0] *= -1.0
    other = dataclasses.replace(events, source_position=gross)
    there, here = (smooth_positions(one, 4.0).events for one in (events, other))
    unmoved = events.receiver != events.source[0]
    np.testing.assert_allclose(
        here.receiver_position[unmoved], there.receiver_position[unmoved], rtol=0, atol=1e-8
    )


def test_error_of_a_reading_must_be_positive():
    with pytest.raises(ReplayError, match="sigma"):
        smooth_positions(events_at(np.arange(3.0), np.zeros(3), np.zeros(3)), 0.0)


def test_drifting_clocks_are_fitted_with_their_errors(as_stored):
    offset = dict(zip(PLACES, [0.8e-3, -2.1e-3, 3.4e-3, -0.6e-3, 1.9e-3, -3.4e-3], strict=True))
    rate = dict(zip(PLACES, [1e-6, -2e-6, 0.5e-6, 0.0, 2e-6, -1.5e-6], strict=True))
    middle = 0.5 * 45.0 * 39
    misses, told = [], []
    for seed in range(30):
        e = table_of(
            ALL, 40, noise=2.5e-4, seed=seed,
            late=lambda a, b, t: offset[b] - offset[a] + (rate[b] - rate[a]) * (t - middle),
        )  # fmt: skip
        clocks = clock_table(e, e["residual_s"], reference="A", drift=True)
        true = np.array([[offset[n] - offset["A"], rate[n] - rate["A"]] for n in clocks["node"]])
        misses.append(clocks[["offset_s", "drift"]].to_numpy()[1:] - true[1:])
        told.append(clocks[["standard_error_s", "standard_error_drift"]].to_numpy()[1:])
    spread, error = np.std(misses, axis=0), np.mean(told, axis=0)
    np.testing.assert_allclose(spread, error, rtol=0.5)
    assert (np.abs(np.mean(misses, axis=0)) < 4.0 * error / np.sqrt(30)).all()
    left = e["residual_s"] - clock_errors(e, clocks)
    assert np.std(left) == pytest.approx(2.5e-4, rel=0.05)
    as_stored(clocks)


def test_clocks_without_pairs_in_both_directions_are_unknown(as_stored):
    one_way = list(itertools.combinations(PLACES, 2))
    e = table_of(one_way, 5, late=lambda *_: 1e-3)
    clocks = known_clocks(e, clock_table(e, e["residual_s"]))
    assert clocks["offset_s"].isna().all()
    assert clocks["standard_error_s"].isna().all()
    assert "none of their pairs was measured in both directions" in unknown_clocks_note(clocks)
    both = [*one_way, ("B", "A"), ("C", "B")]
    mixed = table_of(
        both,
        5,
        late=lambda a, b, _: (
            {"A": 0.0, "B": 2e-3, "C": -1e-3}.get(b, 0) - {"B": 2e-3, "C": -1e-3}.get(a, 0)
        ),
    )
    known = known_clocks(mixed, clock_table(mixed, mixed["residual_s"])).set_index("node")
    np.testing.assert_allclose(
        known.loc[["A", "B", "C"], "offset_s"], np.array([0.0, 2e-3, -1e-3]) - 1e-3 / 3, atol=1e-12
    )
    assert known.loc[["D", "E", "F"], "offset_s"].isna().all()
    assert list(known.loc[["A", "B", "C", "D"], "both_ways"]) == [1, 2, 1, 0]
    as_stored([clocks, known])


def test_times_that_are_no_sound_are_gross_and_do_not_move_clocks(as_stored):
    e = table_of(ALL, 10, noise=1e-4)
    none = pd.DataFrame({"event": [], "travel_time_s": []})
    e["gross"] = find_gross_errors(e, none)
    assert not e["gross"].any()
    assert gross_note(e) is None
    clean = clock_table(e, e["residual_s"])["offset_s"]
    row = int(np.argmax((e["source"] == "A") & (e["receiver"] == "B")))
    e.loc[row, "measured_s"] += 2.7
    e.loc[row, "residual_s"] += 2.7
    later = pd.DataFrame({"event": [3], "travel_time_s": [e["measured_s"][3] + 0.4]})
    e.loc[3, "measured_s"] += 0.4  # a candidate explains it
    e["gross"] = find_gross_errors(e, later)
    assert list(np.flatnonzero(e["gross"])) == [row]
    assert "1 of 300 measured times are no travel times of sound" in gross_note(e)
    np.testing.assert_allclose(clock_table(e, e["residual_s"])["offset_s"], clean, atol=2e-5)
    as_stored([gross_note(e), clock_table(e, e["residual_s"])])


@pytest.mark.parametrize("wrong", ["A", "C", "F"])
def test_only_the_node_with_a_wrong_position_is_suspect(wrong, as_stored):
    offset = np.array([5.0, -6.0])  # true minus stated [m]

    def late(a, b, _):
        step = np.subtract(PLACES[b], PLACES[a])
        along = step / np.linalg.norm(step) @ offset
        return ((b == wrong) - (a == wrong)) * along / SPEED

    e = table_of(ALL, 10, late=late, noise=5e-4)
    nodes = node_table(e, no_clocks(e)).set_index("node")
    assert list(nodes.index[nodes["suspect"]]) == [wrong]
    row = nodes.loc[wrong]
    error = np.hypot(row["north_m"] - offset[0], row["east_m"] - offset[1])
    assert error < 3.0 * row["standard_error_m"]
    assert row["explained"] > 0.9
    right = node_table(e := table_of(ALL, 10, noise=5e-4), no_clocks(e))
    assert not right["suspect"].any()
    if wrong == "C":
        as_stored([nodes, right])


CAMPS = {
    "A": (0.0, 0.0),
    "B": (1400.0, 250.0),
    "C": (-700.0, 1900.0),
    "D": (1500.0, -1700.0),
    "E": (-1300.0, -900.0),
}


def node_campaign(seed, *, water=0.0, ice=0.3, wrong_arrivals=0.0, wrong_by=0.0):
    """
    Events of ten pairs with errors that all events of a pair or of a node share.

    Errors of positions are 0.5 m per axis, at most 2 m. ``water`` is the error of the sound speed,
    for the layers of each node and for all pairs [m/s]; ``ice`` is an error of each pair [m]. Some
    pairs take an arrival that differs by up to 4 m. One node, which is returned too, is wrong by
    ``wrong_by`` metres.
    """
    rng = np.random.default_rng(seed)
    names = list(CAMPS)
    places = {name: rng.normal(0.0, 0.5, 2) for name in names}
    places = {
        name: offset * min(1.0, 1.9 / np.linalg.norm(offset)) for name, offset in places.items()
    }
    node, angle = names[rng.integers(len(names))], rng.uniform(0.0, 2.0 * np.pi)
    places[node] = places[node] + wrong_by * np.array([np.cos(angle), np.sin(angle)])
    slow = dict(
        zip(names, rng.normal(0.0, water, len(names)) + 0.5 * rng.normal(0.0, water), strict=True)
    )
    rows = []
    for a, b in itertools.combinations(names, 2):
        step = np.subtract(CAMPS[b], CAMPS[a])
        distance = np.linalg.norm(step)
        late = (places[b] - places[a]) @ step / distance + rng.normal(0.0, ice)
        late += distance * (slow[a] + slow[b]) / np.sqrt(2.0) / SPEED
        late += (rng.random() < wrong_arrivals) * rng.uniform(-4.0, 4.0)
        for source, receiver, sign in ((a, b, 1.0), (b, a, -1.0)):
            north, east = sign * step
            rows += [
                (
                    source,
                    receiver,
                    f"{a} and {b}",
                    distance,
                    np.degrees(np.arctan2(east, north)),
                    late,
                )
            ] * 2
    table = pd.DataFrame(
        rows, columns=["source", "receiver", "pair", "distance_m", "bearing_deg", "residual_m"]
    )
    seconds = (table.pop("residual_m") + rng.normal(0.0, 0.3, len(table))) / SPEED
    return table.assign(residual_s=seconds, chord_s=table["distance_m"] / SPEED), node, places[node]


ERRORS = {
    "positions and ice": {},
    "water": {"water": 0.7, "ice": 0.5},
    "strong water": {"water": 1.5},
    "wrong arrivals": {"water": 0.5, "ice": 0.5, "wrong_arrivals": 0.15},
}
N_CAMPAIGNS = 80


def suspects(events):
    nodes = node_table(events, no_clocks(events)).set_index("node")
    return nodes[nodes["suspect"]]


@pytest.mark.slow
@pytest.mark.parametrize("errors", ERRORS)
def test_right_nodes_are_suspect_in_at_most_5_percent_of_campaigns(errors):
    """
    With a limit of 4 standard errors from the residuals of one node, 9 to 11 % of these campaigns
    had a suspect.
    """
    flagged = [
        not suspects(node_campaign(seed, **ERRORS[errors])[0]).empty for seed in range(N_CAMPAIGNS)
    ]
    assert np.mean(flagged) <= 0.05


@pytest.mark.parametrize(
    ("wrong_by", "share"), [(5.0, 0.9), pytest.param(7.8, 0.98, marks=pytest.mark.slow)]
)
def test_a_wrong_node_is_found_among_positions_and_ice(wrong_by, share):
    hits, ratios = 0, []
    for seed in range(20):
        events, node, offset = node_campaign(seed, wrong_by=wrong_by)
        table = suspects(events)
        if list(table.index) == [node]:
            hits += 1
            miss = np.hypot(
                *(table.loc[node, ["north_m", "east_m"]].to_numpy(dtype=float) - offset)
            )
            ratios.append(miss / table.loc[node, "standard_error_m"])
    assert hits >= share * 20
    assert np.quantile(ratios, 0.95) < 3.0


def test_one_pair_alone_does_not_make_a_node_suspect():
    events, _, _ = node_campaign(0)
    wrong = events["pair"] == "B and D"
    events.loc[wrong, "residual_s"] += 8.0 / SPEED
    assert suspects(events).empty


def test_errors_that_vary_are_scatter_of_their_node(as_stored):
    rng = np.random.default_rng(3)
    e = table_of(
        ALL, 60, late=lambda a, b, _: ("C" in (a, b)) * rng.normal(0.0, 7.0) / SPEED, noise=7e-4
    )
    nodes = node_table(e, no_clocks(e)).set_index("node")
    assert nodes["scatter_m"].idxmax() == "C"
    assert nodes.loc["C", "scatter_m"] == pytest.approx(7.0, rel=0.15)
    assert nodes["scatter_m"].drop("C").max() < 2.0
    as_stored(nodes)


def test_baselines_learn_from_other_pairs_only(as_stored):
    e = table_of(ALL, 4)
    deep = e["source"].isin(["D", "E", "F"]).astype(int) + e["receiver"].isin(["D", "E", "F"])
    e["source_depth_m"], e["receiver_depth_m"] = 30.0, 30.0 + 100.0 * deep
    true = SPEED + 10.0 * deep  # one speed per pair of depths
    e["measured_s"] = e["distance_m"] / true
    rows = baseline_table(e).set_index("prediction")
    assert rows.loc[BY_DEPTHS, "median_size_m"] < 1e-9
    assert rows.loc[BY_DEPTHS, "p90_all_m"] < 1e-9
    assert rows.loc[CONSTANT, "p90_all_m"] > 5.0
    alone = e[e["pair"] == "A and B"].copy()
    lonely = baseline_table(alone).set_index("prediction")
    assert lonely.loc[CONSTANT, "predicted"] == 0
    assert lonely.loc[CONSTANT, "median_all_m"] == np.inf
    as_stored([rows, lonely])


@pytest.fixture(scope="module")
def spoiled(campaign):
    """
    The campaign with a camp whose stated position is wrong and clocks that drift; offset of the
    camp [m], and the rates.
    """
    events, wrong = campaign.events, np.array([6.0, -5.0])
    rate = dict(zip("ABCDEF", [3e-6, -4e-6, 1e-6, 0.0, 5e-6, -5e-6], strict=True))
    shift = np.array([wrong[0] / 111.6e3, wrong[1] / (111.6e3 * np.cos(np.radians(72.0))), 0.0])
    changes = {
        f"{end}_position": getattr(events, f"{end}_position")
        - np.outer(getattr(events, end) == "C", shift)
        for end in ("source", "receiver")
    }
    drift = np.array(
        [rate[b] - rate[a] for a, b in zip(events.source, events.receiver, strict=True)]
    )
    changes["travel_time"] = events.travel_time + drift * (events.time - events.time.mean())
    result = replay_events(dataclasses.replace(events, **changes), campaign.waters, "within:6")
    return dataclasses.replace(result, clock_drift=True), wrong, rate


@pytest.mark.slow
def test_campaign_with_a_wrong_camp_and_drifting_clocks_returns_both(spoiled):
    result, wrong, rate = spoiled
    nodes = result.nodes.set_index("node")
    assert list(nodes.index[nodes["suspect"]]) == ["C"]
    row = nodes.loc["C"]
    assert (
        np.hypot(row["north_m"] - wrong[0], row["east_m"] - wrong[1])
        < 3.0 * row["standard_error_m"]
    )
    clocks = result.clocks.set_index("node")
    true = pd.Series(rate) - np.mean(list(rate.values()))
    assert (np.abs(clocks["drift"] - true) < 4.0 * clocks["standard_error_drift"]).all()
    assert any("disagree with the ranges" in text for text in result.findings)
    names = list(result.tables)
    assert names.index("baselines") < names.index("nodes") < names.index("events")


@pytest.mark.slow
def test_correction_removes_the_wrong_position_and_the_clocks(spoiled, campaign):
    result, wrong, rate = spoiled
    stated = campaign.events.source_position - np.outer(
        campaign.events.source == "C",
        [wrong[0] / 111.6e3, wrong[1] / (111.6e3 * np.cos(np.radians(72.0))), 0.0],
    )
    drift = np.array(
        [
            rate[b] - rate[a]
            for a, b in zip(campaign.events.source, campaign.events.receiver, strict=True)
        ]
    )
    late = drift * (campaign.events.time - campaign.events.time.mean())
    wrong_events = dataclasses.replace(
        campaign.events, source_position=stated, travel_time=campaign.events.travel_time + late
    )
    right = correct_events(wrong_events, result)
    scale = np.array([111.6e3, 111.6e3 * np.cos(np.radians(72.0)), 1.0])
    before, after = (
        np.abs((e.source_position - campaign.events.source_position) * scale).max()
        for e in (wrong_events, right)
    )
    assert before > 5.0
    assert after < 3.0 * result.nodes.set_index("node").loc["C", "standard_error_m"]
    offset = campaign.truth["offset_s"]
    clock = np.array(
        [offset[b] - offset[a] for a, b in zip(right.source, right.receiver, strict=True)]
    )
    np.testing.assert_allclose(
        wrong_events.travel_time - right.travel_time, clock + late, atol=2e-4
    )


@pytest.mark.slow
def test_page_of_a_replay_has_the_baselines(campaign):
    result = replay_events(campaign.events, campaign.waters, "within:6")
    rows = result.baselines.set_index("prediction")
    assert list(rows.index) == ["rays", CONSTANT, BY_DEPTHS, LAST]
    assert rows.loc["rays", "median_size_m"] < rows.loc[CONSTANT, "median_size_m"]
    assert not result.nodes["suspect"].any()
    assert not result.events["gross"].any()


def test_events_outside_the_water_have_no_clocks_and_no_warning(undrawn, tmp_path, as_stored):
    below = np.array([[0.0, 0.0, 2000.0]] * 4)
    names = np.array(["A", "B"] * 2)
    events = Events(60.0 * np.arange(4), names, names[::-1], below, below + 1.0, np.ones(4), False)
    water = Water(Medium.from_profile([0.0, 900.0], [1440.0, 1455.0], bottom_depth=1000.0))
    replay = replay_events(events, [water])
    assert list(replay.events["status"]) == ["outside"] * 4
    assert not np.isfinite(replay.taken["taken_residual_s"]).any()
    assert write_replay(replay, tmp_path / "page").exists()
    as_stored([replay.events, replay.summary])
