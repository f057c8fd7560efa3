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

import numpy as np
from numba import njit

SMOOTH = 0
LINEAR = 1
ABOVE_SCALE = 20.0  # m; length over which the continuation above the surface bends to a constant
BELOW_SCALE = 200.0  # m; the same below the deepest level
LUT_SIZE = 2048

Section = namedtuple("Section", "kind n_range r_first r_step breaks depth lut lut_scale data")
Section.__doc__ = """Field along one baseline.

n_range columns (SMOOTH) or cells (LINEAR); breaks holds the cell edges (LINEAR);
lut maps depth to a level not below the cell's own; data is (n_range, n_depth, 6).
"""


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def cut_smooth(coef, knots_n, deg_n, knots_e, deg_e, n0, e0, un, ue, r_first, r_step, n_range, data):
    """Fill the columns of a SMOOTH section from B-spline coefficients (north, east, 2 * depth)."""
    n_depth = coef.shape[2] // 2
    wn, dn = np.empty(4), np.empty(4)
    we, de = np.empty(4), np.empty(4)
    acc = np.empty((3, coef.shape[2]))
    for i in range(n_range):
        r = r_first + i * r_step
        i_n = bspline_basis(knots_n, deg_n, n0 + r * un, wn, dn)
        i_e = bspline_basis(knots_e, deg_e, e0 + r * ue, we, de)
        acc[:] = 0.0
        for a in range(deg_n + 1):
            for b in range(deg_e + 1):
                f = wn[a] * we[b]
                f_n = dn[a] * we[b]
                f_e = wn[a] * de[b]
                f_r = f_n * un + f_e * ue
                f_y = f_e * un - f_n * ue
                row = coef[i_n + a, i_e + b]
                for k in range(row.size):
                    v = row[k]
                    acc[0, k] += f * v
                    acc[1, k] += f_r * v
                    acc[2, k] += f_y * v
        for k in range(n_depth):
            for q in range(3):
                data[i, k, 2 * q] = acc[q, k]
                data[i, k, 2 * q + 1] = acc[q, n_depth + k]


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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
    breaks[:count].sort()
    m = 1
    for i in range(1, count):
        if breaks[i] - breaks[m - 1] > 1e-9 or i == count - 1:
            if breaks[i] - breaks[m - 1] <= 1e-9 and m > 1:
                m -= 1
            breaks[m] = breaks[i]
            m += 1
    return m


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _beyond(x, scale):
    """Weight on the slope at the edge, and its two derivatives, at a distance x beyond the edge."""
    t = math.tanh(x / scale)
    s = 1.0 - t * t
    return scale * t, s, -2.0 * t * s / scale


@njit(cache=True, nogil=True, error_model="numpy")
def smooth_depth_weights(depth, k, z):
    """Weights of (f_k, f_k', f_k+1, f_k+1') for value, first and second depth derivative."""
    if z < depth[0]:
        a, b, c = _beyond(z - depth[0], ABOVE_SCALE)
        return 1.0, a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c, 0.0, 0.0
    if z > depth[depth.size - 1]:
        a, b, c = _beyond(z - depth[depth.size - 1], BELOW_SCALE)
        return 0.0, 0.0, 1.0, a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c
    dz = depth[k + 1] - depth[k]
    return hermite((z - depth[k]) / dz, dz)


@njit(cache=True, nogil=True, error_model="numpy")
def smooth_planar(s, r, z):
    """Sound speed and its depth derivatives in a SMOOTH section: c, c_z, c_zz."""
    k = find_level(s.depth, s.lut, s.lut_scale, z)
    w = smooth_depth_weights(s.depth, k, z)
    x = (r - s.r_first) / s.r_step
    i = min(max(int(x), 0), s.n_range - 2)
    v = hermite(x - i, s.r_step)
    p = s.data[i, k]
    q = s.data[i, k + 1]
    c = v[0] * (w[0] * p[0] + w[1] * p[1] + w[2] * q[0] + w[3] * q[1])
    c += v[1] * (w[0] * p[2] + w[1] * p[3] + w[2] * q[2] + w[3] * q[3])
    cz = v[0] * (w[4] * p[0] + w[5] * p[1] + w[6] * q[0] + w[7] * q[1])
    cz += v[1] * (w[4] * p[2] + w[5] * p[3] + w[6] * q[2] + w[7] * q[3])
    czz = v[0] * (w[8] * p[0] + w[9] * p[1] + w[10] * q[0] + w[11] * q[1])
    czz += v[1] * (w[8] * p[2] + w[9] * p[3] + w[10] * q[2] + w[11] * q[3])
    p = s.data[i + 1, k]
    q = s.data[i + 1, k + 1]
    c += v[2] * (w[0] * p[0] + w[1] * p[1] + w[2] * q[0] + w[3] * q[1])
    c += v[3] * (w[0] * p[2] + w[1] * p[3] + w[2] * q[2] + w[3] * q[3])
    cz += v[2] * (w[4] * p[0] + w[5] * p[1] + w[6] * q[0] + w[7] * q[1])
    cz += v[3] * (w[4] * p[2] + w[5] * p[3] + w[6] * q[2] + w[7] * q[3])
    czz += v[2] * (w[8] * p[0] + w[9] * p[1] + w[10] * q[0] + w[11] * q[1])
    czz += v[3] * (w[8] * p[2] + w[9] * p[3] + w[10] * q[2] + w[11] * q[3])
    return c, cz, czz


