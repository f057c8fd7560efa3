"""
Solver of links: compute the section, search, refine, and check that the rays stay in the water.
"""

import math

import numpy as np

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.beside import direct_ray, trace_direct
from pymantaray.acoustics._kernels.boundary import TOUCH, clearances
from pymantaray.acoustics._kernels.field import (
    add_crossings,
    cut_section,
    field_at,
    sort_breaks,
    sort_head,
)
from pymantaray.acoustics._kernels.flights import (
    own_work,
    progress_of,
    put_flight,
    put_progress,
    section_of,
    share_store,
)
from pymantaray.acoustics._kernels.layout import Accuracy, Baseline, Link, Walls
from pymantaray.acoustics._kernels.march import march
from pymantaray.acoustics._kernels.refine import (
    RESOLUTION,
    Launch,
    Widened,
    cross_slowness,
    cubic_angle,
    finish,
    jumps,
    miss_noise,
    narrow,
    polish,
    put_off,
    refine,
    sort_rows,
    taken_up,
    unresolved_db,
    widened,
)
from pymantaray.acoustics._kernels.search import (
    BEYOND,
    FROM_ONE_END,
    STEEP,
    Search,
    advance,
    fan_nodes,
    fill_fan,
    find_brackets,
    is_steep,
    is_weak,
    put_fan,
    shoot,
    shoot_waiting,
    slope_at_root,
    snell_limit,
    speed_extremes,
    tally_of,
    turning_limits,
)
from pymantaray.acoustics._kernels.search_reflected import (
    Hunt,
    add_reflected,
    beside_boundary,
    reach_of,
)
from pymantaray.acoustics._kernels.trace import (
    course_to_levels,
    direct_course,
    ray_axis,
)
from pymantaray.acoustics._kernels.trapped import leave_out_trapped, trapped_angle
from pymantaray.compile import compact, entry, inlined, kernel, shared
from pymantaray.geometry.boundary_kernels import depth_at

# Ray of a bracket: in the water, through the surface, into the sea bed, in the water and weak; or
# no ray because the miss jumps; or no ray
_CLEAR, _THROUGH, _BLOCKED, _WEAK, _JUMP, _NONE = range(6)
# Brackets in the order of refinement: those that may contain an arrival, those whose cubic predicts
# a ray below the cut-off, those with a jump, those with a miss so steep that rays are weak
_LIKELY, _FAINT, _UNLIKELY, _STEEP_BRACKET = range(4)
_FAINT_SHARE = 0.3  # of the slope of a weak ray: slope of a ray three times as weak as the cut-off
OK, SHADOW, BLOCKED, OUTSIDE, WEAK, UNRESOLVED = 0, 1, 2, 3, 4, 7  # as `records.RayStatus`
_LATER = -1  # status of a link that is put off
_SPACING_SMOOTH = (
    0.016,
    3e-4,
)  # rad; spacing of the first fan, and distance within which nodes are merged
_SPACING_LINEAR = 0.008, 1e-9
_RESOLVED = (
    30.0  # m; by which neighbours may fail to predict the miss and the extreme depths of each other
)
# m; a longer link with arrivals is solved from both ends if a curve of rays may exist that this end
# does not meet
_FAR = 12e3
# rad; an upper bound of the shift by horizontal refraction, about twenty times the shift itself
_SMALL_SHIFT = 1e-4
_REACH_SLOPE = 0.05  # largest mean slope of a ray beyond the depths of both ends
# share of the tolerance for the eigenrays of such links: their errors grow with the divergence
_FINER = 0.1
_SAMPLES = 8  # columns of a section
_WITHIN_FAN = 0.999  # of the flatter edge of a fan: rays that may be left out as trapped
_ONE_LAUNCH, _ONE_ARRIVAL = 5e-6, 1e-4  # rad; nearer rays are one
_CHORD_HALF_WIDTH = 0.02  # rad; of the bracket of a steep link
_FULL_TOLERANCE_LENGTH = 2e4  # m; for longer links the tolerance grows with their length
_GAUSS_NODES = (-0.906179845938664, -0.5384693101056831, 0.0, 0.5384693101056831, 0.906179845938664)
_GAUSS_WEIGHTS = (
    0.23692688505618908,
    0.47862867049936647,
    0.5688888888888889,
    0.47862867049936647,
    0.23692688505618908,
)


