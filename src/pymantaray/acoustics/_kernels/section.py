"""The sound-speed field of one link: a vertical section along the baseline, cut from the 3-D medium.

Two kinds. ``SMOOTH``: columns at equally spaced ranges hold the field, its range and cross-track
derivatives at the depth levels, with their depth derivatives; in between bicubic Hermite
interpolation, exact in depth at the columns. ``LINEAR``: the trilinear field itself, which along a
straight baseline is quadratic in range between the crossings of grid lines and linear in depth
between levels.

Rays that leave the water are traced on through a bounded continuation of the field, so that the miss
distance stays a smooth function of the launch angle; such rays are rejected afterwards.
"""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels.compile import inlined, kernel, sort_head


SMOOTH = 0
LINEAR = 1
ABOVE_SCALE = 20.0  # m; length over which the continuation above the surface bends to a constant
BELOW_SCALE = 200.0  # m; the same below the deepest level
LUT_SIZE = 2048

Section = namedtuple("Section", "kind n_range r_first r_step breaks depth lut lut_scale data")
Section.__doc__ = """Field along one baseline.

n_range columns (SMOOTH) or cells (LINEAR); breaks holds the cell edges (LINEAR);
lut maps depth to a level not below the cell's own. data is, for SMOOTH, (n_range, n_depth - 1, 12): the
cubics in depth of c, c_r and c_y in each layer; for LINEAR, (n_range, n_depth, 6).
"""


@kernel
def depth_lut(depth, lut):
    """Fill a table from which `find_level` starts its search; return the entries per metre."""
    n = depth.size
    scale = LUT_SIZE / (depth[n - 1] - depth[0])
    k = 0
    for i in range(LUT_SIZE):
        z = depth[0] + i / scale
        while k < n - 2 and depth[k + 1] <= z:
            k += 1
        lut[i] = k
    return scale


@inlined
def find_level(depth, lut, scale, z):
    """Index k with depth[k] <= z < depth[k+1], limited to the first and last layer."""
    i = int((z - depth[0]) * scale)
    if i < 0:
        return 0
    if i >= LUT_SIZE:
        return depth.size - 2
    k = int(lut[i])
    while k < depth.size - 2 and z >= depth[k + 1]:
        k += 1
    return k


