"""Surface and sea bed along a baseline: depth and slope of the bottom, how near a ray comes, reflection."""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels.cubic import cubic
from pymantaray.acoustics._kernels.field import linear_full, smooth_full
from pymantaray.acoustics._kernels.section import SMOOTH, bilinear_weights, move_level
from pymantaray.acoustics._kernels.step import N_FULL
from pymantaray.compile import kernel

TOUCH = 1e-6  # m; a ray this far beyond a boundary still touches it only
IN_WATER, AT_SURFACE, AT_BOTTOM = 0, 1, 2

NO_BED = 1e30  # m
_CONTINUED = 1.5  # widths of a cell, from its middle: as far as its bed is continued

# rows of a floor's cells
LANDED, HELD, TRIED = 0, 1, 2

# columns of a recorded path: time [m at the source's sound speed], range, depth, cross-track offset [m],
# slowness along range, depth and cross-track [times the source's sound speed], boundary
TIME, RANGE, DEPTH, SIDE, P_RANGE, P_DEPTH, P_SIDE, BOUNDARY = 0, 1, 2, 3, 4, 5, 6, 7
N_PATH = 8

Bed = namedtuple("Bed", "north east depth")
Bed.__doc__ = """Bathymetry on its own axes, one point where it does not vary; bilinear."""

Floor = namedtuple("Floor", "north east bathymetry n0 e0 un ue breaks n_breaks across cells held")
Floor.__doc__ = """The sea bed under one baseline; breaks are the ranges at which it crosses grid lines, the ends too.

across, usually 1, is the share of its slope across the plane that counts. Row LANDED of cells takes the cells in which a ray
is reflected. Where held is not negative the bed is that of the cell cells[HELD, held] alone, continued beyond its
edges by as much as it is wide; there is none elsewhere and for a cell -1.
"""


@kernel
def _middle(axis, i):
    """Middle of a cell along one axis."""
    return 0.5 * (axis[i] + axis[i + 1]) if axis.size > 1 else axis[0]


