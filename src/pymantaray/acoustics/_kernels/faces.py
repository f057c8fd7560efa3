"""Cell faces of a LINEAR section as events: a step ends exactly where the ray enters the next cell."""

from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.cubic import cubic
from pymantaray.acoustics._kernels.field import linear_full
from pymantaray.acoustics._kernels.section import find_level
from pymantaray.acoustics._kernels.step import step

_FACE = 1e-9  # m; how close to a cell face an event has to end


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
def face_slope(face, dw, axis):
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
def crossing(s, b, k, pos, h, y, K, ynew, axis):
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
        e0 = face_slope(face, d0, axis)
        e1 = face_slope(face, d1, axis)
        lo, hi = 0.0, 1.0
        if e0 < 0.0 < e1:  # nearest in the middle
            t = extremum(h, g0, e0, g1, e1)
            if cubic(t, h, g0, e0, g1, e1) >= -_FACE:
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
            if cubic(t, h, g0, e0, g1, e1) > 0.0:
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
def land(s, b, k, face, pos, h, h_max, y, K, ynew, n_eq, axis):
    """Repeat a step with lengths near h until it ends on the face; return the length, or -1."""
    lo, hi = 0.0, h_max
    for _ in range(40):
        if not step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
            return -1.0
        g = _face_distance(s, b, k, face, pos + h, ynew[0], axis)
        if abs(g) < _FACE:
            return h
        if g > 0.0:
            lo = h
        else:
            hi = h
        slope = face_slope(face, K[6, 0], axis)
        new = h - g / slope if slope < 0.0 else 0.5 * (lo + hi)
        if not lo < new < hi:
            new = 0.5 * (lo + hi)
        if abs(new - h) < 1e-13 * (1.0 + pos):
            return h
        h = new
    return h


@kernel
def start_cell(s, axis, dw):
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
