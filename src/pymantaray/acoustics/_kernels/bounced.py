"""Eigenrays with reflections at the surface and the sea bed.

Two fans share the launch angles. Up to STEEPEST_FORWARD from the horizontal, rays are followed in range
and reflected wherever they meet a boundary. Closer to the vertical, where a ray may also turn back
on a slope, they are followed in depth, leg by leg, for each number of reflections. Both look in the vertical plane
of the link first; Newton's method on two launch angles then includes slopes and sound-speed gradients
across it.
"""

import math

from pymantaray.acoustics._kernels.boundary import across_plane, floor_at
from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.limits import fan_nodes
from pymantaray.acoustics._kernels.refine import cubic_angle
from pymantaray.acoustics._kernels.rows import finish
from pymantaray.acoustics._kernels.search import (
    ANGLE,
    CODE,
    GOOD,
    MISS,
    SLOPE,
    fewer_bounces,
    find_brackets,
    shoot,
)
from pymantaray.acoustics._kernels.trace import FORWARD, LEGS, ON_SURFACE, Rule, trace

STEEPEST_FORWARD = 1.08  # rad
SHALLOWEST_LEGS = 1.02  # rad; the fans overlap, what both find is kept once
_SPACING_FORWARD = 0.04  # rad, beyond the angles at which rays can turn
_SPACING_LEGS = 0.13  # rad
_SHARES = 4  # steps in which slopes across the plane are brought in where Newton's method fails at once
_RESOLUTION = 1e-6  # rad; narrower windows between changes of reflection are not looked into
_TRUST = 2e-4  # rad; rays within the usual cut-off fill wider windows than this
_INSET = 1e-3  # m; a receiver on a boundary is met this far inside, and the travel time corrected (Fermat)
_SAME_TIME, _SAME_ANGLE = 2e-8, 4e-5  # s, rad


@kernel
def _in_plane(s, floor, rule, bracket, target, length, axis, tol, work):
    """Launch angle of the root of the miss in a bracket, in the plane of the link; ok False where it slips away."""
    lo, hi, fa, code = bracket[0, ANGLE], bracket[1, ANGLE], bracket[0, MISS], bracket[0, CODE]
    m = 0.5 * (lo + hi)
    node = work.node
    previous = math.inf
    for it in range(60):
        shoot(s, floor, rule, m, target, length, axis, tol, node, work)
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
    level = math.copysign(min(_INSET, 0.5 * abs(level)), level) if rule.fold != 0 else 0.0
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
def _tube(s, floor, rule, angle, q, length, axis, tol, work):
    """Determinant of the end offsets by both launch parameters, by differences from the ray in work; NaN where lost."""
    y, K, ynew = work.y, work.K, work.ynew
    d = 1e-5
    w0, y0 = y[0], y[5]
    ok1, _, _, _, _, _ = trace(s, floor, rule, angle + d, q, length, axis, tol, y, K, ynew, work.no_path)
    w1, y1 = y[0] - w0, y[5] - y0
    ok2, _, _, _, _, _ = trace(s, floor, rule, angle, q + d, length, axis, tol, y, K, ynew, work.no_path)
    w2, y2 = y[0] - w0, y[5] - y0
    return (w1 * y2 - w2 * y1) / (d * d) if ok1 and ok2 else math.nan


@kernel
def _collect(
    s, floor, rule, n_nodes, target, fold_target, span, axis, steep, weak_slope, link, numerics, count, work
):
    """Find and refine the reflected rays of one fan; fold_target is the target of the search. Return the rows in use, those too weak, the rays
    traced, and whether none was left out.
    """
    c1, length, cutoff_db, on_boundary, cross_slope, most_s, most_b = link
    coarse, fine, miss, inset = numerics
    rows = work.rows
    width, trust = _RESOLUTION, _TRUST
    if math.isinf(cutoff_db):  # every ray there is
        width, trust = 1e-3 * width, 1e-3 * trust
    found, _, rays, complete = find_brackets(
        s, floor, rule, n_nodes, fold_target, span, axis, coarse, fine, width, trust, steep, weak_slope, work
    )
    weak = 0
    for i in range(found):
        bracket = work.brackets[i]
        ok, angle, q, _, turns = refine_bounced(s, floor, rule, bracket, target, span, axis, fine, miss, work)
        if not ok or count >= rows.shape[0]:
            continue
        counts = int(bracket[fewer_bounces(bracket), CODE]) % 1024
        n_s, n_b = counts // 32, counts % 32
        if n_s > most_s or n_b > most_b or counts == 0:
            continue
        cb, sb = axis[1], axis[2]
        sb_end = -sb if rule.kind == LEGS and rule.legs % 2 == 0 else sb
        row = rows[count]
        finish(
            row,
            work.y,
            angle,
            q,
            target + inset * cb,
            turns,
            axis[3],
            c1,
            length,
            floor.un,
            floor.ue,
            cb,
            sb,
            sb_end,
            work.y[2] * work.y[7],
        )
        if rule.kind == LEGS:
            row[0] += inset * row[10]
        row[11], row[12] = n_s, n_b
        if n_b > 0 and cross_slope > 1e-9:  # slopes couple both launch parameters
            plain = work.y[2] * work.y[7]
            det = _tube(s, floor, rule, angle, q, span, axis, fine, work)
            if not math.isnan(det):
                row[3] += 10.0 * math.log10(max(abs(det), 1e-300) / max(abs(plain), 1e-300))
        if on_boundary * row[2] < 0.0:  # reflected at the receiver itself
            continue
        if row[3] > cutoff_db:
            weak += 1
            continue
        new = True
        for j in range(count):
            if (
                rows[j, 11] == n_s
                and rows[j, 12] == n_b
                and abs(rows[j, 0] - row[0]) < _SAME_TIME
                and abs(rows[j, 1] - row[1]) < _SAME_ANGLE + 10.0 * abs(inset) / length
            ):
                new = False
        if new:
            count += 1
    return count, weak, rays, complete


