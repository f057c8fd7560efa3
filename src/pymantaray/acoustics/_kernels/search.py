"""All launch angles whose rays meet the receiver: an adaptive fan, then Newton with the fine tracer.

A fan of rays gives the miss ``F`` and its derivative by the launch angle. Between neighbours F is a cubic
Hermite polynomial, judged against a ray in the middle wherever a root is possible; intervals are halved
until each holds one root, none, or is narrower than the resolution. Pairs of roots about an extremum of
F (a caustic) show by the signs of the derivatives.
"""

import math

import numpy as np

from pymantaray.acoustics._kernels.compile import kernel, sort_head
from pymantaray.acoustics._kernels.cubic import cubic
from pymantaray.acoustics._kernels.field import level_speed
from pymantaray.acoustics._kernels.section import SMOOTH
from pymantaray.acoustics._kernels.step import N_FAN, N_FULL
from pymantaray.acoustics._kernels.trace import trace

MAX_ROOTS = 256
MAX_STACK = 128
MAX_RAYS = 20_000
_BOUND = 4.0 / 27.0  # a cubic Hermite departs from its chord by at most this times each end's slope defect


@kernel
def shoot(s, angle, target, length, axis, tol, work):
    """Miss distance at the receiver's plane and its derivative; ok False where the ray does not get there."""
    ok, _, _ = trace(s, angle, 0.0, length, axis, tol, N_FAN, work.y, work.K, work.ynew, work.no_path)
    return work.y[0] - target, work.y[2], ok


@kernel
def find_brackets(s, n_nodes, target, length, axis, tol, min_width, work):
    """Brackets of all roots of the miss between the first and the last of work.nodes.

    work.brackets receives the ends. Returns their number, the smallest miss met, the rays traced
    and whether the budget sufficed.
    """
    nodes, brackets, st = work.nodes, work.brackets, work.stack
    F, D, eps, good = work.fan[0], work.fan[1], work.fan[2], work.fan[3]
    margin = np.inf
    rays = n_nodes
    for i in range(n_nodes):
        eps[i] = 0.0
        F[i], D[i], ok = shoot(s, nodes[i], target, length, axis, tol, work)
        good[i] = 1.0 if ok else 0.0
        if ok:
            margin = min(margin, abs(F[i]))
    for i in range(1, n_nodes - 1):
        if good[i - 1] * good[i] * good[i + 1] > 0.0:
            h = nodes[i + 1] - nodes[i - 1]
            t = (nodes[i] - nodes[i - 1]) / h
            eps[i] = abs(F[i] - cubic(t, h, F[i - 1], D[i - 1], F[i + 1], D[i + 1])) / 8.0
    n_found = 0
    complete = True
    for i in range(n_nodes - 1):
        top = 0
        st[0, 0], st[0, 1], st[0, 2] = nodes[i], F[i], D[i]
        st[0, 3], st[0, 4], st[0, 5] = nodes[i + 1], F[i + 1], D[i + 1]
        st[0, 6] = max(eps[i], eps[i + 1])
        st[0, 7], st[0, 8] = good[i], good[i + 1]
        while top >= 0:
            a, fa, da = st[top, 0], st[top, 1], st[top, 2]
            b, fb, db = st[top, 3], st[top, 4], st[top, 5]
            e = st[top, 6]
            la, lb = st[top, 7] == 0.0, st[top, 8] == 0.0
            top -= 1
            h = b - a
            if la and lb:
                continue
            if not (la or lb):
                lin = fb - fa
                ea = h * da - lin
                eb = h * db - lin
                if fa == 0.0 or fa * fb < 0.0:
                    single = da * lin > 0.0 and db * lin > 0.0 and max(abs(ea), abs(eb)) < 1.5 * abs(lin)
                    if (single and e < 0.05 * abs(lin)) or h < min_width:
                        if n_found < MAX_ROOTS:
                            brackets[n_found, 0] = a
                            brackets[n_found, 1] = b
                            n_found += 1
                        else:
                            complete = False
                        continue
                else:
                    nearest = min(abs(fa), abs(fb))
                    reach = 1.5 * _BOUND * (abs(ea) + abs(eb)) + e
                    if nearest > reach + tol or h < min_width:
                        continue
            elif h < min_width:
                continue
            if rays >= MAX_RAYS or top + 2 >= MAX_STACK:
                complete = False
                continue
            m = 0.5 * (a + b)
            fm, dm, ok = shoot(s, m, target, length, axis, tol, work)
            rays += 1
            if ok:
                margin = min(margin, abs(fm))
            if ok and not (la or lb):
                e = abs(fm - cubic(0.5, h, fa, da, fb, db)) / 4.0
            top += 1
            st[top, 0], st[top, 1], st[top, 2] = m, fm, dm
            st[top, 3], st[top, 4], st[top, 5] = b, fb, db
            st[top, 6] = e
            st[top, 7], st[top, 8] = 1.0 if ok else 0.0, 0.0 if lb else 1.0
            top += 1
            st[top, 0], st[top, 1], st[top, 2] = a, fa, da
            st[top, 3], st[top, 4], st[top, 5] = m, fm, dm
            st[top, 6] = e
            st[top, 7], st[top, 8] = 0.0 if la else 1.0, 1.0 if ok else 0.0
    return n_found, margin, rays, complete


