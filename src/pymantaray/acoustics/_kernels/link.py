"""One link from end to end: cut the section, search, refine, check that the ray stays in the water."""

import math
from collections import namedtuple

import numpy as np

from pymantaray.acoustics._kernels.boundary import TOUCH, bottom_at, clearances
from pymantaray.acoustics._kernels.compile import driver, kernel
from pymantaray.acoustics._kernels.field import field_at, level_speed
from pymantaray.acoustics._kernels.paths import chord_travel_time
from pymantaray.acoustics._kernels.search import MAX_ROOTS, MAX_STACK, fan_nodes, find_brackets, refine, shoot
from pymantaray.acoustics._kernels.section import LINEAR, MAX_COLUMNS, SMOOTH, cut_section, line_breaks
from pymantaray.acoustics._kernels.step import N_FULL

OK, SHADOW, BLOCKED, OUTSIDE, WEAK = 0, 1, 2, 3, 4
MAX_PATH = 4096
MAX_NODES = 4096
STEEP = 0.08  # rad beyond the Snell limit from which a link has one ray only
SPACING_SMOOTH = 0.016  # rad
SPACING_LINEAR = 0.008  # rad
CLOSEST_SMOOTH = 1e-3  # rad; nearer nodes of the first fan are merged
CLOSEST_LINEAR = 1e-9  # rad
N_COLUMNS = 11  # of a result row

Work = namedtuple(
    "Work",
    "y K ynew no_path path breaks floor_breaks small acc store cuts nodes fan stack brackets rows",
)
Work.__doc__ = "Workspaces of one thread, shared by all kernels; made once in `solve_links`."


@kernel
def snell_limit(s, c_source, z0, z1, horizontal):
    """Steepest angle at which a ray can turn within reach of the link: arccos of c over the fastest in reach."""
    angle = 0.6
    for _ in range(3):
        reach = 0.5 * horizontal * math.tan(min(angle, 1.2)) + 1.0
        top = max(min(z0, z1) - reach, s.depth[0])
        low = min(max(z0, z1) + reach, s.depth[s.depth.size - 1])
        fastest = c_source
        for k in range(s.depth.size):
            if (s.depth[k] >= top or (k < s.depth.size - 1 and s.depth[k + 1] >= top)) and (
                s.depth[k] <= low or (k > 0 and s.depth[k - 1] <= low)
            ):
                for b in range(s.n_range):
                    fastest = max(fastest, level_speed(s, b, k))
        new = math.acos(c_source / fastest)
        if new >= angle:
            return new
        angle = new
    return angle


@kernel
def finish(row, y, angle, q, target, turns, c0, c1, length, un, ue, cb, sb):
    """Fill a result row with the ray that ended in state y, moved by its small miss onto the receiver.

    The travel time changes by the slowness at the receiver times the miss (Fermat) and half its rate of
    change; the slownesses by their derivatives along the variation.
    """
    miss = y[0] - target
    rate = y[3] / y[2] if y[2] != 0.0 else 0.0
    p1, q1 = y[1], y[6]
    row[0] = (y[4] - p1 * miss - q1 * y[5] + 0.5 * rate * miss * miss) / c0
    shift = miss / y[2] if y[2] != 0.0 else 0.0
    if abs(shift) < 1e-4:
        angle -= shift
        p1 -= rate * miss
    if y[7] > 0.0:
        q -= y[5] / y[7]
        q1 -= y[5] / y[7]
    n1 = c0 / c1
    h1 = math.sqrt(max(n1 * n1 - p1 * p1 - q1 * q1, 0.0))
    p0 = math.sin(angle)
    h0 = math.sqrt(max(1.0 - p0 * p0 - q * q, 0.0))
    tube = abs(y[2] / math.cos(angle) * y[7] * (h1 / n1) * h0)
    row[3] = 10.0 * math.log10(max(tube, 1e-300) * n1 / (length * length))
    row[4] = turns
    for end in range(2):
        p, side, h = (p0, q, h0) if end == 0 else (p1, q1, h1)
        along = h * cb - p * sb
        down = h * sb + p * cb
        row[1 + end] = math.atan2(down, math.hypot(along, side))
        row[5 + 3 * end] = (along * un - side * ue) / c0
        row[6 + 3 * end] = (along * ue + side * un) / c0
        row[7 + 3 * end] = down / c0


