"""
Properties of every link in every medium: drawn profiles and grids, places in general and in
degenerate position.
"""

import numpy as np
import pytest
from factories import QUICK
from hypothesis import given, settings, strategies as st

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.records import RayStatus

# a duct with both ends on its axis holds rays without number where it is piecewise linear
pytestmark = pytest.mark.filterwarnings("ignore:.*more eigenrays:RuntimeWarning")
SIDE = 110e3  # m; of grids
BAR = 0.3e-6  # s; what a travel time may err by


@st.composite
def media(draw, interpolation):
    """
    A profile or a grid of 2 to 4 columns a side, gradients up to 0.4 1/s, over a flat or rough bed.
    """
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    bottom = draw(st.sampled_from([60.0, 500.0, 3000.0]))
    n_depth = draw(st.integers(2, 8))
    inner = np.sort(rng.uniform(0.02, 0.98, n_depth - 2)) * 1.2 * bottom
    depth = np.concatenate([[0.0], inner, [1.2 * bottom]])
    depth = np.maximum.accumulate(depth + 1.0 * np.arange(n_depth))  # at least 1 m thick
    steepest = draw(st.sampled_from([0.0, 0.02, 0.4]))
    step = np.clip(steepest * rng.uniform(-1.0, 1.0, n_depth - 1) * np.diff(depth), -15.0, 15.0)
    profile = 1480.0 + np.concatenate([[0.0], np.cumsum(step)])
    if draw(st.booleans()):
        return Medium.from_profile(depth, profile, bottom_depth=bottom, interpolation=interpolation)
    sides = [np.linspace(-0.5 * SIDE, 0.5 * SIDE, draw(st.integers(2, 4))) for _ in "ne"]
    shape = (sides[0].size, sides[1].size)
    speed = profile + rng.uniform(-3.0, 3.0, (*shape, 1)) * np.exp(-depth / 300.0)
    bed = bottom * rng.uniform(draw(st.sampled_from([0.3, 1.0])), 1.0, shape)
    return Medium.from_grid(*sides, depth, speed, bathymetry=bed, interpolation=interpolation)


def places(medium, rng):
    """
    Thirty pairs: equal, level, vertical, on levels, surface, bottom and edge; 0.1 m to 100 km
    apart.
    """
    wet = float(medium.bed.depth.min())
    levels = medium.depth[medium.depth <= wet]
    edge = 0.5 * SIDE
    pairs = []
    for distance in (0.0, 0.1, 3.0, 200.0, 5e3, 1e5):
        for kind in range(5):
            z0, z1 = rng.uniform(0.0, wet, 2)
            if kind == 1:
                z1 = z0
            elif kind == 2:
                z0, z1 = rng.choice(levels, 2)
            elif kind == 3:
                z0, z1 = rng.choice([0.0, wet], 2)
            bearing = rng.choice([0.0, 0.5 * np.pi, rng.uniform(0.0, 2.0 * np.pi)])
            step = distance * np.array([np.cos(bearing), np.sin(bearing)])
            start = -0.5 * step + (rng.uniform(-500.0, 500.0, 2) if distance < 9e4 else 0.0)
            if kind == 4 and distance < 9e4:
                start = np.array([edge, edge]) - np.abs(step)
                step = np.abs(step)
            pairs.append(([*start, z0], [*(start + step), z1]))
    source, receiver = (np.array(p) for p in zip(*pairs, strict=True))
    return source, np.clip(receiver, [-edge, -edge, 0.0], [edge, edge, np.inf])


def fastest(medium):
    """
    A bound on the sound speed in the water: splines stay within the hull of their coefficients.
    """
    if medium.interpolation == "linear":
        return medium.sound_speed.max()
    n = medium.depth.size
    value, slope = medium.field[..., :n], medium.field[..., n:]
    h = np.diff(medium.depth)
    inner = [value[..., :-1] + slope[..., :-1] * h / 3.0, value[..., 1:] - slope[..., 1:] * h / 3.0]
    return max(value.max(), *(v.max() for v in inner))  # Bezier points of the cubic in depth


@pytest.mark.parametrize("examples", [3, pytest.param(20, marks=pytest.mark.slow)])
@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_every_link_of_every_medium_has_a_consistent_outcome(interpolation, examples):
    @settings(QUICK, max_examples=examples)
    @given(data=st.data())
    def run(data):
        medium = data.draw(media(interpolation))
        check(medium, *places(medium, np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))))

    run()


