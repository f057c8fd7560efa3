"""One ray through a section, from the source to the receiver's plane."""

import math

from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.faces import crossing, face_slope, land, start_cell
from pymantaray.acoustics._kernels.section import LINEAR, SMOOTH, find_level
from pymantaray.acoustics._kernels.step import N_FULL, derivative, step, step_error

MAX_STEPS = 20_000


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
        b, k = start_cell(s, axis, math.tan(angle))
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
        if not step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
            h *= 0.25
            if h < 1e-7 * length:
                return False, count, turns
            continue
        error = step_error(h, K, n_eq, length - pos)
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
            face, h_hit = crossing(s, b, k, pos, h, y, K, ynew, axis)
            if face >= 0:
                h_hit = land(s, b, k, face, pos, h_hit, h, y, K, ynew, n_eq, axis)
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
            rate = face_slope(face, K[0, 0], axis)
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
        if s.kind == SMOOTH and n_eq == N_FULL:
            # the error estimate does not see a layer that a steep ray steps over
            k = find_level(s.depth, s.lut, s.lut_scale, z_source + pos * sb + y[0] * cb)
            h = min(h, (s.depth[k + 1] - s.depth[k]) / max(abs(new_down), 1e-9))
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