@kernel
def add_bounced(
    s,
    floor,
    ends,
    limit,
    max_surface,
    max_bottom,
    cutoff_db,
    numerics,
    weak_slope,
    spacing,
    closest,
    count,
    work,
):
    """Append all eigenrays with 1 to so many reflections to work.rows; return rows in use, weak ones, rays traced,
    and whether none was left out.
    """
    z0, z1, c0, c1, horizontal, length = ends
    coarse, fine, miss = numerics
    most = max_surface + max_bottom
    deepest = 0.0
    cross_slope, slope = 0.0, 0.0
    for i in range(floor.n_breaks):
        here, f_r, f_y, _, _ = floor_at(floor, floor.breaks[i], 0.0, floor.breaks[i])
        slope = max(slope, abs(f_r))
        deepest = max(deepest, here)
        cross_slope = max(cross_slope, abs(f_y))
    bed = floor_at(floor, horizontal, 0.0, horizontal)[0]
    inset, on_boundary = 0.0, 0.0
    if z1 < _INSET:
        inset, on_boundary = z1 - min(_INSET, 0.5 * bed), -1.0
    elif z1 > bed - _INSET:
        inset, on_boundary = z1 - max(bed - _INSET, 0.5 * bed), 1.0
    z_end = z1 - inset
    link = (c1, length, cutoff_db, on_boundary, cross_slope, max_surface, max_bottom)
    limits = (coarse, fine, miss, inset)
    weak, rays, complete = 0, 0, True
    steepest = 0.5 * math.pi
    if horizontal > 1e-9:
        steepest = math.atan(1.3 * (most + 1) * deepest / horizontal) + 0.1
        hi = min(STEEPEST_FORWARD, max(limit, steepest))
        inner = min(limit, hi)
        n = fan_nodes(-inner, inner, spacing, closest, s, c0, work.nodes)
        more = max(int(math.ceil((hi - inner) / _SPACING_FORWARD)), 0)
        more = min(more, (work.nodes.size - n) // 2)
        for i in range(n):
            work.nodes[n - 1 - i + more] = work.nodes[n - 1 - i]
        for i in range(more):
            step = (hi - inner) * (i + 1) / more
            work.nodes[more - 1 - i] = -inner - step
            work.nodes[more + n + i] = inner + step
        fold = 0
        if on_boundary < 0.0:
            fold = ON_SURFACE
        elif on_boundary > 0.0:
            fold = floor_at(floor, horizontal, 0.0, horizontal)[4] + 2
        rule = Rule(FORWARD, max_surface, max_bottom, 1, 0, 0.0, fold)
        axis = (z0, 1.0, 0.0, c0)
        count, w, r, all_there = _collect(
            s,
            floor,
            rule,
            n + 2 * more,
            z_end - z0,
            z_end - z0 if fold == 0 else (0.0 if fold == ON_SURFACE else bed) - z0,
            horizontal,
            axis,
            limit,
            weak_slope,
            link,
            limits,
            count,
            work,
        )
        weak += w
        rays += r
        complete = complete and all_there
    # on a slope a ray gets steeper by twice its angle at each reflection, and may turn back
    shallowest = max(SHALLOWEST_LEGS - 2.0 * max_bottom * math.atan(slope), limit + 0.05)
    if steepest > shallowest:
        half = 0.5 * math.pi - shallowest
        for first in range(2):
            sb = 1.0 if first == 0 else -1.0
            for legs in range(2, most + 2):
                n_s = legs // 2 if sb < 0.0 else (legs - 1) // 2
                n_b = legs - 1 - n_s
                if n_s > max_surface or n_b > max_bottom:
                    continue
                if horizontal > 1e-9 and math.atan(1.3 * legs * deepest / horizontal) + 0.1 < shallowest:
                    continue
                n = min(int(math.ceil(2.0 * half / _SPACING_LEGS)) + 1, work.nodes.size)
                for i in range(n):
                    work.nodes[i] = half * (2.0 * i / (n - 1) - 1.0)
                rule = Rule(LEGS, n_s, n_b, 0, legs, z_end, 0)
                axis = (z0, 0.0, sb, c0)
                sb_end = sb if legs % 2 == 1 else -sb
                count, w, r, all_there = _collect(
                    s,
                    floor,
                    rule,
                    n,
                    -horizontal * sb_end,
                    -horizontal * sb_end,
                    legs * deepest,
                    axis,
                    -1.0,
                    weak_slope,
                    link,
                    limits,
                    count,
                    work,
                )
                weak += w
                rays += r
                complete = complete and all_there
    return count, weak, rays, complete
