"""
Search for eigenrays with reflections at the surface and the sea bed.

Two fans share the launch angles. Up to _STEEPEST_FORWARD from the horizontal, rays are integrated
in range and reflected wherever they meet a boundary. Steeper rays, which may turn back on a slope,
are integrated in depth, leg by leg, for each number of reflections. Both fans first search in the
vertical plane of the link. Newton's method with two launch angles then includes slopes and
sound-speed gradients across the plane. Over a gridded sea bed, it continues with given cells.
"""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import bed_at, mark_of, surface_at
from pymantaray.acoustics._kernels.cells import (
    KNOWN,
    add_candidate,
    add_neighbours,
    add_of_bracket,
    candidate,
    solve_candidate,
)
from pymantaray.acoustics._kernels.curves import fits_curves
from pymantaray.acoustics._kernels.layout import Accuracy
from pymantaray.acoustics._kernels.refine import INSET, Launch, finish, refine_reflected, tube
from pymantaray.acoustics._kernels.search import (
    Search,
    aimed_at,
    fan_nodes,
    fewer_bounces,
    find_brackets,
)
from pymantaray.acoustics._kernels.trace import forward_course, legs_course
from pymantaray.compile import kernel

_STEEPEST_FORWARD = 1.08  # rad
_SHALLOWEST_LEGS = 1.02  # rad; the fans overlap, and rays of both are kept once
_SPACING_FORWARD = 0.04  # rad, beyond the angles at which rays can turn
_SPACING_LEGS = 0.13  # rad
# rad; a ray up to this angle beyond an edge of its cells in the plane may be within the cells out
# of the plane
_OVERHANG = 0.08
# rad; narrower windows between changes of reflections are searched for strong rays only
_RESOLUTION = 1e-6
# of the course, see `Search`; in water that varies with depth only, and in other water
_LATE, _LATE_BENT = 0.25, 0.06
# m; the steps of rays to a receiver nearer to a boundary end at the levels: across a level, a step
# has an error of centimetres that its estimate does not show
_BESIDE = 0.5
_SHARE_OF_GAP = 0.1  # of a receiver's distance from the boundaries: allowed error of its rays
_TRUST = 2e-4  # rad; rays above the usual cut-off have wider windows
_SAME_TIME, _SAME_ANGLE = 2e-8, 4e-5  # s, rad
_SAME_ERRORS = 4.0  # tolerances of the rays' ends, for a ray of both fans

Hunt = namedtuple("Hunt", "link reach accuracy bounces cutoff_db weak_slope limit spacing")
Hunt.__doc__ = """Link and settings of a search: maximum reflections at the surface and at the
bottom, cut-off [dB], slope of the miss above which rays are too weak, steepest angle of rays that
turn, and spacing of the first fan for `search.fan_nodes` [rad]."""

Reach = namedtuple("Reach", "top bed deepest slope across ice_slope ice_across inset on_boundary")
Reach.__doc__ = """Boundaries of a link: depths at the receiver, largest depth of the sea bed,
largest slopes of sea bed and ice along and across, distance of the target inside the boundary for a
receiver on it, and this boundary: -1 the surface, 1 the sea bed."""


@kernel
def reach_of(walls, link):
    """Depths and slopes of the boundaries of a link."""
    deepest, slope, across, ice_slope, ice_across = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(walls.n_breaks):
        r = walls.breaks[i]
        here, f_r, f_y, _, _ = bed_at(walls, r, 0.0, r)
        slope = max(slope, abs(f_r))
        deepest = max(deepest, here)
        across = max(across, abs(f_y))
        _, f_r, f_y, _, _ = surface_at(walls, r, 0.0, r)
        ice_slope = max(ice_slope, abs(f_r))
        ice_across = max(ice_across, abs(f_y))
    bed = bed_at(walls, link.horizontal, 0.0, link.horizontal)[0]
    top = surface_at(walls, link.horizontal, 0.0, link.horizontal)[0]
    inset, on_boundary = 0.0, 0.0
    if link.z1 - top < INSET:
        inset = link.z1 - (top + min(INSET, 0.5 * (bed - top)))
        on_boundary = -1.0
    elif link.z1 > bed - INSET:
        inset = link.z1 - max(bed - INSET, 0.5 * (top + bed))
        on_boundary = 1.0
    return Reach(top, bed, deepest, slope, across, ice_slope, ice_across, inset, on_boundary)


