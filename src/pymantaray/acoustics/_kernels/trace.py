"""One ray through a section, from the source to the receiver's plane, with or without reflections."""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels.boundary import (
    AT_BOTTOM,
    AT_SURFACE,
    BOUNDARY,
    DEPTH,
    IN_WATER,
    P_DEPTH,
    P_RANGE,
    P_SIDE,
    RANGE,
    SIDE,
    TIME,
    hold,
    landed,
    reflect,
)
from pymantaray.acoustics._kernels.faces import (
    BOTTOM,
    ON_FACE,
    SURFACE,
    crossing,
    face_distance,
    land,
    start_cell,
)
from pymantaray.acoustics._kernels.section import LINEAR, SMOOTH, find_level, move_level
from pymantaray.acoustics._kernels.step import N_FAN, N_FULL, derivative, step, step_error
from pymantaray.compile import kernel, out_of_line

MAX_STEPS = 100_000
_MOST_STUCK = 20  # steps too short to be shortened, of a ray so flat that the field's last digits turn it
# of a fan's end state: where an OPEN ray left the water or a FORWARD one was reflected too often (0: nowhere), and the
# largest |xi| on its way
GONE, GROWN = 4, 7
OPEN, FORWARD, LEGS = 0, 1, 2
_LONG = 1e7  # m; a leg that a boundary ends
_HASH = 2**32
MOST_BOUNCES = 15  # of each kind
ON_SURFACE = 1  # mark of a reflection at the surface; at the sea bed it is the cell plus 2

Rule = namedtuple("Rule", "kind max_surface max_bottom spare legs end_depth fold")
Rule.__doc__ = """What a ray does at the surface and at the sea bed.

OPEN: it goes on beyond them. FORWARD: it is reflected, at most so many times, and spare times more of each kind: a search
needs rays on both sides of those that it may keep. LEGS: on a vertical axis, it is
reflected ``legs - 1`` times and ends at end_depth. fold is the mark of the boundary on which the receiver is, 0 if none: the
search then unfolds the miss, see `search.shoot`.
"""