@kernel
def baseline(domain, source, unit, horizontal, work):
    """FieldSection and boundaries along a baseline."""
    line = Baseline(source[0], source[1], unit[0], unit[1])
    s = cut_section(domain, line, horizontal, work)
    breaks, end = work.wall_breaks, max(horizontal, 1e-6)
    breaks[0] = 0.0
    n = add_crossings(domain.bed, line, end, breaks, 1)
    n = sort_breaks(end, breaks, add_crossings(domain.surface, line, end, breaks, n))
    return s, Walls(domain.bed, domain.surface, line, breaks, n, 1.0, work.cells, -1.0)


@kernel
def prepare(domain, source, receiver, work):
    """FieldSection, boundaries and ends of a link."""
    dn, de, dz = receiver[0] - source[0], receiver[1] - source[1], receiver[2] - source[2]
    horizontal = math.hypot(dn, de)
    unit = 1.0, 0.0
    if horizontal > 0.0:
        unit = dn / horizontal, de / horizontal
    s, walls = baseline(domain, source, unit, horizontal, work)
    c0, c1 = field_at(s, 0.0, source[2]), field_at(s, horizontal, receiver[2])
    length = math.hypot(horizontal, dz)
    return s, walls, Link(source[2], receiver[2], c0, c1, horizontal, length, unit[0], unit[1])


@kernel
def _outside(domain, point):
    """True if a position is outside the domain or the water."""
    north, east = domain.north, domain.east
    if north.size > 1 and not north[0] <= point[0] <= north[north.size - 1]:
        return True
    if east.size > 1 and not east[0] <= point[1] <= east[east.size - 1]:
        return True
    top = depth_at(domain.surface, point[0], point[1])
    if domain.surface.depth.size > 1:
        top -= TOUCH
    return not top <= point[2] <= depth_at(domain.bed, point[0], point[1]) + TOUCH


@kernel
def chord_travel_time(s, link, cuts):
    """
    Travel time along the straight chord: Gauss-Legendre between all levels and columns it crosses.
    """
    z0, z1, horizontal = link.z0, link.z1, link.horizontal
    n = 0
    cuts[n] = 0.0
    n += 1
    if z1 != z0:
        for i in range(s.depth.size):  # in the order in which the chord crosses them
            k = i if z1 > z0 else s.depth.size - 1 - i
            t = (s.depth[k] - z0) / (z1 - z0)
            if 0.0 < t < 1.0:
                cuts[n] = t
                n += 1
    if horizontal > 0.0:
        for i in range(s.n_range + 1):
            r = s.breaks[i] if s.kind == at.LINEAR else s.r_first + i * s.r_step
            t = r / horizontal
            if 0.0 < t < 1.0 and n < cuts.size - 1:
                cuts[n] = t
                n += 1
    cuts[n] = 1.0
    n += 1
    sort_head(cuts, n)
    total = 0.0
    for i in range(n - 1):
        h = 0.5 * (cuts[i + 1] - cuts[i])
        if h <= 0.0:
            continue
        mid = 0.5 * (cuts[i + 1] + cuts[i])
        for q in range(5):
            t = mid + h * _GAUSS_NODES[q]
            total += _GAUSS_WEIGHTS[q] * h / field_at(s, t * horizontal, z0 + t * (z1 - z0))
    return total * link.length


@kernel
def _add_roots(a, b, c, cuts, n):
    """Add the roots between 0 and 1 of a + b t + c t^2 to the first n cuts; return their number."""
    inside = b * b - 4.0 * a * c
    if inside <= 0.0:
        return n
    q = -0.5 * (b + math.copysign(math.sqrt(inside), b))
    if c != 0.0 and 0.0 < q / c < 1.0 and n < cuts.size - 1:
        cuts[n] = q / c
        n += 1
    if q != 0.0 and 0.0 < a / q < 1.0 and n < cuts.size - 1:
        cuts[n] = a / q
        n += 1
    return n


