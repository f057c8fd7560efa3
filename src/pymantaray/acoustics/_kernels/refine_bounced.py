"""The reflected ray of a bracket that meets the receiver, by Newton's method in three dimensions."""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels.boundary import LANDED, across_plane
from pymantaray.acoustics._kernels.refine import cubic_angle
from pymantaray.acoustics._kernels.search import ANGLE, CODE, GOOD, MISS, SLOPE, fewer_bounces, shoot
from pymantaray.acoustics._kernels.trace import trace
from pymantaray.compile import kernel

INSET = 1e-3  # m; a receiver on a boundary is met this far inside, and the travel time corrected (Fermat)
_NEAR = 1e-5  # rad; derivatives are differences between rays so near to each other
# Where Newton's method fails at once, slopes across the plane are brought in by shares of them
_FIRST_SHARE, _LEAST_SHARE = 0.25, 1.0 / 128.0
_RETURN = 10.0  # times its miss: farther beyond the edges of the cells held a ray is not brought back
_ON_THE_WAY = 1e-4  # of the axis: how near to the receiver a ray with a share of the slope comes

Aim = namedtuple("Aim", "target length axis tol miss")
Aim.__doc__ = """What a ray is to meet within miss: the target, an offset at the distance length along the axis; tol as in `trace`. [m]"""


@kernel
def _in_plane(s, floor, rule, bracket, aim, work):
    """Launch angle of the root of the miss in a bracket, in the plane of the link; ok False where it slips away."""
    lo, hi, fa, code = bracket[0, ANGLE], bracket[1, ANGLE], bracket[0, MISS], bracket[0, CODE]
    m = 0.5 * (lo + hi)
    node = work.node
    previous = math.inf
    for it in range(60):
        shoot(s, floor, rule, m, aim.target, aim.length, aim.axis, aim.tol, 0.0, node, work)
        f, d = node[MISS], node[SLOPE]
        if node[GOOD] == 0.0 or node[CODE] != code:
            return m, False
        if abs(f) < max(0.01, 10.0 * aim.tol):
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
def _differences(s, floor, rule, angle, q, aim, work):
    """Whether there are, and the derivatives of both end offsets by both launch parameters, from the ray in work."""
    y, K, ynew = work.y, work.K, work.ynew
    d = _NEAR
    w0, y0 = y[0], y[5]
    ok1, _, _, _, _, _ = trace(
        s, floor, rule, angle + d, q, aim.length, aim.axis, aim.tol, y, K, ynew, work.no_path
    )
    w1, y1 = y[0] - w0, y[5] - y0
    ok2, _, _, _, _, _ = trace(
        s, floor, rule, angle, q + d, aim.length, aim.axis, aim.tol, y, K, ynew, work.no_path
    )
    w2, y2 = y[0] - w0, y[5] - y0
    return ok1 and ok2, w1 / d, w2 / d, y1 / d, y2 / d


@kernel
def newton(s, floor, rule, m, q, jacobian, most, wanted, exact, bracket, bounded, aim, work):
    """Launch angle and cross-track slowness of the ray that ends where it is aimed at, by Newton's method.

    m, q and jacobian are where it starts; a jacobian of zeros is taken from three rays if exact is set or the sea bed's
    slopes are brought in by shares, else from the variation in the plane, and updated by Broyden's formula. Trials with
    other numbers of reflections than the code wanted, or with exact of another code, are taken back half-way. Returns ok,
    m, q, the jacobian, steps, turning points and the code of the last ray.
    """
    y, K, ynew, path = work.y, work.K, work.ynew, work.path
    inner = fewer_bounces(bracket)
    last_m, last_q, last_f, last_y, best = m, q, 0.0, 0.0, math.inf
    j00, j01, j10, j11 = jacobian
    steps, turns, code = 0, 0, wanted
    for it in range(most):
        ok, steps, turns, _, _, code = trace(
            s, floor, rule, m, q, aim.length, aim.axis, aim.tol, y, K, ynew, path
        )
        if not ok or code % 1024 != wanted % 1024 or (exact and code != wanted):
            if math.isinf(best) and rule.fold != 0 and it < 20:
                m = 0.5 * (m + bracket[inner, ANGLE])
                continue
            if math.isinf(best):
                break
            m, q = 0.5 * (m + last_m), 0.5 * (q + last_q)
            continue
        f, side = y[0] - aim.target, y[5]
        if floor.held >= 0.0 and floor.cells[LANDED, -1] > _RETURN * (abs(f) + abs(side)):
            break
        if abs(f) < aim.miss and abs(side) < aim.miss:
            return True, m, q, (j00, j01, j10, j11), steps, turns, code
        dm, dq = m - last_m, q - last_q
        d2 = dm * dm + dq * dq
        if it > 0 and d2 == 0.0:  # no more digits
            return (
                max(abs(f), abs(side)) < 1e3 * aim.miss,
                m,
                q,
                (j00, j01, j10, j11),
                steps,
                turns,
                code,
            )
        if not math.isinf(best) and abs(f) + abs(side) <= 4.0 * best:
            e0 = (f - last_f - j00 * dm - j01 * dq) / d2
            e1 = (side - last_y - j10 * dm - j11 * dq) / d2
            j00, j01, j10, j11 = j00 + e0 * dm, j01 + e0 * dq, j10 + e1 * dm, j11 + e1 * dq
        elif not math.isinf(best) or j00 == 0.0:
            j00, j01, j10, j11 = y[2], 0.0, 0.0, y[7]
            if exact or floor.across != 1.0:
                ok, g00, g01, g10, g11 = _differences(s, floor, rule, m, q, aim, work)
                if ok:
                    j00, j01, j10, j11 = g00, g01, g10, g11
        best = min(best, abs(f) + abs(side))
        det = j00 * j11 - j01 * j10
        if det == 0.0:
            break
        last_m, last_q, last_f, last_y = m, q, f, side
        dm = -(j11 * f - j01 * side) / det
        dq = -(j00 * side - j10 * f) / det
        shrink = min(1.0, 0.05 / max(abs(dm), 1e-300), 0.1 / max(abs(dq), 1e-300))
        m += shrink * dm
        q += shrink * dq
        if bounded and not bracket[0, ANGLE] <= m <= bracket[1, ANGLE]:
            break
    return False, m, q, (j00, j01, j10, j11), steps, turns, code


