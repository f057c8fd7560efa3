"""
A made-up campaign whose ice and water the prediction does not know, by rays of another scheme.

Four nodes at 30 to 90 m, 1.0 to 2.6 km apart, measure in bursts with gaps of 10 s to hours. Rays
are stepped through the vertical plane of each pair, in water with thin layers and under an ice
whose amplitudes drift. Clocks drift, stated positions err, and some receptions have a delay that
no ray has. A receiver stays with its arrival for a while.
"""

import numpy as np
import pandas as pd

NODES = {  # north, east, depth [m]
    "A": (0.0, 0.0, 30.0),
    "B": (1300.0, 250.0, 90.0),
    "C": (-600.0, 1700.0, 60.0),
    "D": (900.0, -900.0, 45.0),
}
PAIRS = [(a, b) for i, a in enumerate(NODES) for b in list(NODES)[i + 1 :]]
DEPTH = np.append(np.arange(0.0, 700.0), [1000.0, 2000.0, 2700.0])
DRAFT, SLOPE, LENGTH = 2.2, np.radians(1.0), 14.0
STAY = 900.0  # s
ERROR = 2e-4  # s, of a measured time
GHOSTS = 0.08  # share of choices that no ray has
STEP, RAYS, FAN, MAX_BOUNCES = 2.5, 2401, np.radians(24.0), 7


def cast(shift=0.0):
    """Sound speed at DEPTH; layers displaced by a shift. [m]"""
    z = DEPTH - shift * np.exp(-(((DEPTH - 60.0) / 50.0) ** 2))
    warm = 6.0 * np.exp(-(((z - 60.0) / 12.0) ** 2))
    warm += 18.0 * (1.0 - np.exp(-np.maximum(z - 100.0, 0.0) / 100.0))
    return 1436.0 + 0.016 * z + warm + 0.4 * np.sin(z / 5.0) * (z < 110.0)


class Ice:
    """Draft along the track of a pair: a sum of waves whose amplitudes drift."""

    def __init__(self, rng, waves=150):
        self.rng = rng
        self.wavenumber = np.abs(rng.normal(0.0, np.sqrt(2.0) / LENGTH, waves))
        self.size = LENGTH * np.tan(SLOPE) / np.sqrt(2.0 * waves)
        self.amplitude = self.size * rng.normal(size=(2, waves))

    def drift(self, keep):
        new = self.size * self.rng.normal(size=self.amplitude.shape)
        self.amplitude = keep * self.amplitude + np.sqrt(1.0 - keep**2) * new

    def draft(self, x):
        """Draft and its slope."""
        phase = np.outer(x, self.wavenumber)
        cosine, sine = np.cos(phase), np.sin(phase)
        over, under = self.amplitude
        slope = cosine @ (self.wavenumber * under) - sine @ (self.wavenumber * over)
        return DRAFT + cosine @ over + sine @ under, slope


def arrivals(speed, ice, source, receiver, reach):
    """Travel times and spreading losses of the rays between two depths at a range. [s, dB]"""
    fine = np.arange(0.0, 2700.0, 0.5)
    speeds = np.interp(fine, DEPTH, speed)
    bending = np.interp(fine, DEPTH, -np.gradient(speed, DEPTH)) / speeds
    angle, depth = np.linspace(-FAN, FAN, RAYS), np.full(RAYS, source)
    time, bounces = np.zeros(RAYS), np.zeros(RAYS, dtype=int)
    steps = int(np.ceil(reach / STEP))
    dx = reach / steps
    grid = np.arange(-20.0, reach + 20.0)
    draft, slope = ice.draft(grid)
    for k in range(1, steps + 1):
        middle = depth + 0.5 * dx * np.tan(angle)
        cell = np.clip((middle / 0.5 + 0.5).astype(int), 0, fine.size - 1)
        turn = bending[cell] * dx
        mean = angle + 0.5 * turn
        depth, angle = depth + dx * np.tan(mean), angle + turn
        time += dx / np.cos(mean) / speeds[cell]
        above = np.interp(k * dx, grid, draft) - depth
        hit = above > 0.0
        depth = np.where(hit, depth + 2.0 * above, depth)
        angle = np.where(hit, 2.0 * np.arctan(np.interp(k * dx, grid, slope)) - angle, angle)
        bounces += hit
    step = np.diff(depth)
    same = (bounces[1:] == bounces[:-1]) & (bounces[1:] <= MAX_BOUNCES) & (np.abs(step) < 400.0)
    crosses = np.flatnonzero(same & ((depth[1:] - receiver) * (depth[:-1] - receiver) <= 0.0))
    between = (receiver - depth[crosses]) / (step[crosses] + 1e-12)
    found = time[crosses] + between * np.diff(time)[crosses]
    tube = reach * np.abs(step[crosses]) * (RAYS - 1) / (2.0 * FAN)
    order = np.argsort(found)
    return found[order], 10.0 * np.log10(np.maximum(tube, 1.0))[order]