@njit(cache=True, nogil=True, error_model="numpy")
def smooth_full(s, r, z):
    """Everything in a SMOOTH section: c, c_z, c_r, c_zz, c_rz, c_rr, c_y, c_yz."""
    k = find_level(s.depth, s.lut, s.lut_scale, z)
    w = smooth_depth_weights(s.depth, k, z)
    x = (r - s.r_first) / s.r_step
    i = min(max(int(x), 0), s.n_range - 2)
    v = hermite(x - i, s.r_step)
    c = 0.0
    cz = 0.0
    cr = 0.0
    czz = 0.0
    crz = 0.0
    crr = 0.0
    cy = 0.0
    cyz = 0.0
    for m in range(2):
        p = s.data[i + m, k]
        q = s.data[i + m, k + 1]
        f = w[0] * p[0] + w[1] * p[1] + w[2] * q[0] + w[3] * q[1]
        g = w[0] * p[2] + w[1] * p[3] + w[2] * q[2] + w[3] * q[3]
        fz = w[4] * p[0] + w[5] * p[1] + w[6] * q[0] + w[7] * q[1]
        gz = w[4] * p[2] + w[5] * p[3] + w[6] * q[2] + w[7] * q[3]
        fzz = w[8] * p[0] + w[9] * p[1] + w[10] * q[0] + w[11] * q[1]
        gzz = w[8] * p[2] + w[9] * p[3] + w[10] * q[2] + w[11] * q[3]
        v0, v1, d0, d1, e0, e1 = v[0], v[1], v[4], v[5], v[8], v[9]
        t = 1.0 - (x - i)
        if m == 1:
            v0, v1, d0, d1, e0, e1 = v[2], v[3], v[6], v[7], v[10], v[11]
            t = x - i
        c += v0 * f + v1 * g
        cz += v0 * fz + v1 * gz
        czz += v0 * fzz + v1 * gzz
        cr += d0 * f + d1 * g
        crz += d0 * fz + d1 * gz
        crr += e0 * f + e1 * g
        cy += t * (w[0] * p[4] + w[1] * p[5] + w[2] * q[4] + w[3] * q[5])
        cyz += t * (w[4] * p[4] + w[5] * p[5] + w[6] * q[4] + w[7] * q[5])
    return c, cz, cr, czz, crz, crr, cy, cyz


@njit(cache=True, nogil=True, error_model="numpy")
def linear_full(s, b, k, r, z):
    """Everything in cell (b, k) of a LINEAR section: c, c_z, c_r, c_zz, c_rz, c_rr, c_y, c_yz.

    k = -1 is the continuation above the first level, k = n - 1 the one below the last.
    """
    x = r - s.breaks[b]
    n = s.depth.size
    kk = min(max(k, 0), n - 2)
    p = s.data[b, kk]
    q = s.data[b, kk + 1]
    dz = s.depth[kk + 1] - s.depth[kk]
    c0 = p[0] + x * (p[1] + x * p[2])
    c1 = q[0] + x * (q[1] + x * q[2])
    r0 = p[1] + 2.0 * x * p[2]
    r1 = q[1] + 2.0 * x * q[2]
    y0 = p[3] + x * p[4]
    y1 = q[3] + x * q[4]
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
        2.0 * (p[2] + u * (q[2] - p[2])),
        y0 + u * (y1 - y0),
        g * (y1 - y0),
    )