@kernel
def solve_link(medium, bathymetry, source, receiver, cutoff_db, tol, work, info):
    """All direct eigenrays of one link.

    work.rows receives travel time, launch angle, arrival angle, spreading [dB], turning
    points and the slowness vectors at both ends; info receives chord travel time, c at both ends, margin
    and the number of rays traced. Returns the number of arrivals and the status.
    """
    kind, north, east = medium[0], medium[1], medium[2]
    rows, brackets = work.rows, work.brackets
    for i in range(4):
        info[i] = np.nan
    info[4] = 0.0
    for point in (source, receiver):
        if north.size > 1 and not north[0] <= point[0] <= north[north.size - 1]:
            return 0, OUTSIDE
        if east.size > 1 and not east[0] <= point[1] <= east[east.size - 1]:
            return 0, OUTSIDE
        floor = bottom_at(north, east, bathymetry, point[0], point[1])
        if not 0.0 <= point[2] <= floor + TOUCH:
            return 0, OUTSIDE
    dn = receiver[0] - source[0]
    de = receiver[1] - source[1]
    dz = receiver[2] - source[2]
    horizontal = math.hypot(dn, de)
    length = math.hypot(horizontal, dz)
    un, ue = 1.0, 0.0
    if horizontal > 0.0:
        un, ue = dn / horizontal, de / horizontal
    s = cut_section(medium, source[0], source[1], un, ue, horizontal, work)
    z0, z1 = source[2], receiver[2]
    c0 = field_at(s, 0.0, z0)
    c1 = field_at(s, horizontal, z1)
    info[1], info[2] = c0, c1
    if length == 0.0:
        info[0], info[3] = 0.0, 0.0
        for i in range(N_COLUMNS):
            rows[0, i] = np.nan
        rows[0, 0] = 0.0
        rows[0, 4] = 0.0
        return 1, OK
    info[0] = chord_travel_time(s, length, horizontal, z0, z1, work.cuts)
    slope = math.atan2(dz, horizontal)
    limit = snell_limit(s, c0, z0, z1, horizontal)
    cb, sb, span, target = 1.0, 0.0, horizontal, dz
    steep = abs(slope) > max(limit + STEEP, 0.3)
    if steep:
        cb, sb, span, target = math.cos(slope), math.sin(slope), length, 0.0
    axis = (z0, cb, sb, c0)
    n_breaks = line_breaks(
        north, east, source[0], source[1], un, ue, 0.0, max(horizontal, 1e-6), work.floor_breaks
    )
    miss = min(1e-2, 1e-6 * length)
    fine = min(tol, 1e-4 * length)
    coarse = min(30.0 * tol, 1e-2 * length)
    if kind == LINEAR:  # a ray that dips a centimetre into the next layer comes out metres away
        fine = min(1e-3 * tol, 1e-8 * length)
        coarse = fine
    found, margin, rays = 0, 0.0, 0
    if steep:
        # one ray: the bracket of a regula falsi about the chord
        half = 0.02
        f0, _, ok0 = shoot(s, -half, target, span, axis, coarse, work)
        f1, _, ok1 = shoot(s, half, target, span, axis, coarse, work)
        rays += 2
        while (not ok0 or not ok1 or f0 * f1 > 0.0) and half < 0.64:
            half *= 2.0
            f0, _, ok0 = shoot(s, -half, target, span, axis, coarse, work)
            f1, _, ok1 = shoot(s, half, target, span, axis, coarse, work)
            rays += 2
        if ok0 and ok1 and f0 * f1 <= 0.0:
            found = 1
            brackets[0, 0] = -half
            brackets[0, 1] = half
        else:
            margin = min(abs(f0), abs(f1))
    else:
        lo = min(-limit - STEEP, slope - 0.1)
        hi = max(limit + STEEP, slope + 0.1)
        if kind == SMOOTH:
            n_nodes = fan_nodes(lo, hi, SPACING_SMOOTH, CLOSEST_SMOOTH, s, c0, work.nodes)
        else:
            n_nodes = fan_nodes(lo, hi, SPACING_LINEAR, CLOSEST_LINEAR, s, c0, work.nodes)
        width = 1e-6 if not math.isnan(cutoff_db) else 1e-9
        found, margin, rays, _ = find_brackets(s, n_nodes, target, span, axis, coarse, width, work)
    count, through_surface, blocked, weak = 0, 0, 0, 0
    for i in range(found):
        ok, angle, q, steps, turns = refine(
            s, brackets[i, 0], brackets[i, 1], target, span, axis, fine, miss, work
        )
        if not ok:
            continue
        below_surface, above_bottom = clearances(
            work.path,
            steps,
            axis,
            source[0],
            source[1],
            un,
            ue,
            north,
            east,
            bathymetry,
            work.floor_breaks,
            n_breaks,
        )
        if below_surface < -TOUCH:
            through_surface += 1
            continue
        if above_bottom < -TOUCH:
            blocked += 1
            continue
        finish(rows[count], work.y, angle, q, target, turns, c0, c1, length, un, ue, cb, sb)
        if rows[count, 3] > cutoff_db:
            weak += 1
            continue
        new = True
        for j in range(count):  # a caustic's two brackets may have found one ray
            if abs(rows[j, 0] - rows[count, 0]) < 1e-9 and abs(rows[j, 1] - rows[count, 1]) < 2e-6:
                new = False
        if not new:
            continue
        count += 1
    info[3] = 0.0 if count > 0 else margin
    info[4] = rays
    if count > 0:
        for i in range(1, count):  # by travel time
            j = i
            while j > 0 and rows[j - 1, 0] > rows[j, 0]:
                for k in range(N_COLUMNS):
                    rows[j - 1, k], rows[j, k] = rows[j, k], rows[j - 1, k]
                j -= 1
        return count, OK
    if weak > 0:
        return 0, WEAK
    if blocked > 0:
        return 0, BLOCKED
    if through_surface > 0:
        info[3] = math.nan  # rays that would come by way of the surface miss by nothing
    return 0, SHADOW


