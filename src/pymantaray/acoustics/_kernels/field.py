"""Sound speed and its derivatives inside a section, and the continuation beyond the water.

Rays that leave the water are traced on through a bounded continuation of the field, so that the miss
distance stays a smooth function of the launch angle; such rays are rejected afterwards.
"""

import math

from pymantaray.acoustics._kernels.section import LINEAR, SMOOTH, find_level
from pymantaray.compile import inlined, kernel

ABOVE_SCALE = 20.0  # m; length over which the continuation above the surface bends to a constant
BELOW_SCALE = 200.0  # m; the same below the deepest level


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
def _smooth_place(s, k, r, z):
    """Column, fraction of the column step, and depth within layer k (limited to the water's levels)."""
    last = s.depth.size - 1
    x = (r - s.r_first) / s.r_step
    i = min(max(int(x), 0), s.n_range - 2)
    return i, x - i, min(max(z, s.depth[0]), s.depth[last]) - s.depth[k]


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
def smooth_planar(s, k, r, z):
    """Sound speed and its depth derivatives in layer k of a SMOOTH section: c, c_z, c_zz."""
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
    return _continue(s, z, c, cz, czz)


@inlined
def smooth_full(s, k, r, z):
    """Everything in layer k of a SMOOTH section: c, c_z, c_r, c_zz, c_rz, c_rr, c_y, c_yz, c_yy, c_yyz."""
    i, t, x = _smooth_place(s, k, r, z)
    d = s.data
    v = hermite(t, s.r_step)
    c, cz, czz, cr, crz, crr, cy, cyz, cyy, cyyz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
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
        a = d[i + m, k, 12] + x * (d[i + m, k, 13] + x * (d[i + m, k, 14] + x * d[i + m, k, 15]))
        az = d[i + m, k, 13] + x * (2.0 * d[i + m, k, 14] + 3.0 * x * d[i + m, k, 15])
        e = _continue(s, z, a, az, 0.0)
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
        cyy += u * e[0]
        cyyz += u * e[1]
    return c, cz, cr, czz, crz, crr, cy, cyz, cyy, cyyz


@inlined
def linear_full(s, b, k, r, z):
    """Everything in cell (b, k) of a LINEAR section: c, c_z, c_r, c_zz, c_rz, c_rr, c_y, c_yz, c_yy, c_yyz.

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
        d[b, kk, 5] + u * (d[b, kk + 1, 5] - d[b, kk, 5]),
        g * (d[b, kk + 1, 5] - d[b, kk, 5]),
    )


@kernel
def field_at(s, r, z):
    """Sound speed at a point of the section."""
    k = find_level(s.depth, s.lut, s.lut_scale, z)
    if s.kind == SMOOTH:
        return smooth_full(s, k, r, z)[0]
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
    if s.kind == LINEAR or k < s.depth.size - 1:
        return s.data[b, k, 0]
    x = s.depth[k] - s.depth[k - 1]
    d = s.data
    return d[b, k - 1, 0] + x * (d[b, k - 1, 1] + x * (d[b, k - 1, 2] + x * d[b, k - 1, 3]))
