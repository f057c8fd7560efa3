"""Faces as events: the faces of a LINEAR section's cells, the surface and the sea bed end a step."""

from pymantaray.acoustics._kernels.boundary import NO_BED, floor_at
from pymantaray.acoustics._kernels.cubic import cubic
from pymantaray.acoustics._kernels.field import linear_full
from pymantaray.acoustics._kernels.section import find_level
from pymantaray.acoustics._kernels.step import N_FULL, step
from pymantaray.compile import kernel

TOP, UNDERSIDE, NEAR, FAR, SURFACE, BOTTOM = 0, 1, 2, 3, 4, 5
ON_FACE = 1e-9  # m; a ray this near to a face is on it
_NONE = 1e30
_LANDED = 1e-2  # m; a ray just reflected is so near to the bed, if it is still over its cell
_BESIDE = 0.1 * NO_BED
_SAMPLES = 8  # of a step over a gridded bed
_NUDGE = 1e-6  # m; by which a point on the edge of a cell is taken to be in the cell of the step


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
def face_distance(s, floor, b, k, face, pos, w, dw, side, dside, axis, nudge):
    """Signed distance into the cell or the water from a face, and its derivative along the axis.

    w and side are the offsets of the ray, dw and dside their derivatives; nudge moves the point
    along the ray by which the cell of the sea bed is chosen.
    """
    z_source, cb, sb, _ = axis
    z = z_source + pos * sb + w * cb
    dz = sb + dw * cb
    if face == SURFACE:
        return z, dz
    if face == TOP:
        return (z - s.depth[k], dz) if k >= 0 else (_NONE, 0.0)
    if face == UNDERSIDE:
        return (s.depth[k + 1] - z, -dz) if k < s.depth.size - 1 else (_NONE, 0.0)
    r = pos * cb - w * sb
    dr = cb - dw * sb
    if face == NEAR:
        return (r - s.breaks[b], dr) if b > 0 else (_NONE, 0.0)
    if face == FAR:
        return (s.breaks[b + 1] - r, -dr) if b < s.n_range - 1 else (_NONE, 0.0)
    bed, f_r, f_y, _, _ = floor_at(floor, r, side, r + nudge * dr)
    return bed - z, f_r * dr + f_y * dside - dz


@kernel
def _over_bed(floor, t, pos, h, y, K, ynew, side0, side1, dside0, dside1, axis):
    """Height above the bed at the fraction t of a step."""
    z_source, cb, sb, _ = axis
    w = cubic(t, h, y[0], K[0, 0], ynew[0], K[6, 0])
    side = cubic(t, h, side0, dside0, side1, dside1)
    s = pos + t * h
    r = s * cb - w * sb
    return floor_at(floor, r, side, r)[0] - (z_source + s * sb + w * cb)


@kernel
def _bed_crossing(floor, pos, h, y, K, ynew, side0, side1, dside0, dside1, axis):
    """Fraction of a step at which it meets a gridded bed, 9 if it does not; off the baseline its edges are anywhere."""
    lo, hi = 0.0, 9.0
    above = True
    if floor.held >= 0.0:  # it may be below the bed of its next cell, which is continued, or beside it
        gap = _over_bed(floor, 0.0, pos, h, y, K, ynew, side0, side1, dside0, dside1, axis)
        above = -_LANDED < gap < _BESIDE
    for j in range(_SAMPLES):
        t = (j + 1.0) / _SAMPLES
        gap = _over_bed(floor, t, pos, h, y, K, ynew, side0, side1, dside0, dside1, axis)
        if gap < -ON_FACE and above:
            hi = t
            break
        above = floor.held < 0.0 or -ON_FACE < gap < _BESIDE
        lo = t
    if hi > 2.0:
        return hi
    for _ in range(40):
        t = 0.5 * (lo + hi)
        if _over_bed(floor, t, pos, h, y, K, ynew, side0, side1, dside0, dside1, axis) > 0.0:
            lo = t
        else:
            hi = t
        if hi - lo < 1e-9:
            break
    return hi


@kernel
def crossing(s, floor, b, k, first, last, pos, h, y, K, ynew, n_eq, axis):
    """First of the faces first to last - 1 crossed within a step whose result is in ynew, K[6].

    Returns the face and the step to it, or -1 and h. Of faces at the same place the boundary of the water goes first.
    """
    best = h
    best_face = -1
    side0, side1, dside0, dside1 = 0.0, 0.0, 0.0, 0.0
    if n_eq == N_FULL:
        side0, side1, dside0, dside1 = y[5], ynew[5], K[0, 5], K[6, 5]
    for i in range(last - first):
        face = last - 1 - i
        if face == BOTTOM and floor.bathymetry.size > 1:
            t = _bed_crossing(floor, pos, h, y, K, ynew, side0, side1, dside0, dside1, axis)
            if t < 2.0:
                best, best_face = t * h, BOTTOM
            continue
        g0, e0 = face_distance(s, floor, b, k, face, pos, y[0], K[0, 0], side0, dside0, axis, _NUDGE)
        if g0 >= _NONE:
            continue
        g1, e1 = face_distance(s, floor, b, k, face, pos + h, ynew[0], K[6, 0], side1, dside1, axis, -_NUDGE)
        lo, hi = 0.0, 1.0
        if e0 < 0.0 < e1:  # nearest in the middle
            t = extremum(h, g0, e0, g1, e1)
            if cubic(t, h, g0, e0, g1, e1) >= -ON_FACE:
                if g1 >= -ON_FACE:
                    continue
                lo = t
            else:
                hi = t
        elif g1 >= -ON_FACE:
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
        if best_face < 0 or hi * h < best - 1e-6:
            best = hi * h
            best_face = face
    return best_face, best


@kernel
def land(s, floor, b, k, face, pos, h, h_max, near, y, K, ynew, n_eq, axis):
    """Repeat a step with lengths near h until it ends within near of the face; return the length, or -1."""
    lo, hi = 0.0, h_max
    side, dside = 0.0, 0.0
    for _ in range(40):
        if not step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
            return -1.0
        if n_eq == N_FULL:
            side, dside = ynew[5], K[6, 5]
        g, slope = face_distance(s, floor, b, k, face, pos + h, ynew[0], K[6, 0], side, dside, axis, 0.0)
        if abs(g) < near:
            return h
        if g > 0.0:
            lo = h
        else:
            hi = h
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
    b = 0
    rate = cb - dw * sb
    while b < s.n_range - 1 and (s.breaks[b + 1] < 0.0 or (s.breaks[b + 1] == 0.0 and rate >= 0.0)):
        b += 1
    n = s.depth.size
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
