"""The sound-speed field of one link: a vertical section along the baseline, cut from the 3-D medium.

Two kinds. ``SMOOTH``: columns at equally spaced ranges hold the field, its range derivative and its first
two cross-track derivatives at the depth levels, with their depth derivatives; in between bicubic Hermite
interpolation, exact in depth at the columns. ``LINEAR``: the trilinear field itself, which along a
straight baseline is quadratic in range between the crossings of grid lines and linear in depth
between levels. Off the baseline both are expanded to second order in the cross-track offset.
"""

import math
from collections import namedtuple

from pymantaray.compile import entry, inlined, kernel

SMOOTH = 0
LINEAR = 1
LUT_SIZE = 2048
MAX_COLUMNS = 1024
MIN_STEP = 50.0  # m

Section = namedtuple("Section", "kind n_range r_first r_step breaks depth lut lut_scale data")
Section.__doc__ = """Field along one baseline.

n_range columns (SMOOTH) or cells (LINEAR); breaks holds the cell edges (LINEAR);
lut maps depth to a level not below the cell's own. data is, for SMOOTH, (n_range, n_depth - 1, 16): the
cubics in depth of c, c_r, c_y and c_yy in each layer; for LINEAR, (n_range, n_depth, 6).
"""


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


@inlined
def move_level(depth, k, z):
    """As `find_level`, from a layer k near by: what the processor can guess it need not wait for."""
    while k < depth.size - 2 and z >= depth[k + 1]:
        k += 1
    while k > 0 and z < depth[k]:
        k -= 1
    return k


@kernel
def bspline_basis(knots, degree, x, w, dw, ddw):
    """Values w and two derivatives of the degree + 1 B-splines that are not zero at x; return the first's index.

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


@kernel
def cut_smooth(
    coef, knots_n, deg_n, knots_e, deg_e, depth, n0, e0, un, ue, r_first, r_step, n_range, data, small, acc
):
    """Fill the columns of a SMOOTH section from B-spline coefficients (north, east, 2 * depth)."""
    n_depth = coef.shape[2] // 2
    wn, dn, ddn, we, de, dde = small[0], small[1], small[2], small[3], small[4], small[5]
    for i in range(n_range):
        r = r_first + i * r_step
        i_n = bspline_basis(knots_n, deg_n, n0 + r * un, wn, dn, ddn)
        i_e = bspline_basis(knots_e, deg_e, e0 + r * ue, we, de, dde)
        for q in range(4):
            for k in range(2 * n_depth):
                acc[q, k] = 0.0
        for a in range(deg_n + 1):
            for b in range(deg_e + 1):
                f = wn[a] * we[b]
                f_n = dn[a] * we[b]
                f_e = wn[a] * de[b]
                f_r = f_n * un + f_e * ue
                f_y = f_e * un - f_n * ue
                f_yy = wn[a] * dde[b] * un * un - 2.0 * dn[a] * de[b] * un * ue + ddn[a] * we[b] * ue * ue
                for k in range(2 * n_depth):
                    v = coef[i_n + a, i_e + b, k]
                    acc[0, k] += f * v
                    acc[1, k] += f_r * v
                    acc[2, k] += f_y * v
                    acc[3, k] += f_yy * v
        for k in range(n_depth - 1):
            h = depth[k + 1] - depth[k]
            for q in range(4):
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
    """Fill the cells of a LINEAR section: per cell and level c = d0 + d1 x + d2 x^2, c_y = d3 + d4 x, c_yy = d5."""
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
            data[b, k, 5] = 2.0 * f11 * bn * be


@kernel
def cut_section(medium, n0, e0, un, ue, horizontal, work):
    """Section of the medium along a baseline, filled into work.store."""
    store, breaks = work.store, work.breaks
    kind, north, east, depth, field, knots_n, deg_n, knots_e, deg_e, lut, lut_scale, column_step = medium
    if kind == SMOOTH:
        count = 2
        if north.size > 1 or east.size > 1:
            count = min(max(int(math.ceil(horizontal / column_step)) + 1, 2), store.shape[0])
        # columns at both ends; rays of short and steep links use the first cell's polynomial beyond them
        step = max(horizontal / (count - 1), MIN_STEP)
        cut_smooth(
            field,
            knots_n,
            deg_n,
            knots_e,
            deg_e,
            depth,
            n0,
            e0,
            un,
            ue,
            0.0,
            step,
            count,
            store,
            work.small,
            work.acc,
        )
        return Section(SMOOTH, count, 0.0, step, breaks, depth, lut, lut_scale, store)
    reach = 1000.0  # m beyond the ends; rays of steep links stray behind the source
    count = line_breaks(north, east, n0, e0, un, ue, -reach, horizontal + reach, breaks) - 1
    cut_linear(field, north, east, n0, e0, un, ue, breaks, count, store)
    return Section(LINEAR, count, 0.0, 1.0, breaks, depth, lut, lut_scale, store)