@driver
def workspace(n_depth):
    """Workspaces of one thread."""
    return Work(
        y=np.empty(N_FULL),
        K=np.empty((7, N_FULL)),
        ynew=np.empty(N_FULL),
        no_path=np.empty((0, 4)),
        path=np.empty((MAX_PATH, 4)),
        breaks=np.empty(MAX_COLUMNS + 2),
        floor_breaks=np.empty(MAX_COLUMNS + 2),
        small=np.empty((4, 4)),
        acc=np.empty((3, 2 * n_depth)),
        store=np.empty((MAX_COLUMNS, n_depth, 12)),
        cuts=np.empty(n_depth + MAX_COLUMNS + 4),
        nodes=np.empty(MAX_NODES),
        fan=np.empty((4, MAX_NODES)),
        stack=np.empty((MAX_STACK, 9)),
        brackets=np.empty((MAX_ROOTS, 2)),
        rows=np.empty((MAX_ROOTS, N_COLUMNS)),
    )


@driver
def solve_links(
    medium, bathymetry, source, receiver, cutoff_db, tol, canonical, all_rows, counts, status, info
):
    """Solve a block of links; all_rows (n_links, MAX_KEPT, 11), the first MAX_KEPT arrivals of each link.

    With canonical, each link is solved from its deeper end (ties: north, east) and turned round.
    """
    work = workspace(medium[3].size)
    for i in range(source.shape[0]):
        a, b = source[i], receiver[i]
        turned = False
        if canonical:
            for k in (2, 0, 1):
                if a[k] != b[k]:
                    turned = a[k] < b[k]
                    break
        if turned:
            a, b = b, a
        n, status[i] = solve_link(medium, bathymetry, a, b, cutoff_db, tol, work, info[i])
        rows = work.rows
        n = min(n, all_rows.shape[1])
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
