"""The reflected ray of a bracket that meets the receiver, by Newton's method in three dimensions."""

import math

from pymantaray.acoustics._kernels.boundary import across_plane
from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.refine import cubic_angle
from pymantaray.acoustics._kernels.search import ANGLE, CODE, GOOD, MISS, SLOPE, fewer_bounces, shoot
from pymantaray.acoustics._kernels.trace import trace

INSET = 1e-3  # m; a receiver on a boundary is met this far inside, and the travel time corrected (Fermat)
_SHARES = 16  # steps in which slopes across the plane are brought in where Newton's method fails at once


@kernel
def _in_plane(s, floor, rule, bracket, target, length, axis, tol, work):
    """Launch angle of the root of the miss in a bracket, in the plane of the link; ok False where it slips away."""
    lo, hi, fa, code = bracket[0, ANGLE], bracket[1, ANGLE], bracket[0, MISS], bracket[0, CODE]
    m = 0.5 * (lo + hi)
    node = work.node
    previous = math.inf
    for it in range(60):
        shoot(s, floor, rule, m, target, length, axis, tol, 0.0, node, work)
        f, d = node[MISS], node[SLOPE]
        if node[GOOD] == 0.0 or node[CODE] != code:
            return m, False
        if abs(f) < max(0.01, 10.0 * tol):
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
def refine_bounced(s, floor, rule, bracket, target, length, axis, tol, miss, work):
    """Launch angle and cross-track slowness of the reflected ray of a bracket that ends within miss of the receiver.

    Newton's method from the root of the bracket's cubic, with Broyden's updates of the derivatives; where that
    leaves the bracket's reflections, again from the root in the plane of the link. The end state stays in
    work.y, its path in work.path. Returns ok, angle, cross-track slowness, steps and turning points.
    """
    y, K, ynew, path = work.y, work.K, work.ynew, work.path
    a, b = bracket[0, ANGLE], bracket[1, ANGLE]
    inner = fewer_bounces(bracket)
    counts = int(bracket[inner, CODE]) % 1024
    level = bracket[inner, MISS]
    level = math.copysign(min(INSET, 0.5 * abs(level)), level) if rule.fold != 0 else 0.0
    m, q = cubic_angle(bracket[0], bracket[1], level), 0.0
    start = m
    for attempt in range(2 + _SHARES):
        across = 1.0
        if attempt == 1:
            if rule.fold != 0:
                continue
            m, ok = _in_plane(s, floor, rule, bracket, target, length, axis, tol, work)
            if not ok:
                return False, m, q, 0, 0
            q = 0.0
        elif attempt > 1 and floor.bathymetry.size == 1:
            break
        elif attempt > 1:  # let the slopes across the plane grow from nothing
            across = (attempt - 1.0) / _SHARES
            if attempt == 2:
                m, q = start, 0.0
        start = m
        tilted = across_plane(floor, across)
        done, last = False, attempt in (0, 1, 1 + _SHARES)
        last_m, last_q, last_f, last_y, best = m, q, 0.0, 0.0, math.inf
        j00, j01, j10, j11 = 1.0, 0.0, 0.0, 1.0
        for it in range(30):
            ok, steps, turns, _, _, code = trace(s, tilted, rule, m, q, length, axis, tol, y, K, ynew, path)
            if not ok or code % 1024 != counts:
                if math.isinf(best) and rule.fold != 0 and it < 20:
                    m = 0.5 * (m + bracket[inner, ANGLE])
                    continue
                if math.isinf(best):
                    break
                m, q = 0.5 * (m + last_m), 0.5 * (q + last_q)
                continue
            f, side = y[0] - target, y[5]
            if abs(f) < miss and abs(side) < miss:
                if last:
                    return True, m, q, steps, turns
                done = True
                break
            dm, dq = m - last_m, q - last_q
            d2 = dm * dm + dq * dq
            if it > 0 and d2 == 0.0:  # no more digits
                return last and max(abs(f), abs(side)) < 1e3 * miss, m, q, steps, turns
            if math.isinf(best) or abs(f) + abs(side) > 4.0 * best:
                j00, j01, j10, j11 = y[2], 0.0, 0.0, y[7]
            else:
                e0 = (f - last_f - j00 * dm - j01 * dq) / d2
                e1 = (side - last_y - j10 * dm - j11 * dq) / d2
                j00, j01, j10, j11 = j00 + e0 * dm, j01 + e0 * dq, j10 + e1 * dm, j11 + e1 * dq
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
            if attempt == 0 and not a <= m <= b and not floor.bathymetry.size > 1:
                break
        if attempt > 1 and not done:
            break
    return False, 0.0, 0.0, 0, 0


@kernel
def tube(s, floor, rule, angle, q, length, axis, tol, work):
    """Determinant of the end offsets by both launch parameters, by differences from the ray in work; NaN where lost."""
    y, K, ynew = work.y, work.K, work.ynew
    d = 1e-5
    w0, y0 = y[0], y[5]
    ok1, _, _, _, _, _ = trace(s, floor, rule, angle + d, q, length, axis, tol, y, K, ynew, work.no_path)
    w1, y1 = y[0] - w0, y[5] - y0
    ok2, _, _, _, _, _ = trace(s, floor, rule, angle, q + d, length, axis, tol, y, K, ynew, work.no_path)
    w2, y2 = y[0] - w0, y[5] - y0
    return (w1 * y2 - w2 * y1) / (d * d) if ok1 and ok2 else math.nan
