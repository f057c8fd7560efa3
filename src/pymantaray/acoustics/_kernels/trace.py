"""One ray through a section: Hamilton's equations with their variation, Dormand-Prince 5(4).

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
from pymantaray.acoustics._kernels.section import (
    LINEAR,
    SMOOTH,
    find_level,
    linear_full,
    smooth_full,
    smooth_planar,
)

N_FULL = 8
N_FAN = 4
MAX_STEPS = 20_000
_FACE = 1e-9  # m; how close to a cell face an event has to end

# Dormand and Prince (1980), table 2: RK5(4)7M
A21 = 1 / 5
A31, A32 = 3 / 40, 9 / 40
A41, A42, A43 = 44 / 45, -56 / 15, 32 / 9
A51, A52, A53, A54 = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
A61, A62, A63, A64, A65 = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
B1, B3, B4, B5, B6 = 35 / 384, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
E1, E3, E4, E5, E6, E7 = 71 / 57600, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40


@inlined
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
def _step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
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
def _error_of(K, i):
    """Embedded error estimate of one component, per unit step."""
    return abs(E1 * K[0, i] + E3 * K[2, i] + E4 * K[3, i] + E5 * K[4, i] + E6 * K[5, i] + E7 * K[6, i])


@inlined
def _step_error(h, K, n_eq, remaining):
    """Estimated displacement at the end of the ray that this step's error causes. [m]"""
    e = _error_of(K, 0) + _error_of(K, 1) * remaining
    if n_eq == N_FULL:
        e += _error_of(K, 4) + _error_of(K, 5)
    return abs(h) * e


@inlined
def _cubic(t, h, f0, d0, f1, d1):
    """Cubic Hermite value at the fraction t of a step h."""
    t2 = t * t
    t3 = t2 * t
    return (
        (1.0 - 3.0 * t2 + 2.0 * t3) * f0
        + (t - 2.0 * t2 + t3) * h * d0
        + (3.0 * t2 - 2.0 * t3) * f1
        + (t3 - t2) * h * d1
    )


@kernel
def extremum(h, f0, d0, f1, d1):
    """Fraction of a step at which its cubic Hermite has zero slope; the slopes at the ends differ in sign."""
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


@kernel
def _face_distance(s, b, k, face, pos, w, axis):
    """Signed distance into the cell from face 0 (top), 1 (bottom), 2 (near) or 3 (far)."""
    z_source, cb, sb, _ = axis
    if face < 2:
        z = z_source + pos * sb + w * cb
        if face == 0:
            return z - s.depth[k] if k >= 0 else 1e30
        return s.depth[k + 1] - z if k < s.depth.size - 1 else 1e30
    r = pos * cb - w * sb
    if face == 2:
        return r - s.breaks[b] if b > 0 else 1e30
    return s.breaks[b + 1] - r if b < s.n_range - 1 else 1e30


@kernel
def _face_slope(face, dw, axis):
    """Derivative of `_face_distance` along the ray, for dw = dw/ds."""
    _, cb, sb, _ = axis
    if face == 0:
        return sb + dw * cb
    if face == 1:
        return -(sb + dw * cb)
    if face == 2:
        return cb - dw * sb
    return -(cb - dw * sb)


@kernel
def _crossing(s, b, k, pos, h, y, K, ynew, n_eq, axis):
    """First face crossed within a step whose result is in ynew, K[6]; (face, step) or (-1, h)."""
    best = h
    best_face = -1
    w0, w1 = y[0], ynew[0]
    d0, d1 = K[0, 0], K[6, 0]
    for face in range(4):
        g0 = _face_distance(s, b, k, face, pos, w0, axis)
        if g0 > 1e29:
            continue
        g1 = _face_distance(s, b, k, face, pos + h, w1, axis)
        e0 = _face_slope(face, d0, axis)
        e1 = _face_slope(face, d1, axis)
        lo, hi = 0.0, 1.0
        if e0 < 0.0 < e1:  # nearest in the middle
            t = extremum(h, g0, e0, g1, e1)
            if _cubic(t, h, g0, e0, g1, e1) >= -_FACE:
                if g1 >= -_FACE:
                    continue
                lo = t
            else:
                hi = t
        elif g1 >= -_FACE:
            continue
        elif e1 < 0.0 < e0:  # leaves the face, turns and comes back
            lo = extremum(h, g0, e0, g1, e1)
        for _ in range(50):
            t = 0.5 * (lo + hi)
            if _cubic(t, h, g0, e0, g1, e1) > 0.0:
                lo = t
            else:
                hi = t
            if hi - lo < 1e-9:
                break
        if hi * h < best or best_face < 0:
            best = hi * h
            best_face = face
    return best_face, best


@kernel
def _land(s, b, k, face, pos, h, h_max, y, K, ynew, n_eq, axis):
    """Repeat a step with lengths near h until it ends on the face; return the length, or -1."""
    lo, hi = 0.0, h_max
    for _ in range(40):
        if not _step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
            return -1.0
        g = _face_distance(s, b, k, face, pos + h, ynew[0], axis)
        if abs(g) < _FACE:
            return h
        if g > 0.0:
            lo = h
        else:
            hi = h
        slope = _face_slope(face, K[6, 0], axis)
        new = h - g / slope if slope < 0.0 else 0.5 * (lo + hi)
        if not lo < new < hi:
            new = 0.5 * (lo + hi)
        if abs(new - h) < 1e-13 * (1.0 + pos):
            return h
        h = new
    return h


