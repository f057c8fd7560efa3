"""One link from end to end: cut the section, search, refine, check that the ray stays in the water."""

import math

import numpy as np

from pymantaray.acoustics._kernels.bounced import add_bounced
from pymantaray.acoustics._kernels.boundary import TOUCH, bottom_at, clearances
from pymantaray.acoustics._kernels.field import field_at
from pymantaray.acoustics._kernels.limits import (
    BEYOND,
    STEEP,
    fan_nodes,
    is_steep,
    snell_limit,
    speed_extremes,
    turning_limits,
)
from pymantaray.acoustics._kernels.paths import baseline, chord_travel_time
from pymantaray.acoustics._kernels.refine import polish, refine, unresolved_db
from pymantaray.acoustics._kernels.rows import N_COLUMNS, finish, sort_rows
from pymantaray.acoustics._kernels.search import GOOD, MISS, copy_ray, find_brackets, shoot
from pymantaray.acoustics._kernels.section import LINEAR
from pymantaray.acoustics._kernels.trace import OPEN, Rule
from pymantaray.compile import entry, kernel

OK, SHADOW, BLOCKED, OUTSIDE, WEAK, UNRESOLVED = 0, 1, 2, 3, 4, 7
SPACING_SMOOTH = 0.016  # rad
SPACING_LINEAR = 0.008  # rad
CLOSEST_SMOOTH = 3e-4  # rad; nearer nodes of the first fan are merged
CLOSEST_LINEAR = 1e-9  # rad
LONG = 2e4  # m; beyond, the tolerance grows with the length of the link
N_INFO = 6  # numbers about a link
RESOLUTION = 1e-6  # rad; narrower intervals of a fan are not divided


