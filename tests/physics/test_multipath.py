"""Laws of bounced rays over twisted facets: reflection, Fermat, eikonal gradients, ray tubes, reciprocity."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from pymantaray.acoustics import Medium, find_eigenrays, trace_paths
from pymantaray.records import Arrivals, RayPaths

Array = NDArray[np.float64]
SURFACE, BED = 1, 2  # boundary flags of a path
C = 1500.0


def rough_axes():
    """Lines of unequal spacing, 0.8 to 2.2 km."""
    return np.cumsum([0.0, 1500, 900, 1200, 2200, 1700, 800, 1900, 1300, 1500]), np.linspace(0.0, 12e3, 9)


def twisted_bed(north, east, *, depth=900.0, slope=0.03, roughness=60.0):
    """Ridges and saddles about a slope: no cell is plane."""
    rng = np.random.default_rng(41)
    bed = depth + slope * north[:, None] - 0.5 * slope * east
    return bed + roughness * rng.uniform(-1.0, 1.0, (north.size, east.size))


def make_rough(arctic, *, uniform=False, interpolation="smooth", **shape):
    """The twisted bed under uniform water, or under a duct that a front crosses."""
    north, east = rough_axes()
    depth, speed = arctic
    c = np.full((north.size, east.size, depth.size), C)
    if not uniform:
        c[:] = speed
        c += 4.0 * np.tanh((north[:, None, None] - 6e3) / 3e3) * np.exp(-depth / 400.0)
        c += 2.0 * np.sin(east[:, None] / 4e3) * np.exp(-depth / 300.0)
    return Medium.from_grid(
        north, east, depth, c, bathymetry=twisted_bed(north, east, **shape), interpolation=interpolation
    )


def make_kind(arctic, kind):
    return make_rough(
        arctic, uniform=kind == "uniform", interpolation="linear" if kind == "linear" else "smooth"
    )


def draw_links(n, seed, longest=5e3):
    """Pairs in the inner part of the rough medium, between the surface and its shallowest bed."""
    rng = np.random.default_rng(seed)
    source = rng.uniform((3e3, 2e3, 20.0), (10e3, 10e3, 650.0), (n, 3))
    bearing, distance = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(200.0, longest, n)
    receiver = source + np.column_stack(
        [distance * np.cos(bearing), distance * np.sin(bearing), 0.0 * bearing]
    )
    receiver[:, 2] = rng.uniform(20.0, 650.0, n)
    inside = np.all((receiver[:, :2] > 500.0) & (receiver[:, :2] < (12.5e3, 11.5e3)), axis=1)
    return source[inside], receiver[inside]


class Case(NamedTuple):
    """Links of one medium, their arrivals and the paths of these."""

    medium: Medium
    source: Array
    receiver: Array
    arrivals: Arrivals
    paths: RayPaths


KINDS = ["uniform", "smooth", "linear"]


def make_case(arctic, kind, n, seed=42):
    """Bounced rays over twisted facets."""
    medium = make_kind(arctic, kind)
    source, receiver = draw_links(n, seed)
    arrivals = find_eigenrays(medium, source, receiver, 2, 2, tolerance=1e-5)
    return Case(
        medium,
        source,
        receiver,
        arrivals,
        trace_paths(medium, source, receiver, arrivals, tolerance=1e-5),
    )


@pytest.fixture(scope="module", params=KINDS)
def rough(request, arctic):
    return make_case(arctic, request.param, 40)


def bed_normals(medium, place):
    """Upward unit normals of the bilinear bed, and the distance of places from the lines of its grid."""
    cell, steps = [], []
    for axis, k in ((medium.north, 0), (medium.east, 1)):
        i = np.clip(np.searchsorted(axis, place[:, k], side="right") - 1, 0, axis.size - 2)
        cell.append(i)
        steps.append(axis[i + 1] - axis[i])
    (i, j), (dn, de) = cell, steps
    u, v = (place[:, 0] - medium.north[i]) / dn, (place[:, 1] - medium.east[j]) / de
    b = medium.bathymetry
    slope_n = ((b[i + 1, j] - b[i, j]) * (1.0 - v) + (b[i + 1, j + 1] - b[i, j + 1]) * v) / dn
    slope_e = ((b[i, j + 1] - b[i, j]) * (1.0 - u) + (b[i + 1, j + 1] - b[i + 1, j]) * u) / de
    normal = np.column_stack([slope_n, slope_e, np.full(len(u), -1.0)])
    edge = np.minimum(np.minimum(u, 1.0 - u) * dn, np.minimum(v, 1.0 - v) * de)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True), edge


def bounces(paths):
    """First of the two nodes of every reflection."""
    at = np.flatnonzero(paths.boundary > 0)[::2]
    assert np.array_equal(np.flatnonzero(paths.boundary > 0), np.column_stack([at, at + 1]).ravel())
    return at


def test_reflection_turns_the_slowness_about_the_local_normal(rough):
    """Angle in is angle out, the tangential slowness stays, and the place is on the boundary."""
    medium, _, _, arrivals, paths = rough
    at = bounces(paths)
    assert at.size > 150
    np.testing.assert_array_equal(paths.position[at], paths.position[at + 1])
    np.testing.assert_array_equal(paths.travel_time[at], paths.travel_time[at + 1])
    np.testing.assert_array_equal(paths.boundary[at], paths.boundary[at + 1])
    place, on_bed = paths.position[at], paths.boundary[at] == BED
    normal, edge = bed_normals(medium, place)
    normal[~on_bed] = [0.0, 0.0, 1.0]
    gap = np.where(on_bed, medium.bottom_depth(place) - place[:, 2], place[:, 2])
    np.testing.assert_allclose(gap, 0.0, atol=1e-5)
    clear = ~on_bed | (edge > 1e-3)  # a normal is that of a cell
    before, after = paths.slowness[at][clear], paths.slowness[at + 1][clear]
    normal = normal[clear]
    across, away = np.sum(before * normal, axis=1), np.sum(after * normal, axis=1)
    np.testing.assert_allclose(away, -across, rtol=0, atol=1e-10)
    tangential = [v - s[:, None] * normal for v, s in ((before, across), (after, away))]
    np.testing.assert_allclose(*tangential, rtol=0, atol=1e-10)
    counts = [
        np.bincount(paths.arrival[at], weights=paths.boundary[at] == flag, minlength=len(arrivals.link))
        for flag in (SURFACE, BED)
    ]
    assert np.array_equal(counts[0], arrivals.surface_bounces)
    assert np.array_equal(counts[1], arrivals.bottom_bounces)


def test_bounced_paths_run_between_the_ends_and_stay_in_the_water(rough):
    medium, source, receiver, arrivals, paths = rough
    first = np.flatnonzero(np.diff(paths.arrival, prepend=-1))
    last = np.append(first[1:], len(paths.arrival)) - 1
    np.testing.assert_array_equal(paths.position[first], source[arrivals.link])
    np.testing.assert_array_equal(paths.position[last], receiver[arrivals.link])
    for node, slowness in ((first, arrivals.source_slowness), (last, arrivals.receiver_slowness)):
        np.testing.assert_allclose(paths.slowness[node], slowness, rtol=0, atol=2e-8)
    np.testing.assert_allclose(paths.travel_time[last], arrivals.travel_time, rtol=0, atol=1e-12)
    assert (np.diff(paths.travel_time)[np.diff(paths.arrival) == 0] >= 0.0).all()
    assert paths.position[:, 2].min() > -1e-5
    assert (medium.bottom_depth(paths.position) - paths.position[:, 2]).min() > -1e-5


def corners(arrivals, paths, source, receiver, ray):
    """Source, places of reflection and receiver of one ray, and the boundary at each place of reflection."""
    own = np.flatnonzero(paths.arrival == ray)
    at = own[paths.boundary[own] > 0][::2]
    link = arrivals.link[ray]
    return np.concatenate([[source[link]], paths.position[at], [receiver[link]]]), paths.boundary[at]


def test_fermat_travel_time_is_stationary_in_every_place_of_reflection(arctic):
    """Uniform water: along the boundary the length of the polygon changes to second order only."""
    medium = make_kind(arctic, "uniform")
    source, receiver = draw_links(40, 43)
    arrivals = find_eigenrays(medium, source, receiver, 2, 2, tolerance=1e-5)
    paths = trace_paths(medium, source, receiver, arrivals, tolerance=1e-5)
    h, tested = 0.5, 0  # m

    def length(nodes):
        return np.sum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))

    for ray in range(len(arrivals.link)):
        nodes, flags = corners(arrivals, paths, source, receiver, ray)
        assert length(nodes) / C == pytest.approx(arrivals.travel_time[ray], abs=1e-8)
        _, edge = bed_normals(medium, nodes)
        for k, flag in enumerate(flags, start=1):
            if flag == BED and edge[k] < 2.0 * h:
                continue
            for axis in (0, 1):
                change = []
                for shift in (h, -h, 0.1 * h, -0.1 * h):
                    moved = nodes.copy()
                    moved[k, axis] += shift
                    moved[k, 2] = medium.bottom_depth(moved[k : k + 1])[0] if flag == BED else 0.0
                    change.append((length(moved) - length(nodes)) / C)
                slope = (change[0] - change[1]) / (2.0 * h)
                assert abs(slope) < 5e-8, (ray, k, axis, slope)  # s/m; a place 1 m away has some 3e-6
                bend = abs(change[0]) + abs(change[1])
                assert abs(change[2]) + abs(change[3]) < 0.02 * bend + 1e-9, (ray, k, axis, change)
                tested += 1
    assert tested > 300


def pair(arrivals, ray, other, link):
    """The row of other arrivals of a link that is the same ray, a little moved: bounces alike, nearest slowness."""
    same = (other.link == link) & (other.surface_bounces == arrivals.surface_bounces[ray])
    rows = np.flatnonzero(same & (other.bottom_bounces == arrivals.bottom_bounces[ray]))
    if rows.size == 0:
        return None
    gap = np.linalg.norm(other.source_slowness[rows] - arrivals.source_slowness[ray], axis=1)
    gap += np.linalg.norm(other.receiver_slowness[rows] - arrivals.receiver_slowness[ray], axis=1)
    best = rows[np.argmin(gap)]
    return best if gap.min() < 2e-5 else None


def clear_of_edges(medium, arrivals, paths, least):
    """Whether all bottom reflections of each arrival are so far inside their cells."""
    at = bounces(paths)
    _, edge = bed_normals(medium, paths.position[at])
    short = (paths.boundary[at] == BED) & (edge < least)
    return np.bincount(paths.arrival[at], weights=short, minlength=len(arrivals.link)) == 0


@pytest.mark.parametrize(
    ("n", "seed", "least"), [(4, 42, 60), pytest.param(60, 45, 1200, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("kind", KINDS)
def test_slowness_is_the_gradient_of_travel_time_by_either_end(kind, arctic, n, seed, least):
    """dt/dx_receiver = slowness there, dt/dx_source = minus slowness there, for each bounced ray."""
    medium, source, receiver, arrivals, paths = make_case(arctic, kind, n, seed)
    h = 0.5  # m
    bounced = (arrivals.surface_bounces + arrivals.bottom_bounces > 0) & (arrivals.spreading_db > -3.0)
    clear = np.flatnonzero(bounced & clear_of_edges(medium, arrivals, paths, 20.0))
    errors, lost = [], 0
    for axis in range(3):
        for end, vector, sign in ((0, arrivals.source_slowness, -1.0), (1, arrivals.receiver_slowness, 1.0)):
            moved = []
            for direction in (1.0, -1.0):
                ends = [source.copy(), receiver.copy()]
                ends[end][:, axis] += direction * h
                moved.append(find_eigenrays(medium, *ends, 2, 2, spreading_cutoff_db=18.0, tolerance=1e-5))
            for ray in clear:
                rows = [pair(arrivals, ray, other, arrivals.link[ray]) for other in moved]
                if None in rows:
                    lost += 1
                    continue
                slope = np.subtract(*(other.travel_time[row] for other, row in zip(moved, rows, strict=True)))
                errors.append(sign * slope / (2.0 * h) - vector[ray, axis])
    errors = np.abs(errors)
    assert len(errors) > least
    assert lost < 0.03 * len(errors), lost
    assert np.median(errors) < 2e-9, np.median(errors)
    assert np.percentile(errors, 98) < 1e-7, np.percentile(errors, 98)


@pytest.mark.parametrize(
    ("n", "seed", "every"), [(24, 42, 14), pytest.param(50, 46, 1, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("kind", KINDS)
def test_spreading_is_the_ray_tube_of_neighbouring_receivers(kind, arctic, n, seed, every):
    """Solid angle of launch per area across the ray at the receiver, by differences of launch directions."""
    medium, source, receiver, arrivals, paths = make_case(arctic, kind, n, seed)
    h = 0.5
    keep = np.flatnonzero(clear_of_edges(medium, arrivals, paths, 20.0) & (arrivals.spreading_db < 10.0))[
        ::every
    ]
    link = arrivals.link[keep]
    shifted = []
    for k in (0, 1):
        across = np.array([np.linalg.svd(arrivals.receiver_slowness[ray][None])[2][1 + k] for ray in keep])
        for sign in (1.0, -1.0):
            found = find_eigenrays(
                medium, source[link], receiver[link] + sign * h * across, 2, 2, 18.0, tolerance=1e-5
            )
            rows = [pair(arrivals, ray, found, i) for i, ray in enumerate(keep)]
            unit = [
                np.full(3, np.nan)
                if row is None
                else found.source_slowness[row] * found.source_sound_speed[i]
                for i, row in enumerate(rows)
            ]
            shifted.append(np.array(unit))
    turns = [(shifted[0] - shifted[1]) / (2.0 * h), (shifted[2] - shifted[3]) / (2.0 * h)]
    solid_angle = np.linalg.norm(np.cross(*turns), axis=1)  # per square metre at the receiver
    distance = np.linalg.norm(receiver - source, axis=1)[link]
    ratio = arrivals.source_sound_speed[link] / arrivals.receiver_sound_speed[link]
    expected = 10.0 * np.log10(ratio / (solid_angle * distance**2))
    known = np.isfinite(expected)
    assert known.mean() > 0.97, known.mean()
    error = np.abs(expected - arrivals.spreading_db[keep])[known]
    assert np.median(error) < 0.005, np.median(error)
    assert np.percentile(error, 95) < 0.1, np.sort(error)[-20:]


def same_rays(there, back, n, atol):
    """Rows of two sets of arrivals that are one ray run both ways, and the rows of the first that have no other."""
    pairs, alone = [], []
    for link in range(n):
        left = list(np.flatnonzero(back.link == link))
        for i in np.flatnonzero(there.link == link):
            same = (
                (back.surface_bounces[left] == there.surface_bounces[i])
                & (back.bottom_bounces[left] == there.bottom_bounces[i])
                & (np.abs(back.travel_time[left] - there.travel_time[i]) < atol)
            )
            gap = np.linalg.norm(back.receiver_slowness[left] + there.source_slowness[i], axis=1)
            same &= gap < 1e-6
            if same.any():
                pairs.append((i, left.pop(int(np.argmin(np.where(same, gap, np.inf))))))
            else:
                alone.append(i)
    return np.array(pairs).reshape(-1, 2), alone


@pytest.mark.parametrize(
    ("n", "seed", "least"), [(24, 44, 130), pytest.param(150, 48, 1120, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("kind", KINDS)
def test_bounced_rays_are_reciprocal_when_both_ways_are_solved(kind, arctic, n, seed, least):
    """The same families from either end; times within 0.1 us."""
    check_reciprocity(make_kind(arctic, kind), *draw_links(n, seed), least)


def test_a_node_of_the_fan_on_a_root_is_no_gap_between_its_intervals(arctic):
    """A node within the tolerance of the root was above zero for one interval and below it for the other."""
    source, receiver = (end[122:123] for end in draw_links(150, 48))
    check_reciprocity(make_kind(arctic, "smooth"), source, receiver, least=8)


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "share"), [(20.0, 0.99), (60.0, 0.8)])
def test_over_cells_drawn_at_random_most_rays_are_found_from_both_ends(noise, share):
    """Known limit: 500 m cells whose slopes of 0.06 and 0.17 (rms) have nothing to do with each other."""
    north, east = np.arange(0.0, 14.1e3, 500.0), np.arange(0.0, 12.1e3, 500.0)
    rng = np.random.default_rng(3)
    bed = 1000.0 + 0.03 * north[:, None] - 0.015 * east + noise * rng.normal(size=(north.size, east.size))
    c = np.full((north.size, east.size, 2), 1500.0)
    medium = Medium.from_grid(north, east, [0.0, 4000.0], c, bathymetry=bed)
    source, receiver = draw_links(40, 5)
    there = find_eigenrays(medium, source, receiver, 2, 2, canonical=False)
    back = find_eigenrays(medium, receiver, source, 2, 2, canonical=False)
    pairs, alone = same_rays(there, back, len(source), 1e-6)
    _, others = same_rays(back, there, len(source), 1e-6)
    odd = sum(there.spreading_db[alone] < 14.5) + sum(back.spreading_db[others] < 14.5)
    assert len(pairs) > 200
    assert len(pairs) > share * (len(pairs) + odd), (len(pairs), odd)


def check_reciprocity(medium, source, receiver, least):
    there = find_eigenrays(medium, source, receiver, 2, 2, canonical=False)
    back = find_eigenrays(medium, receiver, source, 2, 2, canonical=False)
    pairs, alone = same_rays(there, back, len(source), 1e-6)
    assert len(pairs) > least
    # rays at the cut-off may fall on either side of it, pairs at a caustic be one or two
    odd = [i for i in alone if there.spreading_db[i] < 14.5]
    assert not odd, [(there.link[i], there.launch_angle[i], there.spreading_db[i]) for i in odd]
    gap = np.abs(there.travel_time[pairs[:, 0]] - back.travel_time[pairs[:, 1]])
    assert gap.max() < 1e-7, gap.max()
    assert np.median(gap) < 5e-9, np.median(gap)
    spread = np.abs(there.spreading_db[pairs[:, 0]] - back.spreading_db[pairs[:, 1]])
    assert np.percentile(spread, 95) < 0.05, np.percentile(spread, 95)
