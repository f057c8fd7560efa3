"""Eigenrays with reflections at the surface and the sea bed.

Two fans share the launch angles. Up to STEEPEST_FORWARD from the horizontal, rays are followed in range
and reflected wherever they meet a boundary. Closer to the vertical, where a ray may also turn back
on a slope, they are followed in depth, leg by leg, for each number of reflections. Both look in the vertical plane
of the link first; Newton's method on two launch angles then includes slopes and sound-speed gradients
across it.
"""

import math

from pymantaray.acoustics._kernels.boundary import floor_at
from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.limits import fan_nodes
from pymantaray.acoustics._kernels.refine_bounced import INSET, refine_bounced, tube
from pymantaray.acoustics._kernels.rows import finish
from pymantaray.acoustics._kernels.search import CODE, fewer_bounces, find_brackets
from pymantaray.acoustics._kernels.trace import FORWARD, LEGS, ON_SURFACE, Rule

STEEPEST_FORWARD = 1.08  # rad
SHALLOWEST_LEGS = 1.02  # rad; the fans overlap, what both find is kept once
_SPACING_FORWARD = 0.04  # rad, beyond the angles at which rays can turn
_SPACING_LEGS = 0.13  # rad
_RESOLUTION = 1e-6  # rad; narrower windows between changes of reflection are not looked into
_TRUST = 2e-4  # rad; rays within the usual cut-off fill wider windows than this
_SAME_TIME, _SAME_ANGLE = 2e-8, 4e-5  # s, rad


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
    same = False
    for i in range(2 * found):
        bracket = work.brackets[i // 2]
        own = i % 2 == 1  # again, where Newton's method has led to other cells of the sea bed
        if own and same:
            continue
        same = False
        ok, angle, q, _, turns, same = refine_bounced(
            s, floor, rule, bracket, own, target, span, axis, fine, miss, work
        )
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
            det = tube(s, floor, rule, angle, q, span, axis, fine, work)
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
    if z1 < INSET:
        inset, on_boundary = z1 - min(INSET, 0.5 * bed), -1.0
    elif z1 > bed - INSET:
        inset, on_boundary = z1 - max(bed - INSET, 0.5 * bed), 1.0
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
