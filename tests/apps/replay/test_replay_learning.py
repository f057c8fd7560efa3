"""
Errors of water, positions and clocks that are learned from events: known truth comes back, causal
predictions use earlier events only, and intervals cover.
"""

import numpy as np
import pandas as pd
import pytest
from drifting_campaign import CONSTANT, make_campaign
from refusals import refused

from pymantaray import open_waters
from pymantaray.apps.replay import PredictionOptions, read_events, replay_events
from pymantaray.apps.replay.learned_mixture import learn_mixture
from pymantaray.apps.replay.mixture import predict_mixture
from pymantaray.errors import ReplayError

NODES = {  # north, east, depth
    "A": (0.0, 0.0, 30.0),
    "B": (2500.0, 300.0, 90.0),
    "C": (-900.0, 2900.0, 30.0),
    "D": (2400.0, -3000.0, 90.0),
    "E": (-3300.0, -1900.0, 30.0),
}
SPEED = 1440.0
NOISE = 2e-4
WATER = {"30 and 30 m": 5e-4, "30 and 90 m": -3e-4, "90 and 90 m": 8e-4}
CLOCKS = dict(zip(NODES, (4e-4, -3e-4, 6e-4, 0.0, -5e-4), strict=True))


def drifting(rng, sigma, hours, times):
    """Ornstein-Uhlenbeck process, as a sum of its innovations."""
    values = [sigma * rng.standard_normal()]
    for step in np.diff(times):
        keep = np.exp(-step / (3600.0 * hours))
        values.append(keep * values[-1] + sigma * np.sqrt(1 - keep**2) * rng.standard_normal())
    return np.array(values)


def tables(seed=2, n=900, hours=30.0, size=1.0):
    """
    Events and candidates of straight paths and a later arrival, with errors of a known size, as
    tables of a replay; and the true relative error of the water of each event.
    """
    rng = np.random.default_rng(seed)
    names = list(NODES)
    time = np.sort(rng.uniform(0.0, 3600.0 * hours, n))
    varying = size * drifting(rng, 2e-4, 6.0, time)
    walk = {m: size * np.stack([drifting(rng, 1.0, 5.0, time) for _ in range(2)]) for m in names}
    ends = np.array([rng.choice(names, 2, replace=False) for _ in range(n)])
    places = np.array([[NODES[m] for m in pair] for pair in ends])
    step = places[:, 1] - places[:, 0]
    distance = np.linalg.norm(step, axis=1)
    horizontal = np.hypot(*step[:, :2].T)
    unit = step[:, :2] / horizontal[:, None]
    depths = np.sort(places[:, :, 2], axis=1)
    water = np.array([WATER[f"{a:g} and {b:g} m"] for a, b in depths]) * size + varying
    moved = np.array([walk[r][:, k] - walk[s][:, k] for k, (s, r) in enumerate(ends)])
    clock = size * np.array([CLOCKS[r] - CLOCKS[s] for s, r in ends])
    by_range = horizontal / distance / SPEED
    is_second = rng.random(n) < 0.2
    right = distance / SPEED + 0.012 * is_second
    measured = right * (1.0 - water) + by_range * np.einsum("ni,ni->n", unit, moved) + clock
    measured += NOISE * rng.standard_normal(n)
    gross = rng.random(n) < 0.02
    measured[gross] += rng.uniform(-0.1, 0.1, gross.sum())
    events = pd.DataFrame(
        {
            "time_s": time,
            "source": ends[:, 0],
            "receiver": ends[:, 1],
            "pair": [" and ".join(sorted(pair)) for pair in ends],
            "source_depth_m": places[:, 0, 2],
            "receiver_depth_m": places[:, 1, 2],
            "measured_s": measured,
            "sigma_s": np.nan,
            "distance_m": distance,
            "sound_speed_m_s": SPEED,
            "bearing_deg": np.degrees(np.arctan2(unit[:, 1], unit[:, 0])),
        }
    )
    rows = {
        "event": np.repeat(np.arange(n), 2),
        "travel_time_s": (distance[:, None] / SPEED + [0.0, 0.012]).ravel(),
        "loss_db": np.tile([60.0, 62.0], n),
        "surface_bounces": np.tile([0, 1], n),
        "bottom_bounces": 0,
        "share": 1.0,
        "spread_s": 0.0,
        "by_range": np.repeat(by_range, 2),
    }
    return events, pd.DataFrame(rows), water


def learn(events, candidates, how="causal"):
    found = learn_mixture(events, candidates, PredictionOptions(learn=how), persistence=600.0)
    return found.mixture, found.learned


def errors_of(events, candidates, mixture, correction=0.0):
    """Sizes of the errors of the nearer candidate. [m]"""
    at = candidates["event"].to_numpy()
    off = (events["measured_s"] - correction).to_numpy()[at] - candidates["travel_time_s"]
    return SPEED * off.abs().groupby(at).min().to_numpy()


@pytest.fixture(scope="module")
def campaign():
    events, candidates, water = tables()
    return events, candidates, water, learn(events, candidates)


@pytest.fixture(scope="module")
def short():
    events, candidates, _ = tables(n=250)
    return events, candidates, learn(events, candidates)[1]


