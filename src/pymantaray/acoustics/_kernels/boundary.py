"""
Surface and sea bed along a baseline: depth and slope, distance and intersection of rays,
reflection.

A step of a ray ends at the faces of a LINEAR section's cells, at the surface and at the sea bed.
The surface is flat or the underside of ice. Sea bed and varying ice are bilinear.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.field import (
    cubic,
    find_level,
    linear_full,
    move_level,
    smooth_full,
)
from pymantaray.acoustics._kernels.layout import Walls
from pymantaray.acoustics._kernels.step import derivative, step
from pymantaray.compile import inlined, kernel
from pymantaray.geometry.boundary_kernels import bilinear_weights, interval_of

TOUCH = 1e-6  # m; a ray up to this distance beyond a boundary only touches it
TOP, UNDERSIDE, NEAR, FAR, SURFACE, BOTTOM = range(6)  # faces
# mark of a reflection at a flat surface; -1 - i for cell i of the ice, i + 2 for cell i of the sea
# bed
ON_SURFACE = 1
ON_FACE = 1e-9  # m; a ray within this distance of a face is on it
_NO_BED = 1e30  # m
_CONTINUED = (
    1.5  # distance from the middle of a cell to which its bed extends, in widths of the cell
)
_NONE = 1e30
# m; maximum distance from the bed of a ray that was just reflected, if it is still over its cell
_LANDED = 1e-2
_BESIDE = 0.1 * _NO_BED
_SAMPLES = 8  # of a step over a gridded bed
_HASH = 2**32
_SHORTEST_AIM = 1.0  # m; nearer faces are not aimed at
_LONGEST_SETTLING = (
    1.0  # m; distance by which the end of a step may move onto the face at which it was aimed
)
_LEAST_SLOPE = 1e-3  # of a ray at a face that is aimed at
# m; distance from a path within which no boundary is between its depths and those that are
# certainly water
_ASIDE = 100.0
_MOST_NODES = (
    256  # of a boundary's grid near a path; otherwise each step is compared with the boundary
)
_NUDGE = 1e-6  # m; shift of a point on the edge of a cell into the cell of the step


@kernel
def _middle(axis, i):
    """Middle of a cell along one axis."""
    return 0.5 * (axis[i] + axis[i + 1]) if axis.size > 1 else axis[0]


@inlined
def place_at(line, r, y):
    """North and east at a range and a cross-track offset."""
    return (
        line.north + r * line.unit_north - y * line.unit_east,
        line.east + r * line.unit_east + y * line.unit_north,
    )


@inlined
def _bilinear(grid, line, cell, across):
    """
    Depth of a boundary, its derivatives f_r, f_y and f_rr, and the number of its cell, from
    `bilinear_weights`.
    """
    i, j, sn, se, dn, de = cell
    un, ue = line.unit_north, line.unit_east
    di = 1 if grid.north.size > 1 else 0
    dj = 1 if grid.east.size > 1 else 0
    b = grid.depth
    b00 = b[i, j]
    b10 = b[i + di, j] - b00
    b01 = b[i, j + dj] - b00
    b11 = b[i + di, j + dj] - b00 - b10 - b01
    f_n = (b10 + b11 * se) / dn
    f_e = (b01 + b11 * sn) / de
    return (
        b00 + b10 * sn + b01 * se + b11 * sn * se,
        f_n * un + f_e * ue,
        across * (f_e * un - f_n * ue),
        2.0 * b11 / (dn * de) * un * ue,
        i * grid.east.size + j,
    )


@kernel
def bed_at(walls, r, y, r_cell):
    """
    Depth of the sea bed, its derivatives f_r, f_y and f_rr, and its cell; the cell is that at range
    r_cell.
    """
    bed, line = walls.bed, walls.line
    y *= walls.across
    n_cell, e_cell = place_at(line, r_cell, y)
    if walls.held >= 0.0:
        cell = int(walls.cells[at.HELD, int(walls.held)])
        if cell < 0:
            return _NO_BED, 0.0, 0.0, 0.0, cell
        n_cell, e_cell = (
            _middle(bed.north, cell // bed.east.size),
            _middle(bed.east, cell % bed.east.size),
        )
    n, e = place_at(line, r, y)
    weights = bilinear_weights(bed, n, e, n_cell, e_cell)
    i, j, sn, se = weights[0], weights[1], weights[2], weights[3]
    if walls.held >= 0.0 and max(abs(sn - 0.5), abs(se - 0.5)) > _CONTINUED:
        return _NO_BED, 0.0, 0.0, 0.0, i * bed.east.size + j
    return _bilinear(bed, line, weights, walls.across)


@inlined
def surface_at(walls, r, y, r_cell):
    """
    Depth of the surface or the ice's underside, its derivatives f_r, f_y and f_rr, and its cell;
    the cell is that at range r_cell.
    """
    if walls.surface.depth.size == 1:
        return walls.surface.depth[0, 0], 0.0, 0.0, 0.0, 0
    return _varying_surface_at(walls.surface, walls.line, walls.across, r, y, r_cell)


@kernel
def _varying_surface_at(surface, line, across, r, y, r_cell):
    """As `surface_at`, for a surface with varying depth."""
    y *= across
    n, e = place_at(line, r, y)
    n_cell, e_cell = place_at(line, r_cell, y)
    return _bilinear(surface, line, bilinear_weights(surface, n, e, n_cell, e_cell), across)


@kernel
def mark_of(walls, r, y, at_bottom):
    """Mark of a boundary and its cell at a position."""
    if at_bottom:
        return bed_at(walls, r, y, r)[4] + 2
    return ON_SURFACE if walls.surface.depth.size == 1 else -1 - surface_at(walls, r, y, r)[4]


@kernel
def append_code(code, mark):
    """Code of a ray's reflections after one more reflection; the last 10 bits count both kinds."""
    counts = code % 1024 + (32 if mark <= ON_SURFACE else 1)
    return ((code // 1024 * 8191 + mark) % _HASH) * 1024 + counts


@kernel
def landed(walls, r, y, bounce):
    """
    Cell of the bounce-th reflection of a ray at the sea bed.

    The function writes it to cells[LANDED]; the number after the last cell is the distance of the
    reflections beyond the edges of the held cells.
    """
    cell = bed_at(hold(walls, -1.0), r, y, r)[4]
    last = walls.cells.shape[1] - 1
    walls.cells[at.LANDED, min(bounce, last) - 1] = cell
    if walls.held >= 0.0:
        own = int(walls.cells[at.HELD, int(walls.held)])
        n, e = place_at(walls.line, r, y * walls.across)
        n_e = walls.bed.east.size
        beyond = max(_beyond(walls.bed.north, own // n_e, n), _beyond(walls.bed.east, own % n_e, e))
        walls.cells[at.LANDED, last] = (
            max(beyond, walls.cells[at.LANDED, last]) if bounce > 1 else beyond
        )
    return cell


@kernel
def _beyond(axis, i, x):
    """Distance of a point beyond a cell along one axis."""
    return max(axis[i] - x, x - axis[i + 1], 0.0) if axis.size > 1 else 0.0


@kernel
def across_plane(walls, share):
    """Return the same boundaries with a share of their slope across the plane."""
    return Walls(
        walls.bed,
        walls.surface,
        walls.line,
        walls.breaks,
        walls.n_breaks,
        share,
        walls.cells,
        walls.held,
    )


@kernel
def hold(walls, held):
    """
    Return boundaries with only the sea bed of the cell cells[HELD, held], extended beyond its
    edges; -1: all cells.
    """
    return Walls(
        walls.bed,
        walls.surface,
        walls.line,
        walls.breaks,
        walls.n_breaks,
        walls.across,
        walls.cells,
        held,
    )


@kernel
def _extreme_depth(grid, line, reach, sign):
    """
    Largest (sign 1) or smallest (sign -1) depth of a boundary within reach of a line: smallest and
    largest range, largest offset.

    Infinite in the direction of the sign if the line comes near the edges of the grid or crosses
    many cells.
    """
    depth, north, east = grid.depth, grid.north, grid.east
    first, last, side = reach
    lows, counts = (0, 0), (1, 1)
    if depth.size > 1:
        n0, n1 = line.north + first * line.unit_north, line.north + last * line.unit_north
        e0, e1 = line.east + first * line.unit_east, line.east + last * line.unit_east
        south, west = min(n0, n1) - side, min(e0, e1) - side
        n1, e1 = max(n0, n1) + side, max(e0, e1) + side
        inside = (north.size == 1 or north[0] <= south <= n1 <= north[north.size - 1]) and (
            east.size == 1 or east[0] <= west <= e1 <= east[east.size - 1]
        )
        i, j = interval_of(north, south), interval_of(east, west)
        lows, counts = (
            (i, j),
            (
                min(interval_of(north, n1) + 2, north.size) - i,
                min(interval_of(east, e1) + 2, east.size) - j,
            ),
        )
        if not inside or counts[0] * counts[1] > _MOST_NODES:
            return sign * math.inf
    extreme = -math.inf
    for i in range(lows[0], lows[0] + counts[0]):
        for j in range(lows[1], lows[1] + counts[1]):
            extreme = max(extreme, sign * depth[i, j])
    return sign * extreme


@kernel
def _certain_water(path, steps, walls, miss):
    """
    Depths between which a recorded path, with a miss of this size at its end, is certainly in the
    water. [m]
    """
    first, last, side = 0.0, 0.0, 0.0
    for i in range(steps + 1):
        first, last = min(first, path[i, at.RANGE]), max(last, path[i, at.RANGE])
        side = max(side, abs(path[i, at.SIDE]))
    reach = first, last, side + miss + _ASIDE
    top = _extreme_depth(walls.surface, walls.line, reach, 1.0)
    return top, _extreme_depth(walls.bed, walls.line, reach, -1.0)


@kernel
def clearances(path, steps, walls, miss_r, miss_z, miss_y):
    """
    Smallest distances of a recorded path from the surface and from the sea bed, negative beyond
    them. [m]

    Steps that are certainly between both do not count: a cubic remains within the depths of its
    Bezier points. The path is first corrected to end at the receiver: each point moves by a share
    of the miss that increases linearly in time.

    The function samples the cubic Hermite polynomial in time of every step at nine points, at its
    turning point, at each edge of the boundaries' cells, where peaks are, and at the vertex of the
    parabola through the three lowest samples, where a ridge inside a cell is nearest.
    """
    below_surface, above_bottom = math.inf, math.inf
    breaks = walls.breaks
    top, low = _certain_water(path, steps, walls, abs(miss_r) + abs(miss_z) + abs(miss_y))
    top, low = top + abs(miss_z), low - abs(miss_z)
    for i in range(steps):
        a, b = path[i], path[i + 1]
        h = b[at.TIME] - a[at.TIME]
        if h <= 0.0:
            continue
        # slopes in time at both ends, and the Bezier points of the depth
        n0 = a[at.P_RANGE] ** 2 + a[at.P_DEPTH] ** 2 + a[at.P_SIDE] ** 2
        n1 = b[at.P_RANGE] ** 2 + b[at.P_DEPTH] ** 2 + b[at.P_SIDE] ** 2
        r0, r1, dr0, dr1 = a[at.RANGE], b[at.RANGE], a[at.P_RANGE] / n0, b[at.P_RANGE] / n1
        z0, z1, dz0, dz1 = a[at.DEPTH], b[at.DEPTH], a[at.P_DEPTH] / n0, b[at.P_DEPTH] / n1
        middle0, middle1 = z0 + h * dz0 / 3.0, z1 - h * dz1 / 3.0
        if top < min(z0, z1, middle0, middle1) and max(z0, z1, middle0, middle1) < low:
            continue
        # edges of cells that the step crosses
        extra = 0
        first = 0
        while first < walls.n_breaks and breaks[first] <= min(r0, r1):
            first += 1
        while first + extra < walls.n_breaks and breaks[first + extra] < max(r0, r1):
            extra += 1
        # samples: nine points, edges, turning point and vertex
        turning = dz0 * dz1 < 0.0
        before, last, vertex, nearest = math.inf, math.inf, -1.0, math.inf
        for j in range(9 + extra + 2):
            if j < 9:
                t = j / 8.0
            elif j < 9 + extra:
                t = (breaks[first + j - 9] - r0) / (r1 - r0)
            elif j == 9 + extra and turning:
                t = dz0 / (dz0 - dz1)
            elif j > 9 + extra and vertex >= 0.0:
                t = vertex
            else:
                continue
            # distances there, with the share of the miss
            share = (a[at.TIME] + t * h) / path[steps, at.TIME]
            r = cubic(t, h, r0, dr0, r1, dr1) - share * miss_r
            z = cubic(t, h, z0, dz0, z1, dz1) - share * miss_z
            y = a[at.SIDE] + t * (b[at.SIDE] - a[at.SIDE]) - share * miss_y
            below_surface = min(below_surface, z - surface_at(walls, r, y, r)[0])
            n, e = place_at(walls.line, r, y)
            bed = _bilinear(walls.bed, walls.line, bilinear_weights(walls.bed, n, e, n, e), 1.0)[0]
            gap = bed - z
            above_bottom = min(above_bottom, gap)
            # vertex of the parabola through the lowest of the nine points
            if j < 9:
                if j > 1 and before + gap > 2.0 * last:
                    shift = 0.5 * (before - gap) / (before - 2.0 * last + gap)
                    if abs(shift) <= 1.0 and min(before, last, gap) < nearest:
                        vertex, nearest = (j - 1 + shift) / 8.0, min(before, last, gap)
                before, last = last, gap
    return below_surface, above_bottom


@kernel
def reflect(s, walls, cell, pos, ray, axis, hit, new_sb):
    """
    Reflect a ray on a boundary; the axis may change to the tilt new_sb = +-sb with cosine cb.

    Position x and slowness P in the section's plane vary with the launch angle. The point of
    incidence moves along the boundary by ``dx + P dt`` with ``N (dx + P dt) = 0``. The reflection
    is ``P -> P - 2 (P N) N``, where N varies with the curvature of the boundary. The function then
    converts the variation back to fixed distance along the axis. A ray of a fan stays in the plane
    and is not affected by the slope across it. Returns False if the ray does not leave forward
    along the axis.
    """
    z_source, cb, sb, c_ref = axis
    y = ray.y
    r = pos * cb - y[at.W] * sb
    z = z_source + pos * sb + y[at.W] * cb
    full = ray.K.shape[1] == at.N_FULL
    offset, q = 0.0, 0.0
    if full:
        offset, q = y[at.Y], y[at.Q]
    f_r, f_y, f_rr = 0.0, 0.0, 0.0
    if hit == at.AT_BOTTOM:
        _, f_r, f_y, f_rr, _ = bed_at(walls, r, offset, r)
    else:
        _, f_r, f_y, f_rr, _ = surface_at(walls, r, offset, r)
    if not full:
        f_y = 0.0
    b, k = cell
    if s.kind == at.SMOOTH:
        c, cz, cr, _, _, _, cy, cyz, cyy, _ = smooth_full(s, move_level(s.depth, k, z), r, z)
    else:
        c, cz, cr, _, _, _, cy, cyz, cyy, _ = linear_full(s, b, k, r, z)
    c += offset * (cy + 0.5 * offset * cyy)
    n = c_ref / c
    g_r, g_z = -n * n * cr / c, -n * n * (cz + offset * cyz) / c
    p = y[at.P]
    h = math.sqrt(max(n * n - p * p - q * q, 1e-12))
    p_r, p_z = h * cb - p * sb, h * sb + p * cb
    m2 = 1.0 + f_r * f_r + f_y * f_y
    dot = (f_r * p_r + f_y * q - p_z) / m2  # P N / |N|, N = (f_r, f_y, -1)
    new_r, new_z = p_r - 2.0 * dot * f_r, p_z + 2.0 * dot
    new_h = new_r * cb + new_z * new_sb
    if not new_h > 1e-3:
        return False
    # variation by the launch angle, in the plane
    x_r, x_z = -y[at.XI] * sb, y[at.XI] * cb
    h_var = (x_r * g_r + x_z * g_z - p * y[at.ETA]) / h
    v_r, v_z = h_var * cb - y[at.ETA] * sb, h_var * sb + y[at.ETA] * cb
    t = -(f_r * x_r - x_z) / (f_r * p_r - p_z)
    x_r, x_z = x_r + p_r * t, x_z + p_z * t
    v_r, v_z = v_r + g_r * t, v_z + g_z * t
    bend = f_rr * x_r
    norm = 1.0 / (1.0 + f_r * f_r)
    plane_dot = (f_r * p_r - p_z) * norm
    var_dot = (f_r * v_r - v_z + bend * p_r) * norm - 2.0 * plane_dot * f_r * bend * norm
    v_r, v_z = v_r - 2.0 * (var_dot * f_r + plane_dot * bend), v_z + 2.0 * var_dot
    t = -(x_r * cb + x_z * new_sb) / new_h
    y[at.W] = -r * new_sb if cb == 0.0 else y[at.W]
    y[at.P] = new_z * cb - new_r * new_sb
    y[at.XI] = (x_z + new_z * t) * cb - (x_r + new_r * t) * new_sb
    y[at.ETA] = (v_z + g_z * t) * cb - (v_r + g_r * t) * new_sb
    if full:
        y[at.Q] = q - 2.0 * dot * f_y
    return True


@kernel
def extremum(h, f0, d0, f1, d1):
    """
    Fraction of a step at which its cubic Hermite polynomial has zero slope; the slopes at the ends
    have different signs.
    """
    lo, hi = 0.0, 1.0
    a = 6.0 * (f0 - f1) / h + 3.0 * (d0 + d1)
    b = 6.0 * (f1 - f0) / h - 4.0 * d0 - 2.0 * d1
    t = d0 / (d0 - d1)
    for _ in range(60):
        g = d0 + t * (b + t * a)
        if (g > 0.0) == (d0 > 0.0):
            lo = t
        else:
            hi = t
        slope = b + 2.0 * a * t
        new = t - g / slope if slope != 0.0 else 0.5 * (lo + hi)
        if not lo < new < hi:
            new = 0.5 * (lo + hi)
        if abs(new - t) < 1e-14:
            break
        t = new
    return t


@inlined
def _face_distance(s, walls, cell, face, point, axis, nudge):
    """
    Signed distance from a face into the cell or the water, and its derivative along the axis.

    nudge moves the point along the ray before the choice of the boundary's cell.
    """
    z_source, cb, sb, _ = axis
    pos, w, dw, side, dside = point
    b, k = cell
    z = z_source + pos * sb + w * cb
    dz = sb + dw * cb
    if face == TOP:
        return (z - s.depth[k], dz) if k >= 0 else (_NONE, 0.0)
    if face == UNDERSIDE:
        return (s.depth[k + 1] - z, -dz) if k < s.depth.size - 1 else (_NONE, 0.0)
    r = pos * cb - w * sb
    dr = cb - dw * sb
    if face == NEAR:
        return (r - s.breaks[b], dr) if b > 0 else (_NONE, 0.0)
    if face == FAR:
        return (s.breaks[b + 1] - r, -dr) if b < s.n_range - 1 else (_NONE, 0.0)
    if face == SURFACE:
        top, f_r, f_y, _, _ = surface_at(walls, r, side, r + nudge * dr)
        return z - top, dz - (f_r * dr + f_y * dside)
    bed, f_r, f_y, _, _ = bed_at(walls, r, side, r + nudge * dr)
    return bed - z, f_r * dr + f_y * dside - dz


@kernel
def face_distance(s, walls, cell, face, point, axis, nudge):
    """As `_face_distance`, but not inlined, which reduces the time of compilation."""
    return _face_distance(s, walls, cell, face, point, axis, nudge)


@inlined
def _gap_within(walls, face, t, pos, h, ray, axis):
    """
    Distance from the sea bed or the surface, positive in the water, at the fraction t of a step.
    """
    z_source, cb, sb, _ = axis
    y, K, ynew = ray.y, ray.K, ray.ynew
    w = cubic(t, h, y[at.W], K[0, at.W], ynew[at.W], K[6, at.W])
    side = 0.0
    if K.shape[1] == at.N_FULL:
        side = cubic(t, h, y[at.Y], K[0, at.Y], ynew[at.Y], K[6, at.Y])
    s = pos + t * h
    r = s * cb - w * sb
    z = z_source + s * sb + w * cb
    if face == SURFACE:
        return z - surface_at(walls, r, side, r)[0]
    return bed_at(walls, r, side, r)[0] - z


@kernel
def _gridded_crossing(walls, face, pos, h, ray, axis):
    """
    Fraction of a step at which it meets a gridded boundary, or 9; off the baseline, edges of cells
    can be anywhere.
    """
    lo, hi = 0.0, 9.0
    above = True
    held = face == BOTTOM and walls.held >= 0.0
    if held:  # it may be below the extended bed of its next cell, or outside it
        above = -_LANDED < _gap_within(walls, face, 0.0, pos, h, ray, axis) < _BESIDE
    for j in range(_SAMPLES):
        t = (j + 1.0) / _SAMPLES
        gap = _gap_within(walls, face, t, pos, h, ray, axis)
        if gap < -ON_FACE and above:
            hi = t
            break
        above = not held or -ON_FACE < gap < _BESIDE
        lo = t
    if hi < 2.0:
        hi = _bisected(walls, face, lo, hi, (pos, h), ray, axis)
    if axis.cb == 0.0 and not held:
        ridge = _first_ridge(walls, face, hi, (pos, h), ray, axis)
        if ridge < hi:
            lo = math.floor(ridge * _SAMPLES) / _SAMPLES
            hi = _bisected(walls, face, lo, ridge, (pos, h), ray, axis)
    return hi


@kernel
def _bisected(walls, face, lo, hi, stride, ray, axis):
    """Fraction of a step between lo and hi at which it meets a gridded boundary, by bisection."""
    pos, h = stride
    for _ in range(40):
        t = 0.5 * (lo + hi)
        if _gap_within(walls, face, t, pos, h, ray, axis) > 0.0:
            lo = t
        else:
            hi = t
        if hi - lo < 1e-9:
            break
    return hi


@kernel
def _first_ridge(walls, face, before, stride, ray, axis):
    """
    Fraction of a vertical step, smaller than another, at which it is inside a ridge between the
    samples; otherwise 9.

    Ridges are at the edges of the boundary's cells. Steps of rays in range end at these edges, so
    only vertical steps miss them.
    """
    pos, h = stride
    near, far = -ray.y[at.W] * axis.sb, -ray.ynew[at.W] * axis.sb
    first = 9.0
    for i in range(walls.n_breaks):
        r = walls.breaks[i]
        if not min(near, far) < r < max(near, far):
            continue
        t = (r - near) / (far - near)
        if t < min(before, first) and _gap_within(walls, face, t, pos, h, ray, axis) < -ON_FACE:
            first = t
    return first


@kernel
def _cubic_crossing(h, g0, e0, g1, e1):
    """
    Fraction of a step at which a distance with these values and slopes at the ends becomes
    negative; otherwise 9.
    """
    lo, hi = 0.0, 1.0
    if e0 < 0.0 < e1:  # nearest in the middle
        t = extremum(h, g0, e0, g1, e1)
        if cubic(t, h, g0, e0, g1, e1) >= -ON_FACE:
            if g1 >= -ON_FACE:
                return 9.0
            lo = t
        else:
            hi = t
    elif g1 >= -ON_FACE:
        return 9.0
    elif e1 < 0.0 < e0:  # leaves the face, turns and comes back
        lo = extremum(h, g0, e0, g1, e1)
    for _ in range(50):
        t = 0.5 * (lo + hi)
        if cubic(t, h, g0, e0, g1, e1) > 0.0:
            lo = t
        else:
            hi = t
        if hi - lo < 1e-9:
            break
    return hi


@kernel
def crossing(s, walls, cell, faces, pos, h, ray, axis):
    """
    First face of some faces that a step crosses; the result of the step is in ynew and K[6].

    faces are the first, one past the last, and one between them that does not count, or -1. Returns
    the face and the step to it, or -1 and h. If faces coincide, the boundary of the water has
    priority.
    """
    best = h
    best_face = -1
    y, K, ynew = ray.y, ray.K, ray.ynew
    start = at.Point(pos, y[at.W], K[0, at.W], 0.0, 0.0)
    end = at.Point(pos + h, ynew[at.W], K[6, at.W], 0.0, 0.0)
    if K.shape[1] == at.N_FULL:
        start = at.Point(pos, y[at.W], K[0, at.W], y[at.Y], K[0, at.Y])
        end = at.Point(pos + h, ynew[at.W], K[6, at.W], ynew[at.Y], K[6, at.Y])
    first, past, without = faces
    for i in range(past - first):
        face = past - 1 - i
        if face == without:
            continue
        size = walls.bed.depth.size if face == BOTTOM else walls.surface.depth.size
        if face >= SURFACE and size > 1:
            t = _gridded_crossing(walls, face, pos, h, ray, axis)
            if t < 2.0 and (face == BOTTOM or best_face < 0 or t * h < best - 1e-6):
                best, best_face = t * h, face
            continue
        g0, e0 = _face_distance(s, walls, cell, face, start, axis, _NUDGE)
        if g0 >= _NONE:
            continue
        g1, e1 = _face_distance(s, walls, cell, face, end, axis, -_NUDGE)
        t = _cubic_crossing(h, g0, e0, g1, e1)
        if t < 2.0 and (best_face < 0 or t * h < best - 1e-6):
            best, best_face = t * h, face
    return best_face, best


@kernel
def land(s, walls, cell, face, pos, lengths, ray, axis):
    """
    Repeat a step with other `StepLengths` until it ends close enough to the face; return the
    length, or -1.
    """
    h, hi, near = lengths
    lo = 0.0
    ynew, K = ray.ynew, ray.K
    for _ in range(40):
        if not step(s, cell, pos, h, ray, axis):
            return -1.0
        side, dside = 0.0, 0.0
        if K.shape[1] == at.N_FULL:
            side, dside = ynew[at.Y], K[6, at.Y]
        point = at.Point(pos + h, ynew[at.W], K[6, at.W], side, dside)
        g, slope = face_distance(s, walls, cell, face, point, axis, 0.0)
        if abs(g) < near:
            return h
        if g > 0.0:
            lo = h
        else:
            hi = h
        new = h - g / slope if slope < 0.0 else 0.5 * (lo + hi)
        if not lo < new < hi:
            new = 0.5 * (lo + hi)
        if abs(new - h) < 1e-13 * (1.0 + pos):
            return h
        h = new
    return h


@kernel
def aim(s, walls, cell, pos, h, ray, axis):
    """
    Face that a direct ray along the horizontal seems to meet first within a step, and the step to
    it; otherwise -1 and h.

    The offset is a parabola here, with the curvature at the beginning of the step.
    """
    b, k = cell
    w, rate = ray.y[at.W], ray.K[0, at.W]
    z = axis.z_source + w
    best, face = h, -1
    if b < s.n_range - 1 and _SHORTEST_AIM < s.breaks[b + 1] - pos < best:
        best, face = s.breaks[b + 1] - pos, FAR
    field = linear_full(s, b, k, pos, z)
    bend = (1.0 + rate * rate) * (field[2] * rate - field[1]) / field[0]
    for one in (TOP, UNDERSIDE):
        gap = _face_distance(s, walls, cell, one, at.Point(pos, w, rate, 0.0, 0.0), axis, 0.0)
        distance, slope, half = gap[0], gap[1], 0.5 * (bend if one == TOP else -bend)
        inside = slope * slope - 4.0 * half * distance
        if distance < _BESIDE and inside > 0.0:  # the first root with a negative slope
            q = math.sqrt(inside) - slope
            t = 2.0 * distance / q if q > 0.0 else -1.0
            if t > _SHORTEST_AIM and t < best:
                best, face = t, one
    return face, best


@kernel
def settle(s, walls, cell, face, pos, lengths, ray, axis):
    """
    Move the end of a step along the ray onto the face at which it was aimed; return the length of
    the step, or -1 if the face is not near.

    The trapezoidal rule has no error over so short a distance.
    """
    h, longest, near = lengths
    ynew, K = ray.ynew, ray.K
    n_eq, longest = K.shape[1], min(_LONGEST_SETTLING, 0.1 * h, longest - h)
    for i in range(n_eq):  # stages of the step that are no longer needed
        K[1, i], K[2, i] = ynew[i], K[6, i]
    for _ in range(4):
        point = at.Point(pos + h, ynew[at.W], K[6, at.W], 0.0, 0.0)
        g, slope = face_distance(s, walls, cell, face, point, axis, 0.0)
        if abs(g) < near:
            return h
        if not slope < -_LEAST_SLOPE or abs(g) > -slope * longest:
            break
        more = -g / slope
        for i in range(n_eq):
            K[3, i] = ynew[i] + 0.5 * more * K[6, i]
            ynew[i] += more * K[6, i]
        h += more
        if not derivative(s, cell, pos + h, ynew, K[6], n_eq, axis):
            break
        for i in range(n_eq):
            ynew[i] = K[3, i] + 0.5 * more * K[6, i]
    for i in range(n_eq):
        ynew[i], K[6, i] = K[1, i], K[2, i]
    return -1.0


@kernel
def start_cell(s, axis, dw):
    """Range cell and layer in which a ray starts; on a face, its direction decides."""
    z_source, cb, sb, _ = axis
    b = 0
    rate = cb - dw * sb
    while b < s.n_range - 1 and (s.breaks[b + 1] < 0.0 or (s.breaks[b + 1] == 0.0 and rate >= 0.0)):
        b += 1
    n = s.depth.size
    if z_source > s.depth[n - 1]:
        return at.Cell(b, n - 1)
    if z_source < s.depth[0]:
        return at.Cell(b, -1)
    k = find_level(s, z_source)
    down = sb + dw * cb
    if z_source == s.depth[n - 1]:
        return at.Cell(b, n - 1 if down > 0.0 else n - 2)
    if z_source == s.depth[k] and down <= 0.0:
        if down < 0.0:
            return at.Cell(b, k - 1)
        # horizontal on a level: the layer towards which it bends
        below = linear_full(s, b, k, 0.0, z_source)[1]
        above = linear_full(s, b, k - 1, 0.0, z_source)[1]
        if below > 0.0 and above > 0.0:
            return at.Cell(b, k - 1)
    return at.Cell(b, k)
