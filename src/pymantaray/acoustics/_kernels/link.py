"""One link from end to end: cut the section, search, refine, check that the ray stays in the water."""

import math
from collections import namedtuple

import numpy as np

from pymantaray.acoustics._kernels.compile import driver, kernel, sort_head
from pymantaray.acoustics._kernels.search import MAX_ROOTS, MAX_STACK, fan_nodes, find_brackets, refine, shoot
from pymantaray.acoustics._kernels.section import (
    LINEAR,
    SMOOTH,
    Section,
    bilinear_weights,
    cut_linear,
    cut_smooth,
    find_level,
    line_breaks,
    linear_full,
    smooth_full,
)
from pymantaray.acoustics._kernels.trace import N_FULL

OK, SHADOW, BLOCKED, OUTSIDE, WEAK = 0, 1, 2, 3, 4
MAX_COLUMNS = 1024
COLUMN_STEP = 500.0  # m; spacing of the columns of a SMOOTH section at most
MAX_PATH = 4096
MAX_NODES = 4096
TOUCH = 1e-6  # m; a ray this far beyond a boundary still touches it only
STEEP = 0.08  # rad beyond the Snell limit from which a link has one ray only
SPACING_SMOOTH = 0.016  # rad
SPACING_LINEAR = 0.008  # rad
N_COLUMNS = 11  # of a result row

Work = namedtuple(
    "Work",
    "y K ynew no_path path breaks floor_breaks small acc store cuts nodes fan stack brackets rows",
)
Work.__doc__ = "Workspaces of one thread, shared by all kernels; made once in `solve_links`."


@kernel
def field_at(s, r, z):
    """Sound speed at a point of the section."""
    if s.kind == SMOOTH:
        return smooth_full(s, r, z)[0]
    b = 0
    while b < s.n_range - 1 and r >= s.breaks[b + 1]:
        b += 1
    n = s.depth.size
    if z < s.depth[0]:
        return linear_full(s, b, -1, r, z)[0]
    if z > s.depth[n - 1]:
        return linear_full(s, b, n - 1, r, z)[0]
    return linear_full(s, b, find_level(s.depth, s.lut, s.lut_scale, z), r, z)[0]


@kernel
def bottom_at(north, east, bathymetry, n, e):
    """Bilinear depth of the sea bed."""
    i, j, sn, se, _, _ = bilinear_weights(north, east, n, e, n, e)
    di = 1 if north.size > 1 else 0
    dj = 1 if east.size > 1 else 0
    b00 = bathymetry[i, j]
    b10 = bathymetry[i + di, j]
    b01 = bathymetry[i, j + dj]
    b11 = bathymetry[i + di, j + dj]
    return (b00 * (1.0 - sn) + b10 * sn) * (1.0 - se) + (b01 * (1.0 - sn) + b11 * sn) * se


@kernel
def cut_section(medium, n0, e0, un, ue, horizontal, work):
    """Section of the medium along a baseline, filled into work.store."""
    store, breaks = work.store, work.breaks
    kind, north, east, depth, field, knots_n, deg_n, knots_e, deg_e, lut, lut_scale = medium
    if kind == SMOOTH:
        margin = 0.0
        if north.size == 1 and east.size == 1:
            count = 2
        else:
            count = min(max(int(math.ceil(horizontal / COLUMN_STEP)) + 1, 2), MAX_COLUMNS)
            if horizontal < COLUMN_STEP:
                margin = 0.5 * (COLUMN_STEP - horizontal)
        step = (horizontal + 2.0 * margin) / (count - 1)
        if step == 0.0:
            step = COLUMN_STEP
        cut_smooth(
            field, knots_n, deg_n, knots_e, deg_e, depth, n0, e0, un, ue, -margin, step, count, store,
            work.small, work.acc,
        )
        return Section(SMOOTH, count, -margin, step, breaks, depth, lut, lut_scale, store)
    reach = 1000.0  # m beyond the ends; rays of steep links stray behind the source
    count = line_breaks(north, east, n0, e0, un, ue, -reach, horizontal + reach, breaks) - 1
    cut_linear(field, north, east, n0, e0, un, ue, breaks, count, store)
    return Section(LINEAR, count, 0.0, 1.0, breaks, depth, lut, lut_scale, store)


