"""
Find all launch angles whose rays meet the receiver, with limits for their steepness and an adaptive
fan of rays.

A fan of rays gives the miss ``F`` and its derivative by the launch angle. A cubic Hermite
polynomial approximates F between neighbours. If an interval may contain a root, a ray in its middle
checks this polynomial. Intervals are halved until each contains one root or none, or is narrower
than the resolution. The signs of the derivatives show pairs of roots about an extremum of F (a
caustic). The slowness at the receiver shows neighbours that differ by several cycles, because its
cubic is then not resolved. The errors of diverging rays grow with the divergence: if such a ray
comes near the receiver, it is traced again with a smaller tolerance.
"""

import math
from collections import namedtuple

import numpy as np

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.beside import direct_ray_end, offset_in_plane, trace_direct
from pymantaray.acoustics._kernels.boundary import ON_SURFACE, append_code
from pymantaray.acoustics._kernels.curves import fits_curves, piece_at
from pymantaray.acoustics._kernels.field import (
    cubic,
    cubic_root,
    cubic_slope,
    level_speed,
    sort_head,
)
from pymantaray.acoustics._kernels.ladder import (
    add_middles,
    add_turning_angles,
    has_ladder,
    put_ladder,
    trace_ladder,
)
from pymantaray.acoustics._kernels.layout import Course, Progress
from pymantaray.acoustics._kernels.march import (
    ERRING,
    MOST_ATTEMPTS,
    UNDER_WAY,
    WAITING,
    again,
    allowed,
    astray,
)
from pymantaray.acoustics._kernels.trace import (
    course_to_levels,
    fan_ray,
    trace,
)
from pymantaray.compile import compact, inlined, kernel, shared

STEEP = 0.08  # rad; a link steeper than the Snell limit by this has one ray
BEYOND = 0.02  # rad; the fan extends beyond the steepest ray that may arrive by this
MAX_RAYS = 20_000
MAX_RAYS_INTERVAL = 1000
# times as many in an interval of rays that leave the plane: where several end in it at one angle,
# their miss jumps
_MORE_RAYS = 4.0
_RAYS_PER_BRACKET = 15.0  # share of a bracket in the budget of rays
_SLOWNESS_DEFECT = (
    0.3  # of the vertical slowness; a larger defect of its cubic means unresolved cycles
)
_WEAK_WIDTH = 5e-5  # rad; a narrower interval between two weak rays is not divided
_CUBIC_DEPARTURE = (
    16.0 / 27.0
    # bound of the distance between a cubic Hermite polynomial and its chord, per slope defect,
    # times four
)
# of the link; rays whose exits from the water are farther apart left it at different cycles
_EXIT_GAP = 0.25
# of the steepness at the exit must remain within an interval whose rays all leave the water
_MIN_RISE = 0.3
_EXIT_AGREEMENT = (
    0.3  # of the distance to the exit: allowed error of the exit that the derivatives predict
)
# rad; width down to which rays that stay in the water are searched between two that left it
_WINDOW_WIDTH = 1e-6
# the logarithm of the steepness of the later exit changes by less in an interval whose rays all
# leave the water there: the steepness goes to zero like a square root
_EXIT_CHANGE = 0.3
# rad; width down to which intervals that may contain a pair of rays about a caustic are divided
_CAUSTIC_WIDTH = 1e-8
# rad; width down to which changes of reflections are searched: between two rays to a receiver just
# below the surface that reflect there before and after it
_NARROWEST_EDGE = 1e-9
_NARROWEST_ROUGH = 2e-4  # rad
_ROUGH = 0.25  # of the rise of the miss, or of a ray tube in uniform water
_NARROWEST_LATE = 2e-3  # rad; width down to which `Search.late` applies
# A sound-speed maximum may part two rays if the miss bends by more than the first share of its
# size, and if this share times the error of the predicted turning depths exceeds the second number
# of metres
_MIN_BEND, _MIN_BEND_TIMES_DEFECT = 0.2, 1.25
_NOISE = (
    4.0  # tolerances; the miss of a ray out of the plane may differ by this between two attempts
)
_PASSAGE_WIDTH = (
    2e-4  # rad; rays that pass a sound-speed maximum within a narrower interval are weak
)
_FOLD_WEAK = 0.15  # of the slope of a weak ray: larger slopes beside a fold are too weak
# jump of the cross-track slowness; share of its change that its derivatives must predict
_FOLD, _FOLD_DEFECT = 1e-4, 0.5
_UNKNOWN = 1e30  # m; error of a cubic
# derivative of the cross-track offset by the cross-track slowness, divided by the distance: about 1
# in uniform water, and negative somewhere between two rays of one launch angle that both end in the
# plane. If it leaves these limits on the curve of rays that the search follows, others may exist
_LEAST_SPREAD, _MOST_SPREAD = 0.5, 2.0
# of the slope of a weak ray: a ray with a wider tube, 26 dB below the cut-off, is no sign of others
_SHEET_SHARE = 40.0
# times the reach of the cubic; a jump of the cross-track slowness whose rays miss the receiver by
# more does not lead to it
_FOLD_REACH = 3.0
FROM_ONE_END = 0.5  # RESOLVED of such a search
# of the miss: between two rays that predict the miss of each other to this, or to
# `Search.resolved`, the miss does not become zero. A ray along the crest of a sound-speed maximum,
# at a distance d [rad] from another one, changes its miss by A log(d), and the slopes at the ends
# of an interval by about 2 A divided by its width
_FAR_SHARE = 0.125
# rad; rays of a fan through layered SMOOTH water turn this much before the first and last level,
# because a ray that grazes the surface or the sea bed does not arrive
_BEFORE_LEVEL = 1e-6
# Between two rays that do not turn, no ray of the first fan is needed if both slopes of the miss
# differ from the mean by less than the first share, and the slownesses at the end from their
# predictions by less than the second share of the smaller one
_EVEN_MISS, _EVEN_SLOWNESS = 0.2, 0.3
LEFT_OUT = -2.0  # GOOD of a ray of the first fan that is not needed
_DROP, _SPLIT, _BRACKET, _EDGE, _GONE = range(5)  # verdicts on an interval
HALVE, _FINER, _MOVE_FIRST, _MOVE_SECOND = range(
    4
)  # what an interval waits for: its middle, finer ends, an end beyond the root

