"""
Ice as the upper boundary: the mirrored ocean, and what does not get through; images are in
test_wedge, laws in test_laws.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays, path_integrals, trace_paths
from pymantaray.records import RayStatus

C, DEEP, DRAFT = 1500.0, 300.0, 12.0
AXIS = np.linspace(-4e3, 4e3, 9)
ATOL_TIME = 1e-8  # s


def water(ice_draft, interpolation="smooth", bed=DEEP, speed=C, **axes):
    c = np.full((9, 9, 2), 1.0) * speed
    bathymetry = np.broadcast_to(bed, (9, 9))
    return Medium.from_grid(
        AXIS, AXIS, [0.0, 2 * DEEP], c, bathymetry=bathymetry, interpolation=interpolation,
        ice_draft=ice_draft, **axes,
    )  # fmt: skip


def places(n, seed, top=DRAFT, bottom=DEEP - 40.0):
    rng = np.random.default_rng(seed)
    return [rng.uniform([-2e3, -2e3, top + 1.0], [2e3, 2e3, bottom], (n, 3)) for _ in range(2)]


def rows(arrivals, link):
    """Times of a link's arrivals by their reflections."""
    own, names = arrivals.link == link, ("surface_bounces", "bottom_bounces", "travel_time")
    return sorted(zip(*(getattr(arrivals, name)[own] for name in names), strict=True))


@pytest.mark.parametrize("gradient", [0.0, 0.05])
def test_the_mirrored_ocean_has_the_mirrored_rays(gradient):
    """
    Relief of the ice over a flat bed, and the same relief of the bed under a flat surface, upside
    down.
    """
    rng = np.random.default_rng(5)
    relief = 30.0 + np.cumsum(np.cumsum(rng.uniform(-4.0, 4.0, (9, 9)), axis=0), axis=1)
    relief += 10.0 - relief.min()
    z = np.array([0.0, DEEP])
    c = C + gradient * z
    media = [
        Medium.from_grid(AXIS, AXIS, z, np.full((9, 9, 2), 1.0) * speed, **boundaries)
        for speed, boundaries in (
            (c, {"bathymetry": np.full((9, 9), DEEP), "ice_draft": relief}),
            (c[::-1], {"bathymetry": DEEP - relief}),
        )
    ]
    ends = places(15, 6, top=relief.max())
    mirrored = [np.column_stack([end[:, :2], DEEP - end[:, 2]]) for end in ends]
    under_ice = find_eigenrays(media[0], *ends, 1, 1, canonical=False)
    over_bed = find_eigenrays(media[1], *mirrored, 1, 1, canonical=False)
    found = 0
    for link in range(15):
        ours = rows(under_ice, link)
        theirs = sorted((s, b, t) for b, s, t in rows(over_bed, link))
        unmatched = [
            r
            for r in ours
            if not any(r[:2] == o[:2] and abs(r[2] - o[2]) < ATOL_TIME for o in theirs)
        ]
        assert (
            not unmatched
        )  # over facets the search of the sea bed goes on cell by cell and may find more
        found += len(ours)
    assert found > 0.95 * over_bed.link.size


def test_no_direct_ray_crosses_a_keel():
    draft = np.full((9, 9), 2.0)
    draft[4] = 80.0  # a ridge across north 0
    medium = water(draft)
    a, b = [-900.0, 0.0, 20.0], [900.0, 0.0, 20.0]
    assert find_eigenrays(medium, a, b).status[0] == RayStatus.SHADOW
    assert find_eigenrays(water(2.0), a, b).status[0] == RayStatus.OK
    arrivals = find_eigenrays(medium, a, b, 2, 2, None)
    assert arrivals.link.size
    paths = trace_paths(medium, a, b, arrivals)
    gap = paths.position[:, 2] - medium.surface_depth(paths.position)
    assert gap.min() > -1e-5
    assert np.abs(gap[paths.boundary == 1]).max(initial=0.0) < 1e-5
    time = path_integrals(paths, lambda x: np.full(len(x), 1.0 / C))[:, 0]
    np.testing.assert_allclose(time, arrivals.travel_time, rtol=0, atol=1e-7)


def test_positions_in_the_ice_are_outside_the_water():
    medium = water(DRAFT)
    arrivals = find_eigenrays(
        medium, [[0, 0, 5.0], [0, 0, DRAFT], [0, 0, 50.0]],
        [[500.0, 0, 50.0], [500.0, 0, 50.0], [500.0, 0, DRAFT]],
        1, 0,
    )  # fmt: skip
    assert arrivals.status.tolist() == [RayStatus.OUTSIDE, RayStatus.OK, RayStatus.OK]


def test_without_ice_nothing_changes():
    ends = places(20, 3, top=0.0)
    iceless = find_eigenrays(water(0.0), *ends, 2, 2)
    plain = find_eigenrays(
        Medium.from_grid(
            AXIS, AXIS, [0.0, 2 * DEEP], np.full((9, 9, 2), C), bathymetry=np.full((9, 9), DEEP)
        ),
        *ends,
        2,
        2,
    )
    for name in ("link", "travel_time", "spreading_db", "source_slowness", "receiver_slowness"):
        np.testing.assert_array_equal(getattr(iceless, name), getattr(plain, name))
