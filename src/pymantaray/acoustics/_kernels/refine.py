"""
Find the ray of a bracket that meets the receiver, by Newton's method in three dimensions, and fill
its row of an arrival.
"""

import math
from collections import namedtuple

import numpy as np

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.beside import (
    cross_change,
    direct_ray,
    offset_in_plane,
    trace_direct,
)
from pymantaray.acoustics._kernels.boundary import across_plane, bed_at, surface_at
from pymantaray.acoustics._kernels.field import cubic_root
from pymantaray.acoustics._kernels.layout import Accuracy
from pymantaray.acoustics._kernels.search import fewer_bounces, shoot
from pymantaray.acoustics._kernels.trace import full_ray, full_ray_end, ray_axis, trace
from pymantaray.compile import kernel

RESOLUTION = 1e-6  # rad; narrower intervals of a fan of direct rays are not divided
_NARROWEST_JUMP = 1e-9  # rad; a narrower jump of the miss contains no ray
_WIDEST_JUMP, _STEEPEST = (
    5e-5,
    10.0,
)  # rad, times the slope of a weak ray; the miss jumps in a narrower bracket where it is steeper
# m; rays to a receiver on a boundary end this far inside, and the travel time is corrected (Fermat)
INSET = 1e-3
_DIFFERENCE_STEP = 1e-5  # rad; distance of rays whose differences are derivatives
# If Newton's method fails, the slopes of the boundaries across the plane increase from zero in
# these shares
_FIRST_SHARE, _MIN_SHARE = 0.25, 1.0 / 128.0
_MAX_MOVES = 24  # of a bracket's ends
_MIN_MOVE = 1e-3  # of the bracket's width: shortest move
_RETURN_DISTANCE = (
    10.0  # times the miss; a ray farther beyond the edges of the held cells does not return
)
# m; out of the plane, a ray to a receiver nearer to a boundary may reflect there or not
_NEAR_BOUNDARY = 10.0
_MAX_RETREATS = 12  # from such a reflection
_ROUGH_MISS = 1e-4  # of the course: allowed miss of a ray with a share of the slope

Launch = namedtuple("Launch", "ok angle q steps turns")
Launch.__doc__ = """An eigenray: True if it is one, launch angle, slowness out of the plane, steps
of its path, turning points."""

Widened = namedtuple("Widened", "ok a b fa fb q")
Widened.__doc__ = """Widened bracket: False if a ray fails, launch angles and misses of both ends,
slowness out of the plane."""

Trial = namedtuple("Trial", "angle q jacobian most wanted exact")
Trial.__doc__ = """Start of Newton's method, largest number of rays, and required code of
reflections.

A jacobian of zeros is replaced: by differences of three rays if exact is set or only a share of the
boundaries' slopes counts, otherwise by the variation in the plane. A ray with another number of
reflections, or with exact another code, is moved back half-way."""


@kernel
def cubic_angle(a, b, level):
    """Launch angle between two rays of a fan at which the cubic of the miss equals level."""
    h = b[at.ANGLE] - a[at.ANGLE]
    return a[at.ANGLE] + h * cubic_root(
        h, a[at.MISS] - level, a[at.SLOPE], b[at.MISS] - level, b[at.SLOPE]
    )


@kernel
def cross_slowness(a, b, angle):
    """Cross-track slowness at the source of a ray between two rays of a fan."""
    share = (angle - a[at.ANGLE]) / (b[at.ANGLE] - a[at.ANGLE])
    return a[at.CROSS] + share * (b[at.CROSS] - a[at.CROSS])


@kernel
def polish(s, walls, course, bracket, accuracy, work):
    """
    Find the direct ray of a bracket by Newton's method from the root of its cubic, with horizontal
    refraction.

    Not ok if the method does not converge at once, leaves the bracket, or reaches a ray on the
    other side of a caustic.
    """
    y, a, b = work.y, bracket[0], bracket[1]
    lo, hi, rise = a[at.ANGLE], b[at.ANGLE], b[at.MISS] - a[at.MISS]
    m = cubic_angle(a, b, 0.0)
    q = cross_slowness(a, b, m)
    steps, turns = 0, 0
    for _ in range(6):
        ok, steps, turns, _ = trace_direct(
            s, walls, course, m, q, accuracy.fine, direct_ray(course, work)
        )
        if not ok or y[at.XI] * rise <= 0.0 or y[at.DY_DQ] <= 0.0:
            break
        f = offset_in_plane(y) - course.target
        if abs(y[at.W] - course.target) < accuracy.miss and abs(y[at.Y]) < accuracy.miss:
            return Launch(True, m, q, steps, turns)
        q += cross_change(y, -f / y[at.XI])
        m -= f / y[at.XI]
        if not 2.0 * lo - hi <= m <= 2.0 * hi - lo:
            break
    return Launch(False, m, q, steps, turns)


