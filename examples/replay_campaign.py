"""
Make up a campaign of measured travel times whose truth is known, for `mantaray replay`.

Six nodes hang under drifting ice and send in turn for an hour. Clocks are off, receivers change now
and then to a later arrival and stay with it, two casts were taken, and some receptions come where
no ray goes. `python examples/replay_campaign.py FOLDER` writes events.csv, casts.csv and
truth.json. `python examples/replay_campaign.py FOLDER rough` makes another campaign: eight hours
between six nodes on rough fast ice, clocks that drift, and one node with a wrong position.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from pymantaray.acoustics import (
    BoundarySurface,
    Medium,
    choose_arrivals,
    find_eigenrays,
    link_loss_db,
)
from pymantaray.geometry import LocalFrame, stream
from pymantaray.geometry.roughness import Roughness

BOTTOM = 3000.0  # m
START = np.datetime64("2020-03-10T12:00:00", "ms")
CENTRE = (72.0, -145.0)
NODES = {  # north, east, depth [m]
    "A": (0.0, 0.0, 30.0),
    "B": (1500.0, 200.0, 150.0),
    "C": (-1400.0, 2700.0, 150.0),
    "D": (3200.0, 3160.0, 70.0),
    "E": (-3300.0, -4600.0, 30.0),
    "F": (1800.0, -2500.0, 150.0),
}
OFFSETS = {
    "A": 0.8e-3,
    "B": -2.1e-3,
    "C": 3.4e-3,
    "D": -0.6e-3,
    "E": 1.9e-3,
    "F": -3.4e-3,
}  # s, of the clocks
SIGMA = 0.25e-3  # s, of a measured time
SHARE = 0.735  # of pings on which the first candidate is taken
CORRELATION = 247.0  # s, for which a receiver stays with a candidate
INTERVAL, DURATION = 45.0, 3600.0  # s, between a node's pings, and of the campaign
DRIFT = (0.05, -0.12)  # m/s north and east, of the ice
DEPTH = np.array([0, 20, 40, 50, 60, 80, 100, 150, 200, 300, 400, 600, 800, 1000, 2000, 3000.0])
SPEED = np.array(
    [
        1434.5,
        1435,
        1436,
        1439,
        1442.5,
        1440,
        1438.5,
        1440,
        1443,
        1453,
        1457,
        1460,
        1462.5,
        1465.5,
        1481.5,
        1498,
    ]
)
# the campaign on rough ice
CAMPS = {  # north, east, depth [m]
    "A": (0.0, 0.0, 30.0),
    "B": (1400.0, 250.0, 45.0),
    "C": (-700.0, 1900.0, 50.0),
    "D": (1500.0, -1700.0, 20.0),
    "E": (-1300.0, -900.0, 40.0),
    "F": (800.0, 1800.0, 35.0),
}
DRIFTS = {
    "A": 1.0e-7,
    "B": -2.0e-7,
    "C": 0.5e-7,
    "D": 2.0e-7,
    "E": -1.5e-7,
    "F": 0.0,
}  # s/s, of the clocks
WRONG_CAMP, WRONG_BY = "C", (6.0, -5.0)  # true minus stated position, north and east [m]
ICE, SLOPE, LENGTH, TRUE_DRAW = 1.5, math.radians(0.5), 20.0, 1000
BOUNCES = 7
TURN, HOURS = 600.0, 8.0  # s between a node's pings, and hours of the campaign
STAY = 900.0  # s, for which a receiver stays with an arrival
LEVEL_SIGMA, WITHIN = (
    4.0,
    5.0,
)  # dB: spread of a level, and of the levels that are detected below the strongest


def casts() -> dict[str, tuple[np.datetime64, np.ndarray]]:
    """Time and sound speed of two casts; between them the warm layer has sunk."""
    later = SPEED + 0.8 * np.exp(-(((DEPTH - 80.0) / 25.0) ** 2))
    return {"first": (START, SPEED), "second": (START + np.timedelta64(int(DURATION), "s"), later)}


def schedule() -> pd.DataFrame:
    """Who sends to whom, and when; nodes take turns."""
    names = list(NODES)
    rows = [
        (ping * INTERVAL + turn * INTERVAL / len(names), source, receiver)
        for ping in range(int(DURATION / INTERVAL))
        for turn, source in enumerate(names)
        for receiver in names
        if receiver != source
    ]
    return pd.DataFrame(rows, columns=["seconds", "source", "receiver"])


def places(events: pd.DataFrame, end: str) -> np.ndarray:
    """North, east and depth of one end of each event. [m]"""
    start = np.array([NODES[name] for name in events[end]])
    return start + events["seconds"].to_numpy()[:, None] * np.array([*DRIFT, 0.0])


def travel_times(events: pd.DataFrame, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Travel time of the arrival that each receiver takes [s], and whether any ray came."""
    source, receiver = places(events, "source"), places(events, "receiver")
    nearest = np.round(events["seconds"].to_numpy() / DURATION).astype(int)
    time, heard = np.empty(len(events)), np.zeros(len(events), dtype=bool)
    choice = later_candidate(events, seed)
    for number, (_, speed) in enumerate(casts().values()):
        rows = np.flatnonzero(nearest == number)
        medium = Medium.from_profile(DEPTH, speed, bottom_depth=BOTTOM)
        a = find_eigenrays(medium, source[rows], receiver[rows], max_surface_bounces=2)
        least = link_loss_db(a.spreading_db, a.link, rows.size)
        candidate = a.spreading_db <= least[a.link] + 6.0
        chosen = choose_arrivals(a, "first", detected=candidate)
        candidate[chosen.row] = False
        other = choose_arrivals(a, "first", detected=candidate)
        straight = np.linalg.norm(receiver[rows] - source[rows], axis=-1) / 1440.0
        time[rows] = straight + 2e-3  # what leaks into a shadow
        time[rows[chosen.link]] = a.travel_time[chosen.row]
        switched = choice[rows[other.link]]
        time[rows[other.link[switched]]] = a.travel_time[other.row[switched]]
        heard[rows[chosen.link]] = True
    return time, heard