@pytest.mark.slow
def test_causal_intervals_cover_events_that_were_not_used(campaign):
    events, _, _, (mixture, _) = campaign
    inside = events["measured_s"].between(mixture.events["low_s"], mixture.events["high_s"])
    assert 0.90 <= inside.mean() <= 0.97
    assert 0.90 <= inside[300:].mean() <= 0.97


@pytest.mark.slow
def test_water_clocks_and_sizes_come_back_within_their_errors(campaign):
    events, _, water, (_, learned) = campaign
    table = learned.history
    off = []
    for row in table[table["time_h"] > 10.0].itertuples():
        depths = np.sort(events[["source_depth_m", "receiver_depth_m"]].to_numpy(), axis=1)
        same = [f"{a:g} and {b:g} m" == row.depths for a, b in depths]
        near = np.abs(events["time_s"] / 3600.0 - row.time_h).where(same).argmin()
        off.append((row.relative_error - water[near]) / row.sigma)
    assert np.sqrt(np.mean(np.square(off))) < 1.6
    clocks = learned.states[learned.states["kind"] == "clock"].set_index("name")
    value = clocks["value"] - clocks["value"].mean()
    true = pd.Series(CLOCKS) - np.mean(list(CLOCKS.values()))
    assert (np.abs(value - true) < 3.0 * clocks["sigma"]).all()
    assert learned.sizes.unexplained_s == pytest.approx(NOISE, rel=0.6)
    assert 0.4 < learned.sizes.position_varying_m < 2.0


def test_learning_removes_most_of_the_error(short, as_stored):
    events, candidates, learned = short
    plain = np.median(errors_of(events, candidates, None))
    corrected = np.median(errors_of(events, candidates, None, learned.parts.sum(axis=1)))
    assert corrected < 0.5 * plain
    as_stored(learned)


@pytest.mark.slow
def test_later_events_do_not_change_earlier_predictions(campaign):
    events, candidates, _, (mixture, learned) = campaign
    n = 200
    changed = events.copy()
    changed.loc[n:, "measured_s"] += 3e-3
    other, more = learn(changed, candidates)
    np.testing.assert_array_equal(more.parts[: n + 1], learned.parts[: n + 1])
    for name in ("low_s", "high_s", "mixture_s"):
        np.testing.assert_array_equal(other.events[name][: n + 1], mixture.events[name][: n + 1])
    assert (more.parts[n + 1] != learned.parts[n + 1]).any()


@pytest.mark.slow
def test_smooth_predictions_err_less(campaign):
    events, candidates, _, (causal_mixture, causal) = campaign
    mixture, smooth = learn(events, candidates, "smooth")
    sizes = [
        np.median(errors_of(events, candidates, None, one.parts.sum(axis=1)))
        for one in (smooth, causal)
    ]
    assert sizes[0] < sizes[1]
    assert mixture.events["log_likelihood"].mean() > causal_mixture.events["log_likelihood"].mean()
    inside = events["measured_s"].between(mixture.events["low_s"], mixture.events["high_s"])
    assert 0.90 <= inside.mean() <= 0.97


@pytest.mark.slow
def test_smooth_predictions_leave_their_own_event_out(short):
    events, candidates, _ = short
    changed = events.copy()
    changed.loc[125, "measured_s"] += 5e-4
    before, after = (
        learn(table, candidates, "smooth")[1].parts.sum(axis=1) for table in (events, changed)
    )
    moved = np.abs(after - before)
    assert moved[125] < 0.2 * moved[115:136].max()


@pytest.mark.slow
def test_water_that_is_right_stays_right(as_stored):
    events, candidates, _ = tables(3, n=200, size=0.0)
    mixture, learned = learn(events, candidates)
    plain = predict_mixture(events, candidates, PredictionOptions(), persistence=600.0)
    before = errors_of(events, candidates, None)
    after = errors_of(events, candidates, None, learned.parts.sum(axis=1))
    assert np.median(after) < 1.05 * np.median(before)
    assert np.quantile(after, 0.9) < 1.05 * np.quantile(before, 0.9)
    late = slice(100, None)
    assert mixture.events["log_likelihood"][late].mean() > (
        plain.events["log_likelihood"][late].mean() - 0.02
    )
    as_stored([mixture, plain])


def test_errors_that_exist_are_found_within_some_events(short):
    *_, learned = short
    assert learned.no_error_after < 1e-2


def test_clocks_far_worse_than_usual_are_found_after_some_events():
    """Clocks that gain up to 8 ms in a day, 160 times what is expected."""
    events, candidates, _ = tables(seed=5, n=120, hours=12.0, size=0.0)
    rate = pd.Series(dict(zip(NODES, (8e-3, -8e-3, 4e-3, -4e-3, 0.0), strict=True)))
    days = events["time_s"] / 86400.0
    late = days * (rate[events["receiver"]].to_numpy() - rate[events["source"]].to_numpy())
    drifted = events.assign(measured_s=events["measured_s"] + late)
    _, learned = learn(drifted, candidates)
    assert learned.sizes.rate_s_per_day > 2e-3
    left = errors_of(drifted, candidates, None, learned.parts.sum(axis=1))
    assert np.median(left[60:]) < 0.25 * np.median(errors_of(drifted, candidates, None)[60:])


