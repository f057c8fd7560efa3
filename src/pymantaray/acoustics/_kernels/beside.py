"""
Integration of direct rays that leave the plane of their section, along the horizontal in SMOOTH
sections, with coupled variations.

The state follows the equations of `step`. The derivatives of ``w``, ``p``, ``y`` and ``q`` by the
launch angle and by ``q`` depend on each other if the sound speed varies across the plane. With ``m
= n^2 / 2`` and ``g = (m_w dw + m_y dy - p dp - q dq) / h^3``, each of the two sets of derivatives
follows

    dw' = dp / h - p g,   dp' = (m_ww dw + m_wy dy) / h - m_w g,   dy' = dq / h - q g,   dq' = (m_wy
    dw + m_yy dy) / h - m_y g
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.field import find_level, move_level, smooth_beside
from pymantaray.acoustics._kernels.lanes import load, packed, rounded_product, store
from pymantaray.acoustics._kernels.layout import MAX_STEPS, Ray
from pymantaray.acoustics._kernels.step import MIN_WIDTH, TUBE, A, C, step_error, varied
from pymantaray.acoustics._kernels.trace import (
    MAX_STUCK,
    note_exit,
    record_node,
    step_to_level,
    trace,
)
from pymantaray.compile import inlined, kernel, out_of_line, shared


@inlined
def direct_ray(course, work):
    """
    Workspace of a direct ray with all variations, coupled if rays leave the plane, and its path.
    """
    return Ray(work.y, work.K_space if course.cross else work.K, work.ynew, work.path)


@inlined
def direct_ray_end(course, work):
    """As `direct_ray`, without the path."""
    return Ray(work.y, work.K_space if course.cross else work.K, work.ynew, work.no_path)


@kernel
def trace_direct(s, walls, course, angle, q0, tol, ray):
    """
    Trace a `direct_ray` as `trace.trace` does, with coupled variations if rays leave the plane.
    """
    if s.kind == at.SMOOTH and course.cross:
        return _trace_beside(s, walls, course, angle, q0, tol, ray)
    return trace(s, walls, course, angle, q0, tol, ray)


@kernel
def offset_in_plane(y):
    """
    Offset across the axis at which the ray of state y would end if it ended in the plane, to first
    order.
    """
    return y[at.W] - y[at.W_Q] * (y[at.Y] / y[at.DY_DQ]) if y[at.DY_DQ] > 0.0 else y[at.W]


@kernel
def cross_change(y, change):
    """
    Change of the cross-track slowness with which the ray of state y ends in the plane, if its
    launch angle changes.
    """
    return -(y[at.Y] + y[at.Y_ANGLE] * change) / y[at.DY_DQ] if y[at.DY_DQ] > 0.0 else 0.0


@inlined
def _derivative(s, k, pos, y, K, stage, axis):
    """
    Right-hand side, into the row of a stage; returns False if the ray has turned across the axis,
    and the layer, from a search that starts at layer k.

    It is written at once: a vector that is loaded soon after its numbers were stored one by one
    waits for them.
    """
    z, p, q = axis.z_source + y[at.W], y[at.P], y[at.Q]
    k = move_level(s.depth, k, z)
    c, cz, czz, cy, cyz, cyy = smooth_beside(s, k, pos, z, y[at.Y])
    ic = 1.0 / c
    square = axis.c_ref * axis.c_ref - c * c * (p * p + q * q)
    if not square > 1e-6 * c * c:
        return False, k
    ih = c / math.sqrt(square)
    ih3 = ih * ih * ih
    n2 = axis.c_ref * axis.c_ref * ic * ic
    bw, by = cz * ic, cy * ic
    mw, my = -n2 * bw, -n2 * by
    mww = n2 * (3.0 * bw * bw - czz * ic)
    mwy = n2 * (3.0 * bw * by - cyz * ic)
    myy = n2 * (3.0 * by * by - cyy * ic)
    field = (p, q), (mw, my), (mww, mwy, myy), (ih, ih3)
    by_angle = varied((y[at.XI], y[at.ETA], y[at.Y_ANGLE], y[at.Q_ANGLE]), *field)
    by_q = varied((y[at.W_Q], y[at.P_Q], y[at.Y_Q], y[at.Q_Q]), *field)
    here = p * ih, mw * ih, by_angle[0], by_angle[1], n2 * ih, q * ih, my * ih, ih
    store(K, stage, packed((*here, by_angle[2], by_angle[3], *by_q)))
    return True, k


@inlined
def _step(s, k, pos, h, ray, axis):
    """One step as `step.step`; returns False if the ray turned across the axis."""
    y, K, ynew = ray.y, ray.K, ray.ynew
    for stage in range(1, 7):
        total = rounded_product(A[stage, 0], load(K, 0))
        for j in range(1, stage):
            total = total + rounded_product(A[stage, j], load(K, j))
        store(ynew, 0, load(y, 0) + rounded_product(h, total))
        ok, k = _derivative(s, k, pos + C[stage] * h, ynew, K, stage, axis)
        if not ok:
            return False
    return True


@kernel
def _launch(y, angle, q0):
    """Put the initial state of a ray into y."""
    for i in range(at.N_STATE):
        y[i] = 0.0
    y[at.P], y[at.ETA] = math.sin(angle), math.cos(angle)
    y[at.Q], y[at.Q_Q] = q0, 1.0


@shared
def _trace_beside(s, walls, course, angle, q0, tol, ray):
    """
    Trace one direct ray as `trace.trace` does; the variations at the end are those of `_combine`.
    """
    out_of_line()
    axis, length = course.axis, course.length
    y, K, path = ray.y, ray.K, ray.path
    _launch(y, angle, q0)
    k = find_level(s, axis.z_source)
    ok, k = _derivative(s, k, 0.0, y, K, 0, axis)
    if not ok:
        return False, 0, 0, 0
    recorded = path.shape[0] > 0
    if recorded:
        record_node(path[0], 0.0, y, K[0], axis, at.IN_WATER)
    lowest = walls.surface.depth[0, 0] if walls.surface.depth.size == 1 else math.inf
    count, turns, stuck, pos, down = 0, 0, 0, 0.0, K[0, at.W]
    h = min(length, 60.0, step_to_level(s, k, axis.z_source, down))
    for _ in range(MAX_STEPS):
        if pos >= length:
            break
        # a step, again with a smaller width if its error is too large
        last = pos + h * (1.0 + 1e-12) >= length
        if last:
            h = length - pos
        if not _step(s, k, pos, h, ray, axis):
            h *= 0.25
            if h < 1e-7 * length:
                break
            continue
        error = step_error(h, ray, length - pos, tol, MIN_WIDTH * length, TUBE)
        most = tol * h / length
        if error > most:
            if h > 1e-9 * length:
                h *= max(0.2, 0.9 * math.sqrt(math.sqrt(most / error)))
                continue
            stuck += 1
            if stuck > MAX_STUCK:
                break
        # an accepted step: its state, its events and the next width
        pos = length if last else pos + h
        h *= min(4.0, 0.75 * math.sqrt(math.sqrt(most / error))) if error > 0.0 else 5.0
        if _tube(y) * _tube(ray.ynew) < 0.0:
            y[at.CAUSTICS_PASSED] += 1.0
        store(y, 0, load(ray.ynew, 0))
        store(K, 0, load(K, 6))
        count += 1
        z = axis.z_source + y[at.W]
        _note_extremes(y)
        if z < lowest and y[at.GONE] == 0.0:
            _note_exit(walls, axis, pos, z, y, K)
        k = move_level(s.depth, k, z)
        turns += 1 if K[0, at.W] * down < 0.0 else 0
        if K[0, at.W] != 0.0:
            down = K[0, at.W]
        h = min(h, step_to_level(s, k, z, down))
        if recorded:
            if count >= path.shape[0]:
                break
            record_node(path[count], pos, y, K[0], axis, at.IN_WATER)
    if pos < length:
        return False, count, turns, 0
    _combine(y)
    return True, count, turns, 0


@inlined
def _tube(y):
    """Width of the ray tube: determinant of the offsets by both launch parameters."""
    return y[at.XI] * y[at.Y_Q] - y[at.W_Q] * y[at.Y_ANGLE]


@kernel
def _note_extremes(y):
    """As `trace`, with the derivatives by the cross-track slowness."""
    y[at.GROWN] = max(y[at.GROWN], abs(y[at.XI]))
    if y[at.W] < y[at.HIGHEST]:
        y[at.HIGHEST], y[at.HIGHEST_RATE], y[at.HIGHEST_RATE_Q] = y[at.W], y[at.XI], y[at.W_Q]
    elif y[at.W] > y[at.LOWEST]:
        y[at.LOWEST], y[at.LOWEST_RATE], y[at.LOWEST_RATE_Q] = y[at.W], y[at.XI], y[at.W_Q]


@kernel
def _note_exit(walls, axis, pos, z, y, K):
    """As `trace.note_exit`, with the derivatives by the cross-track slowness."""
    note_exit(walls, axis, pos, z, y, K)
    down = K[0, at.W]
    if y[at.GONE] > 0.0 and down < 0.0:
        back = y[at.GONE] - pos
        y[at.GONE_RATE_Q] = -(y[at.W_Q] + back * K[0, at.W_Q]) / down
        y[at.GONE_BEND_Q] = (K[0, at.W_Q] + K[0, at.P] * y[at.GONE_RATE_Q]) / (
            down + back * K[0, at.P]
        )


@kernel
def _combine(y):
    """
    Replace the derivatives by the launch angle by those along the rays that end at the same
    cross-track offset.

    Their cross-track slownesses change with the launch angle by -Y_ANGLE / Y_Q.
    """
    y[at.DY_DQ] = y[at.Y_Q]
    side = -y[at.Y_ANGLE] / y[at.Y_Q]
    y[at.XI] += side * y[at.W_Q]
    y[at.ETA] += side * y[at.P_Q]
    for i in range(4):
        y[at.GONE_RATE + i] += side * y[at.GONE_RATE_Q + i]
