"""
The rays of several links are traced together; the arrivals of a link do not depend on the other
links.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays

N_LINKS = 60
FIELDS = (
    "travel_time",
    "launch_angle",
    "arrival_angle",
    "spreading_db",
    "source_slowness",
    "receiver_slowness",
    "caustics",
)


def duct(draft=0.0):
    """Water with a duct near the surface that varies horizontally."""
    axis, depth = (
        np.linspace(0.0, 3e4, 16),
        np.array([0, 20, 50, 90, 150, 250, 400, 700, 1200, 2000.0]),
    )
    profile = np.array([1440, 1441, 1446, 1443, 1442, 1452, 1461, 1464, 1470, 1482.0])
    gain = 1.0 + 0.4 * np.sin(axis[:, None, None] / 3e3) * np.cos(axis[None, :, None] / 4e3)
    speed = 1440.0 + 0.015 * depth + gain * (profile - 1440.0 - 0.015 * depth)
    ice = draft * (1.0 + np.sin(axis[:, None] / 2e3) * np.cos(axis[None, :] / 3e3))
    return Medium.from_grid(
        axis, axis, depth, speed, bathymetry=np.full((16, 16), 2000.0), ice_draft=ice
    )


def links():
    """Half of the links have both ends in the duct; some are steep, and one has coincident ends."""
    rng = np.random.default_rng(5)
    azimuth, length = rng.uniform(0.0, 2.0 * np.pi, N_LINKS), rng.uniform(500.0, 9e3, N_LINKS)
    source = np.column_stack(
        [
            *rng.uniform(1e4, 2e4, (2, N_LINKS)),
            rng.uniform(10.0, 200.0, N_LINKS) * rng.choice([1, 8], N_LINKS),
        ]
    )
    step = np.column_stack([length * np.cos(azimuth), length * np.sin(azimuth), np.zeros(N_LINKS)])
    step[:5, :2] *= 0.02
    receiver = source + step
    receiver[:, 2] = rng.uniform(10.0, 200.0, N_LINKS)
    receiver[7] = source[7]
    return source, receiver


def by_link(arrivals, number):
    """All that the solver returns of each link, in the order of the number of links."""
    rows = [[] for _ in number]
    for j, i in enumerate(arrivals.link):
        rows[number[i]].append(np.hstack([getattr(arrivals, name)[j] for name in FIELDS]))
    order = np.argsort(number)
    margin = np.nan_to_num(arrivals.shadow_margin[order], nan=-1.0)
    return [np.array(row) for row in rows], arrivals.status[order], margin


def assert_equal(a, b):
    for one, other in zip(a[0], b[0], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(a[1], b[1])
    np.testing.assert_array_equal(a[2], b[2])


@pytest.mark.parametrize("draft", [0.0, 5.0])
def test_arrivals_do_not_depend_on_the_order_of_links_or_on_threads(draft):
    medium, (source, receiver) = duct(draft), links()
    number = np.arange(N_LINKS)
    expected = by_link(find_eigenrays(medium, source, receiver, threads=1), number)
    assert sum(map(len, expected[0])) > N_LINKS // 2
    for seed in range(3):
        shuffled = np.random.default_rng(seed).permutation(N_LINKS)
        other = find_eigenrays(medium, source[shuffled], receiver[shuffled], threads=seed + 1)
        assert_equal(by_link(other, shuffled), expected)


def test_a_link_by_itself_has_the_arrivals_that_it_has_among_others():
    medium, (source, receiver) = duct(), links()
    together = by_link(find_eigenrays(medium, source, receiver), np.arange(N_LINKS))
    for i in range(0, N_LINKS, 4):
        alone = by_link(find_eigenrays(medium, source[i : i + 1], receiver[i : i + 1]), [0])
        assert_equal(alone, tuple(part[i : i + 1] for part in together))


def test_a_long_link_reduces_the_number_of_links_at_a_time():
    axis, depth = np.array([0.0, 1e5, 2e5]), np.array([0.0, 500.0, 1500.0, 4000.0])
    speed = np.array([1500.0, 1480.0, 1490.0, 1530.0]) + np.array([0.0, 1.0, 0.0])[:, None, None]
    medium = Medium.from_grid(
        axis,
        axis,
        depth,
        np.broadcast_to(speed, (3, 3, 4)).copy(),
        bathymetry=np.full((3, 3), 4000.0),
    )
    source, receiver = (np.full((4, 3), value) for value in (1e3, 900.0))
    receiver[:, 0] = [4e3, 1.9e5, 9e3, 5e3]
    receiver[:, 2] = [300.0, 1e3, 800.0, 1200.0]
    together = by_link(find_eigenrays(medium, source, receiver), np.arange(4))
    short = np.array([0, 2, 3])
    alone = by_link(find_eigenrays(medium, source[short], receiver[short]), np.arange(3))
    assert_equal(alone, ([together[0][i] for i in short], together[1][short], together[2][short]))
    assert all(len(rows) for rows in together[0])