def later_candidate(events: pd.DataFrame, seed: int) -> np.ndarray:
    """
    Whether each receiver is on the second candidate: a Markov chain of each sender and receiver.
    """
    second = np.zeros(len(events), dtype=bool)
    stays = math.exp(-INTERVAL / CORRELATION)
    for (source, receiver), rows in events.groupby(["source", "receiver"]).groups.items():
        draw = stream(seed, 0, "campaign", source, receiver)
        now = False
        for i, row in enumerate(rows):
            if i == 0 or draw.random() > stays:
                now = draw.random() > SHARE
            second[row] = now
    return second


def write_drifting(out: Path, seed: int) -> None:
    """Write the campaign under drifting ice."""
    events = schedule()
    time, heard = travel_times(events, seed)
    noise = SIGMA * stream(seed, 0, "campaign", "noise").standard_normal(len(events))
    clock = events["receiver"].map(OFFSETS) - events["source"].map(OFFSETS)
    frame = LocalFrame(*CENTRE)
    table = pd.DataFrame(
        {"time": START + (1e3 * events["seconds"]).round().astype("timedelta64[ms]")}
    )
    for end in ("source", "receiver"):
        place = places(events, end)
        lat, lon = frame.to_geodetic(place[:, 0], place[:, 1])
        table[end], table[f"{end}_lat"], table[f"{end}_lon"] = events[end], lat, lon
        table[f"{end}_depth"] = place[:, 2]
    table["travel_time"] = time + clock + noise
    table["sigma"] = SIGMA
    table.to_csv(
        out / "events.csv", index=False, date_format="%Y-%m-%dT%H:%M:%S.%f", float_format="%.12g"
    )
    rows = [
        {"station": name, "time": str(when), "depth": z, "sound_speed": c}
        for name, (when, speed) in casts().items()
        for z, c in zip(DEPTH, speed, strict=True)
    ]
    pd.DataFrame(rows).to_csv(out / "casts.csv", index=False)
    truth = {
        "offset_s": OFFSETS,
        "sigma_s": SIGMA,
        "share_of_first": SHARE,
        "correlation_s": CORRELATION,
        "events": len(events),
        "without_a_ray": int((~heard).sum()),
    }
    (out / "truth.json").write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")
    print(f"{out}: {len(events)} events, {int((~heard).sum())} of them where no ray goes")