@kernel
def miss_noise(tol, slope, length):
    """
    Difference of the misses of neighbouring rays that their errors can cause; the errors grow with
    the divergence. [m]
    """
    return 30.0 * tol * max(1.0, abs(slope) / length)


@kernel
def jumps(wide, weak):
    """
    True if the miss is much steeper than weak across a widened bracket, as at a crest: usually the
    bracket contains no ray.
    """
    width = wide.b - wide.a
    return (
        wide.ok
        and wide.fa * wide.fb <= 0.0
        and width < _WIDEST_JUMP
        and abs(wide.fb - wide.fa) > _STEEPEST * weak * width
    )


@kernel
def put_off(wide, bracket):
    """Store a widened bracket in columns of the bracket that are used no longer."""
    bracket[0, at.SLOPE], bracket[1, at.SLOPE] = wide.a, wide.b
    bracket[0, at.SLOWNESS], bracket[1, at.SLOWNESS] = wide.fa, wide.fb
    bracket[0, at.SLOWNESS_SLOPE] = wide.q


@kernel
def taken_up(bracket):
    """Widened bracket that `put_off` stored."""
    a, b = bracket[0], bracket[1]
    return Widened(
        True, a[at.SLOPE], b[at.SLOPE], a[at.SLOWNESS], b[at.SLOWNESS], a[at.SLOWNESS_SLOPE]
    )


@kernel
def refine(s, walls, course, wide, accuracy, weak, work):
    """
    Find the direct ray of a widened bracket, with horizontal refraction, that ends within
    accuracy.miss of the receiver.

    Newton's method on both slownesses: the angle by xi, the cross-track slowness by dy/dq,
    safeguarded by bisection. It stops without a ray if the bracket is narrower than _NARROWEST_JUMP
    and the miss in it steeper than weak by more than the rays' errors. The end state stays in
    work.y and its path in work.path.
    """
    y, ray, tol, miss = work.y, direct_ray(course, work), accuracy.fine, accuracy.miss
    ok, a, b, fa, fb, q = wide
    if not ok:
        return Launch(False, a, q, 0, 0)
    bracketed = fa * fb <= 0.0
    m = b - fb * (b - a) / (fb - fa) if fb != fa else 0.5 * (a + b)
    if not a <= m <= b:
        m = 0.5 * (a + b)
    lo, hi, f_lo, f_hi, sure_lo, sure_hi = a, b, fa, fb, a, b
    previous = np.inf
    steps, turns = 0, 0
    for it in range(80 if bracketed else 12):
        ok, steps, turns, _ = trace_direct(s, walls, course, m, q, tol, ray)
        if not ok:
            return Launch(False, m, q, steps, turns)
        f = offset_in_plane(y) - course.target
        if abs(y[at.W] - course.target) < miss and abs(y[at.Y]) < miss:
            return Launch(True, m, q, steps, turns)
        settled = abs(y[at.Y]) < miss
        if bracketed:
            if (f > 0.0) == (fa > 0.0):
                lo, f_lo = m, f
                sure_lo = m if settled else sure_lo
            else:
                hi, f_hi = m, f
                sure_hi = m if settled else sure_hi
            noise = miss_noise(tol, min(abs(y[at.XI]), weak), course.length)
            if hi - lo < _NARROWEST_JUMP and abs(f_hi - f_lo) > max(weak * (hi - lo), noise):
                break
        new = m - f / y[at.XI] if y[at.XI] != 0.0 else 0.5 * (lo + hi)
        rises = 0.0 < y[at.XI] * (1.0 if fb > fa else -1.0) < weak
        if settled and rises and not lo < new < hi and sure_lo < new < sure_hi:
            lo, hi = sure_lo, sure_hi  # a ray out of the plane of the receiver had the wrong sign
        if bracketed and (not lo < new < hi or (it > 3 and abs(f) > 0.5 * previous)):
            new = 0.5 * (lo + hi)
        previous = abs(f)
        if new == m:
            # the angle has no more digits: accept the ray if it is near
            near = abs(f) < 1e3 * miss and abs(y[at.Y]) < miss
            return Launch(near, m, q + cross_change(y, 0.0), steps, turns)
        q += cross_change(y, new - m)
        m = new
    return Launch(False, m, q, steps, turns)


