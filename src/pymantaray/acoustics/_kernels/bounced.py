"""Eigenrays with reflections at the surface and the sea bed.

Two fans share the launch angles. Up to STEEPEST_FORWARD from the horizontal, rays are followed in range
and reflected wherever they meet a boundary. Closer to the vertical, where a ray may also turn back
on a slope, they are followed in depth, leg by leg, for each number of reflections. Both look in the vertical plane
of the link first; Newton's method on two launch angles then includes slopes and sound-speed gradients
across it, and over a gridded sea bed goes on cell by cell.
"""

import math

from pymantaray.acoustics._kernels.boundary import LANDED, floor_at
from pymantaray.acoustics._kernels.cells import (
    KNOWN,
    add_candidate,
    add_neighbours,
    add_of_bracket,
    candidate,
    follow,
)
from pymantaray.acoustics._kernels.limits import fan_nodes
from pymantaray.acoustics._kernels.refine_bounced import INSET, Aim, refine_bounced, tube
from pymantaray.acoustics._kernels.rows import finish
from pymantaray.acoustics._kernels.search import ANGLE, CODE, fewer_bounces, find_brackets
from pymantaray.acoustics._kernels.trace import FORWARD, LEGS, ON_SURFACE, Rule
from pymantaray.compile import kernel

STEEPEST_FORWARD = 1.08  # rad
SHALLOWEST_LEGS = 1.02  # rad; the fans overlap, what both find is kept once
_SPACING_FORWARD = 0.04  # rad, beyond the angles at which rays can turn
_SPACING_LEGS = 0.13  # rad
_OVERHANG = 0.08  # rad; as far beyond an edge of its cells in the plane, a ray may be within them out of it
_RESOLUTION = 1e-6  # rad; narrower windows between changes of reflection are not looked into
_TRUST = 2e-4  # rad; rays within the usual cut-off fill wider windows than this
_SAME_TIME, _SAME_ANGLE = 2e-8, 4e-5  # s, rad


@kernel
def _collect(
    s, floor, rule, n_nodes, target, fold_target, span, axis, steep, weak_slope, link, numerics, count, work
):
    """Find and refine the reflected rays of one fan; fold_target is the target of the search.

    Returns the rows in use, those too weak, the rays traced, and whether none was left out.
    """
    cutoff_db, slope, cross_slope = link[2], link[4], link[5]
    coarse, fine, miss, inset = numerics
    aim = Aim(target, span, axis, fine, miss)
    candidates = work.candidates
    width, trust = _RESOLUTION, _TRUST
    if math.isinf(cutoff_db):  # every ray there is
        width, trust = 1e-3 * width, 1e-3 * trust
    gridded = floor.bathymetry.size > 1 and rule.fold == 0
    overhang = min(_OVERHANG, slope + cross_slope) if gridded else 0.0
    found, _, rays, complete = find_brackets(
        s,
        floor,
        rule,
        n_nodes,
        fold_target,
        span,
        axis,
        coarse,
        fine,
        width,
        trust,
        steep,
        weak_slope,
        overhang,
        work,
    )
    weak, n, done, i = 0, 0, 0, 0
    while i < found or done < n:
        bracket = work.brackets[min(i, found - 1)]
        if i < found:
            i += 1
            generation = 0
            counts = int(bracket[fewer_bounces(bracket), CODE]) % 1024
            ok, angle, q, steps, turns, same = False, 0.0, 0.0, 0, 0, False
            if bracket[0, ANGLE] < bracket[1, ANGLE]:
                ok, angle, q, steps, turns, same = refine_bounced(s, floor, rule, bracket, aim, work)
        else:
            counts, generation = candidate(candidates, done)
            done += 1
            if generation == KNOWN:
                continue
            same = True
            n, ok, angle, q, steps, turns = follow(
                s, floor, rule, candidates, done - 1, n, bracket, aim, work
            )
        if ok:
            if gridded:
                n = add_candidate(candidates, n, floor.cells[LANDED], angle, q, counts, KNOWN)
                n = add_neighbours(floor, candidates, n, angle, q, counts, generation + 1, steps, work)
            count, too_weak = _keep(s, floor, rule, angle, q, turns, counts, aim, link, inset, count, work)
            weak += too_weak
        if gridded and not same:
            n = add_of_bracket(s, floor, rule, bracket, candidates, n, aim, work)
    return count, weak, rays, complete


@kernel
def _keep(s, floor, rule, angle, q, turns, counts, aim, link, inset, count, work):
    """Write the ray in work.y into the next row unless it is there; return the rows in use, and 1 if it is too weak."""
    c1, length, cutoff_db, on_boundary, _, cross_slope, most_s, most_b = link
    axis, rows = aim.axis, work.rows
    n_s, n_b = counts // 32, counts % 32
    if count >= rows.shape[0] or n_s > most_s or n_b > most_b or counts == 0:
        return count, 0
    cb, sb = axis[1], axis[2]
    sb_end = -sb if rule.kind == LEGS and rule.legs % 2 == 0 else sb
    row = rows[count]
    plain = work.y[2] * work.y[7]
    finish(
        row,
        work.y,
        angle,
        q,
        aim.target + inset * cb,
        turns,
        axis[3],
        c1,
        length,
        floor.un,
        floor.ue,
        cb,
        sb,
        sb_end,
        plain,
    )
    if rule.kind == LEGS:
        row[0] += inset * row[10]
    row[11], row[12] = n_s, n_b
    if n_b > 0 and cross_slope > 1e-9:  # slopes couple both launch parameters
        det = tube(s, floor, rule, angle, q, aim, work)
        if not math.isnan(det):
            row[3] += 10.0 * math.log10(max(abs(det), 1e-300) / max(abs(plain), 1e-300))
    if on_boundary * row[2] < 0.0:  # reflected at the receiver itself
        return count, 0
    if row[3] > cutoff_db:
        return count, 1
    for j in range(count):
        if (
            rows[j, 11] == n_s
            and rows[j, 12] == n_b
            and abs(rows[j, 0] - row[0]) < _SAME_TIME
            and abs(rows[j, 1] - row[1]) < _SAME_ANGLE + 10.0 * abs(inset) / length
        ):
            return count, 0
    return count + 1, 0


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
    link = (c1, length, cutoff_db, on_boundary, slope, cross_slope, max_surface, max_bottom)
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