@pytest.mark.slow
def test_levels_tell_arrivals_apart():
    """The later arrival is 12 dB weaker; receivers take one or the other at random."""
    events, candidates, _ = tables(seed=4, n=400, size=0.0)
    candidates = candidates.assign(loss_db=np.tile([60.0, 72.0], len(events)))
    late = events["measured_s"] - events["distance_m"] / SPEED > 6e-3
    level = 190.0 - np.where(late, 72.0, 60.0) + np.random.default_rng(1).normal(0, 2, len(events))
    measured = events.assign(measured_level_db=level)
    with_levels, _ = learn(measured, candidates)
    without, _ = learn(events, candidates)
    assert (
        with_levels.events["log_likelihood"][100:].mean()
        > without.events["log_likelihood"][100:].mean() + 0.3
    )


def test_numbers_of_smooth_learning_with_levels_stay(as_stored):
    events, candidates, _ = tables(n=9, hours=4.0)
    candidates = candidates.assign(loss_db=np.tile([60.0, 72.0], len(events)))
    late = events["measured_s"] - events["distance_m"] / SPEED > 6e-3
    level = 190.0 - np.where(late, 72.0, 60.0)
    mixture, learned = learn(events.assign(measured_level_db=level), candidates, "smooth")
    as_stored([mixture, learned])


def test_words_of_learning_are_checked(campaign_files):
    refused(
        ReplayError,
        "learn is 'often'; allowed are causal and smooth",
        PredictionOptions,
        learn="often",
    )
    refused(
        ReplayError,
        "rule first: learning needs the rule persist",
        replay_events,
        read_events(campaign_files / "events.csv"),
        open_waters(campaign_files / "cast.csv", bathymetry=2680.0),
        "first",
        options=PredictionOptions(learn="causal"),
    )


@pytest.fixture(scope="module")
def campaign_files(tmp_path_factory):
    """Folder with 60 events in right water."""
    folder = tmp_path_factory.mktemp("drifting")
    campaign = make_campaign(1, 60, 2.0, CONSTANT)
    campaign.events.to_csv(folder / "events.csv", index=False)
    campaign.cast.to_csv(folder / "cast.csv", index=False)
    return folder


@pytest.mark.slow
def test_a_replay_has_tables_of_what_was_learned(campaign_files, mantaray, monkeypatch):
    monkeypatch.chdir(campaign_files)
    words = ("--profile", "cast.csv", "--bathymetry", 2680, "--max-surface-bounces", 4)
    done = mantaray("replay", "events.csv", *words, "--ice", 1.5, "--learn", "--out", "out")
    assert done.code == 0, done.err
    assert "unexplained_s" in done.out
    tables_of = campaign_files / "out" / "tables"
    events = pd.read_csv(tables_of / "events.csv")
    parts = events[[f"learned_{name}_s" for name in ("water", "position", "pair", "clock")]]
    assert (parts.iloc[0] == 0.0).all()
    horizons = pd.read_csv(tables_of / "horizons.csv")
    assert horizons["since_last"].iloc[0] == "all"
    assert set(pd.read_csv(tables_of / "followed.csv")["event"]) <= set(range(1, len(events) + 1))
    assert (parts.iloc[30:] != 0.0).any().all()
    water = pd.read_csv(tables_of / "learned_water.csv")
    assert set(water["depths"]) == {"30 and 30 m", "30 and 90 m", "90 and 90 m"}
    assert (pd.read_csv(tables_of / "learned.csv")["sigma"] > 0.0).all()
    assert "Relative error of the sound speed" in (campaign_files / "out/index.html").read_text()


def replayed(folder, how):
    campaign = make_campaign(3, 700, 24.0)
    campaign.events.to_csv(folder / "events.csv", index=False)
    campaign.cast.to_csv(folder / "cast.csv", index=False)
    water = open_waters(folder / "cast.csv", bathymetry=2680.0, max_surface_bounces=4, ice=1.5)
    options = [PredictionOptions(), PredictionOptions(learn=how)]
    events = read_events(folder / "events.csv")
    return campaign.truth, [
        replay_events(events, water, "persist", options=option) for option in options
    ]


def median_of(replay):
    return replay.events["residual_m"].abs().fillna(np.inf).median()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* have more eigenrays than are")
def test_a_campaign_by_rays_with_drifting_errors_returns_them(tmp_path):
    truth, (plain, learned) = replayed(tmp_path, "causal")
    assert median_of(learned) < min(1.0, 0.4 * median_of(plain))
    late = learned.events[200:]
    assert 0.90 <= late["measured_s"].between(late["low_s"], late["high_s"]).mean() <= 0.97
    clocks = learned.more["learned"].query("kind == 'clock'").set_index("name")
    value = clocks["value"] - clocks["value"].mean()
    true = pd.Series(truth["offset"]) - np.mean(list(truth["offset"].values()))
    assert (np.abs(value - true[value.index]) < 3.0 * clocks["sigma"]).all()
