"""
Hamilton's equations of a ray with their variation, and one Dormand-Prince 5(4) step of them.

The independent variable is the distance ``s`` along an axis through the source in the section's
plane. The axis is horizontal, or the chord, with a tilt of cosine ``cb`` and sine ``sb``. With ``n
= c_ref / c``, the offset ``w`` across the axis in the plane (towards greater depth), the offset
``y`` out of the plane (to the right), the conjugate slownesses ``p`` and ``q``, and ``h = sqrt(n^2
- p^2 - q^2)``:

    w' = p / h,   p' = n n_w / h,   y' = q / h,   q' = n n_y / h,   T' = n^2 / h

Rays therefore end exactly on the plane through the receiver. ``xi`` and ``eta`` are the derivatives
of ``w`` and ``p`` by the launch angle; ``A`` is the integral of ``1 / h``, the derivative of ``y``
by ``q``.

`layout` contains the names of the state vector's columns; that of A is DY_DQ. A fan needs only the
first four.
"""

import math

import numpy as np

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.field import linear_full, move_level, smooth_full, smooth_planar
from pymantaray.compile import inlined, kernel, shared

# relative accuracy of the ray tube's width: 0.004 dB; and for a fan's ray with steps that end at
# the levels
TUBE, FAN_TUBE = 1e-3, 2e-3
MIN_WIDTH = 0.05  # minimum width of a tube for the error control, in lengths of the ray

# Dormand and Prince (1980), the pair RK5(4)7M; the tests compare it with scipy.integrate.RK45
C = np.array((0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0))
A = np.array(
    (
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0),
        (3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0),
        (44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0),
        (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0),
        (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    )
)
E1, E3, E4, E5, E6, E7 = 71 / 57600, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40


@shared
def _tilted(axis, pos, w):
    """
    Range and depth of a point from a tilted axis.

    For the horizontal axis, the compiler does not compute these: the range then does not wait for
    the offset, and steps are faster.
    """
    return pos * axis.cb - w * axis.sb, axis.z_source + pos * axis.sb + w * axis.cb


@shared
def _across(axis, cz, cr, second):
    """
    First and second derivative of the sound speed across a tilted axis, from those by depth and
    range.
    """
    _, cb, sb, _ = axis
    czz, crz, crr = second
    return cz * cb - cr * sb, czz * cb * cb - 2.0 * crz * cb * sb + crr * sb * sb


@inlined
def _derivative(s, b, k, pos, y, dy, n_eq, axis):
    """
    Right-hand side; returns False if the ray has turned across the axis, and the layer, from a
    search that starts at layer k.

    n is 1 at the source, where the sound speed is axis.c_ref.
    """
    z_source, cb, sb, c_ref = axis
    r, z = pos, z_source + y[at.W]
    if sb != 0.0:
        r, z = _tilted(axis, pos, y[at.W])
    # sound speed and its derivatives
    cr, crz, crr, cy, cyz, cyy, cyyz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if s.kind == at.SMOOTH:
        k = move_level(s.depth, k, z)
        if n_eq == at.N_FAN and sb == 0.0:
            c, cz, czz = smooth_planar(s, k, r, z)
        else:
            c, cz, cr, czz, crz, crr, cy, cyz, cyy, cyyz = smooth_full(s, k, r, z)
    else:
        c, cz, cr, czz, crz, crr, cy, cyz, cyy, cyyz = linear_full(s, b, k, r, z)
    # derivatives across the axis
    cw, cww = cz, czz
    if sb != 0.0:
        cw, cww = _across(axis, cz, cr, (czz, crz, crr))
    # the ray is beside the plane
    q = 0.0
    if n_eq == at.N_FULL:
        half = 0.5 * y[at.Y]
        c += y[at.Y] * (cy + half * cyy)
        cw += y[at.Y] * cb * (cyz + half * cyyz)
        cy += y[at.Y] * cyy
        q = y[at.Q]
    # index of refraction and its derivatives
    p = y[at.P]
    ic = 1.0 / c
    n = c_ref * ic
    nw = -n * cw * ic
    nww = n * ic * (2.0 * cw * cw * ic - cww)
    square = c_ref * c_ref - c * c * (
        p * p + q * q
    )  # (h c)^2, which does not depend on the division 1 / c
    if not square > 1e-6 * c * c:
        return False, k
    # derivatives of the ray
    ih = c / math.sqrt(square)
    ih3 = ih * ih * ih
    nnw = n * nw
    dy[at.W] = p * ih
    dy[at.P] = nnw * ih
    dy[at.XI] = (ih + p * p * ih3) * y[at.ETA] - p * nnw * ih3 * y[at.XI]
    dy[at.ETA] = ((nw * nw + n * nww) * ih - nnw * nnw * ih3) * y[at.XI] + nnw * p * ih3 * y[at.ETA]
    if n_eq == at.N_FULL:
        dy[at.TAU] = n * n * ih
        dy[at.Y] = q * ih
        dy[at.Q] = -n * n * cy * ic * ih
        dy[at.DY_DQ] = ih
    return True, k