@kernel
def add_reflected(s, walls, hunt, count, work):
    """
    Append all eigenrays with one or more allowed reflections to work.rows; return a `SearchResult`.
    """
    horizontal, reach = hunt.link.horizontal, hunt.reach
    result = at.SearchResult(count, 0, 0, True)
    steepest = 0.5 * math.pi
    if horizontal > 1e-9:
        legs = hunt.bounces[0] + hunt.bounces[1] + 1
        steepest = math.atan(1.3 * legs * reach.deepest / horizontal) + 0.1
        result = _add_forward(s, walls, hunt, steepest, result, work)
    # on a slope, each reflection makes a ray steeper by twice the angle of the slope, so it may
    # turn back
    tilt = hunt.bounces[1] * math.atan(reach.slope) + hunt.bounces[0] * math.atan(reach.ice_slope)
    shallowest = max(_SHALLOWEST_LEGS - 2.0 * tilt, hunt.limit + 0.05)
    if steepest > shallowest:
        result = _add_in_legs(s, walls, hunt, shallowest, result, work)
    return result


@kernel
def beside_boundary(accuracy, reach, link):
    """Tolerances that show on which side of a reflection a ray to a receiver near it is."""
    fine = min(accuracy.fine, _SHARE_OF_GAP * max(INSET, _gap(reach, link)))
    return Accuracy(accuracy.coarse, fine, accuracy.miss)


@kernel
def _gap(reach, link):
    """Distance of the receiver from the nearer boundary. [m]"""
    return min(link.z1 - reach.top, reach.bed - link.z1)