@kernel
def chord_travel_time(s, length, horizontal, z0, z1, cuts):
    """Travel time along the straight chord: Gauss-Legendre between all levels and columns it crosses."""
    x = (-0.906179845938664, -0.5384693101056831, 0.0, 0.5384693101056831, 0.906179845938664)
    w = (0.23692688505618908, 0.47862867049936647, 0.5688888888888889, 0.47862867049936647, 0.23692688505618908)
    n = 0
    cuts[n] = 0.0
    n += 1
    if z1 != z0:
        for k in range(s.depth.size):
            t = (s.depth[k] - z0) / (z1 - z0)
            if 0.0 < t < 1.0:
                cuts[n] = t
                n += 1
    if horizontal > 0.0:
        for i in range(s.n_range + 1):
            r = s.breaks[i] if s.kind == LINEAR else s.r_first + i * s.r_step
            t = r / horizontal
            if 0.0 < t < 1.0 and n < cuts.size - 1:
                cuts[n] = t
                n += 1
    cuts[n] = 1.0
    n += 1
    sort_head(cuts, n)
    total = 0.0
    for i in range(n - 1):
        h = 0.5 * (cuts[i + 1] - cuts[i])
        if h <= 0.0:
            continue
        mid = 0.5 * (cuts[i + 1] + cuts[i])
        for q in range(5):
            t = mid + h * x[q]
            total += w[q] * h / field_at(s, t * horizontal, z0 + t * (z1 - z0))
    return total * length


@kernel
def _level_speed(s, b, k):
    """Sound speed at a level in a column or at the near edge of a cell."""
    if s.kind == LINEAR or k < s.depth.size - 1:
        return s.data[b, k, 0]
    x = s.depth[k] - s.depth[k - 1]
    d = s.data
    return d[b, k - 1, 0] + x * (d[b, k - 1, 1] + x * (d[b, k - 1, 2] + x * d[b, k - 1, 3]))


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
                    fastest = max(fastest, _level_speed(s, b, k))
        new = math.acos(c_source / fastest)
        if new >= angle:
            return new
        angle = new
    return angle


@kernel
def in_water(path, steps, axis, n0, e0, un, ue, north, east, bathymetry, breaks, n_breaks):
    """Whether a traced ray stays between surface and sea bed; also the least clearance. [m]

    Every step's cubic Hermite is sampled, at nine points, at its turning point and at each edge of the
    bathymetry's cells, where its peaks are.
    """
    z_source, cb, sb, _ = axis
    clearance = np.inf
    for i in range(steps):
        s0, w0, d0 = path[i, 0], path[i, 1], path[i, 2]
        h = path[i + 1, 0] - s0
        w1, d1 = path[i + 1, 1], path[i + 1, 2]
        if h <= 0.0:
            continue
        r0 = s0 * cb - w0 * sb
        r1 = (s0 + h) * cb - w1 * sb
        extra = 0
        first = 0
        while first < n_breaks and breaks[first] <= min(r0, r1):
            first += 1
        while first + extra < n_breaks and breaks[first + extra] < max(r0, r1):
            extra += 1
        z_0 = path[i, 3]
        z_1 = path[i + 1, 3]
        turning = z_0 * z_1 < 0.0
        for j in range(9 + extra + 1):
            if j < 9:
                t = j / 8.0
            elif j < 9 + extra:
                t = (breaks[first + j - 9] - r0) / (r1 - r0)
            elif turning:
                t = z_0 / (z_0 - z_1)
            else:
                continue
            t2 = t * t
            t3 = t2 * t
            w = (1 - 3 * t2 + 2 * t3) * w0 + (t - 2 * t2 + t3) * h * d0 + (3 * t2 - 2 * t3) * w1 + (t3 - t2) * h * d1
            s = s0 + t * h
            r = s * cb - w * sb
            z = z_source + s * sb + w * cb
            floor = bottom_at(north, east, bathymetry, n0 + r * un, e0 + r * ue)
            clearance = min(clearance, z, floor - z)
    return clearance >= -TOUCH, clearance