@kernel
def widened(s, walls, course, bracket, tol, work):
    """
    Widen a bracket until it contains the root, which horizontal refraction moves by a small angle.

    If the bracket is still too narrow, the misses have the same sign.
    """
    y, ray = work.y, direct_ray(course, work)
    a, b, fa, fb, slope_a, slope_b = bracket[0, at.ANGLE], bracket[1, at.ANGLE], 0.0, 0.0, 0.0, 0.0
    q = 0.5 * (bracket[0, at.CROSS] + bracket[1, at.CROSS])
    rise = bracket[1, at.MISS] - bracket[0, at.MISS]
    step = b - a
    direction = 0  # -1 if the first end moves, 1 if the second one does
    grows = True
    least = _MIN_MOVE * step
    for attempt in range(_MAX_MOVES):
        ok, _, _, _ = trace_direct(s, walls, course, a, q, tol, ray)
        beyond = direction < 0 and (not ok or y[at.XI] * rise < 0.0)
        if not ok and not beyond:
            return Widened(False, a, b, fa, fb, q)
        if ok:
            fa, slope_a = offset_in_plane(y) - course.target, y[at.XI]
            q += cross_change(y, 0.0)
        ok, _, _, _ = trace_direct(s, walls, course, b, q, tol, ray)
        beyond = beyond or (direction > 0 and (not ok or y[at.XI] * rise < 0.0))
        if not ok and not beyond:
            return Widened(False, a, b, fa, fb, q)
        if ok:
            fb, slope_b = offset_in_plane(y) - course.target, y[at.XI]
            q += cross_change(y, 0.0)
        if attempt == 0:
            continue
        if (fa * fb <= 0.0 and not beyond) or step > 1e-3 or step < least:
            break
        if beyond:  # the root is before the extremum
            grows = False
            step *= 0.5
            a, b = (a + step, b) if direction < 0 else (a, b - step)
            continue
        # by at most the bracket's width at first: beyond a caustic's other ray there is no root
        first = direction == 0
        direction = -1 if abs(fa) < abs(fb) else 1
        if first and (slope_a if direction < 0 else slope_b) * rise < 0.0:
            break  # the end is already beyond the extremum
        if grows and not first:
            step *= 2.0
        a, b = (a - step, b) if direction < 0 else (a, b + step)
    return Widened(True, a, b, fa, fb, q)


@kernel
def unresolved_db(bracket, noise, slope):
    """
    Spreading to add if a bracket has the width of the resolution and the miss jumps across it. [dB]

    Along a sound-speed maximum rays diverge faster than the digits of a launch angle resolve, so
    the slope at one ray says nothing.
    """
    h = bracket[1, at.ANGLE] - bracket[0, at.ANGLE]
    jump = abs(bracket[1, at.MISS] - bracket[0, at.MISS])
    mean = jump / h
    if h > RESOLUTION or jump < noise or mean <= abs(slope):
        return 0.0
    return 10.0 * math.log10(mean / max(abs(slope), 1e-300))


@kernel
def narrow(s, walls, course, bracket, launch, tol, work):
    """
    Move the ends of a bracket to rays beside a ray, closer to each other than the resolution; if
    one does not reach the end, without a jump.
    """
    reach = True
    for i in range(2):
        angle = launch.angle + (i - 0.5) * 0.9 * RESOLUTION
        ok, _, _, _ = trace_direct(s, walls, course, angle, launch.q, tol, direct_ray(course, work))
        bracket[i, at.ANGLE], bracket[i, at.MISS] = angle, offset_in_plane(work.y) - course.target
        reach = reach and ok
    if not reach:
        bracket[1, at.MISS] = bracket[0, at.MISS]