@kernel
def sphere_chord_time(s, link, radius, cuts):
    """
    Travel time along the straight chord through the Earth, from a section of flattened water, as
    `chord_travel_time`.
    """
    horizontal, angle = link.horizontal, link.horizontal / radius
    r0, r1 = radius * math.exp(-link.z0 / radius), radius * math.exp(-link.z1 / radius)
    # the chord in the vertical plane, from (0, r0): up is the direction from the Earth's centre to
    # the source
    along, up = r1 * math.sin(angle), (r1 - r0) - 2.0 * r1 * math.sin(0.5 * angle) ** 2
    length = math.hypot(along, up)
    n = 1
    cuts[0] = 0.0
    for k in range(s.depth.size):
        r = radius * math.exp(-s.depth[k] / radius)
        n = _add_roots((r0 - r) * (r0 + r), 2.0 * r0 * up, length * length, cuts, n)
    if horizontal > 0.0:
        for i in range(s.n_range + 1):
            t = (s.breaks[i] if s.kind == at.LINEAR else s.r_first + i * s.r_step) / horizontal
            if 0.0 < t < 1.0 and n < cuts.size - 1:
                cuts[n] = t
                n += 1
    cuts[n] = 1.0
    n += 1
    sort_head(cuts, n)
    total = 0.0
    for i in range(n - 1):
        h = 0.5 * (cuts[i + 1] - cuts[i])
        if h <= 0.0:
            continue
        mid = 0.5 * (cuts[i + 1] + cuts[i])
        for q in range(5):
            t = mid + h * _GAUSS_NODES[q]
            x, y = t * along, r0 + t * up
            stretch = radius / math.hypot(x, y)
            speed = field_at(s, radius * math.atan2(x, y), radius * math.log(stretch))
            total += _GAUSS_WEIGHTS[q] * h * stretch / speed
    return total * length


@kernel
def _tolerances(s, link, settings):
    """Tolerances of a link's rays, and the slope of the miss above which rays are too weak."""
    tol = settings.tolerance * max(1.0, link.length / _FULL_TOLERANCE_LENGTH)
    fine, coarse = min(tol, 1e-4 * link.length), min(30.0 * tol, 1e-2 * link.length)
    if (
        s.kind == at.LINEAR
    ):  # a ray that enters the next layer by a centimetre leaves it metres away
        fine = min(1e-3 * tol, 1e-8 * link.length)
        coarse = fine
    return Accuracy(coarse, fine, min(1e-2, 1e-6 * link.length)), link.length * 10.0 ** (
        0.1 * settings.cutoff_db + 1.0
    )


@kernel
def _direct_search(s, link, cross, trapped, settings):
    """Settings of the search of direct rays; those flatter than trapped [rad] do not arrive."""
    accuracy, weak_slope = _tolerances(s, link, settings)
    resolved = _RESOLVED if cross else math.inf
    # a ladder has no tolerance
    coarse = accuracy.fine if s.ladder else accuracy.coarse
    return Search(
        coarse, accuracy.fine, RESOLUTION, 0.0, 0.0, weak_slope, 0.0, resolved, 0.0, trapped
    )


@kernel
def _spacing(s):
    """Spacing of the first fan, and distance within which nodes are merged. [rad]"""
    return _SPACING_LINEAR if s.kind == at.LINEAR else _SPACING_SMOOTH


@inlined
def _one_by_one(domain):
    """True if the rays of a fan are traced one after another."""
    return domain.kind == at.LINEAR or domain.ladder


@kernel
def _first_gap(s):
    """Distance of those rays of the first fan that are traced first, 0 if all are. [rad]"""
    return 0.0 if s.kind == at.LINEAR else 2.0 * _SPACING_SMOOTH[0]