@kernel
def solve_link(medium, bathymetry, source, receiver, cutoff_db, tol, work, info):
    """All direct eigenrays of one link.

    work.rows receives travel time, launch angle, arrival angle, spreading [dB], turning
    points and the slowness vectors at both ends; info receives chord travel time, c at both ends, margin
    and the number of rays traced. Returns the number of arrivals and the status.
    """
    kind, north, east, depth = medium[0], medium[1], medium[2], medium[3]
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
    c_ref = c0
    axis = (z0, cb, sb, c_ref)
    n_breaks = line_breaks(north, east, source[0], source[1], un, ue, 0.0, max(horizontal, 1e-6), work.floor_breaks)
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
        spacing = SPACING_SMOOTH if kind == SMOOTH else SPACING_LINEAR
        n_nodes = fan_nodes(lo, hi, spacing, s, c0, work.nodes)
        width = 1e-6 if not math.isnan(cutoff_db) else 1e-9
        found, margin, rays, _ = find_brackets(s, n_nodes, target, span, axis, coarse, width, work)
    count, blocked, weak = 0, 0, 0
    for i in range(found):
        ok, angle, q, steps, turns = refine(
            s, brackets[i, 0], brackets[i, 1], target, span, axis, fine, miss, work
        )
        if not ok:
            continue
        inside, _ = in_water(
            work.path, steps, axis, source[0], source[1], un, ue, north, east, bathymetry, work.floor_breaks, n_breaks
        )
        if not inside:
            blocked += 1
            continue
        y = work.y
        p1, q1 = y[1], y[6]
        n1 = c_ref / c1
        h1 = math.sqrt(max(n1 * n1 - p1 * p1 - q1 * q1, 0.0))
        p0 = math.sin(angle)
        h0 = math.sqrt(max(1.0 - p0 * p0 - q * q, 0.0))
        tube = abs(y[2] / math.cos(angle) * y[7] * (h1 / n1) * h0)
        spreading = 10.0 * math.log10(max(tube, 1e-300) * c0 / c1 / (length * length))
        if spreading > cutoff_db:
            weak += 1
            continue
        time = (y[4] - p1 * (y[0] - target) - q1 * y[5]) / c_ref
        new = True
        for j in range(count):
            if abs(rows[j, 0] - time) < 1e-12 and abs(rows[j, 1] - angle) < 1e-9:
                new = False
        if not new:
            continue
        rows[count, 0] = time
        rows[count, 3] = spreading
        rows[count, 4] = turns
        for end in range(2):
            p, q_, h = (p0, q, h0) if end == 0 else (p1, q1, h1)
            along = h * cb - p * sb
            down = h * sb + p * cb
            rows[count, 1 + end] = math.atan2(down, math.hypot(along, q_))
            rows[count, 5 + 3 * end] = (along * un - q_ * ue) / c_ref
            rows[count, 6 + 3 * end] = (along * ue + q_ * un) / c_ref
            rows[count, 7 + 3 * end] = down / c_ref
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
    return 0, BLOCKED if blocked > 0 else SHADOW


@driver
def solve_links(medium, bathymetry, source, receiver, cutoff_db, tol, canonical, all_rows, counts, status, info):
    """Solve a block of links; all_rows (n_links, MAX_KEPT, 11), the first MAX_KEPT arrivals of each link.

    With canonical, each link is solved from its deeper end (ties: north, east) and turned round.
    """
    n_depth = medium[3].size
    work = Work(
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