@kernel
def floor_at(floor, r, y, r_cell):
    """Bilinear depth of the sea bed, its derivatives f_r, f_y and f_rr, and its cell, that of range r_cell."""
    north, east, n0, e0, un, ue = floor.north, floor.east, floor.n0, floor.e0, floor.un, floor.ue
    y *= floor.across
    n_cell, e_cell = n0 + r_cell * un - y * ue, e0 + r_cell * ue + y * un
    if floor.held >= 0.0:
        cell = int(floor.cells[HELD, int(floor.held)])
        if cell < 0:
            return NO_BED, 0.0, 0.0, 0.0, cell
        n_cell, e_cell = _middle(north, cell // east.size), _middle(east, cell % east.size)
    i, j, sn, se, dn, de = bilinear_weights(
        north, east, n0 + r * un - y * ue, e0 + r * ue + y * un, n_cell, e_cell
    )
    if floor.held >= 0.0 and max(abs(sn - 0.5), abs(se - 0.5)) > _CONTINUED:
        return NO_BED, 0.0, 0.0, 0.0, i * east.size + j
    di = 1 if north.size > 1 else 0
    dj = 1 if east.size > 1 else 0
    b = floor.bathymetry
    b00 = b[i, j]
    b10 = b[i + di, j] - b00
    b01 = b[i, j + dj] - b00
    b11 = b[i + di, j + dj] - b00 - b10 - b01
    f_n = (b10 + b11 * se) / dn
    f_e = (b01 + b11 * sn) / de
    return (
        b00 + b10 * sn + b01 * se + b11 * sn * se,
        f_n * un + f_e * ue,
        floor.across * (f_e * un - f_n * ue),
        2.0 * b11 / (dn * de) * un * ue,
        i * east.size + j,
    )


@kernel
def landed(floor, r, y, bounce):
    """Cell in which a ray is reflected at the sea bed for the bounce-th time.

    cells[LANDED] takes it, and after the last one how far beyond the edges of the held cells the ray has been reflected.
    """
    cell = floor_at(hold(floor, -1.0), r, y, r)[4]
    last = floor.cells.shape[1] - 1
    floor.cells[LANDED, min(bounce, last) - 1] = cell
    if floor.held >= 0.0:
        own = int(floor.cells[HELD, int(floor.held)])
        y *= floor.across
        n, e = floor.n0 + r * floor.un - y * floor.ue, floor.e0 + r * floor.ue + y * floor.un
        beyond = max(
            _beyond(floor.north, own // floor.east.size, n), _beyond(floor.east, own % floor.east.size, e)
        )
        floor.cells[LANDED, last] = max(beyond, floor.cells[LANDED, last]) if bounce > 1 else beyond
    return cell


@kernel
def _beyond(axis, i, x):
    """How far a point is beyond a cell along one axis."""
    return max(axis[i] - x, x - axis[i + 1], 0.0) if axis.size > 1 else 0.0


@kernel
def _with(floor, across, held):
    return Floor(
        floor.north,
        floor.east,
        floor.bathymetry,
        floor.n0,
        floor.e0,
        floor.un,
        floor.ue,
        floor.breaks,
        floor.n_breaks,
        across,
        floor.cells,
        held,
    )


@kernel
def across_plane(floor, share):
    """Give the same sea bed with a share of its slope across the plane."""
    return _with(floor, share, floor.held)


@kernel
def hold(floor, held):
    """Give the sea bed of the cell cells[HELD, held] alone, continued beyond its edges; -1: all of it."""
    return _with(floor, floor.across, held)


@kernel
def bottom_at(bed, n, e):
    """Bilinear depth of the sea bed."""
    north, east, bathymetry = bed.north, bed.east, bed.depth
    i, j, sn, se, _, _ = bilinear_weights(north, east, n, e, n, e)
    di = 1 if north.size > 1 else 0
    dj = 1 if east.size > 1 else 0
    b00 = bathymetry[i, j]
    b10 = bathymetry[i + di, j]
    b01 = bathymetry[i, j + dj]
    b11 = bathymetry[i + di, j + dj]
    return (b00 * (1.0 - sn) + b10 * sn) * (1.0 - se) + (b01 * (1.0 - sn) + b11 * sn) * se


@kernel
def clearances(path, steps, floor, miss_r, miss_z, miss_y):
    """Least distances of a recorded path from the surface and from the sea bed, negative beyond. [m]

    The path is turned onto the receiver: of its miss at the end every place gets its share in time.

    Every step's cubic Hermite in time is sampled, at nine points, at its turning point, at each edge of the
    bathymetry's cells, where its peaks are, and at the vertex of the parabola through the three lowest samples, where a
    cell's own ridge comes nearest.
    """
    below_surface, above_bottom = math.inf, math.inf
    breaks = floor.breaks
    for i in range(steps):
        a, b = path[i], path[i + 1]
        h = b[TIME] - a[TIME]
        if h <= 0.0:
            continue
        n0 = a[P_RANGE] ** 2 + a[P_DEPTH] ** 2 + a[P_SIDE] ** 2
        n1 = b[P_RANGE] ** 2 + b[P_DEPTH] ** 2 + b[P_SIDE] ** 2
        r0, r1, dr0, dr1 = a[RANGE], b[RANGE], a[P_RANGE] / n0, b[P_RANGE] / n1
        z0, z1, dz0, dz1 = a[DEPTH], b[DEPTH], a[P_DEPTH] / n0, b[P_DEPTH] / n1
        extra = 0
        first = 0
        while first < floor.n_breaks and breaks[first] <= min(r0, r1):
            first += 1
        while first + extra < floor.n_breaks and breaks[first + extra] < max(r0, r1):
            extra += 1
        turning = dz0 * dz1 < 0.0
        before, last, vertex = math.inf, math.inf, -1.0
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
            share = (a[TIME] + t * h) / path[steps, TIME]
            r = cubic(t, h, r0, dr0, r1, dr1) - share * miss_r
            z = cubic(t, h, z0, dz0, z1, dz1) - share * miss_z
            bed = floor_at(floor, r, a[SIDE] + t * (b[SIDE] - a[SIDE]) - share * miss_y, r)[0]
            below_surface = min(below_surface, z)
            gap = bed - z
            above_bottom = min(above_bottom, gap)
            if j < 9:
                if j > 1 and last <= before and last <= gap and before + gap > 2.0 * last:
                    vertex = (j - 1 + 0.5 * (before - gap) / (before - 2.0 * last + gap)) / 8.0
                before, last = last, gap
    return below_surface, above_bottom


@kernel
def reflect(s, floor, b, k, pos, y, n_eq, axis, at_bottom, new_sb):
    """Reflect a ray that is on a boundary; the axis may turn to the tilt new_sb = +-sb with cosine cb.

    With x the position and P the slowness in the section's plane, both varying with the launch angle, the
    point of incidence moves along the boundary by ``dx + P dt`` with ``N (dx + P dt) = 0``; there
    ``P -> P - 2 (P N) N``, N varying with the bottom's curvature; the variation is then taken
    back to fixed distance along the axis. A fan ray (n_eq = N_FAN) stays in the plane and
    does not see the slope across it. False where the ray does not leave forward along the axis.
    """
    z_source, cb, sb, c_ref = axis
    r = pos * cb - y[0] * sb
    z = z_source + pos * sb + y[0] * cb
    full = n_eq == N_FULL
    offset, q = 0.0, 0.0
    if full:
        offset, q = y[5], y[6]
    f_r, f_y, f_rr = 0.0, 0.0, 0.0
    if at_bottom:
        _, f_r, f_y, f_rr, _ = floor_at(floor, r, offset, r)
        if not full:
            f_y = 0.0
    if s.kind == SMOOTH:
        c, cz, cr, _, _, _, cy, cyz, cyy, _ = smooth_full(s, move_level(s.depth, k, z), r, z)
    else:
        c, cz, cr, _, _, _, cy, cyz, cyy, _ = linear_full(s, b, k, r, z)
    c += offset * (cy + 0.5 * offset * cyy)
    n = c_ref / c
    g_r, g_z = -n * n * cr / c, -n * n * (cz + offset * cyz) / c
    p = y[1]
    h = math.sqrt(max(n * n - p * p - q * q, 1e-12))
    p_r, p_z = h * cb - p * sb, h * sb + p * cb
    m2 = 1.0 + f_r * f_r + f_y * f_y
    dot = (f_r * p_r + f_y * q - p_z) / m2  # P N / |N|, N = (f_r, f_y, -1)
    new_r, new_z = p_r - 2.0 * dot * f_r, p_z + 2.0 * dot
    new_h = new_r * cb + new_z * new_sb
    if not new_h > 1e-3:
        return False
    # variation by the launch angle, in the plane
    x_r, x_z = -y[2] * sb, y[2] * cb
    h_var = (x_r * g_r + x_z * g_z - p * y[3]) / h
    v_r, v_z = h_var * cb - y[3] * sb, h_var * sb + y[3] * cb
    t = -(f_r * x_r - x_z) / (f_r * p_r - p_z)
    x_r, x_z = x_r + p_r * t, x_z + p_z * t
    v_r, v_z = v_r + g_r * t, v_z + g_z * t
    bend = f_rr * x_r
    norm = 1.0 / (1.0 + f_r * f_r)
    plane_dot = (f_r * p_r - p_z) * norm
    var_dot = (f_r * v_r - v_z + bend * p_r) * norm - 2.0 * plane_dot * f_r * bend * norm
    v_r, v_z = v_r - 2.0 * (var_dot * f_r + plane_dot * bend), v_z + 2.0 * var_dot
    t = -(x_r * cb + x_z * new_sb) / new_h
    y[0] = -r * new_sb if cb == 0.0 else y[0]
    y[1] = new_z * cb - new_r * new_sb
    y[2] = (x_z + new_z * t) * cb - (x_r + new_r * t) * new_sb
    y[3] = (v_z + g_z * t) * cb - (v_r + g_r * t) * new_sb
    if full:
        y[6] = q - 2.0 * dot * f_y
    return True