@kernel
def _leaves_plane(s, link):
    """
    True if horizontal refraction may move the launch angles of rays by more than _SMALL_SHIFT.

    Rays are then traced in three dimensions. With the mean cross-track gradient g of the sound
    speed along the section, a ray leaves the plane by up to g R^2 / 8 c; the gradient's derivative
    by depth turns it there by R / c times their product.
    """
    if s.kind == at.LINEAR or s.n_range < 3:
        return False
    span = link.horizontal
    top = min(link.z0, link.z1) - _REACH_SLOPE * span
    low = max(link.z0, link.z1) + _REACH_SLOPE * span
    gradient, shear = 0.0, 0.0
    stride = max(s.n_range // _SAMPLES, 1)
    for k in range(s.depth.size - 1):
        if s.depth[k + 1] < top or s.depth[k] > low:
            continue
        here, bend, count = 0.0, 0.0, 0
        for i in range(0, s.n_range, stride):
            here, bend, count = here + abs(s.data[i, k, 8]), bend + abs(s.data[i, k, 9]), count + 1
        gradient, shear = max(gradient, here / count), max(shear, bend / count)
    return gradient * span * span / 8.0 * shear * span > _SMALL_SHIFT * link.c0 * link.c0


@kernel
def _begin(domain, section, i, work, results):
    """
    Begin to solve link i: put the angles of its fan into work.nodes; return their number, 0 for a
    steep link, -1 if it is solved.
    """
    s, _, link = section
    info = results.info[i]
    info[at.SOURCE_SPEED], info[at.RECEIVER_SPEED] = link.c0, link.c1
    if link.length == 0.0:
        info[at.CHORD_TIME], info[at.MARGIN] = 0.0, 0.0
        _same_place(work.rows[0])
        _put_rows(1, i, work, results)
        results.status[i] = OK
        return -1
    if domain.radius > 0.0:
        info[at.CHORD_TIME] = sphere_chord_time(s, link, domain.radius, work.cuts)
    else:
        info[at.CHORD_TIME] = chord_travel_time(s, link, work.cuts)
    variation = speed_extremes(s, work.extremes)
    limits = turning_limits(s, link.c0, link.z0, link.z1, link.horizontal, variation, work.extremes)
    slope = math.atan2(link.z1 - link.z0, link.horizontal)
    if is_steep(slope, max(limits[0], limits[1])):
        return 0
    # a ray that turns is within the limits; a ray that does not turn is as steep as the chord at
    # some depth
    lo = -math.acos(math.cos(limits[0]) * math.cos(min(slope, 0.0))) - BEYOND
    hi = math.acos(math.cos(limits[1]) * math.cos(max(slope, 0.0))) + BEYOND
    return fan_nodes(s, lo, hi, _spacing(s), link, work.nodes)


@kernel
def _trapped_rays(s, link, n_nodes, work):
    """
    Leave the rays that are trapped away from the receiver out of a fan of n_nodes angles; return
    the number of the others, and the angle below which rays are trapped, 0 if none is. [rad]
    """
    nodes, angle = work.nodes, 0.0
    if n_nodes > 0 and s.kind == at.LINEAR and s.layered == at.VARYING:
        angle = trapped_angle(s, link, work)
        angle = min(angle, _WITHIN_FAN * min(-nodes[0], nodes[n_nodes - 1]))
    if not angle > 0.0 or n_nodes > nodes.size - 2:
        return n_nodes, 0.0
    return leave_out_trapped(n_nodes, angle, nodes), angle


@kernel
def _start(domain, bounces, settings, ends, slot, work, flights, results):
    """
    Start to solve link i of slot (i, k, across); return True if its rays now wait in slot k of
    the queue, False if it is solved.

    Rays along a chord, those of a LINEAR medium, and all rays if flights is None are traced one by
    one. Links whose rays leave the plane are put off until across is True: the lanes of the queue
    must not depend on each other.
    """
    i, _, across = slot
    for j in range(at.N_INFO):
        results.info[i, j] = np.nan
    results.info[i, at.RAYS] = 0.0
    results.info[i, at.COMPLETE] = 1.0
    results.info[i, at.RESOLVED] = 1.0
    results.counts[i] = 0
    results.status[i] = OUTSIDE
    if _outside(domain, ends[0]) or _outside(domain, ends[1]):
        return False
    section = prepare(domain, ends[0], ends[1], work)
    n_nodes = _begin(domain, section, i, work, results)
    if n_nodes < 0:
        return False
    s, walls, link = section
    cross = n_nodes > 0 and _leaves_plane(s, link)
    if cross and flights is not None and not across:
        results.status[i] = _LATER
        return False
    n_nodes, trapped = _trapped_rays(s, link, n_nodes, work)
    search = _direct_search(s, link, cross, trapped, settings)
    course = direct_course(link, n_nodes == 0, cross)
    if n_nodes == 0:
        tally = _predicted_bracket(link, results.info[i, at.CHORD_TIME], work)
    elif flights is not None and not _one_by_one(domain):  # for None, Numba omits this branch
        fan = put_fan(n_nodes, search.coarse, _first_gap(s), work)
        put_flight(section, slot[:2], fan, cross, work, flights)
        return True
    else:
        tally = find_brackets(s, walls, course, n_nodes, _first_gap(s), search, work)
    _end(section, course, tally, bounces, settings, i, work, results)
    return False


@kernel
def _continue(domain, bounces, settings, k, work, flights, results):
    """
    Continue to solve the link in slot k of the queue after its rays were traced; return True if
    rays wait again, False if it is solved.
    """
    row = flights.links[k]
    section, progress = section_of(domain, row, work), progress_of(row)
    s, walls, link = section
    course = direct_course(link, False, row[at.FLIGHT_CROSS] > 0.0)
    search = _direct_search(s, link, course.cross, 0.0, settings)
    levels = course_to_levels(s, course)
    first, last = int(row[at.FLIGHT_FIRST]), int(row[at.FLIGHT_LAST])
    shoot_waiting(s, walls, levels if row[at.FLIGHT_LEVELS] > 0.0 else course, first, last, work)
    if progress.asked < 0.0:
        progress = fill_fan(link.horizontal, progress, work)
        put_progress(k, first, last, progress, work, flights)
        if row[at.FLIGHT_PENDING] > 0.0:
            return True
    while True:
        progress = advance(s.n_range > 1, course, search, progress, work)
        row[at.FLIGHT_LEVELS] = 1.0
        put_progress(k, 0, 2 * int(progress.asked), progress, work, flights)
        if row[at.FLIGHT_PENDING] > 0.0:
            return True
        if progress.asked == 0.0:
            break
    _end(
        section,
        course,
        tally_of(progress),
        bounces,
        settings,
        int(row[at.FLIGHT_LINK]),
        work,
        results,
    )
    return False


@kernel
def _end(section, course, tally, bounces, settings, i, work, results):
    """
    Find the eigenrays in the brackets of link i, and the reflected ones with up to bounces
    reflections at the surface and the bottom.

    With bounces None, only direct ones. tally is what `find_brackets` returned; the results receive
    the arrivals and the status.
    """
    s, walls, link = section
    n, margin, rays, complete, resolved = tally
    info = results.info[i]
    accuracy, weak_slope = _tolerances(s, link, settings)
    # direct eigenrays
    own = (
        Accuracy(accuracy.coarse, _FINER * accuracy.fine, accuracy.miss)
        if course.cross
        else accuracy
    )
    count, through_surface, blocked, weak = _keep_direct(
        s, walls, link, (n, course), (settings.cutoff_db, weak_slope), own, work
    )
    # reflected eigenrays
    if bounces is not None and bounces[0] + bounces[1] > 0:  # for None, Numba omits this branch
        variation = speed_extremes(s, work.extremes)
        limit = snell_limit(s, link.c0, 0.0, math.inf, variation, work.extremes)[0] + STEEP
        reach = reach_of(walls, link)
        hunt = Hunt(
            link,
            reach,
            beside_boundary(accuracy, reach, link),
            bounces,
            settings.cutoff_db,
            10.0 * weak_slope,
            limit,
            _spacing(s),
        )
        count, more_weak, more_rays, all_there = add_reflected(s, walls, hunt, count, work)
        weak += more_weak
        rays += more_rays
        complete = complete and all_there
    # margin and completeness of the search
    info[at.MARGIN] = 0.0 if count > 0 else margin
    info[at.RAYS] = rays
    info[at.COMPLETE] = 1.0 if complete else 0.0
    if resolved == FROM_ONE_END and (count == 0 or link.horizontal <= _FAR):
        resolved = 1.0
    info[at.RESOLVED] = resolved if complete else 0.0
    # the eigenrays, or the reason why there is none
    if count > 0:
        sort_rows(work.rows, count)
        results.status[i] = OK
    elif not complete:
        results.status[i] = UNRESOLVED
    elif weak > 0:
        results.status[i] = WEAK
    elif blocked > 0:
        results.status[i] = BLOCKED
    else:
        results.status[i] = SHADOW
        if through_surface > 0 or margin == 0.0:
            info[at.MARGIN] = math.nan  # rays through the surface have no miss
    _put_rows(count, i, work, results)


@kernel
def _same_place(row):
    """Fill the row of a link with coincident ends."""
    for i in range(at.N_ARRIVAL):
        row[i] = np.nan
    for i in (at.TRAVEL_TIME, at.TURNING_POINTS, at.CAUSTICS):
        row[i] = 0.0
    for i in (at.SURFACE_BOUNCES, at.BOTTOM_BOUNCES, at.RAY_AXIS):
        row[i] = 0.0


@kernel
def _predicted_bracket(link, chord_time, work):
    """
    Bracket of a steep link about the launch angle that Snell's law predicts, without a ray; returns
    the values of `find_brackets`.

    With c = m (1 + d) along the chord of slope b, the mean m and a mean square v of d, the cosine
    of the slope at the source is cos(b) (c_source / m) (1 - 1.5 v / tan(b)^2) to second order; v is
    that of a constant gradient.
    """
    chord = math.atan2(link.z1 - link.z0, link.horizontal)
    mean = link.length / chord_time
    square = ((link.c1 - link.c0) / mean) ** 2 / 12.0
    ratio = link.horizontal / (link.z1 - link.z0)
    cosine = math.cos(chord) * link.c0 / mean * (1.0 - square * (1.0 + 1.5 * ratio * ratio))
    angle = math.copysign(math.acos(min(cosine, 1.0)), chord) - chord
    for i in range(2):
        end = work.brackets[0, i]
        end[at.ANGLE] = angle + (2 * i - 1) * _CHORD_HALF_WIDTH
        end[at.MISS], end[at.SLOPE] = link.length * (end[at.ANGLE] - angle), link.length
        end[at.CROSS] = 0.0
    return 1, 0.0, 0, True, 1.0


@kernel
def _bracket_about_chord(s, walls, course, tol, work):
    """Widened bracket of a steep link, from rays on both sides of the chord."""
    half = _CHORD_HALF_WIDTH
    a, b = work.stack[0, 0], work.stack[0, 1]
    while half <= 32.0 * _CHORD_HALF_WIDTH:
        shoot(s, walls, course, -half, tol, 0.0, a, work)
        shoot(s, walls, course, half, tol, 0.0, b, work)
        if a[at.GOOD] * b[at.GOOD] > 0.0 and a[at.MISS] * b[at.MISS] <= 0.0:
            return Widened(True, -half, half, a[at.MISS], b[at.MISS], 0.0)
        half *= 2.0
    return Widened(False, -half, half, a[at.MISS], b[at.MISS], 0.0)


@kernel
def _course_of(launch, course, walls, work):
    """Course of the ray in work: _THROUGH the surface, _BLOCKED by the sea bed, or _CLEAR."""
    _, cb, sb, _ = course.axis
    y = work.y
    miss = y[at.W] - course.target
    below_surface, above_bottom = clearances(
        work.path, launch.steps, walls, -sb * miss, cb * miss, y[at.Y]
    )
    if below_surface < -TOUCH:
        return _THROUGH
    return _BLOCKED if above_bottom < -TOUCH else _CLEAR


@shared
def _keep_direct(s, walls, link, fan, cutoff, accuracy, work):
    """
    Refine the direct rays in the brackets of a fan, and keep those that stay in the water.

    fan contains the number of brackets and their course; cutoff contains the cut-off of the
    spreading, and the slope of the miss above which rays are too weak. [dB, m] Returns the number
    of rows, and the numbers of rays through the surface, into the sea bed and below the cut-off.
    """
    n, course = fan
    brackets, rank = work.brackets, work.nodes  # the search has ended and needs its nodes no longer
    count, through_surface, blocked, weak = 0, 0, 0, 0
    for i in range(n):
        rank[i] = _rank(brackets[i], cutoff[1])
    for round_rank in range(_STEEP_BRACKET + 1):
        for i in range(n):
            if rank[i] != round_rank:
                continue
            if round_rank == _STEEP_BRACKET:
                verdict = _course_of_weak(s, walls, course, brackets[i], accuracy, work)
            else:
                own = brackets[i], course, round_rank <= _FAINT
                verdict = _keep_bracket(s, walls, link, own, cutoff, accuracy, (count, work))
            if verdict == _JUMP:
                rank[i] = _UNLIKELY
            through_surface += 1 if verdict == _THROUGH else 0
            blocked += 1 if verdict == _BLOCKED else 0
            weak += 1 if verdict == _WEAK else 0
            count = _keep_row(work.rows, count) if verdict == _CLEAR else count
            if round_rank == _STEEP_BRACKET and weak > 0:
                break
        if count + weak > 0:  # the other brackets matter only without any ray
            break
    return count, through_surface, blocked, weak


@kernel
def _rank(bracket, weak):
    """Round in which a bracket is refined."""
    if is_weak(bracket, weak, RESOLUTION):
        return _STEEP_BRACKET
    return _FAINT if slope_at_root(bracket) > _FAINT_SHARE * weak else _LIKELY


@kernel
def _keep_bracket(s, walls, link, own, cutoff, accuracy, room):
    """
    Refine the direct ray of a bracket and fill its row after the first count rows of room (count,
    work).

    own contains the bracket, its course, and True at the first attempt, which stops if the miss
    jumps. Returns _CLEAR if the ray is an arrival, _WEAK if it is below the cut-off, _THROUGH the
    surface, _BLOCKED by the sea bed, _JUMP, or _NONE.
    """
    bracket, course, first = own
    count, work = room
    launch = Launch(False, 0.0, 0.0, 0, 0)
    if first:
        launch = polish(s, walls, course, bracket, accuracy, work)
    polished = launch.ok
    if not polished:
        if not first:
            wide = taken_up(bracket)
        elif ray_axis(course) == at.CHORD:
            wide = _bracket_about_chord(s, walls, course, accuracy.coarse, work)
        else:
            wide = widened(s, walls, course, bracket, accuracy.fine, work)
        if first and jumps(wide, cutoff[1]):
            put_off(wide, bracket)
            return _JUMP
        launch = refine(s, walls, course, wide, accuracy, cutoff[1], work)
    if not launch.ok:
        return _NONE
    verdict = _course_of(launch, course, walls, work)
    if verdict != _CLEAR:
        return verdict
    row, slope = work.rows[count], work.y[at.XI]
    finish(row, work.y, launch, course, link, 0.0)
    row[at.SURFACE_BOUNCES], row[at.BOTTOM_BOUNCES] = 0.0, 0.0
    # the slope at one ray may be an error of the ray beside a crest; a ray that is weak anyway
    # needs no check
    if not polished and row[at.SPREADING_DB] <= cutoff[0]:
        narrow(s, walls, course, bracket, launch, accuracy.fine, work)
    row[at.SPREADING_DB] += unresolved_db(
        bracket, miss_noise(accuracy.fine, slope, link.length), slope
    )
    return _WEAK if row[at.SPREADING_DB] > cutoff[0] else _CLEAR


@kernel
def _course_of_weak(s, walls, course, bracket, accuracy, work):
    """
    Course of the ray at the root of a bracket's cubic: _WEAK in the water, _THROUGH, _BLOCKED, or
    _NONE if it does not reach the end.
    """
    angle = cubic_angle(bracket[0], bracket[1], 0.0)
    q = cross_slowness(bracket[0], bracket[1], angle)
    ok, steps, turns, _ = trace_direct(
        s, walls, course, angle, q, accuracy.coarse, direct_ray(course, work)
    )
    verdict = _course_of(Launch(ok, angle, 0.0, steps, turns), course, walls, work)
    if verdict != _CLEAR:
        return verdict
    return _WEAK if ok else _NONE


@kernel
def _keep_row(rows, count):
    """
    Append the row after the first count, or keep only the stronger of two rows of one ray; return
    the number of rows.

    Both brackets at a caustic may lead to the same ray.
    """
    row = rows[count]
    for j in range(count):
        near_in_time = abs(rows[j, at.TRAVEL_TIME] - row[at.TRAVEL_TIME]) < 1e-7
        near_here = abs(rows[j, at.LAUNCH_ANGLE] - row[at.LAUNCH_ANGLE]) < _ONE_LAUNCH
        near_there = abs(rows[j, at.ARRIVAL_ANGLE] - row[at.ARRIVAL_ANGLE]) < _ONE_ARRIVAL
        if near_in_time and near_here and near_there:
            if row[at.SPREADING_DB] < rows[j, at.SPREADING_DB]:
                for k in range(at.N_ARRIVAL):
                    rows[j, k] = row[k]
            return count
    return count + 1


@kernel
def _put_rows(n, i, work, results):
    """Write n arrivals to the results of link i, as many as there is room for."""
    if n > results.rows.shape[1]:
        n = results.rows.shape[1]
        results.info[i, at.COMPLETE], results.info[i, at.RESOLVED] = 0.0, 0.0
    results.counts[i] = n
    for j in range(n):
        for k in range(at.N_ARRIVAL):
            results.rows[i, j, k] = work.rows[j, k]


@kernel
def _reverse(rows, info):
    """Exchange both ends in the arrivals of a link."""
    for row in rows:
        launch, arrival = row[at.LAUNCH_ANGLE], row[at.ARRIVAL_ANGLE]
        row[at.LAUNCH_ANGLE], row[at.ARRIVAL_ANGLE] = -arrival, -launch
        for k in range(3):
            at_source, at_receiver = row[at.SOURCE_SLOWNESS + k], row[at.RECEIVER_SLOWNESS + k]
            row[at.SOURCE_SLOWNESS + k], row[at.RECEIVER_SLOWNESS + k] = -at_receiver, -at_source
    info[at.SOURCE_SPEED], info[at.RECEIVER_SPEED] = info[at.RECEIVER_SPEED], info[at.SOURCE_SPEED]


@kernel
def _upwards(a, b):
    """
    True if a link's canonical direction, from the deeper end (ties: north, east), is from b to a.
    """
    for k in (2, 0, 1):
        if a[k] != b[k]:
            return a[k] < b[k]
    return False


@kernel
def _from_receiver(settings, source, receiver):
    """True if a link is solved from its receiver."""
    return settings.canonical and _upwards(source, receiver) != settings.shallower


@kernel
def _finish(settings, source, receiver, i, results):
    """Reverse the results of link i if it was solved from its receiver."""
    if _from_receiver(settings, source[i], receiver[i]):
        _reverse(results.rows[i, : results.counts[i]], results.info[i])


@kernel
def _solve(domain, bounces, settings, ends, share, work, flights, results):
    """As `solve_links`; with flights, the rays of several links are traced together."""
    source, receiver = ends
    following, every = share
    if flights is None or _one_by_one(domain):
        for i in range(following, source.shape[0], every):
            _start(
                domain,
                bounces,
                settings,
                _ends(settings, ends, i),
                (i, 0, True),
                work,
                flights,
                results,
            )
            _finish(settings, source, receiver, i, results)
    else:
        _solve_queue(domain, bounces, settings, ends, share, False, (work, flights), results)
        put_off = False
        for i in range(following, source.shape[0], every):
            put_off = put_off or results.status[i] == _LATER
        if put_off:
            _solve_queue(domain, bounces, settings, ends, share, True, (work, flights), results)


@kernel
def _solve_queue(domain, bounces, settings, ends, share, across, room, results):
    """
    Solve the links of a share whose rays remain in their planes, or with across those that were put
    off because they leave them.
    """
    source, receiver = ends
    following, every = share
    work, flights = room
    columns, count = share_store(domain, source, receiver, work, flights)
    rows, busy = flights.links, True
    while busy:
        busy = False
        for k in range(count):
            row = rows[k]
            if row[at.FLIGHT_LINK] >= 0.0 and row[at.FLIGHT_PENDING] > 0.0:
                busy = True
                continue
            own = own_work(work, flights, k, columns)
            if row[at.FLIGHT_LINK] >= 0.0 and not _continue(
                domain, bounces, settings, k, own, flights, results
            ):
                _finish(settings, source, receiver, int(row[at.FLIGHT_LINK]), results)
                row[at.FLIGHT_LINK] = -1.0
            while row[at.FLIGHT_LINK] < 0.0 and following < source.shape[0]:
                i = following
                link_ends = _ends(settings, ends, i)
                following += every
                if across and results.status[i] != _LATER:
                    continue
                waits = _start(
                    domain, bounces, settings, link_ends, (i, k, across), own, flights, results
                )
                if not waits and results.status[i] != _LATER:
                    _finish(settings, source, receiver, i, results)
            busy = busy or row[at.FLIGHT_LINK] >= 0.0
        if across:
            march(domain, flights, count, True, work.store)
        else:
            march(domain, flights, count, None, work.store)


@kernel
def _ends(settings, ends, i):
    """Ends of link i in the direction in which it is solved."""
    a, b = ends[0][i], ends[1][i]
    return (b, a) if _from_receiver(settings, a, b) else (a, b)


@entry
@compact
def solve_links(domain, bounces, settings, source, receiver, share, room, results):
    """
    Solve the links first, first + every, ... of share (first, every); the results contain the first
    arrivals that have room.

    With bounces None, only direct rays. With settings.canonical, the solver starts from the deeper
    end of each link (ties: north, east) and reverses the results.
    """
    _solve(domain, bounces, settings, (source, receiver), share, room.work, room.flights, results)
