"""
Made-up surveys in water that drifts, with what a solver does not model: tide, internal waves, an
Ornstein-Uhlenbeck process, a trend, errors of the satellite positions and noise with a memory.
"""

from dataclasses import dataclass

import numpy as np
from campaigns import GRADIENT, SURFACE_SPEED, direct_time

from pymantaray.acoustics import Medium
from pymantaray.apps.locate import Node, Survey

M2_PERIOD = 44_714.0  # s
STEP = 20.0  # s; of the made-up time series


@dataclass
class DriftingSurvey:
    """A survey, the true positions of its nodes, and what drifted."""

    survey: Survey
    truth: np.ndarray  # (k, 3) m
    depth: float
    span: float  # s
    rms_fraction: float  # of the sound speed

    def half(self, which):
        """First (0) or second (1) half in time as a survey of its own."""
        first = self.survey.time < np.median(self.survey.time)
        return self.survey.rows(first if which == 0 else ~first)


def ornstein_uhlenbeck(rng, count, memory, step=STEP):
    """Stationary process of unit variance whose correlation falls to 1/e in the memory [s]."""
    keep = np.exp(-step / memory)
    out = np.empty(count)
    value = rng.normal()
    for i in range(count):
        out[i] = value
        value = keep * value + np.sqrt(1.0 - keep**2) * rng.normal()
    return out


def internal_waves(rng, time, slowest=43_200.0, fastest=600.0):
    """Sum of 300 waves of unit variance whose spectrum falls with the square of the frequency."""
    edges = np.geomspace(1.0 / slowest, 1.0 / fastest, 301)
    frequency = np.sqrt(edges[1:] * edges[:-1])
    size = np.sqrt(2.0 * np.diff(edges) / frequency**2)
    size /= np.sqrt(0.5 * np.sum(size**2))
    phase = rng.uniform(0.0, 2.0 * np.pi, size.size)
    out = np.zeros(time.size)
    for f, a, p in zip(frequency, size, phase, strict=True):
        out += a * np.cos(2.0 * np.pi * f * time + p)
    return out


def water_series(rng, time, rms):
    """Fraction by which the water is faster than the profile, of a total rms (before a trend)."""
    tide = np.sqrt(2.0) * np.cos(2.0 * np.pi * time / M2_PERIOD + rng.uniform(0.0, 2.0 * np.pi))
    memory = np.exp(rng.uniform(np.log(600.0), np.log(21_600.0)))
    parts = [tide, ornstein_uhlenbeck(rng, time.size, memory), internal_waves(rng, time)]
    shares = rng.dirichlet(np.ones(3))
    trend = rng.normal() * (time / 86_400.0 - 0.5 * time[-1] / 86_400.0)
    return rms * (np.sqrt(shares) @ np.array(parts) + trend) + rng.normal(0.0, 3e-4)


def constant_water(rng, time, _):
    """Fraction by which the water is faster than the profile, constant."""
    return np.full(time.size, rng.normal(0.0, 3e-4))


def deep_water():
    """Profile of the surveys as a medium."""
    depth = np.array([0.0, 7000.0])
    return Medium.from_profile(
        depth, SURFACE_SPEED + GRADIENT * depth, bottom_depth=7000.0, interpolation="linear"
    )


def pattern(time, radius, speed):
    """Circle, two diameters and a slow drift near the centre, one after the other, repeated."""
    laps = np.array([2.0 * np.pi * radius, 2.0 * radius, np.sqrt(2.0) * radius, 2.0 * radius])
    legs = np.append(laps / speed, 0.3 * radius / speed)
    ends = np.cumsum(legs)
    phase = np.mod(time, ends[-1])
    leg = np.searchsorted(ends, phase, side="right")
    along = (phase - np.append(0.0, ends[:-1])[leg]) / legs[leg]
    angle = 2.0 * np.pi * along
    corners = radius * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    out = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    for k in (1, 2, 3):
        line = corners[k - 1] + along[:, None] * (corners[k] - corners[k - 1])
        out = np.where((leg == k)[:, None], line, out)
    drift = radius * np.column_stack([0.15 * along, 0.1 * np.sin(3.0 * along)])
    return np.where((leg == 4)[:, None], drift, out)