@kernel
def solve_link(medium, bed, source, receiver, bounces, cutoff_db, tol, work, info):
    """All eigenrays of one link with at most so many reflections at the surface and the bottom; with None, direct ones.

    work.rows receives the arrivals, see `rows`; info receives chord travel time, c at both ends, margin,
    the number of rays traced, and 1 if none was left out for want of room. Returns the number of arrivals and the status.
    """
    kind, north, east = medium[0], medium[1], medium[2]
    rows, brackets = work.rows, work.brackets
    for i in range(4):
        info[i] = np.nan
    info[4], info[5] = 0.0, 1.0
    for point in (source, receiver):
        if north.size > 1 and not north[0] <= point[0] <= north[north.size - 1]:
            return 0, OUTSIDE
        if east.size > 1 and not east[0] <= point[1] <= east[east.size - 1]:
            return 0, OUTSIDE
        if not 0.0 <= point[2] <= bottom_at(bed, point[0], point[1]) + TOUCH:
            return 0, OUTSIDE
    dn = receiver[0] - source[0]
    de = receiver[1] - source[1]
    dz = receiver[2] - source[2]
    horizontal = math.hypot(dn, de)
    length = math.hypot(horizontal, dz)
    un, ue = 1.0, 0.0
    if horizontal > 0.0:
        un, ue = dn / horizontal, de / horizontal
    s, floor = baseline(medium, bed, source, (un, ue), horizontal, work)
    z0, z1 = source[2], receiver[2]
    c0 = field_at(s, 0.0, z0)
    c1 = field_at(s, horizontal, z1)
    info[1], info[2] = c0, c1
    if length == 0.0:
        info[0], info[3] = 0.0, 0.0
        for i in range(N_COLUMNS):
            rows[0, i] = np.nan
        for i in (0, 4, 11, 12):
            rows[0, i] = 0.0
        return 1, OK
    info[0] = chord_travel_time(s, length, horizontal, z0, z1, work.cuts)
    slope = math.atan2(dz, horizontal)
    variation = speed_extremes(s, work.extremes)
    up, down = turning_limits(s, c0, z0, z1, horizontal, variation, work.extremes)
    steep = is_steep(slope, max(up, down))
    cb, sb, span, target = 1.0, 0.0, horizontal, dz
    if steep:
        cb, sb, span, target = math.cos(slope), math.sin(slope), length, 0.0
    axis = (z0, cb, sb, c0)
    rule = Rule(OPEN, 0, 0, 0, 0, 0.0, 0)
    miss = min(1e-2, 1e-6 * length)
    tol *= max(1.0, length / LONG)
    fine = min(tol, 1e-4 * length)
    coarse = min(30.0 * tol, 1e-2 * length)
    spacing, closest = SPACING_SMOOTH, CLOSEST_SMOOTH
    if kind == LINEAR:  # a ray that dips a centimetre into the next layer comes out metres away
        fine = min(1e-3 * tol, 1e-8 * length)
        coarse = fine
        spacing, closest = SPACING_LINEAR, CLOSEST_LINEAR
    weak_slope = length * 10.0 ** (0.1 * cutoff_db + 2.0)
    found, margin, rays, complete = 0, 0.0, 0, True
    if steep:
        # one ray: the bracket of a regula falsi about the chord
        half = 0.02
        a, b = work.stack[0, 0], work.stack[0, 1]
        while True:
            shoot(s, floor, rule, -half, target, span, axis, coarse, 0.0, a, work)
            shoot(s, floor, rule, half, target, span, axis, coarse, 0.0, b, work)
            rays += 2
            if a[GOOD] * b[GOOD] > 0.0 and a[MISS] * b[MISS] <= 0.0:
                found = 1
                copy_ray(a, brackets[0, 0])
                copy_ray(b, brackets[0, 1])
                break
            half *= 2.0
            if half > 0.64:
                margin = min(abs(a[MISS]), abs(b[MISS]))
                break
    else:
        # a ray that turns does so within the limits; one that does not is at some depth as steep as the chord
        lo = -math.acos(math.cos(up) * math.cos(min(slope, 0.0))) - BEYOND
        hi = math.acos(math.cos(down) * math.cos(max(slope, 0.0))) + BEYOND
        n_nodes = fan_nodes(lo, hi, spacing, closest, s, c0, work.nodes)
        found, margin, rays, complete = find_brackets(
            s,
            floor,
            rule,
            n_nodes,
            target,
            span,
            axis,
            coarse,
            fine,
            RESOLUTION,
            0.0,
            0.0,
            weak_slope,
            0.0,
            work,
        )
    through_surface, blocked, weak = 0, 0, 0
    count = 0 * floor.n_breaks  # a literal 0 would compile `add_bounced` once more
    for i in range(found):
        ok, angle, q, steps, turns = polish(s, floor, rule, brackets[i], target, span, axis, fine, miss, work)
        if not ok:
            ok, angle, q, steps, turns = refine(
                s, floor, rule, brackets[i], target, span, axis, fine, miss, work
            )
        if not ok:
            continue
        below_surface, above_bottom = clearances(
            work.path, steps, floor, -sb * (work.y[0] - target), cb * (work.y[0] - target), work.y[5]
        )
        if below_surface < -TOUCH:
            through_surface += 1
            continue
        if above_bottom < -TOUCH:
            blocked += 1
            continue
        det = work.y[2] * work.y[7]
        finish(rows[count], work.y, angle, q, target, turns, c0, c1, length, un, ue, cb, sb, sb, det)
        rows[count, 11], rows[count, 12] = 0.0, 0.0
        rows[count, 3] += unresolved_db(
            brackets[i], RESOLUTION, 30.0 * fine * max(1.0, abs(work.y[2]) / length), work.y[2]
        )
        if rows[count, 3] > cutoff_db:
            weak += 1
            continue
        same = count
        for j in range(count):  # a caustic's two brackets may have found one ray
            if abs(rows[j, 0] - rows[count, 0]) < 1e-7 and abs(rows[j, 1] - rows[count, 1]) < 5e-6:
                same = j
        if same < count and rows[count, 3] < rows[same, 3]:
            for j in range(N_COLUMNS):
                rows[same, j] = rows[count, j]
        count += 1 if same == count else 0
    if bounces is not None and bounces[0] + bounces[1] > 0:  # for None Numba leaves this out
        ends = (z0, z1, c0, c1, horizontal, length)
        numerics = (coarse, fine, miss)
        count, more_weak, more_rays, more_complete = add_bounced(
            s,
            floor,
            ends,
            snell_limit(s, c0, 0.0, math.inf, variation, work.extremes)[0] + STEEP,
            bounces[0],
            bounces[1],
            cutoff_db,
            numerics,
            weak_slope,
            spacing,
            closest,
            count,
            work,
        )
        weak += more_weak
        rays += more_rays
        complete = complete and more_complete
    info[3] = 0.0 if count > 0 else margin
    info[4] = rays
    info[5] = 1.0 if complete else 0.0
    if count > 0:
        sort_rows(rows, count)
        return count, OK
    if not complete:
        return 0, UNRESOLVED
    if weak > 0:
        return 0, WEAK
    if blocked > 0:
        return 0, BLOCKED
    if through_surface > 0:
        info[3] = math.nan  # rays that would come by way of the surface miss by nothing
    return 0, SHADOW


@entry
def solve_links(
    medium,
    bed,
    source,
    receiver,
    bounces,
    cutoff_db,
    tol,
    canonical,
    first,
    every,
    work,
    all_rows,
    counts,
    status,
    info,
):
    """Solve the links first, first + every, ...; all_rows (n_links, MAX_KEPT, N_COLUMNS), the first MAX_KEPT arrivals of each link.

    With canonical, each link is solved from its deeper end (ties: north, east) and turned round.
    """
    for i in range(first, source.shape[0], every):
        a, b = source[i], receiver[i]
        turned = False
        if canonical:
            for k in (2, 0, 1):
                if a[k] != b[k]:
                    turned = a[k] < b[k]
                    break
        if turned:
            a, b = b, a
        n, status[i] = solve_link(medium, bed, a, b, bounces, cutoff_db, tol, work, info[i])
        rows = work.rows
        if n > all_rows.shape[1]:
            n = all_rows.shape[1]
            info[i, 5] = 0.0
        counts[i] = n
        for j in range(n):
            for k in range(N_COLUMNS):
                all_rows[i, j, k] = rows[j, k]
            if turned:
                all_rows[i, j, 1] = -rows[j, 2]
                all_rows[i, j, 2] = -rows[j, 1]
                for k in range(3):
                    all_rows[i, j, 5 + k] = -rows[j, 8 + k]
                    all_rows[i, j, 8 + k] = -rows[j, 5 + k]
        if turned:
            info[i, 1], info[i, 2] = info[i, 2], info[i, 1]