Search = namedtuple(
    "Search", "coarse fine min_width trust steep weak overhang resolved late trapped"
)
Search.__doc__ = """Settings of a search: tolerances of the fan's rays and of rays near the receiver
[m], narrowest interval [rad].

Across a change of code the slopes of the miss are used beyond the angle steep and in intervals
narrower than trust [rad]. Rays with a slope above weak [m/rad] are too weak to be searched. A ray
at a change of code that would meet the receiver within overhang [rad] beyond the change is a
bracket without width. Two direct rays may be neighbours only if both slopes of the miss predict the
other miss to within resolved [m]. Between two rays of which one has too many reflections only in
the last share, late, of the course, rays with fewer reflections are searched. Rays flatter than
trapped [rad] do not meet the receiver."""


@kernel
def aimed_at(course, target):
    """Return the course with another target."""
    return Course(course.rule, course.axis, course.length, target, course.to_levels, course.cross)


@kernel
def shoot(s, walls, course, angle, tol, growth, node, work):
    """
    Trace a ray of a fan into a node with an error of at most tol at its end; growth is the expected
    divergence.

    The steps of a diverging ray end at the levels. Slopes are derivatives by the launch angle. If
    the receiver is on a boundary, a reflection there is unfolded: rays that are reflected just
    before the receiver miss it on the other side, so the miss changes sign at the receiver.
    """
    rule = course.rule
    y = work.y
    grown, exact = 0.0, fits_curves(s, walls, course, angle, 0.0)
    laddered = exact and (s.ladder or rule.kind == at.FORWARD)
    while True:
        if growth > 0.0:
            course = course_to_levels(s, course)
        finer = allowed(tol, growth, course.to_levels)
        if has_ladder(work) and laddered:
            ok, code = trace_ladder(s, walls, course, angle, work)
        elif course.cross:
            ok, code = _shoot_across(s, walls, course, angle, finer, node, work)
        else:
            ok, _, _, code = trace(s, walls, course, angle, 0.0, finer, fan_ray(work))
        grown = y[at.GROWN] / course.length
        gone = rule.kind == at.OPEN and y[at.GONE] > 0.0
        if (
            gone
            or exact
            or not again(y[at.W] - course.target, tol, grown, growth, course.to_levels)
        ):
            break
        growth = grown
    node[at.ANGLE], node[at.MISS], node[at.SLOPE] = angle, y[at.W] - course.target, y[at.XI]
    node[at.SLOWNESS], node[at.SLOWNESS_SLOPE] = y[at.P], y[at.ETA]
    node[at.GOOD], node[at.CODE] = 1.0 if ok else 0.0, code
    node[at.TOL], node[at.GROWTH], node[at.LEFT] = tol, grown, y[at.GONE]
    node[at.LEFT_RATE], node[at.LEFT_BEND] = y[at.GONE_RATE], y[at.GONE_BEND]
    node[at.TOP], node[at.TOP_RATE] = y[at.HIGHEST], y[at.HIGHEST_RATE]
    node[at.LOW], node[at.LOW_RATE] = y[at.LOWEST], y[at.LOWEST_RATE]
    if rule.fold != 0 and (code % 1024 // 32 if rule.fold <= ON_SURFACE else code % 32) % 2 == 1:
        for i in (at.MISS, at.SLOPE, at.SLOWNESS, at.SLOWNESS_SLOPE):
            node[i] = -node[i]


@kernel
def _shoot_across(s, walls, course, angle, tol, node, work):
    """
    Trace a direct ray out of the plane until it ends in it; the node receives its cross-track
    slowness.
    """
    y = work.y
    for _ in range(MOST_ATTEMPTS):
        ok, _, _, code = trace_direct(
            s, walls, course, angle, node[at.CROSS], tol, direct_ray_end(course, work)
        )
        if not ok:
            break
        change = y[at.Y] / y[at.DY_DQ]  # of the cross-track slowness, to end in the plane
        node[at.SPREAD] = y[at.DY_DQ] / course.length
        node[at.CROSS_SLOPE] = -y[at.Y_ANGLE] / y[at.Y_Q]
        y[at.W] = offset_in_plane(y)
        y[at.P] -= y[at.P_Q] * change
        node[at.CROSS] -= change
        miss = y[at.W] - course.target
        grown = y[at.GROWN] / course.length
        if not astray(y[at.Y], miss, node[at.TOL], grown, course.length):
            break
    return ok, code


@kernel
def _same_code(a, b, fold):
    """
    True if the miss is smooth between two rays: equal reflections, or one more at the receiver's
    boundary.
    """
    if a[at.CODE] == b[at.CODE]:
        return True
    return fold != 0 and (
        append_code(int(a[at.CODE]), fold) == b[at.CODE]
        or append_code(int(b[at.CODE]), fold) == a[at.CODE]
    )


@kernel
def _too_many_bounces(node, rule):
    """True if a ray failed or has more reflections than requested."""
    counts = int(node[at.CODE]) % 1024
    return node[at.GOOD] == 0.0 or counts // 32 > rule.max_surface or counts % 32 > rule.max_bottom


@kernel
def fewer_bounces(bracket):
    """Index of the bracket's ray with fewer reflections."""
    return 0 if int(bracket[0, at.CODE]) % 1024 <= int(bracket[1, at.CODE]) % 1024 else 1


@kernel
def _cannot_vanish(node, h):
    """
    True if the miss cannot become zero within h, even if its derivative grows like an inverse root.
    """
    return node[at.GOOD] == 0.0 or abs(node[at.MISS]) > 3.0 * abs(node[at.SLOPE]) * h


@kernel
def _oscillates(a, b, h):
    """
    True if the slowness at the receiver's plane differs between two rays by more than its slopes
    predict.

    Two rays that differ by several cycles may both be at the top of a cycle, where the miss is
    flat.
    """
    rise = b[at.SLOWNESS] - a[at.SLOWNESS]
    defect = max(abs(h * a[at.SLOWNESS_SLOPE] - rise), abs(h * b[at.SLOWNESS_SLOPE] - rise))
    return defect > _SLOWNESS_DEFECT * max(
        abs(math.sin(a[at.ANGLE])), abs(math.sin(b[at.ANGLE])), 0.02
    )


@kernel
def _window(a, b, length):
    """
    True if two rays left the water so far apart that rays between them may stay in it: they turn
    once more before.
    """
    return a[at.LEFT] * b[at.LEFT] > 0.0 and abs(a[at.LEFT] - b[at.LEFT]) > _EXIT_GAP * length


@kernel
def _may_stay(a, b, h, length):
    """
    True if direct rays between two that left the water far apart may stay in it: the later exit may
    vanish between them.
    """
    if not _window(a, b, length):
        return False
    late = a if a[at.LEFT] > b[at.LEFT] else b
    shift = abs(h * late[at.LEFT_RATE])
    remains = abs(h * late[at.LEFT_BEND]) < _EXIT_CHANGE and shift < _EXIT_AGREEMENT * late[at.LEFT]
    return not (remains and late[at.LEFT] + shift < length)


@kernel
def _maximum_between(a, b, h, bend, resolved):
    """
    True if a sound-speed maximum seems to turn one of two rays, while the other one crosses it.

    The least and greatest depths of a ray are smooth functions of the launch angle, except at the
    angle of a ray that runs along the crest of a maximum. In water that varies horizontally, rays
    near that angle may enter a duct beyond the crest: the miss then changes by hundreds of metres
    within 1e-4 rad, which neither ray's derivative shows. bend is the larger slope defect of the
    miss, as a share of the nearer miss. The depths of neighbours must predict each other to within
    resolved.
    """
    defect = max(_turning_defect(a, b, h, at.TOP), _turning_defect(a, b, h, at.LOW))
    return defect > resolved or (bend > _MIN_BEND and bend * defect > _MIN_BEND_TIMES_DEFECT)


@kernel
def _turning_defect(a, b, h, column):
    """
    Error with which an extreme depth of each ray and its derivative predict that of the other ray,
    the larger one. [m]

    Zero if both rays are at their extreme depths at the receiver: these depths are the miss, not
    turning depths.
    """
    if a[column + 1] == a[at.SLOPE] and b[column + 1] == b[at.SLOPE]:
        return 0.0
    change = b[column] - a[column]
    return max(abs(h * a[column + 1] - change), abs(h * b[column + 1] - change))


@kernel
def _leave_water_alike(a, b, length):
    """
    True if two direct rays left the water in the same way, so all rays between them leave it.

    The exit and the steepness there are smooth functions of the launch angle until the steepness
    becomes zero. Three conditions hold: the derivatives show no such zero within the interval, they
    predict the other ray's exit, and no exit is beyond the receiver (about a caustic, rays may
    leave beyond it between two that leave just before it).
    """
    if a[at.LEFT] == 0.0 or b[at.LEFT] == 0.0:
        return False
    h = b[at.ANGLE] - a[at.ANGLE]
    gap = b[at.LEFT] - a[at.LEFT]
    ahead, back = h * a[at.LEFT_RATE], h * b[at.LEFT_RATE]
    return (
        max(a[at.LEFT], b[at.LEFT]) + max(ahead, -back, 0.0) < length
        and h * a[at.LEFT_BEND] > _MIN_RISE - 1.0
        and h * b[at.LEFT_BEND] < 1.0 - _MIN_RISE
        and max(abs(ahead - gap), abs(back - gap)) < _EXIT_AGREEMENT * min(a[at.LEFT], b[at.LEFT])
        and abs(0.5 * (ahead + back) - gap) < 0.5 * max(abs(ahead), abs(back))
    )


@kernel
def _leave_on_one_side(a, b):
    """True if two direct rays left the water and pass the receiver on the same side."""
    return a[at.LEFT] * b[at.LEFT] > 0.0 and a[at.MISS] * b[at.MISS] > 0.0


@kernel
def is_weak(bracket, weak, resolution):
    """
    True if the miss is so steep across a bracket that its ray is too weak.

    In a bracket at the resolution the mean slope decides. The cubic of a wider bracket is resolved,
    and its slope at the root is at least a quarter of the smallest of the mean slope and the slopes
    at both ends.
    """
    a, b = bracket[0], bracket[1]
    h = b[at.ANGLE] - a[at.ANGLE]
    mean = (b[at.MISS] - a[at.MISS]) / h
    if h <= resolution:
        return abs(mean) > weak
    return min(abs(mean), mean / abs(mean) * a[at.SLOPE], mean / abs(mean) * b[at.SLOPE]) > weak


@kernel
def slope_at_root(bracket):
    """Slope of the miss at the root of a bracket's cubic. [m/rad]"""
    a, b = bracket[0], bracket[1]
    h = b[at.ANGLE] - a[at.ANGLE]
    ends = a[at.MISS], a[at.SLOPE], b[at.MISS], b[at.SLOPE]
    return abs(cubic_slope(cubic_root(h, *ends), h, *ends))


@kernel
def _points_across(end, rule, overhang):
    """
    True if a reflected ray at an edge of its cells would meet the receiver if the cells were
    larger.

    Slopes across the plane may move this ray back within the edge.
    """
    if _too_many_bounces(end, rule) or int(end[at.CODE]) % 32 == 0:
        return False
    beyond = -end[at.MISS] / end[at.SLOPE]
    return 0.0 < beyond < overhang or overhang < beyond < 0.0


@kernel
def copy_ray(source, target):
    """Copy as many columns of a ray as the target has."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@kernel
def shoot_waiting(s, walls, course, first, last, work):
    """Trace the rays of some rows that are WAITING or failed UNDER_WAY, one by one."""
    for i in range(first, last):
        ray = work.rays[i]
        if ray[at.GOOD] == WAITING or ray[at.GOOD] == UNDER_WAY:
            shoot(s, walls, course, ray[at.ANGLE], ray[at.TOL], ray[at.GROWTH], ray, work)


@kernel
def first_row(work):
    """
    Row of the first ray of the fan; before it are the rays for which intervals wait, and those
    traced ahead.
    """
    return 6 * work.halves.shape[0]


@kernel
def put_fan(n_nodes, tol, gap, work):
    """
    Put the rays of a fan with the angles work.nodes into work.rays; return the state of a new
    search.

    With a positive gap [rad], only rays that are at most so far apart wait at first; `fill_fan`
    decides about those between them.
    """
    fan = work.rays[first_row(work) :]
    previous = work.nodes[0]
    for i in range(n_nodes):
        ray = fan[i]
        ray[at.ANGLE], ray[at.TOL], ray[at.GOOD] = work.nodes[i], tol, WAITING
        ray[at.GROWTH], ray[at.DEFECT], ray[at.CROSS] = 0.0, 0.0, 0.0
        ray[at.SPREAD], ray[at.CROSS_SLOPE] = 1.0, 0.0
        if 0 < i < n_nodes - 1 and work.nodes[i + 1] - previous <= gap:
            ray[at.GOOD] = LEFT_OUT
        else:
            previous = ray[at.ANGLE]
        work.nodes[i] = 0.0  # from here on the rays used in the interval above this node
    return Progress(-1.0 if gap > 0.0 else 0.0, 0.0, 0.0, n_nodes - 2.0, 0.0, np.inf, 0.0, 1.0, 1.0)


@kernel
def fill_fan(length, progress, work):
    """
    Keep the other rays of a fan for later, unless the rays on both sides exclude a root and a
    turning ray.
    """
    fan = work.rays[first_row(work) :]
    a = 0
    for b in range(1, int(progress.right) + 2):
        if fan[b, at.GOOD] == LEFT_OUT:
            continue
        if b - a > 1 and not _is_even(fan[a], fan[b], length):
            for i in range(a + 1, b):
                fan[i, at.GOOD] = WAITING
                fan[i, at.CROSS] = 0.5 * (fan[a, at.CROSS] + fan[b, at.CROSS])
        a = b
    return Progress(0.0, 0.0, 0.0, progress.right, 0.0, np.inf, 0.0, 1.0, 1.0)


@kernel
def _is_even(a, b, length):
    """
    True if the miss certainly rises without a root between two rays: neither turned, and nor does
    any ray between them.

    The miss of rays that do not turn rises with the launch angle.
    """
    if a[at.GOOD] * b[at.GOOD] <= 0.0 or a[at.MISS] * b[at.MISS] <= 0.0:
        return False
    descends = _descends(a)
    if descends == 0.0 or descends != _descends(b):
        return False
    if a[at.LEFT] + b[at.LEFT] > 0.0 and not _leave_water_alike(a, b, length):
        return False
    h = b[at.ANGLE] - a[at.ANGLE]
    rise = b[at.MISS] - a[at.MISS]
    change = b[at.SLOWNESS] - a[at.SLOWNESS]
    bend = max(abs(h * a[at.SLOPE] - rise), abs(h * b[at.SLOPE] - rise))
    defect = max(abs(h * a[at.SLOWNESS_SLOPE] - change), abs(h * b[at.SLOWNESS_SLOPE] - change))
    return (
        bend < _EVEN_MISS * rise
        and bend < min(abs(a[at.MISS]), abs(b[at.MISS]))
        and defect < _EVEN_SLOWNESS * min(abs(a[at.SLOWNESS]), abs(b[at.SLOWNESS]))
    )


@kernel
def _descends(ray):
    """1 if a ray descends along its whole path, -1 if it ascends, otherwise 0."""
    if (
        ray[at.ANGLE] > 0.0
        and ray[at.SLOWNESS] > 0.0
        and ray[at.TOP] == 0.0
        and ray[at.LOW_RATE] == ray[at.SLOPE]
    ):
        return 1.0
    if (
        ray[at.ANGLE] < 0.0
        and ray[at.SLOWNESS] < 0.0
        and ray[at.LOW] == 0.0
        and ray[at.TOP_RATE] == ray[at.SLOPE]
    ):
        return -1.0
    return 0.0


@kernel
def _close_gaps(n_nodes, work):
    """Remove the rays that were left out from the fan; return the number of the others."""
    fan = work.rays[first_row(work) :]
    n = 0
    for i in range(n_nodes):
        if fan[i, at.GOOD] != LEFT_OUT:
            if n < i:
                copy_ray(fan[i], fan[n])
            n += 1
    return n


@kernel
def find_brackets(s, walls, course, n_nodes, gap, search, work):
    """
    Bracket all roots of the miss between the first and the last angle of work.nodes; rays are
    traced one by one. gap is that of `put_fan`.

    Returns the number of brackets, the smallest miss, the number of rays, True if the budget was
    sufficient, and RESOLVED: 0 if an interval remained unresolved, FROM_ONE_END if there are signs
    of rays that the search does not follow, otherwise 1.
    """
    progress = put_fan(n_nodes, search.coarse, gap, work)
    fan = first_row(work)
    if s.ladder or course.rule.kind == at.FORWARD:
        put_ladder(s, walls, course, work)
        for i in range(n_nodes if s.kind == at.LINEAR and has_ladder(work) else 0):
            work.rays[fan + i, at.DEFECT] = (
                _UNKNOWN  # beside a change of reflections: the middle decides
            )
    shoot_waiting(s, walls, course, fan, fan + n_nodes, work)
    if progress.asked < 0.0:
        progress = fill_fan(course.length, progress, work)
        shoot_waiting(s, walls, course, fan, fan + n_nodes, work)
    course = course_to_levels(s, course)
    while True:
        progress = advance(s.n_range > 1, course, search, progress, work)
        if progress.asked == 0.0:
            return tally_of(progress)
        shoot_waiting(s, walls, course, 0, 2 * int(progress.asked), work)


@kernel
def tally_of(progress):
    """Values that `find_brackets` returns."""
    complete = progress.complete > 0.0
    return int(progress.brackets), progress.margin, int(progress.rays), complete, progress.resolved


@shared
@compact
def advance(varies, course, search, progress, work):
    """
    Continue a search after its rays were traced, until intervals wait for rays again; none wait if
    the search is complete.

    A search of reflected rays skips direct rays. The miss is smooth between rays of one code; it
    may bend or jump across a change of code. If the miss is within a few tolerances of zero, or
    changes sign without becoming smooth, the rays are traced again with the fine tolerance. Between
    rays that exceed the number of reflections at points far apart, rays with fewer reflections are
    searched in wider intervals. Several intervals of direct rays wait at a time: the first two rows
    of work.rays belong to the first of them, and so on, and those to be traced are WAITING.
    work.brackets receives the rays at both ends of each bracket. varies is False if the section is
    the same at all ranges.
    """
    asked, top = int(progress.asked), int(progress.top)
    left, right = int(progress.left), int(progress.right)
    tally = tally_of(progress)
    if tally[2] == 0:  # no ray counted yet: the first fan was traced just now
        right = _close_gaps(right + 2, work) - 2
        tally = 0, _read_fan(right + 2, work), right + 2, True, 1.0
    asked, top, tally = _put_back(course, asked, top, tally, search.fine, work)
    asked, pending, tally = _gather(varies, course, search, asked, (top, left, right), tally, work)
    top, left, right = pending
    n_brackets, margin, rays, complete, resolved = tally
    return Progress(
        float(asked),
        float(top),
        float(left),
        float(right),
        float(n_brackets),
        margin,
        float(rays),
        1.0 if complete else 0.0,
        resolved,
    )


@kernel
def _read_fan(n_nodes, work):
    """Write the errors of the cubics near the rays of the first fan; return the smallest miss."""
    fan = work.rays[first_row(work) :]
    margin = np.inf
    for i in range(n_nodes):
        if fan[i, at.GOOD] > 0.0:
            margin = min(margin, abs(fan[i, at.MISS]))
    for i in range(1, n_nodes - 1):
        a, m, b = fan[i - 1], fan[i], fan[i + 1]
        if a[at.GOOD] * m[at.GOOD] * b[at.GOOD] > 0.0 and a[at.CODE] == m[at.CODE] == b[at.CODE]:
            m[at.DEFECT] = 2.0 * _defect(a, m, b)
    return margin


@kernel
def _next_interval(pending, work):
    """
    Put the steepest pending interval of the fan on the empty stack: the number of rays towards the
    axis may be unlimited.
    """
    _, left, right = pending
    fan = work.rays[first_row(work) :]
    ends = work.stack[0]
    i = left if abs(fan[left, at.ANGLE]) >= abs(fan[right + 1, at.ANGLE]) else right
    copy_ray(fan[i], ends[0])
    copy_ray(fan[i + 1], ends[1])
    ends[0, at.DEFECT] = max(fan[i, at.DEFECT], fan[i + 1, at.DEFECT])
    ends[1, at.INTERVAL] = i
    return (1, left + 1, right) if i == left else (1, left, right - 1)


@inlined
def _gather(varies, course, search, asked, pending, tally, work):
    """
    Judge intervals until as many wait for rays as there is room for or none is left; return their
    number.

    pending has the size of the stack and the first and last interval of the fan; tally is what
    `find_brackets` returns.
    """
    n_brackets, margin, rays, complete, resolved = tally
    top, left, right = pending
    spent, st, fine = work.nodes, work.stack, search.fine
    reflecting = course.rule.kind != at.OPEN
    budget = MAX_RAYS_INTERVAL * (_MORE_RAYS if course.cross else 1.0)
    most = 1 if reflecting else work.halves.shape[0]  # reflected rays are traced one by one
    while asked < most and (top > 0 or left <= right):
        if top == 0:
            top, left, right = _next_interval((top, left, right), work)
        top -= 1
        a, b = st[top, 0], st[top, 1]
        tol_here, h = max(a[at.TOL], b[at.TOL]), b[at.ANGLE] - a[at.ANGLE]
        k = int(b[at.INTERVAL])
        room = n_brackets < work.brackets.shape[0] and spent[k] + _RAYS_PER_BRACKET <= budget
        verdict, same = _judge(a, b, varies, course, search)
        crosses = a[at.MISS] * b[at.MISS] < 0.0
        if (
            verdict == _SPLIT
            and same
            and h < _WEAK_WIDTH
            and min(abs(a[at.SLOPE]), abs(b[at.SLOPE])) > search.weak
            and not _dips(a, b, h)
        ):  # a root between two weak rays is weak too, except about an extremum
            verdict = _BRACKET if crosses and room else _DROP
        if verdict == _BRACKET:
            complete = complete and room
            if room:
                n_brackets = _add_bracket(a, b, n_brackets, k, work)
        elif verdict == _EDGE and search.overhang > 0.0 and room:
            n_brackets = _add_edges(st[top], course.rule, search.overhang, n_brackets, k, work)
        elif verdict == _GONE and a[at.MISS] * b[at.MISS] <= 0.0:  # a root out of the water
            margin = 0.0
        elif verdict == _DROP and course.cross and same:
            for end in (0, 1):
                if n_brackets < work.brackets.shape[0] and _meets(st[top, end], fine, h):
                    n_brackets = _add_around(st[top, end], fine, n_brackets, k, work)
        if verdict != _SPLIT:
            dropped = verdict == _DROP and same and not reflecting
            resolved = min(resolved, _resolution(a, b, dropped, course, search))
            continue
        # the error of a ray may hide on which side of the receiver it passes
        nearest = min(abs(a[at.MISS]), abs(b[at.MISS]))
        doubtful = (crosses and h < _WEAK_WIDTH) or nearest < 4.0 * tol_here
        doubtful = doubtful and (same or (reflecting and h < _WEAK_WIDTH))
        if tol_here > fine and doubtful:
            traced = _ask_finer(a, b, fine, asked, work)
        else:
            full = spent[k] >= budget or top + 2 * asked + 4 > st.shape[0]
            if full or rays >= MAX_RAYS:  # a narrow edge between reflections contains no ray
                complete = complete and reflecting and not same and h < _WEAK_WIDTH
                resolved = resolved if reflecting else 0.0
                continue
            traced = _ask_middle(a, b, tol_here, asked, work)
        spent[k] += traced
        rays += traced
        asked += 1
    return asked, (top, left, right), (n_brackets, margin, rays, complete, resolved)


@kernel
def _ask_finer(a, b, fine, i, work):
    """Ask for both rays of an interval again with the fine tolerance; return the number of rays."""
    first, second = work.rays[2 * i], work.rays[2 * i + 1]
    work.kinds[i] = _FINER
    rays = 0
    copy_ray(a, work.halves[i, 0])
    copy_ray(b, work.halves[i, 1])
    copy_ray(a, first)
    copy_ray(b, second)
    for ray in (first, second):
        if ray[at.TOL] > fine:
            ray[at.TOL] = fine
            ray[at.GOOD] = WAITING
            rays += 1
    return rays


@kernel
def _ask_middle(a, b, tol, i, work):
    """
    Ask for the ray in the middle of an interval; fine at once if the rays diverge and their cubic
    comes near the receiver.
    """
    middle = work.rays[2 * i]
    h = b[at.ANGLE] - a[at.ANGLE]
    work.kinds[i] = HALVE
    copy_ray(a, work.halves[i, 0])
    copy_ray(b, work.halves[i, 1])
    growth = min(a[at.GROWTH], b[at.GROWTH]) if a[at.LEFT] * b[at.LEFT] == 0.0 else 0.0
    miss = cubic(0.5, h, a[at.MISS], a[at.SLOPE], b[at.MISS], b[at.SLOPE])
    middle[at.ANGLE] = 0.5 * (a[at.ANGLE] + b[at.ANGLE])
    middle[at.TOL] = tol
    middle[at.GOOD] = WAITING
    middle[at.CROSS] = 0.5 * (a[at.CROSS] + b[at.CROSS])
    middle[at.GROWTH] = growth if abs(miss) <= ERRING * tol * growth else 0.0
    work.rays[2 * i + 1, at.GOOD] = 0.0
    return 1


@inlined
def _put_back(course, asked, top, tally, fine, work):
    """
    Put the intervals that waited back on the stack, halved or with other ends; return the number of
    those that wait again.
    """
    n_brackets, margin, rays, complete, resolved = tally
    still = 0
    for i in range(asked):
        a, ray, b = work.halves[i, 0], work.rays[2 * i], work.halves[i, 1]
        kind = int(work.kinds[i])
        if kind == HALVE:
            if ray[at.GOOD] > 0.0:
                margin = min(margin, abs(ray[at.MISS]))
            top = _put_halves(course.rule, a, ray, b, top, work)
            continue
        if kind == _FINER:
            end, change = _end_to_move(a, b, ray, work.rays[2 * i + 1])
            copy_ray(ray, a)
            copy_ray(work.rays[2 * i + 1], b)
            if end >= 0:
                _ask_beyond(a, b, end, change, fine, still, work)
                work.nodes[int(b[at.INTERVAL])] += 1.0
                rays += 1
                still += 1
                continue
        else:
            copy_ray(ray, a if kind == _MOVE_FIRST else b)
        copy_ray(a, work.stack[top, 0])
        copy_ray(b, work.stack[top, 1])
        top += 1
    return still, top, (n_brackets, margin, rays, complete, resolved)


@kernel
def _end_to_move(a, b, finer_a, finer_b):
    """
    Index of the interval's end that must be moved, or -1, and the change of its angle.

    If the fine tolerance moved the root just beyond one end, or a change of reflections, the
    adjacent interval may lack it. A root inside the interval remains there.
    """
    nearer = 0 if abs(finer_a[at.MISS]) < abs(finer_b[at.MISS]) else 1
    end = finer_a if nearer == 0 else finer_b
    over, h = -2.0 * end[at.MISS] / end[at.SLOPE], b[at.ANGLE] - a[at.ANGLE]
    if a[at.CODE] != b[at.CODE] and finer_a[at.CODE] == finer_b[at.CODE]:
        return (0, -h - abs(over)) if finer_a[at.CODE] != a[at.CODE] else (1, h + abs(over))
    lost = a[at.MISS] * b[at.MISS] < 0.0 < finer_a[at.MISS] * finer_b[at.MISS]
    outwards = over < 0.0 if nearer == 0 else over > 0.0
    return nearer if lost and outwards and abs(over) < h else -1, over


@kernel
def _ask_beyond(a, b, end, change, fine, i, work):
    """Ask for one end of an interval, 0 or 1, again at another angle."""
    ray = work.rays[2 * i]
    copy_ray(a if end == 0 else b, ray)
    ray[at.ANGLE] += change
    ray[at.TOL] = fine
    ray[at.GOOD] = WAITING
    work.rays[2 * i + 1, at.GOOD] = 0.0
    work.kinds[i] = _MOVE_FIRST if end == 0 else _MOVE_SECOND
    copy_ray(a, work.halves[i, 0])
    copy_ray(b, work.halves[i, 1])


@kernel
def _put_halves(rule, a, m, b, top, work):
    """
    Put both halves of an interval on the stack, the steeper on top; return the size of the stack.
    """
    e = a[at.DEFECT]
    if (
        m[at.GOOD] * a[at.GOOD] * b[at.GOOD] > 0.0
        and _same_code(a, m, rule.fold)
        and _same_code(m, b, rule.fold)
    ):
        e = 4.0 * _defect(a, m, b)
    elif rule.kind != at.OPEN:
        e = _UNKNOWN  # the middles of the halves decide
    upper = 1 if a[at.ANGLE] + b[at.ANGLE] > 0.0 else 0
    for half in range(2):
        ends = work.stack[top + (half if upper == 1 else 1 - half)]
        copy_ray(m if half == 1 else a, ends[0])
        copy_ray(b if half == 1 else m, ends[1])
        ends[0, at.DEFECT] = e
        ends[1, at.INTERVAL] = b[at.INTERVAL]
    return top + 2


@kernel
def _add_bracket(a, b, n, interval, work):
    """Append a bracket to those of an interval of the fan; return the number of brackets."""
    copy_ray(a, work.brackets[n, 0])
    copy_ray(b, work.brackets[n, 1])
    work.nodes[interval] += _RAYS_PER_BRACKET
    return n + 1


@kernel
def _add_edges(ends, rule, overhang, n, interval, work):
    """
    Append rays at a change of code that would meet the receiver beyond it, as brackets without
    width; return the number of brackets.
    """
    for end in range(2):
        ray = ends[end]
        beyond = overhang if end == 0 else -overhang
        if n < work.brackets.shape[0] and _points_across(ray, rule, beyond):
            n = _add_bracket(ray, ray, n, interval, work)
    return n


@kernel
def _resolution(a, b, dropped, course, search):
    """RESOLVED of an interval that is not divided; dropped: it counts as one without a root."""
    h = b[at.ANGLE] - a[at.ANGLE]
    if dropped and h < search.min_width and _unresolved(a, b, h, search):
        return 0.0
    if not course.cross:
        return 1.0
    if _folds(a, b, h, search.weak):
        return 0.0
    if h < _WINDOW_WIDTH and _may_stay(a, b, h, course.length):
        return 0.0
    for ray in (a, b):
        arrives = ray[at.GOOD] > 0.0 and ray[at.LEFT] == 0.0
        strong = abs(ray[at.SLOPE] * ray[at.SPREAD]) < _SHEET_SHARE * search.weak
        if arrives and strong and not _LEAST_SPREAD < ray[at.SPREAD] < _MOST_SPREAD:
            return FROM_ONE_END
    return 1.0


@kernel
def _unresolved(a, b, h, search):
    """
    True if a pair of rays about an extremum of the miss may be between two rays at the resolution.

    Where the miss jumps, and between two weak rays, rays are too weak. A monotonic miss has no
    extremum.
    """
    rise = b[at.MISS] - a[at.MISS]
    ea, eb = h * a[at.SLOPE] - rise, h * b[at.SLOPE] - rise
    if _is_monotonic(a, b, rise, max(abs(ea), abs(eb))) and not _oscillates(a, b, h):
        return False
    reach = _CUBIC_DEPARTURE * (abs(ea) + abs(eb))
    nearest = min(abs(a[at.MISS]), abs(b[at.MISS]))
    weak = min(abs(a[at.SLOPE]), abs(b[at.SLOPE])) > search.weak and not _dips(a, b, h)
    return not weak and abs(rise) < search.weak * h and nearest < reach + _noise(a, b, search)


@kernel
def _noise(a, b, search):
    """Error of the miss of two rays that were traced with the fine tolerance. [m]"""
    return search.fine * max(1.0, min(a[at.GROWTH], b[at.GROWTH]))


@kernel
def _dips(a, b, h):
    """True if the cubic between two rays on the same side of the receiver is zero twice."""
    side = 1.0 if a[at.MISS] > 0.0 else -1.0
    fa, fb = side * a[at.MISS], side * b[at.MISS]
    da, db = side * h * a[at.SLOPE], side * h * b[at.SLOPE]
    if not (fb > 0.0 and da < 0.0 < db):
        return False
    # the zero of the derivative da + 2 c t + 3 d t^2 between 0 and 1
    c, d = 3.0 * (fb - fa) - 2.0 * da - db, da + db - 2.0 * (fb - fa)
    t = -da / (c + math.sqrt(c * c - 3.0 * d * da))
    return cubic(t, 1.0, fa, da, fb, db) < 0.0


@kernel
def _is_monotonic(a, b, rise, defect):
    """
    True if the miss between two rays has no extremum, from the larger defect of its slopes.
    """
    return a[at.SLOPE] * rise > 0.0 and b[at.SLOPE] * rise > 0.0 and defect < 1.5 * abs(rise)


@kernel
def _folds(a, b, h, weak):
    """
    True if the cross-track slowness jumps between two rays beside the plane: several rays of one
    launch angle end in it.
    """
    if h >= _WEAK_WIDTH or a[at.GOOD] * b[at.GOOD] <= 0.0 or a[at.LEFT] + b[at.LEFT] > 0.0:
        return False
    if min(abs(a[at.SLOPE]), abs(b[at.SLOPE])) > _FOLD_WEAK * weak:
        return False
    change = b[at.CROSS] - a[at.CROSS]
    defect = max(abs(h * a[at.CROSS_SLOPE] - change), abs(h * b[at.CROSS_SLOPE] - change))
    rise = b[at.MISS] - a[at.MISS]
    reach = _CUBIC_DEPARTURE * (abs(h * a[at.SLOPE] - rise) + abs(h * b[at.SLOPE] - rise))
    nearest = min(abs(a[at.MISS]), abs(b[at.MISS]))
    if a[at.MISS] * b[at.MISS] > 0.0 and nearest > _FOLD_REACH * reach:
        return False
    return defect > max(_FOLD, _FOLD_DEFECT * abs(change))


@kernel
def _meets(ray, fine, h):
    """
    True if a ray out of the plane meets the receiver within its error: the sign of its miss may
    differ between its two intervals.
    """
    return ray[at.TOL] <= fine and abs(ray[at.MISS]) < _NOISE * fine < 0.5 * h * abs(ray[at.SLOPE])


@kernel
def _add_around(ray, fine, n, interval, work):
    """Append a bracket about a ray that meets the receiver; return the number of brackets."""
    n = _add_bracket(ray, ray, n, interval, work)
    half = _NOISE * fine / abs(ray[at.SLOPE])
    for i in range(2):
        end = work.brackets[n - 1, i]
        end[at.ANGLE] += (2 * i - 1) * half
        end[at.MISS] += (2 * i - 1) * half * ray[at.SLOPE]
    return n


@kernel
def _is_rough(a, b, h, length):
    """True if the miss is not smooth between two rays, so that rays between them may reflect."""
    rise = b[at.MISS] - a[at.MISS]
    defect = max(abs(h * a[at.SLOPE] - rise), abs(h * b[at.SLOPE] - rise))
    return defect > _ROUGH * max(abs(rise), length * h)


@inlined
def _judge(a, b, varies, course, search):
    """
    Return the verdict on the interval between two rays, and True if the miss is smooth there;
    varies is False if the section is the same at all ranges.
    """
    rule = course.rule
    h = b[at.ANGLE] - a[at.ANGLE]
    reflecting = rule.kind != at.OPEN
    if -search.trapped <= a[at.ANGLE] and b[at.ANGLE] <= search.trapped:
        return _DROP, False
    alive = a[at.GOOD] > 0.0 and b[at.GOOD] > 0.0
    same = alive and _same_code(a, b, rule.fold)
    if reflecting and same and a[at.CODE] * b[at.CODE] == 0.0:  # direct
        hides = h > _NARROWEST_ROUGH and _is_rough(a, b, h, course.length)
        return _SPLIT if hides else _DROP, same
    if a[at.GOOD] + b[at.GOOD] == 0.0 or (
        reflecting and _too_many_bounces(a, rule) and _too_many_bounces(b, rule)
    ):
        last = max(a[at.LEFT], b[at.LEFT])
        late = h > _NARROWEST_LATE and last > (1.0 - search.late) * course.length
        if not reflecting or h < search.trust or not (late or _window(a, b, course.length)):
            return _DROP, False
        return _SPLIT, False
    if reflecting and not same:
        believed = h < search.trust or min(abs(a[at.ANGLE]), abs(b[at.ANGLE])) > search.steep
        edge = believed and _cannot_vanish(a, h) and _cannot_vanish(b, h)
        weak = min(abs(a[at.SLOPE]), abs(b[at.SLOPE])) > search.weak
        least = search.min_width if weak else min(search.min_width, _NARROWEST_EDGE)
        return _EDGE if edge or h < least else _SPLIT, False
    if not alive:
        return _DROP if h < search.min_width else _SPLIT, False
    if not reflecting and _leave_water_alike(a, b, course.length):
        return _GONE, same
    if not reflecting and h < _WINDOW_WIDTH and _leave_on_one_side(a, b):
        return _DROP, same
    return _judge_smooth(a, b, varies, not reflecting, course.length, search), same


@inlined
def _judge_smooth(a, b, varies, direct, length, search):
    """
    Return the verdict on an interval between rays with the same reflections, or between direct
    rays.
    """
    h = b[at.ANGLE] - a[at.ANGLE]
    fa, fb = a[at.MISS], b[at.MISS]
    e = a[at.DEFECT]
    rise = fb - fa
    ea = h * a[at.SLOPE] - rise
    eb = h * b[at.SLOPE] - rise
    monotonic = (
        _is_monotonic(a, b, rise, max(abs(ea), abs(eb)))
        and e < 0.05 * abs(rise)
        and not _oscillates(a, b, h)
    )
    if fa == 0.0 or fa * fb < 0.0:
        resolved = monotonic and max(abs(ea), abs(eb)) < search.resolved
        return _BRACKET if resolved or h < search.min_width else _SPLIT
    tol = max(a[at.TOL], b[at.TOL])
    nearest = min(abs(fa), abs(fb))
    reach = _CUBIC_DEPARTURE * (abs(ea) + abs(eb)) + e
    # If one end is within the tolerance of zero, only the fine tolerance shows on which side of
    # zero it is; without this condition the intervals beside it would be halved without end.
    sure = tol <= search.fine or nearest > 4.0 * tol
    even = sure and monotonic and max(abs(ea), abs(eb)) < 0.5 * abs(rise)
    clear = even or (nearest > reach + tol and not _oscillates(a, b, h))
    clear = clear and max(abs(ea), abs(eb)) < max(search.resolved, _FAR_SHARE * nearest)
    window = varies and h > _WINDOW_WIDTH and _may_stay(a, b, h, length)
    may_hide = direct and varies and h > _PASSAGE_WIDTH
    bend = max(abs(ea), abs(eb)) / max(nearest, 1e-9)
    hidden = may_hide and _maximum_between(a, b, h, bend, search.resolved)
    if h < search.min_width:
        # rays between two whose miss is within its error do not show whether the receiver has rays
        shows = nearest > _noise(a, b, search) and h > _CAUSTIC_WIDTH
        return _SPLIT if direct and shows and _unresolved(a, b, h, search) else _DROP
    folds = direct and search.resolved < math.inf and _folds(a, b, h, search.weak)
    return _DROP if clear and not (window or hidden or folds) else _SPLIT


@kernel
def _defect(a, m, b):
    """
    Largest error of the cubic in the wider part of [a, b], from its error at the ray between; the
    error is taken as a quartic.
    """
    h = b[at.ANGLE] - a[at.ANGLE]
    t = (m[at.ANGLE] - a[at.ANGLE]) / h
    departure = abs(m[at.MISS] - cubic(t, h, a[at.MISS], a[at.SLOPE], b[at.MISS], b[at.SLOPE]))
    shape = max((t * (1.0 - t)) ** 2, 1e-4)
    return departure / 16.0 / shape * max(t, 1.0 - t) ** 4


@kernel
def fan_nodes(s, lo, hi, spacing, link, nodes):
    """
    Launch angles of the first fan: equal spacing, and the angles at which rays turn at the levels.

    spacing contains the equal spacing and the least distance between two nodes. [rad]

    A ray that turns between two levels depends on the profile there: the miss has structure on the
    scale of these angles, and in a LINEAR section singularities exactly at them.
    """
    spacing, closest = spacing
    count = max(int(math.ceil((hi - lo) / spacing)), 2) + 1
    count = min(count, nodes.size // 2)
    for i in range(count):
        nodes[i] = lo + (hi - lo) * i / (count - 1)
    if s.kind == at.LINEAR and s.layered != at.VARYING:
        n = add_turning_angles(s, lo, hi, link, count, nodes)
    else:
        n = _add_level_angles(s, lo, hi, link.c0, count, nodes)
    sort_head(nodes, n)
    m = 1
    for i in range(1, n):
        if nodes[i] - nodes[m - 1] > closest:
            nodes[m] = nodes[i]
            m += 1
    if s.kind == at.LINEAR and s.layered != at.VARYING:
        m = add_middles(m, nodes)
    return m


@kernel
def _add_level_angles(s, lo, hi, c_source, n, nodes):
    """
    Append to the first n nodes the angles at which rays turn at the levels; return the number of
    nodes.
    """
    for k in range(s.depth.size):
        at_boundary = s.layered != at.VARYING and k % (s.depth.size - 1) == 0
        c_first, before = 0.0, _BEFORE_LEVEL if at_boundary else 0.0
        for cell in range(s.n_range):
            c = level_speed(s, cell, k)
            c_first = c if cell == 0 else c_first
            if c > c_source and n < nodes.size - 2:
                angle = math.acos(c_source / c) - before
                if angle < hi:
                    nodes[n] = angle
                    n += 1
                if -angle > lo:
                    nodes[n] = -angle
                    n += 1
            if s.kind == at.SMOOTH or (cell > 0 and abs(c - c_first) < 1e-9):
                break
    return n


@kernel
def speed_extremes(s, extremes):
    """
    Put the least and largest sound speed of each layer into extremes; return the largest variation
    along the section.
    """
    variation = 0.0
    for i in range(s.n_range):
        for k in range(s.depth.size - 1):
            h = s.depth[k + 1] - s.depth[k]
            c0 = s.data[i, k, 0]
            c1 = s.data[i, k + 1, 0] if k + 1 < s.data.shape[1] else 0.0
            if s.kind == at.SMOOTH:
                least, largest = _cubic_extremes(
                    h, c0, s.data[i, k, 1], s.data[i, k, 2], s.data[i, k, 3]
                )
            else:
                least, largest = min(c0, c1), max(c0, c1)
            if i == 0:
                extremes[0, k], extremes[1, k] = least, largest
            extremes[0, k] = min(extremes[0, k], least)
            extremes[1, k] = max(extremes[1, k], largest)
            variation = max(variation, abs(c0 - s.data[0, k, 0]))
    return variation


@inlined
def _cubic_extremes(h, c0, d1, d2, d3):
    """Least and largest value of a cubic in a layer of thickness h, from its coefficients."""
    c1 = c0 + h * (d1 + h * (d2 + h * d3))
    least, largest = min(c0, c1), max(c0, c1)
    bend = d2 + 3.0 * h * d3
    if (
        d1 * (d1 + h * (d2 + bend)) > 0.0 and d2 * bend >= 0.0
    ):  # the slope is not zero inside the layer
        return least, largest
    root = d2 * d2 - 3.0 * d1 * d3
    if root > 0.0:
        q = -(d2 + math.copysign(math.sqrt(root), d2))
        for x in (q / (3.0 * d3) if d3 != 0.0 else -1.0, d1 / q if q != 0.0 else -1.0):
            if 0.0 < x < h:
                c = c0 + x * (d1 + x * (d2 + x * d3))
                least, largest = min(least, c), max(largest, c)
    return least, largest


@kernel
def snell_limit(s, c_source, top, low, variation, extremes):
    """
    Steepest launch angle of a ray that turns between two depths, and steepest angle of such a ray
    there, from the horizontal.

    Snell's law: arccos of the sound speed at the source over the largest between the depths,
    increased by the variation of the field along the section.
    """
    slowest, fastest = c_source, c_source
    for k in range(s.depth.size - 1):
        if s.depth[k + 1] >= top and s.depth[k] <= low:
            slowest = min(slowest, extremes[0, k])
            fastest = max(fastest, extremes[1, k])
    if s.layered == at.DEEPER and low > s.depth[s.depth.size - 1]:
        edge = piece_at(s, s.depth.size - 1)
        farthest = edge.c0 + edge.c1 * edge.scale
        slowest, fastest = min(slowest, farthest), max(fastest, farthest)
    if fastest > c_source:
        fastest += variation
    return math.acos(c_source / fastest), math.acos(slowest / fastest)


@kernel
def turning_limits(s, c_source, z0, z1, horizontal, variation, extremes):
    """
    Steepest launch angles upwards and downwards at which a ray can turn within reach of a link.
    """
    up, down, steep_up, steep_down = 0.6, 0.6, 0.6, 0.6
    for _ in range(3):
        reach = 0.5 * horizontal * math.tan(steep_up) + 1.0
        up, steep_up = snell_limit(s, c_source, min(z0, z1) - reach, z0, variation, extremes)
        reach = 0.5 * horizontal * math.tan(steep_down) + 1.0
        down, steep_down = snell_limit(s, c_source, z0, max(z0, z1) + reach, variation, extremes)
    return up, down


@kernel
def is_steep(slope, limit):
    """True if the chord is so steep that the link has one direct ray, traced along the chord."""
    return abs(slope) > max(limit + STEEP, 0.3)
