"""
Laws that every ray obeys, direct and reflected, in every kind of medium: Snell, Fermat,
reciprocity, eikonal gradients, ray tubes.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from factories import ARCTIC_DEPTH as DEPTH, arctic, front_links, inner_links, make_front, twisted
from numpy.typing import NDArray
from oracles import field_of, sheet_under
from scipy.integrate import RK45

from pymantaray.acoustics import Medium, RayPaths, find_eigenrays, path_integrals, trace_paths
from pymantaray.acoustics._kernels import step
from pymantaray.records import Arrivals

Array = NDArray[np.float64]
SURFACE, BED = 1, 2  # boundary flags of a path
C = 1500.0
DIRECT = ["profile smooth", "profile linear", "front smooth", "front linear"]
REFLECTED = ["facets uniform", "facets smooth", "facets linear", "ice smooth", "ice linear"]
OFTEN = "profile linear", "front smooth", "facets smooth", "ice linear"
"""Media of the fast tests: both interpolations, direct and reflected rays, each kind of water."""
SOON_SOLVED = "profile linear", "front smooth", "ice linear"
"""Those of them in which links are solved again and again."""


def in_kinds(often, every=DIRECT + REFLECTED):
    """A test in every medium, of which these are fast."""
    return pytest.mark.parametrize(
        "kind",
        [kind if kind in often else pytest.param(kind, marks=pytest.mark.slow) for kind in every],
    )


KINDS = in_kinds(OFTEN)


@cache
def medium_of(kind):
    """
    Profiles, a front, facets under uniform water or under a duct that a front crosses, and water
    under rolling ice.
    """
    what, interpolation = kind.split()
    interpolation = "linear" if interpolation == "linear" else "smooth"
    if what == "profile":
        return Medium.from_profile(
            DEPTH, arctic(DEPTH), bottom_depth=3000.0, interpolation=interpolation
        )
    if what == "front":
        return make_front(interpolation)
    if what == "facets":
        return twisted(
            DEPTH, None if "uniform" in kind else arctic(DEPTH), interpolation=interpolation
        )
    axis = np.linspace(-2e3, 16e3, 19)
    c = C + 5e-4 * (axis[:, None, None] - axis[:, None]) + [0.0, 4.0]
    draft = 20.0 + 8.0 * np.sin(axis[:, None] / 900.0) * np.cos(axis / 1100.0)
    return Medium.from_grid(
        axis,
        axis,
        [0.0, 2e3],
        c,
        bathymetry=np.full((19, 19), 900.0),
        ice_draft=draft,
        interpolation=interpolation,
    )


class Case(NamedTuple):
    """
    Links of one medium, how many reflections they may have, their arrivals and the paths of these.
    """

    medium: Medium
    source: Array
    receiver: Array
    most: tuple[int, int]
    arrivals: Arrivals
    paths: RayPaths


def ends_of(kind, n, seed):
    if kind in REFLECTED:
        return inner_links(n, seed, top=30.0)
    return [
        end + np.array([0.0, 0.0, shift])
        for end, shift in zip(front_links(n, seed), (3.7, 2.3), strict=True)
    ]


@cache
def case_of(kind, n=None, seed=42):
    medium, ends = medium_of(kind), ends_of(kind, n or 40, seed)
    if n is None and kind in REFLECTED:  # of which each has many rays
        ends = [end[:20] for end in ends]
    most = {"f": (2, 2), "i": (1, 1)}[kind[0]] if kind in REFLECTED else (0, 0)
    arrivals = find_eigenrays(medium, *ends, *most, tolerance=1e-5)
    return Case(medium, *ends, most, arrivals, trace_paths(medium, *ends, arrivals, tolerance=1e-5))


def bounces(paths):
    """First of the two nodes of every reflection."""
    at = np.flatnonzero(paths.boundary > 0)[::2]
    assert np.array_equal(np.flatnonzero(paths.boundary > 0), np.column_stack([at, at + 1]).ravel())
    return at


def boundary(medium, place, on_bed):
    """
    Height of places in the water above the bed, or depth below the surface, normals there, and
    distance from grid lines.
    """
    bed = sheet_under(medium.bed.north, medium.bed.east, medium.bed.depth, place)
    ice = sheet_under(medium.surface.north, medium.surface.east, medium.surface.depth, place)
    gap = np.where(on_bed, bed[0] - place[:, 2], place[:, 2] - ice[0])
    normal = np.column_stack([np.where(on_bed[:, None], bed[1], ice[1]), np.full(len(place), -1.0)])
    return (
        gap,
        normal / np.linalg.norm(normal, axis=1, keepdims=True),
        np.where(on_bed, bed[2], ice[2]),
    )


def clear_of_edges(case, least):
    """Whether all reflections of each arrival are so far inside their cells."""
    at = bounces(case.paths)
    _, _, edge = boundary(case.medium, case.paths.position[at], case.paths.boundary[at] == BED)
    return np.bincount(case.paths.arrival[at], edge < least, len(case.arrivals.link)) == 0


@KINDS
def test_slowness_has_its_length_and_its_integral_is_the_travel_time(kind):
    medium, _, _, _, arrivals, paths = case_of(kind)
    field = field_of(medium)
    assert len(arrivals.link) > 34
    length = np.linalg.norm(paths.slowness, axis=1)
    # a linear section's cells are those under the baseline: a reflected ray beside it meets other
    # kinks
    beside = kind == "facets linear"
    atol = 2e-5 if beside else 1e-7
    np.testing.assert_allclose(length * field(paths.position), 1.0, rtol=0, atol=atol)
    for end in ("source", "receiver"):
        length = np.linalg.norm(getattr(arrivals, f"{end}_slowness"), axis=1)
        speed = getattr(arrivals, f"{end}_sound_speed")[arrivals.link]
        np.testing.assert_allclose(length * speed, 1.0, rtol=0, atol=1e-9)
    time = path_integrals(paths, lambda x: 1.0 / field(x))[:, 0]
    np.testing.assert_allclose(time, arrivals.travel_time, rtol=0, atol=6e-7 if beside else 1e-7)


@pytest.mark.parametrize("kind", DIRECT[:2])
def test_horizontal_slowness_is_constant_in_uniform_oceans(kind):
    _, _, _, _, arrivals, paths = case_of(kind)
    at_source = arrivals.source_slowness[:, :2]
    np.testing.assert_allclose(paths.slowness[:, :2], at_source[paths.arrival], rtol=0, atol=1e-10)
    cosine = np.cos(arrivals.launch_angle) / arrivals.source_sound_speed[arrivals.link]
    np.testing.assert_allclose(np.linalg.norm(at_source, axis=1), cosine, rtol=1e-12)


@KINDS
def test_paths_lead_from_source_to_receiver_within_the_water(kind):
    medium, source, receiver, _, arrivals, paths = case_of(kind)
    first = np.flatnonzero(np.diff(paths.arrival, prepend=-1))
    last = np.append(first[1:], len(paths.arrival)) - 1
    assert np.array_equal(paths.arrival[first], np.arange(len(arrivals.link)))
    np.testing.assert_array_equal(paths.position[first], source[arrivals.link])
    np.testing.assert_array_equal(paths.position[last], receiver[arrivals.link])
    atol = 2e-8 if kind in REFLECTED else 1e-8
    for node, slowness in ((first, arrivals.source_slowness), (last, arrivals.receiver_slowness)):
        np.testing.assert_allclose(paths.slowness[node], slowness, rtol=0, atol=atol)
    np.testing.assert_array_equal(paths.travel_time[first], 0.0)
    np.testing.assert_allclose(paths.travel_time[last], arrivals.travel_time, rtol=0, atol=1e-12)
    inside = np.diff(paths.arrival) == 0
    assert (np.diff(paths.travel_time)[inside] >= 0.0).all()
    for on_bed in (True, False):
        assert (
            boundary(medium, paths.position, np.full(len(paths.arrival), on_bed))[0].min() > -1e-5
        )
    if kind in DIRECT:
        assert (paths.boundary == 0).all()
        turns = (np.diff(np.sign(paths.slowness[:, 2])) != 0)[inside]
        n_turns = np.bincount(paths.arrival[1:][inside], turns, len(arrivals.link))
        assert np.array_equal(n_turns, arrivals.turning_points)


@in_kinds(REFLECTED[:2] + REFLECTED[3:], REFLECTED)
def test_reflection_turns_the_slowness_about_the_local_normal(kind):
    """Angle in is angle out, the tangential slowness stays, and the place is on the boundary."""
    medium, _, _, _, arrivals, paths = case_of(kind)
    at = bounces(paths)
    assert at.size > 100
    np.testing.assert_array_equal(paths.position[at], paths.position[at + 1])
    np.testing.assert_array_equal(paths.travel_time[at], paths.travel_time[at + 1])
    np.testing.assert_array_equal(paths.boundary[at], paths.boundary[at + 1])
    gap, normal, edge = boundary(medium, paths.position[at], paths.boundary[at] == BED)
    np.testing.assert_allclose(gap, 0.0, atol=1e-5)
    clear = edge > 1e-3  # a normal is that of a cell
    before, after, normal = paths.slowness[at][clear], paths.slowness[at + 1][clear], normal[clear]
    across, away = np.sum(before * normal, axis=1), np.sum(after * normal, axis=1)
    np.testing.assert_allclose(away, -across, rtol=0, atol=1e-10)
    tangential = [v - s[:, None] * normal for v, s in ((before, across), (after, away))]
    np.testing.assert_allclose(*tangential, rtol=0, atol=1e-10)
    for flag, counts in ((SURFACE, arrivals.surface_bounces), (BED, arrivals.bottom_bounces)):
        met = np.bincount(paths.arrival[at], paths.boundary[at] == flag, len(arrivals.link))
        assert np.array_equal(met, counts)


def test_travel_time_is_stationary_at_every_reflection():
    """Uniform water: along the boundary the length of the polygon changes to second order only."""
    case = case_of("facets uniform")
    medium, source, receiver, _, arrivals, paths = case
    h, tested = 0.5, 0  # m

    def length(nodes):
        return np.sum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))

    for ray, link in enumerate(arrivals.link):
        own = np.flatnonzero(paths.arrival == ray)
        at = own[paths.boundary[own] > 0][::2]
        nodes = np.concatenate([[source[link]], paths.position[at], [receiver[link]]])
        assert length(nodes) / C == pytest.approx(arrivals.travel_time[ray], abs=1e-8)
        on_bed = paths.boundary[at] == BED
        _, _, edge = boundary(medium, paths.position[at], on_bed)
        for k in range(1, len(at) + 1):
            if edge[k - 1] < 2.0 * h:
                continue
            for axis in (0, 1):
                change = []
                for shift in (h, -h, 0.1 * h, -0.1 * h):
                    moved = nodes.copy()
                    moved[k, axis] += shift
                    moved[k, 2] = medium.bottom_depth(moved[k : k + 1])[0] if on_bed[k - 1] else 0.0
                    change.append((length(moved) - length(nodes)) / C)
                slope = (change[0] - change[1]) / (2.0 * h)
                assert abs(slope) < 5e-8, (
                    ray,
                    k,
                    axis,
                    slope,
                )  # s/m; a place 1 m away has some 3e-6
                bend = abs(change[0]) + abs(change[1])
                assert abs(change[2]) + abs(change[3]) < 0.02 * bend + 1e-9, (ray, k, axis, change)
                tested += 1
    assert tested > 120


def twin(arrivals, ray, other, link):
    """
    The row of other arrivals of a link that is the same ray, a little moved: bounces alike, nearest
    slowness.
    """
    same = (other.link == link) & (other.surface_bounces == arrivals.surface_bounces[ray])
    rows = np.flatnonzero(same & (other.bottom_bounces == arrivals.bottom_bounces[ray]))
    if rows.size == 0:
        return None
    gap = np.linalg.norm(other.source_slowness[rows] - arrivals.source_slowness[ray], axis=1)
    gap += np.linalg.norm(other.receiver_slowness[rows] - arrivals.receiver_slowness[ray], axis=1)
    best = rows[np.argmin(gap)]
    return best if gap.min() < 2e-5 else None


@pytest.mark.parametrize(("n", "seed"), [(3, 42)])
@in_kinds(SOON_SOLVED)
def test_slowness_is_the_gradient_of_travel_time_by_either_end(kind, n, seed):
    """
    Eikonal: dt/dx_receiver = slowness there, dt/dx_source = minus slowness there, for each ray.
    """
    direct = kind in DIRECT
    case = case_of(kind, n * 4 if direct else n, seed)
    _, source, receiver, _, arrivals, _ = case
    h = 0.5  # m
    strong = (arrivals.spreading_db > -3.0) & (clear_of_edges(case, 20.0))
    if direct:  # the others may be at a caustic
        strong &= np.bincount(arrivals.link)[arrivals.link] == 1
    else:
        strong &= arrivals.surface_bounces + arrivals.bottom_bounces > 0
    errors, lost = [], 0
    for axis in range(3):
        for end, vector, sign in (
            (0, arrivals.source_slowness, -1.0),
            (1, arrivals.receiver_slowness, 1.0),
        ):
            moved = []
            for direction in (1.0, -1.0):
                ends = [source.copy(), receiver.copy()]
                ends[end][:, axis] += direction * h
                tolerance = 1e-6 if direct else 1e-5
                moved.append(
                    find_eigenrays(case.medium, *ends, *case.most, 18.0, tolerance=tolerance)
                )
            for ray in np.flatnonzero(strong):
                rows = [twin(arrivals, ray, other, arrivals.link[ray]) for other in moved]
                if None in rows:
                    lost += 1
                    continue
                slope = np.subtract(
                    *(other.travel_time[row] for other, row in zip(moved, rows, strict=True))
                )
                errors.append(sign * slope / (2.0 * h) - vector[ray, axis])
    errors = np.abs(errors)
    assert len(errors) > 10 * n
    assert lost < 0.03 * len(errors), lost
    assert np.median(errors) < (2e-10 if direct else 2e-9), np.median(errors)
    least, share = (2e-8, 90) if direct else (1e-7, 98)
    assert np.percentile(errors, share) < least, np.percentile(errors, share)


@pytest.mark.parametrize(("n", "seed", "every"), [(None, 42, 20)])
@in_kinds(SOON_SOLVED)
def test_spreading_is_the_ray_tube_of_neighbouring_receivers(kind, n, seed, every):
    """
    Solid angle of launch per area across the ray at the receiver, by differences of launch
    directions.
    """
    case = case_of(kind, n, seed)
    medium, source, receiver, most, arrivals, _ = case
    h = 0.5
    clear = clear_of_edges(case, 20.0) & (arrivals.spreading_db < 10.0)
    keep = np.flatnonzero(clear)[:: every if kind in REFLECTED else 1]
    link = arrivals.link[keep]
    shifted = []
    for k in (0, 1):
        across = np.array(
            [np.linalg.svd(arrivals.receiver_slowness[ray][None])[2][1 + k] for ray in keep]
        )
        for sign in (1.0, -1.0):
            near = find_eigenrays(
                medium,
                source[link],
                receiver[link] + sign * h * across,
                *most,
                18.0,
                tolerance=1e-5,
            )
            rows = [twin(arrivals, ray, near, i) for i, ray in enumerate(keep)]
            unit = [
                np.full(3, np.nan)
                if row is None
                else near.source_slowness[row] * near.source_sound_speed[i]
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
    """
    Rows of two sets of arrivals that are one ray run both ways, and the rows of the first that have
    no other.
    """
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
    ("n", "seed", "every"), [(8, 44, 1), pytest.param(150, 48, 3, marks=pytest.mark.slow)]
)
@KINDS
def test_rays_are_reciprocal_when_both_ways_are_solved(kind, n, seed, every):
    """The same families from either end, angles exchanged and turned; times within 0.1 us."""
    n = 4 * n if kind in DIRECT else n
    ends = (end[::every] for end in ends_of(kind, n, seed))
    check_reciprocity(kind, *ends, (0.8 if kind in DIRECT else 3.0) * n / every)


def test_a_node_of_the_fan_on_a_root_is_no_gap_between_its_intervals():
    """
    A node within the tolerance of the root was above zero for one interval and below it for the
    other.
    """
    source, receiver = (end[122:123] for end in inner_links(150, 48))
    check_reciprocity("facets smooth", source, receiver, least=8)


def test_a_ray_with_jumps_of_its_miss_is_found_from_both_ends():
    """
    Weak, from near a crest: neighbours part so fast that a step more or less moves them by
    millimetres.
    """
    source, receiver = (end[330:331] for end in ends_of("profile smooth", 600, 48))
    check_reciprocity("profile smooth", source, receiver, least=1)


def check_reciprocity(kind, source, receiver, least):
    medium = medium_of(kind)
    most = (0, 0) if kind in DIRECT else (2, 2) if kind[0] == "f" else (1, 1)
    there = find_eigenrays(medium, source, receiver, *most, canonical=False)
    back = find_eigenrays(medium, receiver, source, *most, canonical=False)
    pairs, alone = same_rays(there, back, len(source), 1e-6)
    assert len(pairs) > least, len(pairs)
    # rays at the cut-off may fall on either side of it, pairs at a caustic be one or two
    odd = [i for i in alone if there.spreading_db[i] < 14.5]
    assert not odd, [(there.link[i], there.launch_angle[i], there.spreading_db[i]) for i in odd]
    one, two = pairs.T
    gap = np.abs(there.travel_time[one] - back.travel_time[two])
    assert gap.max() < 1e-7, gap.max()
    assert np.median(gap) < 5e-9, np.median(gap)
    spread = np.abs(there.spreading_db[one] - back.spreading_db[two])
    assert np.percentile(spread, 95) < 0.05, np.percentile(spread, 95)
    angle = np.abs(there.launch_angle[one] + back.arrival_angle[two])
    assert np.median(angle) < 1e-7, np.median(angle)
    assert np.mean(there.turning_points[one] == back.turning_points[two]) > 0.98
    canonical = [
        find_eigenrays(medium, *ends, *most).travel_time
        for ends in ((source, receiver), (receiver, source))
    ]
    assert np.array_equal(*canonical)


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "share"), [(20.0, 0.99), (60.0, 0.8)])
def test_over_random_cells_most_rays_are_found_from_both_ends(noise, share):
    """
    Known limit: 500 m cells whose slopes of 0.06 and 0.17 (rms) have nothing to do with each other.
    """
    north, east = np.arange(0.0, 14.1e3, 500.0), np.arange(0.0, 12.1e3, 500.0)
    rng = np.random.default_rng(3)
    bed = (
        1000.0
        + 0.03 * north[:, None]
        - 0.015 * east
        + noise * rng.normal(size=(north.size, east.size))
    )
    c = np.full((north.size, east.size, 2), 1500.0)
    medium = Medium.from_grid(north, east, [0.0, 4000.0], c, bathymetry=bed)
    source, receiver = inner_links(40, 5)
    there = find_eigenrays(medium, source, receiver, 2, 2, canonical=False)
    back = find_eigenrays(medium, receiver, source, 2, 2, canonical=False)
    pairs, alone = same_rays(there, back, len(source), 1e-6)
    _, others = same_rays(back, there, len(source), 1e-6)
    odd = sum(there.spreading_db[alone] < 14.5) + sum(back.spreading_db[others] < 14.5)
    assert len(pairs) > 200
    assert len(pairs) > share * (len(pairs) + odd), (len(pairs), odd)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_azimuth_and_place_do_not_matter_where_the_ocean_is_uniform(interpolation):
    medium = medium_of(f"profile {interpolation}")
    rng = np.random.default_rng(15)
    n = 40
    distance, bearing = rng.uniform(300.0, 8e3, n), rng.uniform(0.0, 2 * np.pi, n)
    z0, z1 = rng.uniform(5.0, 800.0, (2, n))
    zero = np.zeros(n)
    source = np.column_stack([zero, zero, z0])
    plain = find_eigenrays(medium, source, np.column_stack([distance, zero, z1]))
    corner = rng.uniform(-1e5, 1e5, (n, 2))
    step = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing)])
    moved = find_eigenrays(
        medium, np.column_stack([corner, z0]), np.column_stack([corner + step, z1])
    )
    assert np.array_equal(plain.link, moved.link)
    np.testing.assert_allclose(moved.travel_time, plain.travel_time, rtol=0, atol=1e-9)
    at = bearing[plain.link]
    flat = plain.source_slowness[:, 0]
    turned = np.column_stack([flat * np.cos(at), flat * np.sin(at), plain.source_slowness[:, 2]])
    np.testing.assert_allclose(moved.source_slowness, turned, rtol=0, atol=5e-9)


@pytest.mark.filterwarnings(
    "ignore:.*more eigenrays:RuntimeWarning"
)  # coarse tolerances make rays up
@pytest.mark.parametrize("kind", ["profile", "front"])
def test_time_error_is_of_first_order_in_the_tolerance_or_better(kind):
    medium = medium_of(f"{kind} smooth")
    source, receiver = front_links(30, 16)
    exact = find_eigenrays(medium, source, receiver, tolerance=1e-8)
    tolerances = 10.0 ** -np.arange(1.0, 6.0)
    errors = []
    for tolerance in tolerances:
        found = find_eigenrays(medium, source, receiver, tolerance=tolerance)
        gap = [
            np.min(np.abs(found.travel_time[found.link == i] - t), initial=np.inf)
            for i, t in zip(exact.link, exact.travel_time, strict=True)
        ]
        errors.append(np.percentile(gap, 90))
    if kind == "profile":  # quadrature over depth does not depend on the tolerance
        assert max(errors) < 1e-10, errors
        return
    order = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert order > 0.7, (order, errors)
    assert errors[2] < 3e-8, errors  # s, at the default tolerance


def test_turning_and_shifting_the_ocean_turns_and_shifts_the_rays():
    """
    A quarter turn maps (north, east) to (east, -north); the axes are reversed to keep them
    increasing.
    """
    front, (source, receiver) = make_front(), front_links(80, 6)
    plain = find_eigenrays(front, source, receiver)
    times = plain.first().travel_time
    turned = Medium.from_grid(
        front.east + 500.0,
        -front.north[::-1] + 9000.0,
        front.depth,
        np.swapaxes(front.sound_speed, 0, 1)[:, ::-1],
        bathymetry=np.swapaxes(front.bed.depth, 0, 1)[:, ::-1],
    )
    ends = [
        np.column_stack([p[:, 1] + 500.0, 9000.0 - p[:, 0], p[:, 2]]) for p in (source, receiver)
    ]
    moved = find_eigenrays(turned, *ends)
    again = moved.first().travel_time
    np.testing.assert_allclose(
        again, times, rtol=0, atol=1e-8
    )  # level links: another canonical end
    slant = (source[:, 2] != receiver[:, 2])[plain.link]
    assert np.array_equal(
        moved.link[(source[:, 2] != receiver[:, 2])[moved.link]], plain.link[slant]
    )
    for name in ("source_slowness", "receiver_slowness"):
        old = getattr(plain, name)[slant]
        new = getattr(moved, name)[(source[:, 2] != receiver[:, 2])[moved.link]]
        expected = np.column_stack([old[:, 1], -old[:, 0], old[:, 2]])
        assert np.percentile(np.abs(new - expected), 98) < 1e-9, name


def test_integrator_has_the_coefficients_of_dormand_and_prince():
    for row, theirs in zip(step.A[1:6], RK45.A[1:], strict=True):
        np.testing.assert_allclose(row[: len(theirs)], theirs, rtol=1e-15)
        assert not row[len(theirs) :].any()
    np.testing.assert_allclose(step.A[6], RK45.B, rtol=1e-15)
    np.testing.assert_allclose(step.C[:6], RK45.C, rtol=1e-15)
    np.testing.assert_allclose(
        [step.E1, 0.0, step.E3, step.E4, step.E5, step.E6, step.E7], -RK45.E, rtol=1e-13
    )


def test_bounce_limits_are_kept_and_asking_for_more_only_adds():
    front, (source, receiver) = make_front(), front_links(8, 47)
    source[:, 2] += 20.0
    rows = {}
    for most in ((0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (2, 2)):
        found = find_eigenrays(front, source, receiver, *most)
        assert found.surface_bounces.max() <= most[0]
        assert found.bottom_bounces.max() <= most[1]
        names = ("link", "surface_bounces", "bottom_bounces", "travel_time", "launch_angle")
        rows[most] = np.array(sorted(zip(*(getattr(found, name) for name in names), strict=True)))
    for few, less in rows.items():
        for many, more in rows.items():
            if few[0] <= many[0] and few[1] <= many[1]:
                kept = more[(more[:, 1] <= few[0]) & (more[:, 2] <= few[1])]
                # the same rays, polished from other ends of an interval
                gap = np.abs(kept[:, None] - less[None])
                same = np.all(gap < [0.5, 0.5, 0.5, 2e-9, 1e-6], axis=-1)
                assert same.sum() == len(kept) == len(less), (few, many)
    assert len(rows[2, 2]) > len(rows[1, 1]) > len(rows[0, 0])