@kernel
def derivative(s, cell, pos, y, dy, n_eq, axis):
    """Right-hand side at one point; returns False if the ray has turned across the axis."""
    return _derivative(s, cell.column, cell.layer, pos, y, dy, n_eq, axis)[0]


@inlined
def varied(variation, slowness, gradient, bends, inverses):
    """
    Derivatives of a coupled variation of w, p, y and q along the ray, as in `beside`: of one ray,
    or of sixteen.
    """
    dw, dp, dy, dq = variation
    p, q = slowness
    mw, my = gradient
    mww, mwy, myy = bends
    ih, ih3 = inverses
    g = (mw * dw + my * dy - p * dp - q * dq) * ih3
    return (
        dp * ih - p * g,
        (mww * dw + mwy * dy) * ih - mw * g,
        dq * ih - q * g,
        (mwy * dw + myy * dy) * ih - my * g,
    )


@inlined
def _advance(stage, h, y, K, ynew, n):
    """
    Put the first n numbers of the state at a stage into ynew; with a constant n the compiler uses
    vector instructions.
    """
    for i in range(n):
        ynew[i] = A[stage, 0] * K[0, i]
    for j in range(1, stage):
        for i in range(n):
            ynew[i] += A[stage, j] * K[j, i]
    for i in range(n):
        ynew[i] = y[i] + h * ynew[i]


@inlined
def step(s, cell, pos, h, ray, axis):
    """
    One Dormand-Prince step from pos with the derivative in K[0]; the derivative at the end is in
    K[6].
    """
    y, K, ynew = ray.y, ray.K, ray.ynew
    b, k = cell
    n_eq = K.shape[1]
    for stage in range(1, 7):
        if n_eq == at.N_FULL:
            _advance(stage, h, y, K, ynew, at.N_FULL)
        else:
            _advance(stage, h, y, K, ynew, at.N_FAN)
        ok, k = _derivative(s, b, k, pos + C[stage] * h, ynew, K[stage], n_eq, axis)
        if not ok:
            return False
    return True


@inlined
def _embedded(K, i):
    """Difference of the two embedded formulas divided by the length of the step."""
    return abs(
        E1 * K[0, i] + E3 * K[2, i] + E4 * K[3, i] + E5 * K[4, i] + E6 * K[5, i] + E7 * K[6, i]
    )


@inlined
def step_error(h, ray, remaining, tol, width, tube):
    """
    Estimate the displacement at the end of the ray due to the error of this step. [m]

    An error of the variation of tube times its size (at least width) counts as much as the whole
    tolerance; if tube is 0, the variation does not count.
    """
    K = ray.K
    total = _embedded(K, at.W) + remaining * _embedded(K, at.P)
    if K.shape[1] >= at.N_FULL:
        total += _embedded(K, at.TAU) + _embedded(K, at.Y)
    if tube > 0.0:
        total += tol / (tube * max(abs(ray.ynew[at.XI]), width)) * _embedded(K, at.XI)
    return abs(h) * total