@kernel
def _in_plane(s, walls, course, bracket, accuracy, work):
    """
    Launch angle of the root of the miss in a bracket, in the plane of the link, and False if it
    cannot be found.
    """
    lo, hi, fa, code = (
        bracket[0, at.ANGLE],
        bracket[1, at.ANGLE],
        bracket[0, at.MISS],
        bracket[0, at.CODE],
    )
    m = 0.5 * (lo + hi)
    node = work.rays[0]
    previous = math.inf
    for it in range(60):
        shoot(s, walls, course, m, accuracy.fine, 0.0, node, work)
        f, d = node[at.MISS], node[at.SLOPE]
        if node[at.GOOD] == 0.0 or node[at.CODE] != code:
            return m, False
        if abs(f) < max(0.01, 10.0 * accuracy.fine):
            return m, True
        if (f > 0.0) == (fa > 0.0):
            lo = m
        else:
            hi = m
        new = m - f / d if d != 0.0 else 0.5 * (lo + hi)
        if not lo < new < hi or (it > 3 and abs(f) > 0.5 * previous):
            new = 0.5 * (lo + hi)
        previous = abs(f)
        if new == m:
            return m, True
        m = new
    return m, False


@kernel
def _differences(s, walls, course, angle, q, tol, work):
    """
    Return ok and the derivatives of both end offsets by both launch parameters, by differences from
    the ray in work.
    """
    y, ray, d = work.y, full_ray_end(work), _DIFFERENCE_STEP
    w0, y0 = y[at.W], y[at.Y]
    ok1, _, _, _ = trace(s, walls, course, angle + d, q, tol, ray)
    w1, y1 = y[at.W] - w0, y[at.Y] - y0
    ok2, _, _, _ = trace(s, walls, course, angle, q + d, tol, ray)
    w2, y2 = y[at.W] - w0, y[at.Y] - y0
    return ok1 and ok2, (w1 / d, w2 / d, y1 / d, y2 / d)


@kernel
def _away_from_boundary(walls, course):
    """Sign of the change of depth away from a boundary near the target; otherwise 0."""
    if course.rule.kind != at.FORWARD:
        return 0.0
    z, r = course.axis.z_source + course.target, course.length
    above = z - surface_at(walls, r, 0.0, r)[0]
    below = bed_at(walls, r, 0.0, r)[0] - z
    if min(above, below) > _NEAR_BOUNDARY:
        return 0.0
    return 1.0 if above < below else -1.0


@kernel
def newton(s, walls, course, trial, bracket, bounded, accuracy, work):
    """
    Find the reflected ray that ends at the target, by Newton's method with Broyden's updates.

    If bounded, the search stops when it leaves the bracket. If the first ray has other reflections
    because of a boundary near the target, the next ones are farther away from it. Returns the
    launch, the jacobian and the code of the last ray.
    """
    rule, y, ray, fine, miss = course.rule, work.y, full_ray(work), accuracy.fine, accuracy.miss
    inner = fewer_bounces(bracket)
    m, q, wanted = trial.angle, trial.q, trial.wanted
    last_m, last_q, last_f, last_y, best = m, q, 0.0, 0.0, math.inf
    j00, j01, j10, j11 = trial.jacobian
    steps, turns, code = 0, 0, wanted
    away = _away_from_boundary(walls, course)
    for it in range(trial.most):
        ok, steps, turns, code = trace(s, walls, course, m, q, fine, ray)
        # a failed ray, or one with other reflections: try another launch
        if not ok or code % 1024 != wanted % 1024 or (trial.exact and code != wanted):
            if math.isinf(best) and rule.fold != 0 and it < 20:
                m = 0.5 * (m + bracket[inner, at.ANGLE])
                continue
            if math.isinf(best) and ok and away != 0.0 and it < _MAX_RETREATS:
                wrong = max(abs(y[at.W] - course.target), INSET)
                m += away * wrong / bracket[inner, at.SLOPE] * 2.0**it
                q -= y[at.Y] / y[at.DY_DQ] if y[at.DY_DQ] > 0.0 else 0.0
                continue
            if math.isinf(best):
                break
            m, q = 0.5 * (m + last_m), 0.5 * (q + last_q)
            continue
        f, side = y[at.W] - course.target, y[at.Y]
        if walls.held >= 0.0 and walls.cells[at.LANDED, -1] > _RETURN_DISTANCE * (
            abs(f) + abs(side)
        ):
            break
        if abs(f) < miss and abs(side) < miss:
            return Launch(True, m, q, steps, turns), (j00, j01, j10, j11), code
        dm, dq = m - last_m, q - last_q
        d2 = dm * dm + dq * dq
        if it > 0 and d2 == 0.0:  # no more digits
            near = max(abs(f), abs(side)) < 1e3 * miss
            return Launch(near, m, q, steps, turns), (j00, j01, j10, j11), code
        # Broyden's update; a new jacobian if there is none or the ray is worse
        if not math.isinf(best) and abs(f) + abs(side) <= 4.0 * best:
            e0 = (f - last_f - j00 * dm - j01 * dq) / d2
            e1 = (side - last_y - j10 * dm - j11 * dq) / d2
            j00, j01, j10, j11 = j00 + e0 * dm, j01 + e0 * dq, j10 + e1 * dm, j11 + e1 * dq
        elif not math.isinf(best) or j00 == 0.0:
            j00, j01, j10, j11 = y[at.XI], 0.0, 0.0, y[at.DY_DQ]
            if trial.exact or walls.across != 1.0:
                ok, differences = _differences(s, walls, course, m, q, fine, work)
                if ok:
                    j00, j01, j10, j11 = differences
        best = min(best, abs(f) + abs(side))
        det = j00 * j11 - j01 * j10
        if det == 0.0:
            break
        # Newton's step, with a limit
        last_m, last_q, last_f, last_y = m, q, f, side
        dm = -(j11 * f - j01 * side) / det
        dq = -(j00 * side - j10 * f) / det
        shrink = min(1.0, 0.05 / max(abs(dm), 1e-300), 0.1 / max(abs(dq), 1e-300))
        m += shrink * dm
        q += shrink * dq
        if bounded and not bracket[0, at.ANGLE] <= m <= bracket[1, at.ANGLE]:
            break
    return Launch(False, m, q, steps, turns), (j00, j01, j10, j11), code


