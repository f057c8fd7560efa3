"""
A made-up campaign under rough Arctic ice: six pairs, 1.2 to 3.3 km apart, at depths of 20 to 90 m,
and one-way times.

The ice is a sum of random waves on a grid, the rays are those of the general solver, and the water
differs from the cast by displaced layers. A receiver takes the first arrival above a random
threshold and stays with it for a while. None of this uses the package's rough ice or its
candidates.
"""

import numpy as np
import pandas as pd

from pymantaray.acoustics import BoundarySurface, Medium, find_eigenrays

BOTTOM, DRAFT, SLOPE, LENGTH = 2680.0, 1.5, np.radians(0.5), 20.0
NODES = {  # north, east, depth [m]
    "A": (0.0, 0.0, 30.0),
    "B": (1400.0, 250.0, 90.0),
    "C": (-700.0, 1900.0, 60.0),
    "D": (1100.0, -900.0, 20.0),
}
DEPTH = np.unique(
    np.concatenate(
        [np.arange(0.0, 200.0, 2.0), np.arange(200.0, 600.0, 20.0), [800.0, 1000.0, 2000.0, 2700.0]]
    )
)
STAY = 900.0  # s
ERROR = 2e-4  # s, of a measured time


def cast(shift=0.0):
    """
    Sound speed at DEPTH: cold upward-refracting water with a warm layer and thin steps; layers
    displaced by a shift [m].
    """
    z = DEPTH - shift * np.exp(-(((DEPTH - 60.0) / 50.0) ** 2))
    warm = 6.0 * np.exp(-(((z - 60.0) / 12.0) ** 2)) + 18.0 * (
        1.0 - np.exp(-np.maximum(z - 100.0, 0.0) / 100.0)
    )
    return 1436.0 + 0.016 * z + warm + 0.4 * np.sin(z / 5.0) * (z < 110.0)


def ice(rng, step=5.0, half=2600.0, waves=600):
    """
    Underside of ice as a sum of waves whose wavenumbers are normal, which gives a Gaussian
    spectrum.
    """
    axis = np.arange(-half, half + step, step)
    k = rng.normal(0.0, np.sqrt(2.0) / LENGTH, (2, waves))
    phase = rng.uniform(0.0, 2.0 * np.pi, waves)
    height = LENGTH * np.tan(SLOPE) / np.sqrt(2.0)
    wave = np.exp(1j * np.outer(axis, k[0]) + 1j * phase) @ np.exp(1j * np.outer(axis, k[1])).T
    return BoundarySurface(DRAFT + height * np.sqrt(2.0 / waves) * wave.real, axis, axis)


def arrivals_of(rng, epochs):
    """Times [s], spreading [dB] and ends of each pair in each epoch."""
    under, names, found = ice(rng), list(NODES), {}
    drift = rng.normal(0.0, 0.6, (len(names), 3)) * [1.0, 1.0, 0.1]
    for epoch in range(epochs):
        medium = Medium.from_profile(
            DEPTH, cast(rng.normal(0.0, 1.5)), bottom_depth=BOTTOM, ice_draft=under
        )
        place = {n: np.array(NODES[n]) + epoch * drift[i] for i, n in enumerate(names)}
        pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
        a, b = (np.array([place[pair[k]] for pair in pairs]) for k in range(2))
        rays = find_eigenrays(medium, a, b, 7, 0)
        for i, pair in enumerate(pairs):
            rows = rays.link == i
            found[pair, epoch] = rays.travel_time[rows], rays.spreading_db[rows]
        found[epoch] = place
    return pairs, found


def make_events(seed=5, events=1252, epochs=4, hours=8.0):
    """Events in metres, with the columns of `read_events`."""
    rng = np.random.default_rng(seed)
    pairs, found = arrivals_of(rng, epochs)
    known = {n: rng.normal(0.0, 0.7, 2) for n in NODES}  # errors of the positions
    time = np.sort(rng.uniform(0.0, 3600.0 * hours, events))
    last, rows = {}, []
    for t in time:
        source, receiver = (names := pairs[rng.integers(len(pairs))])[:: rng.choice([1, -1])]
        epoch = min(int(t / (3600.0 * hours) * epochs), epochs - 1)
        arrival, spreading = found[names, epoch]
        place = found[epoch]
        if not arrival.size:
            continue
        distance = np.linalg.norm(np.subtract(place[source], place[receiver]))
        delay = arrival - distance / 1437.0
        before = last.get((source, receiver))
        if before is not None and rng.random() < np.exp(-(t - before[0]) / STAY):
            k = int(np.argmin(np.abs(delay - before[1])))
        else:
            loud = np.flatnonzero(
                spreading + rng.normal(0.0, 4.0, spreading.size) < spreading.min() + 5.0
            )
            k = int(loud[0]) if loud.size else int(np.argmin(spreading))
        last[source, receiver] = t, delay[k]
        ends = {}
        for end, name in (("source", source), ("receiver", receiver)):
            ends[f"{end}_north"], ends[f"{end}_east"] = place[name][:2] + known[name]
            ends[f"{end}_depth"] = place[name][2]
        rows.append(
            {
                "time": t,
                "source": source,
                "receiver": receiver,
                **ends,
                "travel_time": arrival[k] + rng.normal(0.0, ERROR),
            }
        )
    return pd.DataFrame(rows)


def write_campaign(folder, **options):
    """Write events.csv and cast.csv; return the events."""
    table = make_events(**options)
    table.to_csv(folder / "events.csv", index=False)
    fine = np.arange(0.0, 700.0, 1.0)
    fine = np.append(fine, [1000.0, 2000.0, 2700.0])
    pd.DataFrame({"depth": fine, "sound_speed": np.interp(fine, DEPTH, cast())}).to_csv(
        folder / "cast.csv", index=False
    )
    return table