def check(medium, source, receiver):
    arrivals = find_eigenrays(medium, source, receiver, canonical=False)
    first = arrivals.first()
    distance = np.linalg.norm(receiver - source, axis=1)
    # the status says whether there are arrivals, and the margin agrees
    counts = np.bincount(arrivals.link, minlength=len(source))
    assert np.array_equal(counts > 0, first.status == RayStatus.OK)
    assert np.isin(first.status, list(RayStatus)).all()
    assert not (first.status == RayStatus.OUTSIDE).any()
    assert (first.shadow_margin[counts > 0] == 0.0).all()
    assert np.isfinite(first.chord_travel_time).all()
    # arrivals are sorted and finite, but for the direction of rays of no length
    assert (np.diff(arrivals.link) >= 0).all()
    assert (np.diff(arrivals.travel_time)[np.diff(arrivals.link) == 0] >= 0.0).all()
    length = distance[arrivals.link]
    proper = length > 0.0
    assert np.isfinite(arrivals.travel_time).all()
    assert (arrivals.travel_time[~proper] == 0.0).all()
    for name in (
        "spreading_db",
        "launch_angle",
        "arrival_angle",
        "source_slowness",
        "receiver_slowness",
    ):
        assert np.isfinite(getattr(arrivals, name)[proper]).all(), name
    assert (arrivals.spreading_db[proper] <= 15.0).all()
    # nothing is faster than sound, nor later than its own slowness says at the ends
    c_max = fastest(medium)
    assert (arrivals.travel_time * c_max >= length * (1.0 - 1e-9)).all()
    assert (first.chord_travel_time * c_max >= distance * (1.0 - 1e-9)).all()
    for end in ("source", "receiver"):
        vector = getattr(arrivals, f"{end}_slowness")[proper]
        speed = getattr(arrivals, f"{end}_sound_speed")[arrivals.link][proper]
        np.testing.assert_allclose(np.linalg.norm(vector, axis=1) * speed, 1.0, rtol=0, atol=1e-6)
        angle = getattr(arrivals, "launch_angle" if end == "source" else "arrival_angle")[proper]
        np.testing.assert_allclose(np.sin(angle), vector[:, 2] * speed, rtol=0, atol=1e-6)
    # reciprocity, each way solved on its own
    back = find_eigenrays(medium, receiver, source, canonical=False)
    reverse = back.first()
    np.testing.assert_allclose(reverse.chord_travel_time, first.chord_travel_time, rtol=1e-10)
    own = np.bincount(back.link, minlength=len(source))
    single = (counts == 1) & (own == 1)
    gap = np.abs(first.travel_time - reverse.travel_time)[single]
    bad = np.flatnonzero(single)[gap > 2.0 * BAR]
    assert bad.size == 0, [
        (source[i], receiver[i], first.travel_time[i] - reverse.travel_time[i]) for i in bad
    ]
    # Fermat: where no way by a boundary, and none around the domain, can be faster than the chord,
    # the fastest way is a ray, exists, and is no later than the chord
    if medium.interpolation == "smooth":
        sure = np.flatnonzero(
            in_open_water(medium, source, receiver, first.chord_travel_time, c_max)
        )
        everything = find_eigenrays(
            medium, source[sure], receiver[sure], spreading_cutoff_db=None
        ).first()
        lost = sure[everything.status != RayStatus.OK]
        assert lost.size == 0, [(source[i], receiver[i]) for i in lost]
        bending = everything.travel_time - first.chord_travel_time[sure]
        assert (bending < BAR).all(), bending


def in_open_water(medium, source, receiver, chord_time, c_max):
    """Links whose chord beats every path by way of the surface, the bed or the domain's sides."""
    horizontal = np.linalg.norm((receiver - source)[:, :2], axis=1)
    bed = float(medium.bed.depth.min())
    ways = [
        np.hypot(horizontal, source[:, 2] + receiver[:, 2]),
        np.hypot(horizontal, 2.0 * bed - source[:, 2] - receiver[:, 2]),
    ]
    for k, axis in ((0, medium.north), (1, medium.east)):
        if axis.size > 1:
            across = np.linalg.norm(np.delete(receiver - source, k, axis=1), axis=1)
            ways.append(np.hypot(across, 2.0 * axis[-1] - source[:, k] - receiver[:, k]))
            ways.append(np.hypot(across, source[:, k] + receiver[:, k] - 2.0 * axis[0]))
    return np.min(ways, axis=0) / c_max > chord_time * (1.0 + 1e-9)