def rays_on_ice() -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
    """Times [s] and spreading [dB] of the arrivals of each pair, the same in both directions."""
    rough = BoundarySurface(ICE, roughness=Roughness(SLOPE, LENGTH, draw=TRUE_DRAW))
    medium = Medium.from_profile(DEPTH, SPEED, bottom_depth=BOTTOM, ice_draft=rough)
    pairs = [(a, b) for a in CAMPS for b in CAMPS if a < b]
    source, receiver = (np.array([CAMPS[pair[k]] for pair in pairs]) for k in range(2))
    rays = find_eigenrays(medium, source, receiver, BOUNCES)
    return {
        pair: (rays.travel_time[rays.link == i], rays.spreading_db[rays.link == i])
        for i, pair in enumerate(pairs)
    }


def taken_arrival(spreading: np.ndarray, draw: np.random.Generator) -> int:
    """Row of the first arrival that a receiver detects."""
    loud = np.flatnonzero(
        spreading + LEVEL_SIGMA * draw.standard_normal(spreading.size) < spreading.min() + WITHIN
    )
    return int(loud[0]) if loud.size else int(np.argmin(spreading))


def events_on_ice(seed: int) -> pd.DataFrame:
    """Receptions of all nodes, which send in turn, in the local frame."""
    names, rays = list(CAMPS), rays_on_ice()
    rows = []
    for source in names:
        for receiver in names:
            if receiver == source:
                continue
            time, spreading = rays[min(source, receiver), max(source, receiver)]
            if not time.size:
                continue  # a shadow for this ice
            draw = stream(seed, 0, "campaign", "rough", source, receiver)
            taken = -1
            for at in np.arange(0.0, 3600.0 * HOURS, TURN) + names.index(source) * TURN / len(
                names
            ):
                if taken < 0 or draw.random() > math.exp(-TURN / STAY):
                    taken = taken_arrival(spreading, draw)
                late = at - 1800.0 * HOURS
                clock = (
                    OFFSETS[receiver] - OFFSETS[source] + late * (DRIFTS[receiver] - DRIFTS[source])
                )
                rows.append(
                    (at, source, receiver, time[taken] + clock + SIGMA * draw.standard_normal())
                )
    table = pd.DataFrame(rows, columns=["time", "source", "receiver", "travel_time"])
    for end in ("source", "receiver"):
        place = np.array([CAMPS[name] for name in table[end]])
        place[:, :2] -= np.outer(table[end] == WRONG_CAMP, WRONG_BY)
        for k, axis in enumerate(("north", "east", "depth")):
            table[f"{end}_{axis}"] = place[:, k]
    return table.sort_values(["time", "receiver"], ignore_index=True)


def write_on_ice(out: Path, seed: int) -> None:
    """Write the campaign on rough ice."""
    events = events_on_ice(seed)
    events.to_csv(out / "events.csv", index=False, float_format="%.12g")
    pd.DataFrame({"depth": DEPTH, "sound_speed": SPEED}).to_csv(out / "cast.csv", index=False)
    truth = {
        "offset_s": OFFSETS,
        "drift": DRIFTS,
        "mean_time_s": 1800.0 * HOURS,
        "wrong_camp": WRONG_CAMP,
        "wrong_by_m": WRONG_BY,
        "sigma_s": SIGMA,
    }
    (out / "truth.json").write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")
    print(f"{out}: {len(events)} events on rough ice")


def main(folder: str = "campaign", kind: str = "drifting", seed: int = 1) -> None:
    """Write a campaign, "drifting" or "rough"."""
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    if kind == "rough":
        write_on_ice(out, seed)
    else:
        write_drifting(out, seed)


if __name__ == "__main__":
    main(*sys.argv[1:3])