def make_campaign(seed, events=1252, hours=14.0, epoch=600.0):
    """Events with the columns of `read_events`, and the cast that the prediction has."""
    rng = np.random.default_rng(seed)
    sea = list(_seas(rng, int(np.ceil(3600.0 * hours / epoch)), epoch / 3600.0))
    place = {name: rng.normal(0.0, 0.7, 2) for name in NODES}
    offset = {name: rng.normal(0.0, 2e-4) for name in NODES}
    rate = {name: rng.normal(0.0, 3e-9) for name in NODES}
    ghost = {(a, b): rng.uniform(2e-3, 25e-3) for a in NODES for b in NODES}
    rows, last = [], {}
    for at, source in _pings(rng, 3600.0 * hours):
        found, nodes = sea[int(at / epoch)]
        for receiver in NODES:
            if receiver == source or rng.random() < 0.55 or len(rows) == events:
                continue
            way = source, receiver
            times, losses = found[way if way in found else way[::-1]]
            if not times.size:
                continue
            straight = np.linalg.norm(nodes[source] - nodes[receiver]) / 1437.0
            taken = _taken(times, losses, straight, last.get(way), at, ghost[way], rng)
            last[way] = at, taken - straight
            clock = offset[receiver] - offset[source] + (rate[receiver] - rate[source]) * at
            row = {"time": at, "source": source, "receiver": receiver}
            for end, name in (("source", source), ("receiver", receiver)):
                north, east = nodes[name][:2] + place[name] + rng.normal(0.0, 0.15, 2)
                row |= {f"{end}_north": north, f"{end}_east": east}
                row[f"{end}_depth"] = nodes[name][2]
            rows.append(row | {"travel_time": taken + clock + rng.normal(0.0, ERROR)})
    return pd.DataFrame(rows), pd.DataFrame({"depth": DEPTH, "sound_speed": cast()})


def _seas(rng, epochs, hours):
    """Arrivals of all pairs, and places of nodes, in each epoch."""
    sizes, centres, widths = rng.normal(0.0, 1.6, 5), rng.uniform(10, 110, 5), rng.uniform(3, 9, 5)
    layers = zip(sizes, centres, widths, strict=True)
    thin = sum(a * np.exp(-(((DEPTH - z) / w) ** 2)) for a, z, w in layers)
    ice = {pair: Ice(rng) for pair in PAIRS}
    walk = {name: np.zeros(3) for name in NODES}
    shift = rng.normal(0.0, 1.5)
    keep = np.exp(-hours / 5.0)
    for _ in range(epochs):
        nodes = {name: np.array(NODES[name]) + walk[name] for name in NODES}
        found = {}
        for a, b in PAIRS:
            reach = float(np.hypot(*(nodes[b] - nodes[a])[:2]))
            ends = nodes[a][2], nodes[b][2]
            found[a, b] = arrivals(cast(shift) + thin, ice[a, b], *ends, reach)
            ice[a, b].drift(np.exp(-hours / 12.0))
        yield found, nodes
        shift = keep * shift + 1.5 * np.sqrt(1.0 - keep**2) * rng.normal()
        for step in walk.values():
            step += rng.normal(0.0, 0.5 * np.sqrt(hours), 3) * [1.0, 1.0, 0.1]


def _pings(rng, duration):
    """Times and sources: bursts in which the nodes take turns, with gaps of 10 s to 2.5 hours."""
    at, turn = 0.0, 0
    while at < duration:
        end = at + rng.uniform(60.0, 500.0)
        while at < min(end, duration):
            yield at, list(NODES)[turn % len(NODES)]
            turn += 1
            at += rng.choice([5.0, 10.0, 20.0])
        at += np.exp(rng.uniform(np.log(10.0), np.log(9000.0)))


def _taken(times, losses, straight, before, at, ghost, rng):
    """Travel time that a receiver takes: that of its last arrival, of a loud ray, or of none."""
    every = np.append(times, times.min() + ghost)
    if before is not None and rng.random() < np.exp(-(at - before[0]) / STAY):
        return every[np.argmin(np.abs(every - straight - before[1]))]
    if rng.random() < GHOSTS:
        return every[-1]
    loud = np.flatnonzero(losses + rng.normal(0.0, 4.0, losses.size) < losses.min() + 5.0)
    return times[loud[0]] if loud.size else times[np.argmin(losses)]