@kernel
def refine_bounced(s, floor, rule, bracket, aim, work):
    """Launch angle and cross-track slowness of the reflected ray of a bracket that ends where it is aimed at.

    Newton's method from the root of the bracket's cubic; where that leaves the bracket's reflections, again from the root
    in the plane of the link; where that fails too, the slopes of the sea bed across the plane grow from nothing, and the
    ray is followed. The end state stays in work.y, its path in work.path. Returns ok, angle, cross-track slowness, steps,
    turning points and whether the cells of the sea bed are the bracket's.
    """
    inner = fewer_bounces(bracket)
    wanted = int(bracket[inner, CODE])
    level = bracket[inner, MISS]
    level = math.copysign(min(INSET, 0.5 * abs(level)), level) if rule.fold != 0 else 0.0
    start = cubic_angle(bracket[0], bracket[1], level)
    gridded = floor.bathymetry.size > 1
    none = (0.0, 0.0, 0.0, 0.0)
    for attempt in range(2):
        if attempt == 1:
            if rule.fold != 0:
                continue
            start, ok = _in_plane(s, floor, rule, bracket, aim, work)
            if not ok:
                return False, start, 0.0, 0, 0, False
        bounded = attempt == 0 and not gridded
        ok, m, q, _, steps, turns, code = newton(
            s, floor, rule, start, 0.0, none, 30, wanted, False, bracket, bounded, aim, work
        )
        if ok:
            return True, m, q, steps, turns, code == wanted
    if not gridded:
        return False, 0.0, 0.0, 0, 0, True
    rough = Aim(aim.target, aim.length, aim.axis, aim.tol, max(aim.miss, _ON_THE_WAY * aim.length))
    m, q, share, jacobian = start, 0.0, 0.0, none
    ahead = _FIRST_SHARE
    rate_m, rate_q = 0.0, 0.0  # change of the ray by the share
    while ahead > _LEAST_SHARE:
        ahead = min(ahead, 1.0 - share)
        last = share + ahead == 1.0
        ok, new_m, new_q, new_jacobian, steps, turns, code = newton(
            s,
            across_plane(floor, share + ahead),
            rule,
            m + ahead * rate_m,
            q + ahead * rate_q,
            jacobian,
            10,
            wanted,
            False,
            bracket,
            False,
            aim if last else rough,
            work,
        )
        if not ok:
            ahead *= 0.5
            continue
        if last:
            return True, new_m, new_q, steps, turns, code == wanted
        rate_m, rate_q = (new_m - m) / ahead, (new_q - q) / ahead
        m, q, jacobian = new_m, new_q, new_jacobian
        share += ahead
        ahead *= 2.0
    return False, 0.0, 0.0, 0, 0, False


@kernel
def tube(s, floor, rule, angle, q, aim, work):
    """Determinant of the end offsets by both launch parameters, by differences from the ray in work; NaN where lost."""
    ok, w1, w2, y1, y2 = _differences(s, floor, rule, angle, q, aim, work)
    return w1 * y2 - w2 * y1 if ok else math.nan
