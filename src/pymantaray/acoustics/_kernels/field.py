"""
Sound-speed field of one link: a vertical section of the 3-D medium along the baseline.

There are two kinds. ``SMOOTH``: columns at equally spaced ranges contain the field, its range
derivative and its first two cross-track derivatives at the depth levels, with their depth
derivatives. Interpolation between them is bicubic Hermite, and exact in depth at the columns.
``LINEAR``: the trilinear field itself, which along a straight baseline is quadratic in range
between crossings of grid lines, and linear in depth between levels. Off the baseline, both are
expanded to second order in the cross-track offset.

Rays that leave the water continue through a bounded extension of the field. The miss distance is
therefore a smooth function of the launch angle. The solver rejects such rays afterwards.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.layout import Baseline, FieldSection
from pymantaray.compile import entry, inlined, kernel, shared
from pymantaray.geometry.boundary_kernels import bilinear_weights

LUT_SIZE = 2048
_MIN_STEP = 50.0  # m; between columns
ABOVE_SCALE = 20.0  # m; length over which the extension above the surface becomes constant
BELOW_SCALE = 200.0  # m; the same below the deepest level


@inlined
def cubic(t, h, f0, d0, f1, d1):
    """Value of the cubic at the fraction t of an interval h, from values and slopes at its ends."""
    t2 = t * t
    t3 = t2 * t
    return (
        (1.0 - 3.0 * t2 + 2.0 * t3) * f0
        + (t - 2.0 * t2 + t3) * h * d0
        + (3.0 * t2 - 2.0 * t3) * f1
        + (t3 - t2) * h * d1
    )


@kernel
def cubic_slope(t, h, f0, d0, f1, d1):
    """Derivative of the cubic at the fraction t of an interval h, as `cubic`."""
    rise = 6.0 * t * (1.0 - t) * (f1 - f0) / h
    return rise + (1.0 - t) * (1.0 - 3.0 * t) * d0 + t * (3.0 * t - 2.0) * d1


@kernel
def cubic_root(h, f0, d0, f1, d1):
    """
    Fraction of an interval h at which the cubic is zero; the values at the ends have different
    signs.
    """
    lo, hi = 0.0, 1.0
    for _ in range(40):
        t = 0.5 * (lo + hi)
        if (cubic(t, h, f0, d0, f1, d1) > 0.0) == (f0 > 0.0):
            lo = t
        else:
            hi = t
    return 0.5 * (lo + hi)


@kernel
def sort_head(values, count):
    """Sort the first count values in place (insertion sort: short and nearly sorted input)."""
    for i in range(1, count):
        v = values[i]
        j = i - 1
        while j >= 0 and values[j] > v:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = v


@entry
def depth_lut(depth, lut):
    """
    Fill a table of starts for the search of `find_level`; return the number of entries per metre.

    A row contains the index of a layer, the depth of the level above it, and the depths of the two
    levels below, infinite beyond the last layer.
    """
    n = depth.size
    scale = LUT_SIZE / (depth[n - 1] - depth[0])
    k = 0
    for i in range(LUT_SIZE):
        z = depth[0] + i / scale
        while k < n - 2 and depth[k + 1] <= z:
            k += 1
        lut[i, 0], lut[i, 1] = k, depth[k]
        for j in range(2):
            lut[i, 2 + j] = depth[k + 1 + j] if k + 1 + j < n - 1 else math.inf
    return scale


@inlined
def find_level(s, z):
    """Index k with depth[k] <= z < depth[k+1], limited to the first and last layer."""
    depth = s.depth
    i = int((z - depth[0]) * s.lut_scale)
    if i < 0:
        return 0
    if i >= LUT_SIZE:
        return depth.size - 2
    k = int(s.lut[i, 0])
    while k < depth.size - 2 and z >= depth[k + 1]:
        k += 1
    return k


@inlined
def move_level(depth, k, z):
    """
    As `find_level`, but starting from a layer k near by; the processor can predict the branches of
    this search.
    """
    while k < depth.size - 2 and z >= depth[k + 1]:
        k += 1
    while k > 0 and z < depth[k]:
        k -= 1
    return k


@kernel
def bspline_basis(knots, degree, x, w, dw, ddw):
    """
    Compute values w and two derivatives of the degree + 1 B-splines that are not zero at x; return
    the index of the first.

    The function uses the recurrence of Cox and de Boor. Outside the knots, it extrapolates the
    pieces at the ends.
    """
    n = knots.size - degree - 1
    lo, hi = degree, n
    if n <= degree + 1:
        span = degree
    else:
        while hi - lo > 1:
            mid = (lo + hi) // 2
            if x < knots[mid]:
                hi = mid
            else:
                lo = mid
        span = lo
    w[0], dw[0], ddw[0] = 1.0, 0.0, 0.0
    for d in range(1, degree + 1):
        saved, saved_d, saved_dd = 0.0, 0.0, 0.0
        for i in range(d):
            right = knots[span + i + 1]
            left = knots[span + i + 1 - d]
            scale = 1.0 / (right - left)
            q, q_d, q_dd = w[i] * scale, dw[i] * scale, ddw[i] * scale
            w[i] = saved + (right - x) * q
            dw[i] = saved_d + (right - x) * q_d - q
            ddw[i] = saved_dd + (right - x) * q_dd - 2.0 * q_d
            saved = (x - left) * q
            saved_d = (x - left) * q_d + q
            saved_dd = (x - left) * q_dd + 2.0 * q_d
        w[d], dw[d], ddw[d] = saved, saved_d, saved_dd
    return span - degree


@inlined
def _product(q, north, east, line):
    """
    Value (q = 0), range derivative, or first or second cross-track derivative of a product, from
    those of both factors.
    """
    un, ue = line.unit_north, line.unit_east
    if q == 0:
        return north[0] * east[0]
    if q == 1:
        return north[1] * east[0] * un + north[0] * east[1] * ue
    if q == 2:
        return north[0] * east[1] * un - north[1] * east[0] * ue
    mixed = 2.0 * north[1] * east[1] * un * ue
    return north[0] * east[2] * un * un - mixed + north[2] * east[0] * ue * ue


@kernel
def _add_splines(coef, small, starts, degrees, units, acc):
    """
    Sum the B-splines that are not zero at a point into acc: values and slopes of the quantities of
    `_product`.

    small contains values and two derivatives of the splines in both directions, starts the first of
    them in coef. The arguments are few, because each column of a section calls this function.
    """
    line = Baseline(0.0, 0.0, units[0], units[1])
    wn, dn, ddn, we, de, dde = small[0], small[1], small[2], small[3], small[4], small[5]
    i_n, last = starts[0], starts[1] + degrees[1]
    for q in range(4):
        total = acc[q]
        for k in range(total.size):
            total[k] = 0.0
        for a in range(degrees[0] + 1):
            f0, f1, f2, f3 = 0.0, 0.0, 0.0, 0.0
            for b in range(degrees[1] + 1):
                f = _product(q, (wn[a], dn[a], ddn[a]), (we[b], de[b], dde[b]), line)
                f0, f1, f2, f3 = f1, f2, f3, f
            rows = coef[i_n + a]
            # four at a time; with a lower degree, the first have no weight
            row0, row1, row2, row3 = (
                rows[max(last - 3, 0)],
                rows[max(last - 2, 0)],
                rows[max(last - 1, 0)],
                rows[last],
            )
            for k in range(total.size):
                total[k] += f0 * row0[k] + f1 * row1[k] + f2 * row2[k] + f3 * row3[k]


@kernel
def _cut_smooth(domain, line, r_step, n_range, work):
    """Fill the columns of a SMOOTH section from B-spline coefficients (north, east, 2 * depth)."""
    depth, acc, small, data = domain.depth, work.acc, work.small, work.store
    n_depth, un, ue = depth.size, line.unit_north, line.unit_east
    wn, dn, ddn, we, de, dde = small[0], small[1], small[2], small[3], small[4], small[5]
    degrees = domain.degree_north, domain.degree_east
    for i in range(n_range):
        r = i * r_step
        first_n = bspline_basis(domain.knots_north, degrees[0], line.north + r * un, wn, dn, ddn)
        first_e = bspline_basis(domain.knots_east, degrees[1], line.east + r * ue, we, de, dde)
        _add_splines(domain.field, small, (first_n, first_e), degrees, (un, ue), acc)
        for k in range(n_depth - 1):
            i1 = 1.0 / (depth[k + 1] - depth[k])
            for q in range(4):
                f0, g0, g1 = acc[q, k], acc[q, n_depth + k], acc[q, n_depth + k + 1]
                rise = (acc[q, k + 1] - f0) * i1
                data[i, k, 4 * q] = f0
                data[i, k, 4 * q + 1] = g0
                data[i, k, 4 * q + 2] = (3.0 * rise - 2.0 * g0 - g1) * i1
                data[i, k, 4 * q + 3] = (g0 + g1 - 2.0 * rise) * (i1 * i1)


@kernel
def add_crossings(grid, line, r_hi, breaks, count):
    """
    Append the ranges up to r_hi, beyond the first of breaks, at which a line crosses lines of a
    grid; return their number.
    """
    for axis_index in range(2):
        axis = grid.north if axis_index == 0 else grid.east
        x0 = line.north if axis_index == 0 else line.east
        u = line.unit_north if axis_index == 0 else line.unit_east
        if axis.size < 2 or abs(u) < 1e-12:
            continue
        for i in range(1, axis.size - 1):
            r = (axis[i] - x0) / u
            if breaks[0] < r < r_hi and count < breaks.size - 1:
                breaks[count] = r
                count += 1
    return count


@kernel
def sort_breaks(r_hi, breaks, count):
    """Sort ranges, append r_hi and remove duplicates; return their number."""
    breaks[count] = r_hi
    count += 1
    sort_head(breaks, count)
    m = 1
    for i in range(1, count):
        if breaks[i] - breaks[m - 1] > 1e-9 or i == count - 1:
            if breaks[i] - breaks[m - 1] <= 1e-9 and m > 1:
                m -= 1
            breaks[m] = breaks[i]
            m += 1
    return m


@kernel
def _cut_linear(domain, line, breaks, n_cells, data):
    """
    Fill the cells of a LINEAR section: per cell and level c = d0 + d1 x + d2 x^2, c_y = d3 + d4 x,
    c_yy = d5.
    """
    field, un, ue = domain.field, line.unit_north, line.unit_east
    di = 1 if domain.north.size > 1 else 0
    dj = 1 if domain.east.size > 1 else 0
    for b in range(n_cells):
        r = breaks[b]
        r_mid = 0.5 * (breaks[b] + breaks[b + 1])
        i, j, sn, se, dn, de = bilinear_weights(
            domain,
            line.north + r * un,
            line.east + r * ue,
            line.north + r_mid * un,
            line.east + r_mid * ue,
        )
        an = un / dn if di else 0.0  # d(sn)/dr
        ae = ue / de if dj else 0.0
        bn = -ue / dn if di else 0.0  # d(sn)/dy, y to the right of the baseline
        be = un / de if dj else 0.0
        for k in range(field.shape[2]):
            f00 = field[i, j, k]
            f10 = field[i + di, j, k] - f00
            f01 = field[i, j + dj, k] - f00
            f11 = field[i + di, j + dj, k] - f00 - f10 - f01
            data[b, k, 0] = f00 + f10 * sn + f01 * se + f11 * sn * se
            data[b, k, 1] = f10 * an + f01 * ae + f11 * (an * se + sn * ae)
            data[b, k, 2] = f11 * an * ae
            data[b, k, 3] = f10 * bn + f01 * be + f11 * (bn * se + sn * be)
            data[b, k, 4] = f11 * (bn * ae + an * be)
            data[b, k, 5] = 2.0 * f11 * bn * be


@kernel
def column_count(domain, horizontal, most):
    """
    Number of columns of the section of a link with a horizontal distance; for LINEAR, as many as
    there are.
    """
    if domain.kind == at.LINEAR:
        return most
    if domain.uniform:
        return 2
    return min(max(int(math.ceil(horizontal / domain.column_step)) + 1, 2), most)


@shared
def cut_section(domain, line, horizontal, work):
    """Compute the section of the medium along a baseline into work.store."""
    store, breaks, levels = work.store, work.breaks, (domain.depth, domain.lut, domain.lut_scale)
    if domain.kind == at.SMOOTH:
        count = column_count(domain, horizontal, store.shape[0])
        # columns at both ends; beyond them, rays of short and steep links use the polynomial of the
        # first cell
        step = max(horizontal / (count - 1), _MIN_STEP)
        _cut_smooth(domain, line, step, count, work)
        return FieldSection(
            domain.kind, count, 0.0, step, breaks, *levels, store, domain.layered, domain.ladder
        )
    reach = 1000.0  # m beyond the ends; rays of steep links may extend behind the source
    breaks[0] = -reach
    count = 1 if domain.uniform else add_crossings(domain, line, horizontal + reach, breaks, 1)
    count = sort_breaks(horizontal + reach, breaks, count)
    _cut_linear(domain, line, breaks, count - 1, store)
    return FieldSection(
        domain.kind, count - 1, 0.0, 1.0, breaks, *levels, store, domain.layered, domain.ladder
    )


@inlined
def hermite(u, h):
    """
    Cubic Hermite weights for (f0, f0', f1, f1') on an interval of length h, and their derivatives.
    """
    u2 = u * u
    u3 = u2 * u
    i1 = 1.0 / h
    i2 = i1 * i1
    return (
        1.0 - 3.0 * u2 + 2.0 * u3,
        (u - 2.0 * u2 + u3) * h,
        3.0 * u2 - 2.0 * u3,
        (u3 - u2) * h,
        (6.0 * u2 - 6.0 * u) * i1,
        1.0 - 4.0 * u + 3.0 * u2,
        (6.0 * u - 6.0 * u2) * i1,
        3.0 * u2 - 2.0 * u,
        (12.0 * u - 6.0) * i2,
        (6.0 * u - 4.0) * i1,
        (6.0 - 12.0 * u) * i2,
        (6.0 * u - 2.0) * i1,
    )


@inlined
def _beyond(x, scale):
    """Weight of the slope at the edge, and its two derivatives, at a distance x beyond the edge."""
    q = x / scale
    f = 1.0 / (1.0 + q * q)
    g = math.sqrt(f)
    return x * g, f * g, -3.0 * q * f * f * g / scale


@inlined
def _smooth_place(s, k, r, z):
    """
    Column, fraction of the column step, and depth within layer k (limited to the water's levels).
    """
    last = s.depth.size - 1
    x = (r - s.r_first) / s.r_step
    i = min(max(int(x), 0), s.n_range - 2)
    return i, x - i, min(max(z, s.depth[0]), s.depth[last]) - s.depth[k]


@inlined
def _outside(s, z):
    """True if z is beyond the levels."""
    return z < s.depth[0] or z > s.depth[s.depth.size - 1]


@inlined
def _extension(s, z):
    """
    Weights of the slope at the edge in the extension and in its derivatives, at a depth beyond the
    levels.
    """
    if z < s.depth[0]:
        return _beyond(z - s.depth[0], ABOVE_SCALE)
    return _beyond(z - s.depth[s.depth.size - 1], BELOW_SCALE)


@inlined
def smooth_planar(s, k, r, z):
    """Sound speed and its derivatives in layer k of a SMOOTH section: c, c_z, c_zz."""
    i, t, x = _smooth_place(s, k, r, z)
    d = s.data
    t1 = 1.0 - t
    v0 = t1 * t1 * (1.0 + 2.0 * t)
    v1 = t1 * t1 * t * s.r_step
    v2 = t * t * (3.0 - 2.0 * t)
    v3 = -t * t * t1 * s.r_step
    a0 = v0 * d[i, k, 0] + v1 * d[i, k, 4] + v2 * d[i + 1, k, 0] + v3 * d[i + 1, k, 4]
    a1 = v0 * d[i, k, 1] + v1 * d[i, k, 5] + v2 * d[i + 1, k, 1] + v3 * d[i + 1, k, 5]
    a2 = v0 * d[i, k, 2] + v1 * d[i, k, 6] + v2 * d[i + 1, k, 2] + v3 * d[i + 1, k, 6]
    a3 = v0 * d[i, k, 3] + v1 * d[i, k, 7] + v2 * d[i + 1, k, 3] + v3 * d[i + 1, k, 7]
    c = a0 + x * (a1 + x * (a2 + x * a3))
    cz = a1 + x * (2.0 * a2 + 3.0 * x * a3)
    czz = 2.0 * a2 + 6.0 * x * a3
    if _outside(s, z):
        offset, slope, bend = _extension(s, z)
        return c + offset * cz, slope * cz, bend * cz
    return c, cz, czz


@inlined
def _column_at(s, i, k, x, z):
    """
    Quantities of column i at a depth x in layer k: c and c_r with two derivatives, c_y and c_yy
    with one.
    """
    d = s.data[i, k]
    f = d[0] + x * (d[1] + x * (d[2] + x * d[3]))
    fz = d[1] + x * (2.0 * d[2] + 3.0 * x * d[3])
    fzz = 2.0 * d[2] + 6.0 * x * d[3]
    g = d[4] + x * (d[5] + x * (d[6] + x * d[7]))
    gz = d[5] + x * (2.0 * d[6] + 3.0 * x * d[7])
    gzz = 2.0 * d[6] + 6.0 * x * d[7]
    b = d[8] + x * (d[9] + x * (d[10] + x * d[11]))
    bz = d[9] + x * (2.0 * d[10] + 3.0 * x * d[11])
    e = d[12] + x * (d[13] + x * (d[14] + x * d[15]))
    ez = d[13] + x * (2.0 * d[14] + 3.0 * x * d[15])
    if _outside(s, z):
        offset, slope, bend = _extension(s, z)
        f, fz, fzz = f + offset * fz, slope * fz, bend * fz
        g, gz, gzz = g + offset * gz, slope * gz, bend * gz
        b, bz, e, ez = b + offset * bz, slope * bz, e + offset * ez, slope * ez
    return f, fz, fzz, g, gz, gzz, b, bz, e, ez


@inlined
def smooth_full(s, k, r, z):
    """
    Sound speed and its derivatives in layer k of a SMOOTH section: c, c_z, c_r, c_zz, c_rz, c_rr,
    c_y, c_yz, c_yy, c_yyz.
    """
    i, t, x = _smooth_place(s, k, r, z)
    v0, v1, v2, v3, d0, d1, d2, d3, e0, e1, e2, e3 = hermite(t, s.r_step)
    f0, fz0, fzz0, g0, gz0, gzz0, b0, bz0, a0, az0 = _column_at(s, i, k, x, z)
    f1, fz1, fzz1, g1, gz1, gzz1, b1, bz1, a1, az1 = _column_at(s, i + 1, k, x, z)
    u = 1.0 - t
    return (
        (v0 * f0 + v1 * g0) + (v2 * f1 + v3 * g1),
        (v0 * fz0 + v1 * gz0) + (v2 * fz1 + v3 * gz1),
        (d0 * f0 + d1 * g0) + (d2 * f1 + d3 * g1),
        (v0 * fzz0 + v1 * gzz0) + (v2 * fzz1 + v3 * gzz1),
        (d0 * fz0 + d1 * gz0) + (d2 * fz1 + d3 * gz1),
        (e0 * f0 + e1 * g0) + (e2 * f1 + e3 * g1),
        u * b0 + t * b1,
        u * bz0 + t * bz1,
        u * a0 + t * a1,
        u * az0 + t * az1,
    )


@inlined
def smooth_beside(s, k, r, z, y):
    """
    Sound speed and its derivatives beside the plane, in layer k of a SMOOTH section: c, c_z, c_zz,
    c_y, c_yz, c_yy.
    """
    i, t, x = _smooth_place(s, k, r, z)
    d0, d1, u = s.data[i, k], s.data[i + 1, k], 1.0 - t
    v0 = u * u * (1.0 + 2.0 * t)
    v1 = u * u * t * s.r_step
    v2 = t * t * (3.0 - 2.0 * t)
    v3 = -t * t * u * s.r_step
    c, cz, czz, cy, cyz, cyy, cyyz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(3, -1, -1):  # Horner's scheme for the cubics and their derivatives by depth
        b, e = u * d0[8 + j] + t * d1[8 + j], u * d0[12 + j] + t * d1[12 + j]
        a = (v0 * d0[j] + v1 * d0[4 + j]) + (v2 * d1[j] + v3 * d1[4 + j]) + y * (b + 0.5 * y * e)
        czz = 2.0 * cz + x * czz
        cz, cyz, cyyz = c + x * cz, cy + x * cyz, cyy + x * cyyz
        c, cy, cyy = a + x * c, b + y * e + x * cy, e + x * cyy
    if _outside(s, z):
        offset, slope, bend = _extension(s, z)
        c, cz, czz = c + offset * cz, slope * cz, bend * cz
        cy, cyz, cyy = cy + offset * cyz, slope * cyz, cyy + offset * cyyz
    return c, cz, czz, cy, cyz, cyy


@inlined
def linear_full(s, b, k, r, z):
    """
    Sound speed and its derivatives in cell (b, k) of a LINEAR section: c, c_z, c_r, c_zz, c_rz,
    c_rr, c_y, c_yz, c_yy, c_yyz.

    k = -1 is the extension above the first level, and k = n - 1 that below the last.
    """
    x = r - s.breaks[b]
    n = s.depth.size
    kk = min(max(k, 0), n - 2)
    d = s.data
    dz = s.depth[kk + 1] - s.depth[kk]
    c0 = d[b, kk, 0] + x * (d[b, kk, 1] + x * d[b, kk, 2])
    c1 = d[b, kk + 1, 0] + x * (d[b, kk + 1, 1] + x * d[b, kk + 1, 2])
    r0 = d[b, kk, 1] + 2.0 * x * d[b, kk, 2]
    r1 = d[b, kk + 1, 1] + 2.0 * x * d[b, kk + 1, 2]
    y0 = d[b, kk, 3] + x * d[b, kk, 4]
    y1 = d[b, kk + 1, 3] + x * d[b, kk + 1, 4]
    if k == kk:
        u = (z - s.depth[kk]) / dz
        g = 1.0 / dz
        gg = 0.0
    elif k < 0:
        a, b1, c2 = _beyond(z - s.depth[0], ABOVE_SCALE)
        u = a / dz
        g = b1 / dz
        gg = c2 / dz
    else:
        a, b1, c2 = _beyond(z - s.depth[n - 1], BELOW_SCALE)
        u = 1.0 + a / dz
        g = b1 / dz
        gg = c2 / dz
    return (
        c0 + u * (c1 - c0),
        g * (c1 - c0),
        r0 + u * (r1 - r0),
        gg * (c1 - c0),
        g * (r1 - r0),
        2.0 * (d[b, kk, 2] + u * (d[b, kk + 1, 2] - d[b, kk, 2])),
        y0 + u * (y1 - y0),
        g * (y1 - y0),
        d[b, kk, 5] + u * (d[b, kk + 1, 5] - d[b, kk, 5]),
        g * (d[b, kk + 1, 5] - d[b, kk, 5]),
    )


@kernel
def field_at(s, r, z):
    """Sound speed at a point of the section."""
    k = find_level(s, z)
    if s.kind == at.SMOOTH:
        return smooth_planar(s, k, r, z)[0]
    b = 0
    while b < s.n_range - 1 and r >= s.breaks[b + 1]:
        b += 1
    if z < s.depth[0]:
        k = -1
    elif z > s.depth[s.depth.size - 1]:
        k = s.depth.size - 1
    return linear_full(s, b, k, r, z)[0]


@kernel
def level_speed(s, b, k):
    """Sound speed at a level in a column or at the near edge of a cell."""
    if s.kind == at.LINEAR or k < s.depth.size - 1:
        return s.data[b, k, 0]
    x = s.depth[k] - s.depth[k - 1]
    d = s.data
    return d[b, k - 1, 0] + x * (d[b, k - 1, 1] + x * (d[b, k - 1, 2] + x * d[b, k - 1, 3]))