@kernel
def refine(s, a, b, target, length, axis, tol, miss, work):
    """Launch angle in [a, b] whose ray, with horizontal refraction, ends within miss of the receiver.

    Newton on both slownesses: the angle by xi, the cross-track slowness by A, safeguarded by bisection.
    The end state stays in work.y and its path in work.path. Returns ok, angle, cross-track slowness, steps, turning points.
    """
    y, K, ynew, path = work.y, work.K, work.ynew, work.path
    q = 0.0
    fa, fb = 0.0, 0.0
    bracketed = False
    width = b - a
    for attempt in range(24):
        # horizontal refraction moves the root by a little: widen the bracket until it holds it
        ok, steps, turns = trace(s, a, q, length, axis, tol, N_FULL, y, K, ynew, path)
        if not ok:
            return False, a, q, steps, turns
        fa = y[0] - target
        if y[7] > 0.0:
            q -= y[5] / y[7]
        ok, steps, turns = trace(s, b, q, length, axis, tol, N_FULL, y, K, ynew, path)
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
        if width > 5e-3:
            break
        width = max(2.0 * width, 1e-9)
        if abs(fa) < abs(fb):
            a -= width
        else:
            b += width
    m = b - fb * (b - a) / (fb - fa) if fb != fa else 0.5 * (a + b)
    if not a <= m <= b:
        m = 0.5 * (a + b)
    lo, hi = a, b
    previous = np.inf
    for it in range(80):
        ok, steps, turns = trace(s, m, q, length, axis, tol, N_FULL, y, K, ynew, path)
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
def fan_nodes(lo, hi, spacing, closest, s, c_source, nodes):
    """Launch angles of the first fan: equal spacing, and the angles at which rays turn at the levels.

    What a profile does between two levels a ray feels when it turns there: the miss has structure on
    the scale of these angles, and in a LINEAR section singularities exactly at them.
    """
    count = max(math.ceil((hi - lo) / spacing), 2) + 1
    count = min(count, nodes.size // 2)
    for i in range(count):
        nodes[i] = lo + (hi - lo) * i / (count - 1)
    n = count
    for k in range(s.depth.size):
        c_first = 0.0
        for cell in range(s.n_range):
            c = level_speed(s, cell, k)
            c_first = c if cell == 0 else c_first
            if c > c_source and n < nodes.size - 2:
                angle = math.acos(c_source / c)
                if angle < hi:
                    nodes[n] = angle
                    n += 1
                if -angle > lo:
                    nodes[n] = -angle
                    n += 1
            if s.kind == SMOOTH or (cell > 0 and abs(c - c_first) < 1e-9):
                break
    sort_head(nodes, n)
    m = 1
    for i in range(1, n):
        if nodes[i] - nodes[m - 1] > closest:
            nodes[m] = nodes[i]
            m += 1
    return m