def drifting_survey(
    seed,
    *,
    water=water_series,
    nodes=None,
    truth=None,
    displacement=(0.0, 0.0, 0.0),
    **fixed,
):
    """
    Draw a survey of one node or of an array; ``water`` draws the fraction of the sound speed.

    Keywords fix what is drawn otherwise: ``depth`` [m], ``hours``, ``pings``, ``sigma`` [s],
    ``rms`` (fraction of the sound speed), ``gnss`` [m], ``red`` (share of noise with a memory).
    """
    rng = np.random.default_rng([seed, 46])
    drawn = {
        "depth": rng.uniform(2000.0, 5000.0),
        "hours": np.exp(rng.uniform(np.log(3.0), np.log(48.0))),
        "pings": int(np.exp(rng.uniform(np.log(500.0), np.log(3000.0)))),
        "sigma": np.exp(rng.uniform(np.log(5e-5), np.log(3e-4))),
        "rms": np.exp(rng.uniform(np.log(2e-5), np.log(2e-4))),
        "gnss": rng.uniform(0.01, 0.03),
        "red": rng.uniform(0.0, 0.5),
    } | fixed
    kind = rng.integers(2)
    count = nodes or (1, 4)[kind]
    depth = drawn["depth"]
    span = 3600.0 * drawn["hours"]
    angle = 2.0 * np.pi * (np.arange(count) + rng.uniform()) / count
    spread = 0.0 if count == 1 else rng.uniform(0.3, 0.6) * depth
    prior = np.column_stack(
        [spread * np.cos(angle), spread * np.sin(angle), depth + rng.uniform(-30.0, 30.0, count)]
    )
    if truth is None:
        truth = prior + rng.normal(size=prior.shape) * [20.0, 20.0, 10.0]
    prior = truth + rng.normal(size=prior.shape) * [20.0, 20.0, 10.0]
    truth = truth + np.asarray(displacement)
    n = drawn["pings"]
    node = np.arange(n) % count
    time = np.sort(rng.uniform(0.0, span, n))
    series_time = np.arange(0.0, span + 60.0, STEP)
    series = water(rng, series_time, drawn["rms"])
    radius = depth * rng.uniform(0.7, 1.1)
    speed = max(2.0, 14.0 * radius / span)

    def ship(at):
        horizontal = pattern(at, radius, speed)
        return np.column_stack([horizontal, 4.0 + 0.3 * np.sin(2.0 * np.pi * at / 9.0)])

    received = time + 2.0 * depth / 1500.0
    for _ in range(3):
        out = direct_time(ship(time), truth[node]) * np.exp(-np.interp(time, series_time, series))
        back = direct_time(ship(received), truth[node])
        back = back * np.exp(-np.interp(received, series_time, series))
        received = time + out + back
    noise = rng.normal(size=n) * np.sqrt(1.0 - drawn["red"])
    memory = np.exp(rng.uniform(np.log(60.0), np.log(900.0)))
    red = ornstein_uhlenbeck(rng, series_time.size, memory)
    noise += np.sqrt(drawn["red"]) * np.interp(time, series_time, red)
    memory = np.exp(rng.uniform(np.log(600.0), np.log(7200.0)))
    gnss = [ornstein_uhlenbeck(rng, series_time.size, memory) for _ in range(3)]
    gnss = drawn["gnss"] * np.array([1.0, 1.0, 1.5])[:, None] * np.array(gnss)

    def measured(at):
        return ship(at) + np.column_stack([np.interp(at, series_time, axis) for axis in gnss])

    survey = Survey(
        [
            Node(f"N{k + 1}", tuple(map(float, place)), (60.0, 60.0, 30.0))
            for k, place in enumerate(prior)
        ],
        node,
        time,
        out + back + drawn["sigma"] * noise,
        measured(time),
        measured(received),
    )
    return DriftingSurvey(survey, truth, depth, span, float(np.std(series)))
