"""
Searches from both ends of a link: one row a ray, and what is known if neither search is complete.
"""

import numpy as np
import pytest

from pymantaray.acoustics import both_ends
from pymantaray.acoustics._kernels import layout
from pymantaray.acoustics._kernels.layout import Results
from pymantaray.records import RayStatus

OK, SHADOW, BLOCKED, WEAK, UNRESOLVED = (
    RayStatus[name] for name in ("OK", "SHADOW", "BLOCKED", "WEAK", "UNRESOLVED")
)


def results(*links):
    """
    Results of links, each (status, resolved, rays), a ray being (time, launch angle, arrival angle,
    surface bounces).
    """
    rays = [ray for _, _, link in links for ray in link]
    rows, info = np.zeros((len(rays), layout.N_ARRIVAL)), np.zeros((len(links), layout.N_INFO))
    columns = [
        layout.TRAVEL_TIME,
        layout.LAUNCH_ANGLE,
        layout.ARRIVAL_ANGLE,
        layout.SURFACE_BOUNCES,
    ]
    if rays:
        rows[:, columns] = rays
    info[:, layout.RESOLVED] = [resolved for _, resolved, _ in links]
    info[:, layout.COMPLETE] = 1.0
    info[:, layout.MARGIN] = [0.0 if link else 40.0 for _, _, link in links]
    counts = np.array([len(link) for _, _, link in links])
    return Results(rows, counts, np.array([s for s, _, _ in links], dtype=np.int8), info)


def times(merged, link):
    starts = np.concatenate([[0], np.cumsum(merged.counts)])
    return merged.rows[starts[link] : starts[link + 1], layout.TRAVEL_TIME].tolist()


def test_rays_of_both_searches_are_merged_in_order():
    found = results((OK, 0, [(2.0, 0.1, -0.1, 0)]), (OK, 1, [(5.0, 0.0, 0.0, 0)]))
    other = results((OK, 1, [(1.0, 0.2, -0.2, 0), (2.0 + 1e-9, 0.1 + 1e-8, -0.1, 0)]))
    merged = both_ends.merged(found, both_ends.unresolved_links(found), other)
    assert (times(merged, 0), times(merged, 1)) == ([1.0, 2.0], [5.0])
    assert merged.counts.tolist() == [2, 1]
    assert merged.info[:, layout.RESOLVED].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("angles", [(3e-4, 0.0), (0.0, 3e-4)], ids=["launch", "arrival"])
def test_a_pair_at_a_caustic_stays_two_rays(angles):
    """Times agree to 1 ns, angles do not; each search found one ray of the pair."""
    found = results((OK, 0, [(2.0, 0.1, -0.1, 0)]))
    other = results((OK, 0, [(2.0 + 1e-9, 0.1 + angles[0], -0.1 + angles[1], 0)]))
    assert both_ends.merged(found, np.array([0]), other).counts.tolist() == [2]


def test_two_copies_of_a_pair_stay_two_rays():
    """Both are near each other in time and angles; each has one partner, itself."""
    pair = [(2.0, 0.1, -0.1, 0), (2.0 + 4e-8, 0.1 + 5e-5, -0.1, 0)]
    merged = both_ends.merged(results((OK, 0, pair)), np.array([0]), results((OK, 0, pair[::-1])))
    assert merged.counts.tolist() == [2]


@pytest.mark.parametrize("known", [0, 1])
def test_the_ray_of_a_narrow_pair_that_one_search_lacks_is_added(known):
    pair = [(2.0, 0.1, -0.1, 0), (2.0 + 4e-8, 0.1 + 5e-5, -0.1, 0)]
    merged = both_ends.merged(
        results((OK, 0, [pair[known]])), np.array([0]), results((OK, 0, pair))
    )
    assert times(merged, 0) == [2.0, 2.0 + 4e-8]


def test_reflected_rays_of_the_other_search_are_not_added():
    merged = both_ends.merged(
        results((OK, 0, [(1.0, 0.1, 0.1, 0)])),
        np.array([0]),
        results((OK, 0, [(2.0, 0.1, 0.1, 1)])),
    )
    assert times(merged, 0) == [1.0]


@pytest.mark.parametrize(
    ("one", "other", "resolved", "expected"),
    [
        (SHADOW, SHADOW, 1, SHADOW),
        (SHADOW, WEAK, 1, WEAK),
        (BLOCKED, SHADOW, 1, BLOCKED),
        (UNRESOLVED, SHADOW, 1, SHADOW),
        (SHADOW, SHADOW, 0, UNRESOLVED),
        (SHADOW, WEAK, 0, UNRESOLVED),
    ],
)
def test_a_link_is_unresolved_only_if_both_searches_are_incomplete(one, other, resolved, expected):
    found = both_ends.merged(results((one, 0, [])), np.array([0]), results((other, resolved, [])))
    assert both_ends.without_certificate(found).status.tolist() == [expected]
    assert found.info[0, layout.MARGIN] == 40.0


def test_a_link_that_only_the_other_search_solves_is_ok():
    found = both_ends.merged(
        results((SHADOW, 0, [])), np.array([0]), results((OK, 0, [(2.0, 0.1, 0.1, 0)]))
    )
    assert both_ends.without_certificate(found).status.tolist() == [OK]
    assert found.info[0].tolist() == results((OK, 0, [(2.0, 0.1, 0.1, 0)])).info[0].tolist()