@kernel
def refine_reflected(s, walls, course, bracket, accuracy, work):
    """
    Find the reflected ray of a bracket that ends at the target; also return True if it has the
    bracket's boundary cells.

    Newton's method starts from the root of the bracket's cubic. If the reflections change, it
    starts again from the root in the plane of the link. If this fails too, the slopes of the
    boundaries across the plane increase from zero, and each ray starts the search of the next. The
    end state stays in work.y, its path in work.path.
    """
    rule = course.rule
    inner = fewer_bounces(bracket)
    wanted = int(bracket[inner, at.CODE])
    level = bracket[inner, at.MISS]
    level = math.copysign(min(INSET, 0.5 * abs(level)), level) if rule.fold != 0 else 0.0
    start = cubic_angle(bracket[0], bracket[1], level)
    gridded = walls.bed.depth.size > 1 or walls.surface.depth.size > 1
    none = (0.0, 0.0, 0.0, 0.0)
    for attempt in range(2):
        if attempt == 1:
            if rule.fold != 0:
                continue
            start, ok = _in_plane(s, walls, course, bracket, accuracy, work)
            if not ok:
                return Launch(False, start, 0.0, 0, 0), False
        bounded = attempt == 0 and not gridded
        trial = Trial(start, 0.0, none, 30, wanted, False)
        launch, _, code = newton(s, walls, course, trial, bracket, bounded, accuracy, work)
        if launch.ok:
            return launch, code == wanted
    if not gridded:
        return Launch(False, 0.0, 0.0, 0, 0), True
    return _increase_slope(s, walls, course, start, bracket, accuracy, work)


@kernel
def _increase_slope(s, walls, course, start, bracket, accuracy, work):
    """
    Continue a reflected ray from the plane of the link while the boundaries' slopes across the
    plane increase from zero.
    """
    wanted = int(bracket[fewer_bounces(bracket), at.CODE])
    rough = Accuracy(
        accuracy.coarse, accuracy.fine, max(accuracy.miss, _ROUGH_MISS * course.length)
    )
    m, q, share, jacobian = start, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0)
    ahead = _FIRST_SHARE
    rate_m, rate_q = 0.0, 0.0  # derivatives of the ray by the share
    while ahead > _MIN_SHARE:
        ahead = min(ahead, 1.0 - share)
        last = share + ahead == 1.0
        trial = Trial(m + ahead * rate_m, q + ahead * rate_q, jacobian, 10, wanted, False)
        sloping = across_plane(walls, share + ahead)
        launch, new_jacobian, code = newton(
            s, sloping, course, trial, bracket, False, accuracy if last else rough, work
        )
        if not launch.ok:
            ahead *= 0.5
            continue
        if last:
            return launch, code == wanted
        rate_m, rate_q = (launch.angle - m) / ahead, (launch.q - q) / ahead
        m, q, jacobian = launch.angle, launch.q, new_jacobian
        share += ahead
        ahead *= 2.0
    return Launch(False, 0.0, 0.0, 0, 0), False


