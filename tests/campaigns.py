"""Made-up surveys whose truth is known: closed-form travel times in a linear profile, rotations written out, made without the package's code."""

from dataclasses import dataclass

import numpy as np
from oracles import direct_travel_time_linear_gradient

from pymantaray.acoustics import Medium
from pymantaray.locate import LeverArm, Node, Survey

SURFACE_SPEED, GRADIENT = 1480.0, 0.017


def direct_time(a, b):
    """Travel time of the direct ray between places. [s]"""
    return direct_travel_time_linear_gradient(a, b, sound_speed_surface=SURFACE_SPEED, gradient=GRADIENT)


def to_world(attitude, vector):
    """Body vector (forward, starboard, down) of headings, pitches and rolls in north, east, down, written out."""
    h, p, r = attitude.T
    f, s, d = vector
    ch, sh, cp, sp, cr, sr = np.cos(h), np.sin(h), np.cos(p), np.sin(p), np.cos(r), np.sin(r)
    return np.column_stack(
        [
            ch * cp * f + (ch * sp * sr - sh * cr) * s + (ch * sp * cr + sh * sr) * d,
            sh * cp * f + (sh * sp * sr + ch * cr) * s + (sh * sp * cr - ch * sr) * d,
            -sp * f + cp * sr * s + cp * cr * d,
        ]
    )


@dataclass
class Campaign:
    """What a ship measured, and the truth behind it."""

    names: list
    prior: np.ndarray  # (k, 3) m
    prior_sigma: np.ndarray  # (k, 3)
    truth: np.ndarray  # (k, 3)
    node: np.ndarray
    time: np.ndarray  # s
    two_way: np.ndarray  # s
    antenna: tuple  # positions (n, 3) at transmission and reception
    attitude: tuple  # (n, 3) rad
    lever: tuple
    gross: np.ndarray


def sailed(time, radius, speed=2.0):
    """Place (n, 3) and heading of a ship that sails circles of two radii and a cross over them, 1 m waves."""
    turn = speed / radius * time
    lap = np.floor(turn / (2.0 * np.pi)).astype(int) % 3
    size = np.choose(lap, [radius, 0.5 * radius, radius])
    angle = np.where(lap == 2, np.pi / 4.0, turn)
    along = np.where(lap == 2, np.cos(turn), 1.0)
    north, east = size * along * np.cos(angle), size * along * np.sin(angle)
    return np.column_stack([north, east, -12.0 + 0.5 * np.sin(2.0 * np.pi * time / 8.0)])


def make_campaign(
    seed,
    *,
    depth=1300.0,
    radius=900.0,
    nodes=3,
    pings=200,
    interval=45.0,
    sigma=1e-4,
    lever=(6.0, -2.5, 20.0),
    lever_sigma=(0.0, 0.0, 0.0),
    turn_around=0.013,
    turn_around_sigma=0.0,
    drift=3e-4,
    gross=0.03,
    prior_sigma=(5.0, 5.0, 5.0),
):
    """Ping each node in turn; the fraction by which the water is faster than the profile is a red sum of waves of rms drift."""
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * (np.arange(nodes) + 0.2) / nodes
    prior = np.column_stack([500.0 * np.cos(angle), 500.0 * np.sin(angle), depth + 12.0 * np.arange(nodes)])
    truth = prior + rng.normal(size=prior.shape) * prior_sigma
    arm = np.asarray(lever) + rng.normal(size=3) * lever_sigma
    delay = turn_around + rng.normal(size=nodes) * turn_around_sigma
    time = np.repeat(interval * np.arange(pings), nodes) + np.tile(1.5 * np.arange(nodes), pings)
    node = np.tile(np.arange(nodes), pings)
    span = time[-1]
    period = span * np.exp(rng.uniform(np.log(0.1), np.log(2.0), 12))
    size = rng.normal(size=12) * period
    size *= np.sqrt(2.0 / np.sum(period**2))
    phase = rng.uniform(0.0, 2.0 * np.pi, 12)

    def fraction(t):
        return drift * np.sum(size * np.sin(2.0 * np.pi * np.asarray(t)[..., None] / period + phase), axis=-1)

    def attitude_at(t):
        heading = 2.0 / radius * t + np.pi / 2.0
        pitch = np.radians(1.5) * np.sin(2.0 * np.pi * t / 7.0)
        return np.column_stack([heading, pitch, np.radians(2.5) * np.sin(2.0 * np.pi * t / 11.0 + 1.0)])

    def transducer_at(t):
        return sailed(t, radius) + to_world(attitude_at(t), arm)

    both = direct_time(transducer_at(time), truth[node]) * 2.0
    for _ in range(4):  # the reception depends on the time that is measured
        received = time + both + delay[node]
        out = direct_time(transducer_at(time), truth[node]) * np.exp(-fraction(time))
        back = direct_time(transducer_at(received), truth[node]) * np.exp(-fraction(received))
        both = out + back
    received = time + both + delay[node]
    bad = rng.random(time.size) < gross
    measured = both + delay[node] + rng.normal(0.0, sigma, time.size)
    measured[bad] += rng.choice([-1.0, 1.0], bad.sum()) * rng.uniform(0.02, 0.6, bad.sum())
    return Campaign(
        [f"N{k + 1}" for k in range(nodes)],
        prior,
        np.tile(prior_sigma, (nodes, 1)),
        truth,
        node,
        time,
        measured,
        (sailed(time, radius), sailed(received, radius)),
        (attitude_at(time), attitude_at(received)),
        (tuple(map(float, lever)), tuple(map(float, lever_sigma))),
        bad,
    )


def water():
    """The campaign's profile as a medium."""
    depth = np.array([0.0, 3000.0])
    return Medium.from_profile(
        depth, SURFACE_SPEED + GRADIENT * depth, bottom_depth=3000.0, interpolation="linear"
    )


def survey_of(campaign, *, turn_around=0.013, turn_around_sigma=0.0, sigma=None, **changes):
    """A campaign as the solver takes it, with what it knows beforehand."""
    nodes = [
        Node(name, tuple(place), tuple(spread), turn_around, turn_around_sigma)
        for name, place, spread in zip(campaign.names, campaign.prior, campaign.prior_sigma, strict=True)
    ]
    fields = {
        "nodes": nodes,
        "node": campaign.node,
        "time": campaign.time,
        "travel_time": campaign.two_way,
        "transmit_position": campaign.antenna[0],
        "receive_position": campaign.antenna[1],
        "transmit_attitude": campaign.attitude[0],
        "receive_attitude": campaign.attitude[1],
        "lever": LeverArm(*campaign.lever),
        "sigma": [] if sigma is None else np.full(campaign.time.size, sigma),
    }
    return Survey(**(fields | changes))