@kernel
def start_cell(s, y, axis, dw):
    """Range cell and layer in which a ray starts, by its direction where it starts on a face."""
    z_source, cb, sb, _ = axis
    n = s.depth.size
    b = 0
    rate = cb - dw * sb
    while b < s.n_range - 1 and (s.breaks[b + 1] < 0.0 or (s.breaks[b + 1] == 0.0 and rate >= 0.0)):
        b += 1
    if z_source > s.depth[n - 1]:
        return b, n - 1
    if z_source < s.depth[0]:
        return b, -1
    k = find_level(s.depth, s.lut, s.lut_scale, z_source)
    down = sb + dw * cb
    if z_source == s.depth[n - 1]:
        return b, n - 1 if down > 0.0 else n - 2
    if z_source == s.depth[k] and down <= 0.0:
        if down < 0.0:
            return b, k - 1
        # horizontal on a level: into the layer towards which it bends
        below = linear_full(s, b, k, 0.0, z_source)[1]
        above = linear_full(s, b, k - 1, 0.0, z_source)[1]
        if below > 0.0 and above > 0.0:
            return b, k - 1
    return b, k


@kernel
def trace(s, angle, q0, length, axis, tol, n_eq, y, K, ynew, path):
    """Trace one ray to s = length.

    angle is the launch angle from the axis, q0 the slowness out of the plane, tol the end displacement
    allowed. [rad, 1, m] The end state is left in y, its derivative in K[0]; path (n, 4) takes s, w, w' and
    the layer-independent depth slope of every accepted step when it has rows.

    Returns
    -------
    ok : bool
    steps : int
        Steps taken, also the rows of path in use less one.
    turns : int
        Turning points in depth.
    """
    z_source, cb, sb, _ = axis
    y[0] = 0.0
    y[1] = math.sin(angle)
    y[2] = 0.0
    y[3] = math.cos(angle)
    y[4] = 0.0
    y[5] = 0.0
    y[6] = q0
    y[7] = 0.0
    b, k = 0, 0
    if s.kind == LINEAR:
        b, k = start_cell(s, y, axis, math.tan(angle))
    if not derivative(s, b, k, 0.0, y, K[0], n_eq, axis):
        return False, 0, 0
    record = path.shape[0] > 0
    if record:
        path[0, 0] = 0.0
        path[0, 1] = 0.0
        path[0, 2] = K[0, 0]
        path[0, 3] = sb + K[0, 0] * cb
    pos = 0.0
    h = min(length, 60.0)
    turns = 0
    down = sb + K[0, 0] * cb
    count = 0
    for _ in range(MAX_STEPS):
        if pos >= length:
            break
        last = False
        if pos + h * (1.0 + 1e-12) >= length:
            h = length - pos
            last = True
        if not _step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
            h *= 0.25
            if h < 1e-7 * length:
                return False, count, turns
            continue
        error = _step_error(h, K, n_eq, length - pos)
        allowed = tol * h / length
        if error > allowed and h > 1e-9 * length:
            h *= max(0.2, 0.9 * (allowed / error) ** 0.25)
            continue
        grow = 5.0
        if error > 0.0:
            grow = min(5.0, 0.9 * (allowed / error) ** 0.2)
        face = -1
        h_next = h * grow
        if s.kind == LINEAR:
            face, h_hit = _crossing(s, b, k, pos, h, y, K, ynew, n_eq, axis)
            if face >= 0:
                h_hit = _land(s, b, k, face, pos, h_hit, h, y, K, ynew, n_eq, axis)
                if h_hit < 0.0:
                    return False, count, turns
                last = last and h_hit == h
                h = h_hit
        pos = length if last else pos + h
        h = h_next
        for i in range(n_eq):
            y[i] = ynew[i]
            K[0, i] = K[6, i]
        if face >= 0:
            before = K[0, 1]
            rate = _face_slope(face, K[0, 0], axis)
            weight = cb if face == 0 else (-cb if face == 1 else (-sb if face == 2 else sb))
            if face == 0:
                k -= 1
            elif face == 1:
                k += 1
            elif face == 2:
                b -= 1
            else:
                b += 1
            if not derivative(s, b, k, pos, y, K[0], n_eq, axis):
                return False, count, turns
            if rate < 0.0:
                y[3] += (before - K[0, 1]) * (-weight * y[2] / rate)
                derivative(s, b, k, pos, y, K[0], n_eq, axis)
        count += 1
        new_down = sb + K[0, 0] * cb
        if new_down * down < 0.0:
            turns += 1
        if new_down != 0.0:
            down = new_down
        if record:
            if count >= path.shape[0]:
                return False, count, turns
            path[count, 0] = pos
            path[count, 1] = y[0]
            path[count, 2] = K[0, 0]
            path[count, 3] = new_down
    return pos >= length, count, turns