@kernel
def tube(s, walls, course, launch, tol, work):
    """
    Determinant of the end offsets by both launch parameters, by differences from the ray in work;
    NaN if a ray fails.
    """
    ok, (w1, w2, y1, y2) = _differences(s, walls, course, launch.angle, launch.q, tol, work)
    return w1 * y2 - w2 * y1 if ok else math.nan


@kernel
def finish(row, y, launch, course, link, inset):
    """
    Fill a row with the ray that ended in state y, moved by its small miss onto the receiver, which
    is inset beyond the target.

    The travel time changes by the slowness at the receiver times the miss (Fermat), to second
    order; the slownesses change by their derivatives along the variation.
    """
    _, cb, sb, _ = course.axis
    angle, q, c0 = launch.angle, launch.q, link.c0
    miss = y[at.W] - (course.target + inset * cb)
    rate = y[at.ETA] / y[at.XI] if y[at.XI] != 0.0 else 0.0
    p1, q1 = y[at.P], y[at.Q]
    row[at.TRAVEL_TIME] = (y[at.TAU] - p1 * miss - q1 * y[at.Y] + 0.5 * rate * miss * miss) / c0
    angle_change = miss / y[at.XI] if y[at.XI] != 0.0 else 0.0
    if abs(angle_change) < 1e-4:
        angle -= angle_change
        p1 -= rate * miss
    if y[at.DY_DQ] > 0.0:
        q -= y[at.Y] / y[at.DY_DQ]
        q1 -= y[at.Y] / y[at.DY_DQ]
    n1 = c0 / link.c1
    h1 = math.sqrt(max(n1 * n1 - p1 * p1 - q1 * q1, 0.0))
    p0 = math.sin(angle)
    h0 = math.sqrt(max(1.0 - p0 * p0 - q * q, 0.0))
    width = abs(y[at.XI] * y[at.DY_DQ] / math.cos(angle) * (h1 / n1) * h0)
    row[at.SPREADING_DB] = 10.0 * math.log10(max(width, 1e-300) * n1 / (link.length * link.length))
    row[at.TURNING_POINTS], row[at.RAY_AXIS] = launch.turns, ray_axis(course)
    row[at.CAUSTICS] = y[at.CAUSTICS_PASSED]
    sb_end = -sb if course.rule.kind == at.LEGS and course.rule.legs % 2 == 0 else sb
    _finish_end(row, (p0, q, h0), (cb, sb), link, at.LAUNCH_ANGLE, at.SOURCE_SLOWNESS)
    _finish_end(row, (p1, q1, h1), (cb, sb_end), link, at.ARRIVAL_ANGLE, at.RECEIVER_SLOWNESS)


@kernel
def _finish_end(row, slowness, tilt, link, angle_column, slowness_column):
    """
    Write angle and slowness vector of one end, from the slownesses across the axis, out of the
    plane and along the axis.
    """
    p, side, h = slowness
    cb, sb = tilt
    along = h * cb - p * sb
    down = h * sb + p * cb
    row[angle_column] = math.atan2(down, math.hypot(along, side))
    row[slowness_column] = (along * link.unit_north - side * link.unit_east) / link.c0
    row[slowness_column + 1] = (along * link.unit_east + side * link.unit_north) / link.c0
    row[slowness_column + 2] = down / link.c0


@kernel
def sort_rows(rows, count):
    """Sort the first count rows by travel time."""
    for i in range(1, count):
        j = i
        while j > 0 and rows[j - 1, at.TRAVEL_TIME] > rows[j, at.TRAVEL_TIME]:
            for k in range(at.N_ARRIVAL):
                rows[j - 1, k], rows[j, k] = rows[j, k], rows[j - 1, k]
            j -= 1