@kernel
def bspline_basis(knots, degree, x, w, dw):
    """Values w and derivatives dw of the degree + 1 B-splines that are not zero at x; return the first's index.

    Cox and de Boor's recurrence; x outside the knots extrapolates the end pieces.
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
    w[0] = 1.0
    dw[0] = 0.0
    for d in range(1, degree + 1):
        saved = 0.0
        saved_d = 0.0
        for i in range(d):
            right = knots[span + i + 1]
            left = knots[span + i + 1 - d]
            q = w[i] / (right - left)
            if d == degree:
                dw[i] = saved_d - d * q
                saved_d = d * q
            w[i] = saved + (right - x) * q
            saved = (x - left) * q
        w[d] = saved
        if d == degree:
            dw[d] = saved_d
    return span - degree


@kernel
def cut_smooth(coef, knots_n, deg_n, knots_e, deg_e, depth, n0, e0, un, ue, r_first, r_step, n_range, data, small, acc):
    """Fill the columns of a SMOOTH section from B-spline coefficients (north, east, 2 * depth)."""
    n_depth = coef.shape[2] // 2
    wn, dn, we, de = small[0], small[1], small[2], small[3]
    for i in range(n_range):
        r = r_first + i * r_step
        i_n = bspline_basis(knots_n, deg_n, n0 + r * un, wn, dn)
        i_e = bspline_basis(knots_e, deg_e, e0 + r * ue, we, de)
        for q in range(3):
            for k in range(2 * n_depth):
                acc[q, k] = 0.0
        for a in range(deg_n + 1):
            for b in range(deg_e + 1):
                f = wn[a] * we[b]
                f_n = dn[a] * we[b]
                f_e = wn[a] * de[b]
                f_r = f_n * un + f_e * ue
                f_y = f_e * un - f_n * ue
                for k in range(2 * n_depth):
                    v = coef[i_n + a, i_e + b, k]
                    acc[0, k] += f * v
                    acc[1, k] += f_r * v
                    acc[2, k] += f_y * v
        for k in range(n_depth - 1):
            h = depth[k + 1] - depth[k]
            for q in range(3):
                f0, f1 = acc[q, k], acc[q, k + 1]
                g0, g1 = acc[q, n_depth + k], acc[q, n_depth + k + 1]
                rise = (f1 - f0) / h
                data[i, k, 4 * q] = f0
                data[i, k, 4 * q + 1] = g0
                data[i, k, 4 * q + 2] = (3.0 * rise - 2.0 * g0 - g1) / h
                data[i, k, 4 * q + 3] = (g0 + g1 - 2.0 * rise) / (h * h)


@kernel
def _cell(axis, x):
    """Index of the axis interval that holds x, limited to the axis; 0 on an axis of one point."""
    lo, hi = 0, axis.size - 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if x < axis[mid]:
            hi = mid
        else:
            lo = mid
    return lo


@kernel
def line_breaks(north, east, n0, e0, un, ue, r_lo, r_hi, breaks):
    """Sorted ranges in [r_lo, r_hi] where a line crosses grid lines, both ends included; return their number."""
    count = 0
    breaks[count] = r_lo
    count += 1
    for axis_index in range(2):
        axis = north if axis_index == 0 else east
        x0 = n0 if axis_index == 0 else e0
        u = un if axis_index == 0 else ue
        if axis.size < 2 or abs(u) < 1e-12:
            continue
        for i in range(1, axis.size - 1):
            r = (axis[i] - x0) / u
            if r_lo < r < r_hi and count < breaks.size - 1:
                breaks[count] = r
                count += 1
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
def bilinear_weights(north, east, n, e, n_mid, e_mid):
    """Cell of the point (n_mid, e_mid) and the local coordinates of (n, e) in it, with their metres."""
    i = _cell(north, n_mid)
    j = _cell(east, e_mid)
    sn = 0.0
    se = 0.0
    dn = 1.0
    de = 1.0
    if north.size > 1:
        dn = north[i + 1] - north[i]
        sn = (n - north[i]) / dn
    if east.size > 1:
        de = east[j + 1] - east[j]
        se = (e - east[j]) / de
    return i, j, sn, se, dn, de


@kernel
def cut_linear(field, north, east, n0, e0, un, ue, breaks, n_cells, data):
    """Fill the cells of a LINEAR section: per cell and level c = d0 + d1 x + d2 x^2, c_y = d3 + d4 x."""
    di = 1 if north.size > 1 else 0
    dj = 1 if east.size > 1 else 0
    for b in range(n_cells):
        r = breaks[b]
        r_mid = 0.5 * (breaks[b] + breaks[b + 1])
        i, j, sn, se, dn, de = bilinear_weights(
            north, east, n0 + r * un, e0 + r * ue, n0 + r_mid * un, e0 + r_mid * ue
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
            data[b, k, 5] = 0.0


@inlined
def hermite(u, h):
    """Cubic Hermite weights of (f0, f0', f1, f1') on an interval of length h, and their derivatives."""
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
    """Weight on the slope at the edge, and its two derivatives, at a distance x beyond the edge."""
    t = math.tanh(x / scale)
    s = 1.0 - t * t
    return scale * t, s, -2.0 * t * s / scale


@inlined
def _smooth_place(s, r, z):
    """Column, layer, fraction of the column step, and depth within the layer (limited to the water's levels)."""
    depth = s.depth
    last = depth.size - 1
    zc = min(max(z, depth[0]), depth[last])
    k = int(s.lut[min(int((zc - depth[0]) * s.lut_scale), LUT_SIZE - 1)])
    while k < last - 1 and zc >= depth[k + 1]:
        k += 1
    x = (r - s.r_first) / s.r_step
    i = min(max(int(x), 0), s.n_range - 2)
    return i, k, x - i, zc - depth[k]


@inlined
def smooth_planar(s, r, z):
    """Sound speed and its depth derivatives in a SMOOTH section: c, c_z, c_zz."""
    i, k, t, x = _smooth_place(s, r, z)
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
    return _continue(s, z, c, cz, czz)


@inlined
def _continue(s, z, c, cz, czz):
    """Value and derivatives of the continuation where z is beyond the levels, else as given."""
    if z < s.depth[0]:
        a, b, e = _beyond(z - s.depth[0], ABOVE_SCALE)
        return c + a * cz, b * cz, e * cz
    if z > s.depth[s.depth.size - 1]:
        a, b, e = _beyond(z - s.depth[s.depth.size - 1], BELOW_SCALE)
        return c + a * cz, b * cz, e * cz
    return c, cz, czz


@inlined
def smooth_full(s, r, z):
    """Everything in a SMOOTH section: c, c_z, c_r, c_zz, c_rz, c_rr, c_y, c_yz."""
    i, k, t, x = _smooth_place(s, r, z)
    d = s.data
    v = hermite(t, s.r_step)
    c, cz, czz, cr, crz, crr, cy, cyz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(2):
        a = d[i + m, k, 0] + x * (d[i + m, k, 1] + x * (d[i + m, k, 2] + x * d[i + m, k, 3]))
        az = d[i + m, k, 1] + x * (2.0 * d[i + m, k, 2] + 3.0 * x * d[i + m, k, 3])
        f = _continue(s, z, a, az, 2.0 * d[i + m, k, 2] + 6.0 * x * d[i + m, k, 3])
        a = d[i + m, k, 4] + x * (d[i + m, k, 5] + x * (d[i + m, k, 6] + x * d[i + m, k, 7]))
        az = d[i + m, k, 5] + x * (2.0 * d[i + m, k, 6] + 3.0 * x * d[i + m, k, 7])
        g = _continue(s, z, a, az, 2.0 * d[i + m, k, 6] + 6.0 * x * d[i + m, k, 7])
        a = d[i + m, k, 8] + x * (d[i + m, k, 9] + x * (d[i + m, k, 10] + x * d[i + m, k, 11]))
        az = d[i + m, k, 9] + x * (2.0 * d[i + m, k, 10] + 3.0 * x * d[i + m, k, 11])
        b = _continue(s, z, a, az, 0.0)
        v0, v1, d0, d1, e0, e1, u = v[0], v[1], v[4], v[5], v[8], v[9], 1.0 - t
        if m == 1:
            v0, v1, d0, d1, e0, e1, u = v[2], v[3], v[6], v[7], v[10], v[11], t
        c += v0 * f[0] + v1 * g[0]
        cz += v0 * f[1] + v1 * g[1]
        czz += v0 * f[2] + v1 * g[2]
        cr += d0 * f[0] + d1 * g[0]
        crz += d0 * f[1] + d1 * g[1]
        crr += e0 * f[0] + e1 * g[0]
        cy += u * b[0]
        cyz += u * b[1]
    return c, cz, cr, czz, crz, crr, cy, cyz


@inlined
def linear_full(s, b, k, r, z):
    """Everything in cell (b, k) of a LINEAR section: c, c_z, c_r, c_zz, c_rz, c_rr, c_y, c_yz.

    k = -1 is the continuation above the first level, k = n - 1 the one below the last.
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
    )
