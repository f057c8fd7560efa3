"""The ray of a bracket that meets the receiver, by Newton's method with horizontal refraction."""

import math

import numpy as np

from pymantaray.acoustics._kernels.cubic import cubic_root
from pymantaray.acoustics._kernels.search import ANGLE, MISS, SLOPE
from pymantaray.acoustics._kernels.trace import trace
from pymantaray.compile import kernel


@kernel
def cubic_angle(a, b, level):
    """Launch angle at which the cubic between two rays of a fan has the miss level, between those of the two."""
    h = b[ANGLE] - a[ANGLE]
    return a[ANGLE] + h * cubic_root(h, a[MISS] - level, a[SLOPE], b[MISS] - level, b[SLOPE])


@kernel
def polish(s, floor, rule, bracket, target, length, axis, tol, miss, work):
    """Newton from the root of a bracket's cubic, with horizontal refraction; as `refine`.

    Not ok where it does not converge at once, leaves the bracket, or meets a ray on the other side of a caustic.
    """
    y, K, ynew, path = work.y, work.K, work.ynew, work.path
    a, b, q = bracket[0], bracket[1], 0.0
    lo, hi, rise = a[ANGLE], b[ANGLE], b[MISS] - a[MISS]
    m = cubic_angle(a, b, 0.0)
    steps, turns = 0, 0
    for _ in range(6):
        ok, steps, turns, _, _, _ = trace(s, floor, rule, m, q, length, axis, tol, y, K, ynew, path)
        if not ok or y[2] * rise <= 0.0 or y[7] <= 0.0:
            break
        f = y[0] - target
        if abs(f) < miss and abs(y[5]) < miss:
            return True, m, q, steps, turns
        q -= y[5] / y[7]
        m -= f / y[2]
        if not 2.0 * lo - hi <= m <= 2.0 * hi - lo:
            break
    return False, m, q, steps, turns


@kernel
def refine(s, floor, rule, bracket, target, length, axis, tol, miss, work):
    """Launch angle in a bracket whose ray, with horizontal refraction, ends within miss of the receiver.

    Newton on both slownesses: the angle by xi, the cross-track slowness by A, safeguarded by bisection.
    The end state stays in work.y and its path in work.path. Returns ok, angle, cross-track slowness, steps, turning points.
    """
    y, K, ynew, path = work.y, work.K, work.ynew, work.path
    a, b = bracket[0, ANGLE], bracket[1, ANGLE]
    q = 0.0
    fa, fb = 0.0, 0.0
    bracketed = False
    width = b - a
    for attempt in range(16):
        # horizontal refraction moves the root by a little: widen the bracket until it holds it
        ok, steps, turns, _, _, _ = trace(s, floor, rule, a, q, length, axis, tol, y, K, ynew, path)
        if not ok:
            return False, a, q, steps, turns
        fa = y[0] - target
        if y[7] > 0.0:
            q -= y[5] / y[7]
        ok, steps, turns, _, _, _ = trace(s, floor, rule, b, q, length, axis, tol, y, K, ynew, path)
        if not ok:
            return False, b, q, steps, turns
        fb = y[0] - target
        if y[7] > 0.0:
            q -= y[5] / y[7]
        if attempt > 0 and fa * fb <= 0.0:
            bracketed = True
            break
        if attempt == 0:
            continue
        if width > 1e-3:
            break
        width = max(4.0 * width, 1e-9)
        if abs(fa) < abs(fb):
            a -= width
        else:
            b += width
    m = b - fb * (b - a) / (fb - fa) if fb != fa else 0.5 * (a + b)
    if not a <= m <= b:
        m = 0.5 * (a + b)
    lo, hi = a, b
    previous = np.inf
    for it in range(80 if bracketed else 12):
        ok, steps, turns, _, _, _ = trace(s, floor, rule, m, q, length, axis, tol, y, K, ynew, path)
        if not ok:
            return False, m, q, steps, turns
        f = y[0] - target
        if abs(f) < miss and abs(y[5]) < miss:
            return True, m, q, steps, turns
        if y[7] > 0.0:
            q -= y[5] / y[7]
        if bracketed:
            if (f > 0.0) == (fa > 0.0):
                lo = m
            else:
                hi = m
        new = m - f / y[2] if y[2] != 0.0 else 0.5 * (lo + hi)
        if bracketed and (not lo < new < hi or (it > 3 and abs(f) > 0.5 * previous)):
            new = 0.5 * (lo + hi)
        previous = abs(f)
        if new == m:
            # the angle has no more digits: the best there is, if near
            return abs(f) < 1e3 * miss and abs(y[5]) < miss, m, q, steps, turns
        m = new
    return False, m, q, steps, turns


@kernel
def unresolved_db(bracket, resolution, noise, slope):
    """Spreading to add where a bracket is as narrow as the search goes and the miss jumps across it. [dB]

    Along a sound-speed maximum rays part faster than launch angles have digits: the slope at one of them says nothing.
    """
    h = bracket[1, ANGLE] - bracket[0, ANGLE]
    jump = abs(bracket[1, MISS] - bracket[0, MISS])
    mean = jump / h
    if h > resolution or jump < noise or mean <= abs(slope):
        return 0.0
    return 10.0 * math.log10(mean / max(abs(slope), 1e-300))
