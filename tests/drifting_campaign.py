"""
A made-up Arctic campaign with known truth: water, stated positions and clocks that drift.

Six nodes at 30 and 90 m, 0.6 to 10 km apart, under ice that reflects. The water between them has a
constant error and one that varies in time, and stated positions err by metres. Receivers take the
first arrival above a random threshold and stay with it for a while; 2 % of the times are wrong. The
rays are those of the general solver, in the true water at the true positions.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from pymantaray.acoustics import BoundarySurface, Medium, find_eigenrays

BOTTOM, DRAFT = 2680.0, 1.5
NODES = {  # north, east, depth [m]
    "A": (0.0, 0.0, 30.0),
    "B": (450.0, 380.0, 90.0),
    "C": (-700.0, 1900.0, 30.0),
    "D": (2500.0, -1700.0, 90.0),
    "E": (-3300.0, -900.0, 30.0),
    "F": (4800.0, 3900.0, 90.0),
}
DEPTH = np.unique(
    np.concatenate(
        [np.arange(0.0, 200.0, 4.0), np.arange(200.0, 600.0, 20.0), [800.0, 1000.0, 2000.0, 2700.0]]
    )
)
FLOE = (0.06, -0.09)  # m/s north and east
STAY = 900.0  # s, for which a receiver stays with an arrival
EPOCH = 1800.0  # s, for which true water and positions are constant
ERROR = 2e-4  # s, of a measured time


class Truth(NamedTuple):
    """Sizes of the errors of a campaign."""

    scale: float = 6e-4  # constant relative error of the slowness
    shift: float = 2.5  # m, displacement of layers that varies in time
    water_hours: float = 5.0
    position: float = 1.5  # m, constant error of each coordinate
    walk: float = 1.0  # m, varying error of each coordinate
    position_hours: float = 6.0
    clock: float = 5e-4  # s
    rate: float = 4e-9  # s/s
    gross: float = 0.02


CONSTANT = Truth(0.0, 0.0, 5.0, 0.0, 0.0, 6.0, 0.0, 0.0)
"""Water and positions as stated, and perfect clocks."""


class Campaign(NamedTuple):
    """Events with the columns of `read_events`, and their true parameters."""

    events: pd.DataFrame
    cast: pd.DataFrame
    truth: dict


def cast(shift=0.0, scale=0.0):
    """Sound speed at DEPTH with displaced layers [m] and a relative error of the slowness."""
    z = DEPTH - shift * np.exp(-(((DEPTH - 70.0) / 60.0) ** 2))
    warm = 6.0 * np.exp(-(((z - 60.0) / 14.0) ** 2))
    warm += 18.0 * (1.0 - np.exp(-np.maximum(z - 110.0, 0.0) / 100.0))
    return (1436.0 + 0.016 * z + warm) * (1.0 - scale)


def varying(rng, sigma, hours, times):
    """Ornstein-Uhlenbeck process at ascending times. [s]"""
    values = np.empty(times.size)
    values[0] = sigma * rng.standard_normal()
    for k in range(1, times.size):
        keep = np.exp(-(times[k] - times[k - 1]) / (3600.0 * hours))
        values[k] = keep * values[k - 1] + sigma * np.sqrt(1.0 - keep**2) * rng.standard_normal()
    return values


def make_campaign(seed=1, events=1252, hours=36.0, truth=None):
    """Events, cast and true parameters."""
    truth = truth or Truth()
    rng = np.random.default_rng(seed)
    names = list(NODES)
    epochs = np.arange(0.0, 3600.0 * hours + EPOCH, EPOCH)
    shift = varying(rng, truth.shift, truth.water_hours, epochs)
    scale = truth.scale
    errors = {
        n: np.stack(
            [
                rng.normal(0.0, truth.position)
                + varying(rng, truth.walk, truth.position_hours, epochs)
                for _ in range(2)
            ]
        )
        for n in names
    }
    offset = {n: rng.normal(0.0, truth.clock) for n in names}
    rate = {n: rng.normal(0.0, truth.rate) for n in names}
    arrivals = _arrivals(names, epochs, shift, scale, errors)
    pings = np.sort(rng.uniform(0.0, 3600.0 * hours, -(-events // 4)))
    rows, last = [], {}
    for at in pings:
        source = names[rng.integers(len(names))]
        others = [n for n in names if n != source]
        for receiver in rng.choice(others, 4, replace=False):
            epoch = round(at / EPOCH)
            taken = _taken(
                arrivals[epoch, min(source, receiver), max(source, receiver)],
                (source, receiver),
                at,
                last,
                rng,
            )
            if taken is None:
                continue
            clock = offset[receiver] - offset[source]
            clock += (at - 1800.0 * hours) * (rate[receiver] - rate[source])
            time = taken + clock + ERROR * rng.standard_normal()
            if rng.random() < truth.gross:
                time += rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.3)
            row = {"time": at, "source": source, "receiver": receiver, "travel_time": abs(time)}
            for end, name in (("source", source), ("receiver", receiver)):
                place = np.array(NODES[name][:2]) + at * np.array(FLOE)
                row[f"{end}_north"], row[f"{end}_east"] = place
                row[f"{end}_depth"] = NODES[name][2]
            rows.append(row)
    fine = np.append(np.arange(0.0, 700.0, 2.0), [1000.0, 2000.0, 2700.0])
    table = pd.DataFrame({"depth": fine, "sound_speed": np.interp(fine, DEPTH, cast())})
    known = {"epochs": epochs, "shift": shift, "scale": scale, "errors": errors}
    return Campaign(pd.DataFrame(rows[:events]), table, known | {"offset": offset, "rate": rate})


def _arrivals(names, epochs, shift, scale, errors):
    """Times and spreading of the arrivals of each pair, in the true water at true positions."""
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    arrivals = {}
    for k in range(epochs.size):
        medium = Medium.from_profile(
            DEPTH, cast(shift[k], scale), bottom_depth=BOTTOM, ice_draft=BoundarySurface(DRAFT)
        )
        place = {n: np.array(NODES[n]) + np.append(errors[n][:, k], 0.0) for n in names}
        a, b = (np.array([place[pair[end]] for pair in pairs]) for end in range(2))
        rays = find_eigenrays(medium, a, b, 4, 0)
        for i, pair in enumerate(pairs):
            rows = rays.link == i
            bounces = rays.surface_bounces[rows]
            arrivals[k, pair[0], pair[1]] = rays.travel_time[rows], rays.spreading_db[rows], bounces
    return arrivals


def _taken(arrivals, way, at, last, rng):
    """Travel time of the arrival that a receiver takes, None without any."""
    time, spreading, bounces = arrivals
    if not time.size:
        return None
    delay = time - time.min()
    before = last.get(way)
    if before is not None and rng.random() < np.exp(-(at - before[0]) / STAY):
        k = int(np.argmin(np.abs(delay - before[1]) + 1e-2 * (bounces != before[2])))
    else:
        level = spreading + rng.normal(0.0, 4.0, spreading.size)
        loud = np.flatnonzero(level < spreading.min() + 5.0)
        k = int(loud[0]) if loud.size else int(np.argmin(spreading))
    last[way] = at, delay[k], bounces[k]
    return time[k]
