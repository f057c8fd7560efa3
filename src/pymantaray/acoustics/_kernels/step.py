"""Hamilton's equations of a ray with their variation, and one Dormand-Prince 5(4) step of them.

The independent variable is the distance ``s`` along an axis through the source in the section's plane,
either the horizontal or the chord, tilted by an angle with cosine ``cb`` and sine ``sb``. With
``n = c_ref / c``, ``w`` the offset across the axis in the plane (towards greater depth) and ``y`` the
offset out of the plane (to the right), conjugate slownesses ``p`` and ``q`` and ``h = sqrt(n^2 - p^2 - q^2)``:

    w' = p / h,   p' = n n_w / h,   y' = q / h,   q' = n n_y / h,   T' = n^2 / h

Rays therefore end exactly on the plane through the receiver. ``xi`` and ``eta`` are the derivatives of
``w`` and ``p`` by the launch angle; ``A`` is the integral of ``1 / h``, the derivative of ``y`` by ``q``.

State vector: w, p, xi, eta, T, y, q, A. A fan needs the first four only.
"""

import math

from pymantaray.acoustics._kernels.compile import inlined, kernel
from pymantaray.acoustics._kernels.field import linear_full, smooth_full, smooth_planar
from pymantaray.acoustics._kernels.section import SMOOTH

N_FULL = 8
N_FAN = 4

# Dormand and Prince (1980), the pair RK5(4)7M; the tests compare it with scipy.integrate.RK45
A21 = 1 / 5
A31, A32 = 3 / 40, 9 / 40
A41, A42, A43 = 44 / 45, -56 / 15, 32 / 9
A51, A52, A53, A54 = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
A61, A62, A63, A64, A65 = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
B1, B3, B4, B5, B6 = 35 / 384, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
E1, E3, E4, E5, E6, E7 = 71 / 57600, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40


@kernel
def derivative(s, b, k, pos, y, dy, n_eq, axis):
    """Right-hand side; False where the ray has turned across the axis.

    axis = (z_source, cb, sb, c_ref); c_ref is the sound speed at the source, so that n = 1 there.
    """
    z_source, cb, sb, c_ref = axis
    r = pos * cb - y[0] * sb
    z = z_source + pos * sb + y[0] * cb
    cr, crz, crr, cy, cyw = 0.0, 0.0, 0.0, 0.0, 0.0
    if s.kind == SMOOTH:
        if n_eq == N_FAN and sb == 0.0:
            c, cz, czz = smooth_planar(s, r, z)
        else:
            c, cz, cr, czz, crz, crr, cy, cyw = smooth_full(s, r, z)
    else:
        c, cz, cr, czz, crz, crr, cy, cyw = linear_full(s, b, k, r, z)
    cw = cz * cb - cr * sb
    cww = czz * cb * cb - 2.0 * crz * cb * sb + crr * sb * sb
    q = 0.0
    if n_eq == N_FULL:
        c += cy * y[5]
        cw += cyw * cb * y[5]
        q = y[6]
    p = y[1]
    ic = 1.0 / c
    n = c_ref * ic
    nw = -n * cw * ic
    nww = n * ic * (2.0 * cw * cw * ic - cww)
    h2 = n * n - p * p - q * q
    if not h2 > 1e-6:
        return False
    ih = 1.0 / math.sqrt(h2)
    ih3 = ih * ih * ih
    nnw = n * nw
    dy[0] = p * ih
    dy[1] = nnw * ih
    dy[2] = (ih + p * p * ih3) * y[3] - p * nnw * ih3 * y[2]
    dy[3] = ((nw * nw + n * nww) * ih - nnw * nnw * ih3) * y[2] + nnw * p * ih3 * y[3]
    if n_eq == N_FULL:
        dy[4] = n * n * ih
        dy[5] = q * ih
        dy[6] = -n * n * cy * ic * ih
        dy[7] = ih
    return True


@kernel
def step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
    """One Dormand-Prince step from K[0] = derivative at pos; leaves the derivative at the end in K[6]."""
    for i in range(n_eq):
        ynew[i] = y[i] + h * A21 * K[0, i]
    if not derivative(s, b, k, pos + 0.2 * h, ynew, K[1], n_eq, axis):
        return False
    for i in range(n_eq):
        ynew[i] = y[i] + h * (A31 * K[0, i] + A32 * K[1, i])
    if not derivative(s, b, k, pos + 0.3 * h, ynew, K[2], n_eq, axis):
        return False
    for i in range(n_eq):
        ynew[i] = y[i] + h * (A41 * K[0, i] + A42 * K[1, i] + A43 * K[2, i])
    if not derivative(s, b, k, pos + 0.8 * h, ynew, K[3], n_eq, axis):
        return False
    for i in range(n_eq):
        ynew[i] = y[i] + h * (A51 * K[0, i] + A52 * K[1, i] + A53 * K[2, i] + A54 * K[3, i])
    if not derivative(s, b, k, pos + 8.0 / 9.0 * h, ynew, K[4], n_eq, axis):
        return False
    for i in range(n_eq):
        ynew[i] = y[i] + h * (A61 * K[0, i] + A62 * K[1, i] + A63 * K[2, i] + A64 * K[3, i] + A65 * K[4, i])
    if not derivative(s, b, k, pos + h, ynew, K[5], n_eq, axis):
        return False
    for i in range(n_eq):
        ynew[i] = y[i] + h * (B1 * K[0, i] + B3 * K[2, i] + B4 * K[3, i] + B5 * K[4, i] + B6 * K[5, i])
    return derivative(s, b, k, pos + h, ynew, K[6], n_eq, axis)


@inlined
def step_error(h, K, n_eq, remaining):
    """Estimated displacement at the end of the ray that this step's error causes. [m]"""
    total = 0.0
    for i in range(n_eq):
        weight = 1.0 if i == 0 or i == 4 or i == 5 else (remaining if i == 1 else 0.0)
        if weight > 0.0:
            total += weight * abs(
                E1 * K[0, i] + E3 * K[2, i] + E4 * K[3, i] + E5 * K[4, i] + E6 * K[5, i] + E7 * K[6, i]
            )
    return abs(h) * total