@kernel
def append_code(code, mark):
    """Code of a ray's reflections after one more; the last 10 bits count both kinds."""
    counts = code % 1024 + (32 if mark == ON_SURFACE else 1)
    return ((code // 1024 * 8191 + mark) % _HASH) * 1024 + counts


@kernel
def trace(s, floor, rule, angle, q0, length, axis, tol, y, K, ynew, path):
    """Trace one ray to the distance length along the axis, for LEGS to the end of the last leg.

    angle is the launch angle from the axis, q0 the slowness out of the plane, tol the end displacement
    allowed over length. [rad, 1, m] The end state is left in y (a fan's with GONE and GROWN besides), its derivative in K[0]. K (7, N_FULL) asks for
    the full state, K (7, N_FAN) for that of a fan; path (n, N_PATH) takes every accepted step of a full ray when it has rows.

    Returns
    -------
    ok : bool
    steps : int
        Rows of path in use less one.
    turns, surface, bottom : int
        Turning points in depth and reflections.
    code : int
        Equal for rays with the same reflections, in order, on the same cells of the sea bed; 32 surface + bottom
        modulo 1024.
    """
    out_of_line()
    n_eq = K.shape[1]
    z_source, cb, sb, c_ref = axis
    y[0] = 0.0
    y[1] = math.sin(angle)
    y[2] = 0.0
    y[3] = math.cos(angle)
    y[4] = 0.0
    y[5] = 0.0
    y[6] = q0
    y[7] = 0.0
    turns, surface, bottom, code, count = 0, 0, 0, 0, 0
    b, k = 0, find_level(s.depth, s.lut, s.lut_scale, z_source)
    if s.kind == LINEAR:
        b, k = start_cell(s, axis, math.tan(angle))
    if not derivative(s, b, k, 0.0, y, K[0], n_eq, axis):
        return False, 0, 0, 0, 0, 0
    down = sb + K[0, 0] * cb
    walls = rule.kind != OPEN
    if walls and (
        (z_source <= 0.0 and down < 0.0)
        or (
            floor.held < 0.0
            and face_distance(s, floor, b, k, BOTTOM, 0.0, 0.0, K[0, 0], 0.0, 0.0, axis, 0.0)[0] <= 0.0 < down
        )
    ):
        return False, 0, 0, 0, 0, 0
    record = n_eq == N_FULL and path.shape[0] > 0
    if record:
        _record(path[0], 0.0, y, K[0], axis, IN_WATER)
    leg = 1
    span = length
    if rule.kind == LEGS:
        span = _LONG
    pos, gone = 0.0, 0.0
    h = min(length, 60.0)
    next_break, stuck = 0, 0
    if s.kind == SMOOTH and n_eq == N_FULL:
        h = min(h, _to_level(s, k, z_source, down))
    hit = IN_WATER
    near = max(ON_FACE, 1e-3 * tol)
    first_face = 0 if s.kind == LINEAR else SURFACE
    last_face = BOTTOM + 1 if walls else SURFACE
    for _ in range(MAX_STEPS):
        if hit != IN_WATER:
            surface += 1 if hit == AT_SURFACE else 0
            bottom += 1 if hit == AT_BOTTOM else 0
            too_many = surface > rule.max_surface or bottom > rule.max_bottom
            if too_many and n_eq == N_FAN and rule.kind == FORWARD and y[GONE] == 0.0:
                y[GONE] = pos
            if surface > rule.max_surface + rule.spare or bottom > rule.max_bottom + rule.spare:
                return False, count, turns, surface, bottom, code
            new_sb = sb
            z = z_source + pos * sb + y[0] * cb
            if rule.kind == LEGS:
                new_sb = -sb
            r = pos * cb - y[0] * sb
            mark = landed(floor, r, y[5], bottom) + 2 if hit == AT_BOTTOM else ON_SURFACE
            code = append_code(code, mark)
            if not reflect(s, floor, b, k, pos, y, n_eq, axis, hit == AT_BOTTOM, new_sb):
                return False, count, turns, surface, bottom, code
            if hit == AT_BOTTOM and floor.held >= 0.0:
                floor = hold(floor, floor.held + 1.0)
            if rule.kind == LEGS:
                gone += pos
                pos = 0.0
                leg += 1
                sb = new_sb
                z_source = z
                axis = (z_source, cb, sb, c_ref)
                if leg == rule.legs:
                    span = (rule.end_depth - z_source) * sb
                    if not span >= 0.0:
                        return False, count, turns, surface, bottom, code
            if not derivative(s, b, k, pos, y, K[0], n_eq, axis):
                return False, count, turns, surface, bottom, code
            down = sb + K[0, 0] * cb
            if s.kind == SMOOTH and n_eq == N_FULL:
                k = move_level(s.depth, k, z)
                h = min(h, _to_level(s, k, z, down))
            if record:
                count += 1
                if count >= path.shape[0]:
                    return False, count, turns, surface, bottom, code
                _record(path[count], pos, y, K[0], axis, hit)
            hit = IN_WATER
        if pos >= span:
            break
        if floor.held >= 0.0 and pos > length:  # past the continued cell, where there is no bed
            break
        last = False
        if pos + h * (1.0 + 1e-12) >= span:
            h = span - pos
            last = True
        if rule.kind == FORWARD:  # no step across an edge of the sea bed's cells
            while next_break < floor.n_breaks and floor.breaks[next_break] <= pos + 1e-9:
                next_break += 1
            if next_break < floor.n_breaks and pos + h > floor.breaks[next_break]:
                h = floor.breaks[next_break] - pos
                last = last and pos + h >= span
        if not step(s, b, k, pos, h, y, K, ynew, n_eq, axis):
            h *= 0.25
            if h < 1e-7 * length:
                return False, count, turns, surface, bottom, code
            continue
        error = step_error(h, K, ynew, n_eq, max(length - gone - pos, 0.0), tol, 0.05 * length)
        allowed = tol * h / length
        if error > allowed:
            if h > 1e-9 * length:
                h *= max(0.2, 0.9 * math.sqrt(math.sqrt(allowed / error)))
                continue
            stuck += 1
            if stuck > _MOST_STUCK:
                return False, count, turns, surface, bottom, code
        grow = 5.0
        if error > 0.0:
            grow = min(4.0, 0.75 * math.sqrt(math.sqrt(allowed / error)))
        face = -1
        h_next = h * grow
        if last_face > first_face:
            face, h_hit = crossing(s, floor, b, k, first_face, last_face, pos, h, y, K, ynew, n_eq, axis)
            if face >= 0:
                h_hit = land(s, floor, b, k, face, pos, h_hit, h, near, y, K, ynew, n_eq, axis)
                if h_hit < 0.0:
                    return False, count, turns, surface, bottom, code
                last = last and h_hit == h
                h = h_hit
        pos = span if last else pos + h
        h = h_next
        for i in range(n_eq):
            y[i] = ynew[i]
            K[0, i] = K[6, i]
        if face >= SURFACE:
            hit = AT_SURFACE if face == SURFACE else AT_BOTTOM
            if pos >= span:  # at the receiver's plane: it is there, not reflected
                hit = IN_WATER
        elif face >= 0:
            before = K[0, 1]
            rate = face_distance(s, floor, b, k, face, pos, y[0], K[0, 0], 0.0, 0.0, axis, 0.0)[1]
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
                return False, count, turns, surface, bottom, code
            if rate < 0.0:
                y[3] += (before - K[0, 1]) * (-weight * y[2] / rate)
                derivative(s, b, k, pos, y, K[0], n_eq, axis)
        count += 1
        new_down = sb + K[0, 0] * cb
        z = z_source + pos * sb + y[0] * cb
        if n_eq == N_FAN:
            y[GROWN] = max(y[GROWN], abs(y[2]))
            if z < 0.0 and y[GONE] == 0.0 and not walls:
                y[GONE] = pos
        if s.kind == SMOOTH:
            k = move_level(s.depth, k, z)
            if n_eq == N_FULL:
                h = min(h, _to_level(s, k, z, new_down))
        if new_down * down < 0.0:
            turns += 1
        if new_down != 0.0:
            down = new_down
        if record:
            if count >= path.shape[0]:
                return False, count, turns, surface, bottom, code
            _record(path[count], pos, y, K[0], axis, hit)
    return pos >= span, count, turns, surface, bottom, code


@kernel
def _to_level(s, k, z, down):
    """Step to the next level of a SMOOTH section: the error estimate does not see one that a steep ray steps over."""
    ahead = 1 if down > 0.0 else 0
    thickness = s.depth[k + 1] - s.depth[k]
    gap = abs(s.depth[k + ahead] - z)
    if gap < 1e-3 * thickness:
        next_k = min(max(k + (1 if down > 0.0 else -1), 0), s.depth.size - 2)
        gap += s.depth[next_k + 1] - s.depth[next_k]
    return (gap + 1e-4 * thickness) / max(abs(down), 1e-9)


@kernel
def _record(row, pos, y, dy, axis, boundary):
    """Write one place of a full ray into a row of a path."""
    z_source, cb, sb, _ = axis
    h = 1.0 / dy[7]
    row[TIME] = y[4]
    row[RANGE] = pos * cb - y[0] * sb
    row[DEPTH] = z_source + pos * sb + y[0] * cb
    row[SIDE] = y[5]
    row[P_RANGE] = h * cb - y[1] * sb
    row[P_DEPTH] = h * sb + y[1] * cb
    row[P_SIDE] = y[6]
    row[BOUNDARY] = boundary