@kernel
def _add_forward(s, walls, hunt, steepest, result, work):
    """Append the eigenrays that are integrated along the horizontal."""
    link, reach = hunt.link, hunt.reach
    nodes = work.nodes
    hi = min(_STEEPEST_FORWARD, max(hunt.limit, steepest))
    inner = min(hunt.limit, hi)
    n = fan_nodes(s, -inner, inner, hunt.spacing, link, nodes)
    more = max(int(math.ceil((hi - inner) / _SPACING_FORWARD)), 0)
    more = min(more, (nodes.size - n) // 2)
    for i in range(n):
        nodes[n - 1 - i + more] = nodes[n - 1 - i]
    for i in range(more):
        step = (hi - inner) * (i + 1) / more
        nodes[more - 1 - i] = -inner - step
        nodes[more + n + i] = inner + step
    fold = 0
    fold_depth = link.z1 - reach.inset
    if reach.on_boundary != 0.0:
        at_bottom = reach.on_boundary > 0.0
        fold = mark_of(walls, link.horizontal, 0.0, at_bottom)
        fold_depth = reach.bed if at_bottom else reach.top
    z_end = link.z1 - reach.inset
    beside = s.kind == at.SMOOTH and _gap(reach, link) < _BESIDE
    course = forward_course(link, hunt.bounces, 1, fold, z_end, beside)
    fan = aimed_at(course, fold_depth - link.z0)
    return _collect(s, walls, (course, fan), n + 2 * more, hunt.limit, hunt, result, work)


@kernel
def _add_in_legs(s, walls, hunt, shallowest, result, work):
    """Append the eigenrays that are integrated in depth."""
    link, deepest = hunt.link, hunt.reach.deepest
    nodes = work.nodes
    half = 0.5 * math.pi - shallowest
    for first in range(2):
        for legs in range(2, hunt.bounces[0] + hunt.bounces[1] + 2):
            n_s = legs // 2 if first == 1 else (legs - 1) // 2
            n_b = legs - 1 - n_s
            if n_s > hunt.bounces[0] or n_b > hunt.bounces[1]:
                continue
            horizontal = link.horizontal
            if (
                horizontal > 1e-9
                and math.atan(1.3 * legs * deepest / horizontal) + 0.1 < shallowest
            ):
                continue
            n = min(int(math.ceil(2.0 * half / _SPACING_LEGS)) + 1, nodes.size)
            for i in range(n):
                nodes[i] = half * (2.0 * i / (n - 1) - 1.0)
            course = legs_course(
                link, (n_s, n_b), first == 0, link.z1 - hunt.reach.inset, legs * deepest
            )
            result = _collect(s, walls, (course, course), n, -1.0, hunt, result, work)
    return result


@kernel
def _collect(s, walls, courses, n_nodes, steep, hunt, result, work):
    """
    Find and refine the reflected rays of one fan; courses are that of the rays, and that of the fan
    with the target of the search.
    """
    count, weak, rays, complete = result
    course, fan_course = courses
    reach, accuracy = hunt.reach, hunt.accuracy
    cells = walls.cells
    # resolution and tolerances of the search
    width, trust = _RESOLUTION, _TRUST
    if math.isinf(hunt.cutoff_db):  # every ray there is
        width, trust = 1e-3 * width, 1e-3 * trust
    gridded = walls.bed.depth.size > 1 and course.rule.fold == 0
    overhang = min(_OVERHANG, reach.slope + reach.across) if gridded else 0.0
    coarse, late = accuracy.coarse, _LATE_BENT
    if s.kind == at.SMOOTH and fits_curves(s, walls, course, math.inf, 0.0):
        coarse, late = accuracy.fine, _LATE
    search = Search(
        coarse, accuracy.fine, width, trust, steep, hunt.weak_slope, overhang, math.inf, late, 0.0
    )
    n_brackets, _, more_rays, all_there, _ = find_brackets(
        s, walls, fan_course, n_nodes, 0.0, search, work
    )
    # rays of the brackets, then those of the candidates that they add
    n, done = 0, 0  # candidates, and those solved
    i = 0
    while i < n_brackets or done < n:
        bracket = work.brackets[min(i, n_brackets - 1)]
        launch = Launch(False, 0.0, 0.0, 0, 0)
        same = False
        generation = 0
        if i < n_brackets:
            i += 1
            counts = int(bracket[fewer_bounces(bracket), at.CODE]) % 1024
            if bracket[0, at.ANGLE] < bracket[1, at.ANGLE]:
                launch, same = refine_reflected(s, walls, course, bracket, accuracy, work)
        else:
            counts, generation = candidate(work.candidates, done)
            done += 1
            if generation == KNOWN:
                continue
            same = True
            n, launch = solve_candidate(s, walls, course, (done - 1, n), bracket, accuracy, work)
        # keep the ray, and add the cells around its own
        if launch.ok:
            if gridded:
                q = launch.q
                n = add_candidate(
                    work.candidates, n, cells[at.LANDED], launch.angle, q, counts, KNOWN
                )
                n = add_neighbours(walls, n, launch, counts, generation + 1, work)
            count, too_weak = _keep(s, walls, course, launch, counts, hunt, count, work)
            weak += too_weak
        # add the bracket's cells if the ray has others
        if gridded and not same:
            n = add_of_bracket(s, walls, course, bracket, n, accuracy.fine, work)
    return at.SearchResult(count, weak, rays + more_rays, complete and all_there)


@kernel
def _keep(s, walls, course, launch, counts, hunt, count, work):
    """
    Write the ray in work.y to the next row unless it exists; return the number of rows, and 1 if
    the ray is below the cut-off.
    """
    link, reach = hunt.link, hunt.reach
    rows = work.rows
    n_s, n_b = counts // 32, counts % 32
    if count >= rows.shape[0] or n_s > hunt.bounces[0] or n_b > hunt.bounces[1] or counts == 0:
        return count, 0
    row = rows[count]
    plain = work.y[at.XI] * work.y[at.DY_DQ]
    finish(row, work.y, launch, course, link, reach.inset)
    if course.rule.kind == at.LEGS:
        row[at.TRAVEL_TIME] += reach.inset * row[at.RECEIVER_SLOWNESS + 2]
    row[at.SURFACE_BOUNCES], row[at.BOTTOM_BOUNCES] = n_s, n_b
    # slopes couple both launch parameters
    if (n_b > 0 and reach.across > 1e-9) or (n_s > 0 and reach.ice_across > 1e-9):
        det = tube(s, walls, course, launch, hunt.accuracy.fine, work)
        if not math.isnan(det):
            row[at.SPREADING_DB] += 10.0 * math.log10(
                max(abs(det), 1e-300) / max(abs(plain), 1e-300)
            )
    if reach.on_boundary * row[at.ARRIVAL_ANGLE] < 0.0:  # reflected at the receiver itself
        return count, 0
    if row[at.SPREADING_DB] > hunt.cutoff_db:
        return count, 1
    angle = _SAME_ANGLE + 10.0 * abs(reach.inset) / link.length
    for j in range(count):
        # rays of both fans differ by the errors of two integrations
        both = rows[j, at.RAY_AXIS] != row[at.RAY_AXIS]
        time = max(_SAME_TIME, _SAME_ERRORS * hunt.accuracy.fine / link.c0) if both else _SAME_TIME
        if (
            rows[j, at.SURFACE_BOUNCES] == n_s
            and rows[j, at.BOTTOM_BOUNCES] == n_b
            and abs(rows[j, at.TRAVEL_TIME] - row[at.TRAVEL_TIME]) < time
            and abs(rows[j, at.LAUNCH_ANGLE] - row[at.LAUNCH_ANGLE]) < angle
        ):
            return count, 0
    return count + 1, 0
