"""
Integration of one ray through a section from the source to the receiver's plane, and courses of a
link's rays.

A direct ray is integrated along the horizontal, or along the chord of a steep link, and continues
beyond surface and sea bed. A reflected ray is integrated along the horizontal, or in depth if it is
steep or may turn back on a slope. Only `direct_course`, `forward_course` and `legs_course` define
this; the row of an arrival records it as RAY_AXIS.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import (
    BOTTOM,
    FAR,
    NEAR,
    ON_FACE,
    SURFACE,
    TOP,
    UNDERSIDE,
    aim,
    append_code,
    crossing,
    face_distance,
    hold,
    land,
    landed,
    mark_of,
    reflect,
    settle,
    start_cell,
    surface_at,
)
from pymantaray.acoustics._kernels.curves import fits_curves, trace_curves
from pymantaray.acoustics._kernels.field import find_level, move_level
from pymantaray.acoustics._kernels.layout import MAX_STEPS, BoundaryRule, Course, Ray
from pymantaray.acoustics._kernels.step import (
    FAN_TUBE,
    MIN_WIDTH,
    TUBE,
    derivative,
    step,
    step_error,
)
from pymantaray.compile import inlined, kernel, out_of_line, shared

MAX_STUCK = (
    20  # minimum steps in a row; then the ray is so flat that rounding of the field turns it
)
_ENDLESS_LEG = 1e7  # m; length of a leg that ends at a boundary


@kernel
def direct_course(link, along_chord, cross):
    """
    Course of direct rays along the horizontal, or along the chord; with cross, rays of a fan leave
    the plane.
    """
    cb, sb, length, target = 1.0, 0.0, link.horizontal, link.z1 - link.z0
    if along_chord:
        slope = math.atan2(target, link.horizontal)
        cb, sb, length, target = math.cos(slope), math.sin(slope), link.length, 0.0
    return Course(
        BoundaryRule(at.OPEN, 0, 0, 0, 0, 0.0, 0),
        at.Axis(link.z0, cb, sb, link.c0),
        length,
        target,
        False,
        cross,
    )


@kernel
def forward_course(link, bounces, spare, fold, z_end, to_levels):
    """
    Course of rays along the horizontal to a depth, with at most these reflections at the surface
    and at the sea bed; with to_levels, the steps of a fan's rays end at the levels.
    """
    rule = BoundaryRule(at.FORWARD, bounces[0], bounces[1], spare, 0, 0.0, fold)
    axis = at.Axis(link.z0, 1.0, 0.0, link.c0)
    return Course(rule, axis, link.horizontal, z_end - link.z0, to_levels, False)


@kernel
def legs_course(link, bounces, down, z_end, length):
    """
    Course of rays in depth to an end depth, initially downward or upward, with these numbers of
    reflections.
    """
    legs = bounces[0] + bounces[1] + 1
    sb = 1.0 if down else -1.0
    sb_end = sb if legs % 2 == 1 else -sb
    rule = BoundaryRule(at.LEGS, bounces[0], bounces[1], 0, legs, z_end, 0)
    axis = at.Axis(link.z0, 0.0, sb, link.c0)
    return Course(rule, axis, length, -link.horizontal * sb_end, False, False)


@kernel
def ray_axis(course):
    """Axis of integration for an arrival's row."""
    if course.rule.kind == at.LEGS:
        return at.VERTICAL
    return at.CHORD if course.axis.sb != 0.0 else at.HORIZONTAL


@inlined
def course_to_levels(s, course):
    """
    Let the steps of a fan's rays end at the levels, for direct rays along the horizontal in a
    SMOOTH section; other courses stay as they are.
    """
    able = s.kind == at.SMOOTH and course.rule.kind == at.OPEN and course.axis.sb == 0.0
    to_levels = able or course.to_levels
    return Course(course.rule, course.axis, course.length, course.target, to_levels, course.cross)


@inlined
def full_ray(work):
    """Workspace of a ray with all variations and its path."""
    return Ray(work.y, work.K, work.ynew, work.path)


@inlined
def full_ray_end(work):
    """Workspace of a ray with all variations, without its path."""
    return Ray(work.y, work.K, work.ynew, work.no_path)


@inlined
def fan_ray(work):
    """Workspace of a ray of a fan."""
    return Ray(work.y, work.K_fan, work.ynew, work.no_path)


@shared
def trace(s, walls, course, angle, q0, tol, ray):
    """
    Trace one ray to the course's length, or for LEGS to the end of the last leg.

    angle is the launch angle from the axis, q0 the slowness out of the plane, and tol the allowed
    displacement at the end. [rad, 1, m] The end state is in y, and its derivative in K[0].

    Returns
    -------
    ok : bool
        True if the ray reached the end.
    steps : int
        Number of rows of the path minus one.
    turns : int
        Turning points in depth.
    code : int
        Code of the reflections, their order and the cells of the boundaries; 32 surface + bottom
        modulo 1024.
    """
    out_of_line()
    if fits_curves(s, walls, course, angle, q0):
        return trace_curves(s, walls, course, angle, ray)
    rule, axis, length = course.rule, course.axis, course.length
    y, K, path, n_eq = ray.y, ray.K, ray.path, ray.K.shape[1]
    ok, cell, down = _launch(s, walls, course, angle, q0, ray)
    if not ok:
        return False, 0, 0, 0
    record = n_eq == at.N_FULL and path.shape[0] > 0
    if record:
        record_node(path[0], 0.0, y, K[0], axis, at.IN_WATER)
    full = n_eq == at.N_FULL
    at_levels = course.to_levels or (s.kind == at.SMOOTH and full)
    tube = TUBE if full else (FAN_TUBE if course.to_levels else 0.0)
    span = _ENDLESS_LEG if rule.kind == at.LEGS else length
    turns, code, surface, bottom = 0, 0, 0, 0
    count, leg, next_break, stuck = 0, 1, 0, 0
    pos, gone, h = 0.0, 0.0, min(length, 60.0)
    if at_levels:
        h = min(h, step_to_level(s, cell.layer, axis.z_source, down))
    # offset of a plane surface
    lowest = walls.surface.depth[0, 0] if walls.surface.depth.size == 1 else math.inf
    hit, near = at.IN_WATER, max(ON_FACE, 1e-3 * tol)
    aims = s.kind == at.LINEAR and rule.kind == at.OPEN and axis.sb == 0.0
    faces = 0 if s.kind == at.LINEAR else SURFACE, SURFACE if rule.kind == at.OPEN else BOTTOM + 1
    for _ in range(MAX_STEPS):
        if hit != at.IN_WATER:
            surface += 1 if hit == at.AT_SURFACE else 0
            bottom += 1 if hit == at.AT_BOTTOM else 0
            reflections = at.Reflections(surface, bottom, code)
            ok, code, new_axis = _reflected(
                s, walls, course.rule, axis, cell, (pos, hit), reflections, ray
            )
            if not ok:
                return False, count, turns, code
            if hit == at.AT_BOTTOM and walls.held >= 0.0:
                walls = hold(walls, walls.held + 1.0)
            if rule.kind == at.LEGS:
                gone += pos
                pos = 0.0
                leg += 1
                axis = new_axis
                if leg == rule.legs:
                    span = (rule.end_depth - axis.z_source) * axis.sb
                    if not span >= 0.0:
                        return False, count, turns, code
            if not derivative(s, cell, pos, y, K[0], n_eq, axis):
                return False, count, turns, code
            down = axis.sb + K[0, at.W] * axis.cb
            if at_levels:
                z = _depth(axis, pos, y)
                cell = at.Cell(cell.column, move_level(s.depth, cell.layer, z))
                h = min(h, step_to_level(s, cell.layer, z, down))
            if record:
                count += 1
                if count >= path.shape[0]:
                    return False, count, turns, code
                record_node(path[count], pos, y, K[0], axis, hit)
            hit = at.IN_WATER
        # the end, or an extended cell without a bed
        if pos >= span or (walls.held >= 0.0 and pos > length):
            break
        wanted, aimed = h, -1
        if aims:
            aimed, h = aim(s, walls, cell, pos, h, ray, axis)
        last = pos + h * (1.0 + 1e-12) >= span
        if last:
            h, aimed = span - pos, -1
        if rule.kind == at.FORWARD:  # no step crosses an edge of the boundaries' cells
            while next_break < walls.n_breaks and walls.breaks[next_break] <= pos + 1e-9:
                next_break += 1
            if next_break < walls.n_breaks and pos + h > walls.breaks[next_break]:
                h = walls.breaks[next_break] - pos
                last = last and pos + h >= span
        if not step(s, cell, pos, h, ray, axis):
            h *= 0.25
            if h < 1e-7 * length:
                return False, count, turns, code
            continue
        error = step_error(h, ray, max(length - gone - pos, 0.0), tol, MIN_WIDTH * length, tube)
        allowed = tol * h / length
        if error > allowed:
            if h > 1e-9 * length:
                h *= max(0.2, 0.9 * _fourth_root(allowed / error))
                continue
            # the shortest step is taken with its error, but only a few times
            stuck += 1
            if stuck > MAX_STUCK:
                return False, count, turns, code
        h_next = h * (min(4.0, 0.75 * _fourth_root(allowed / error)) if error > 0.0 else 5.0)
        face = -1
        if aimed >= 0:
            h_next = max(h_next, wanted)
            lengths = at.StepLengths(h, span - pos, near)
            face, h = _on_aimed_face(s, walls, cell, (*faces, aimed), pos, lengths, ray, axis)
        if face < 0 and faces[1] > faces[0]:
            face, h_hit = crossing(s, walls, cell, (*faces, -1), pos, h, ray, axis)
            if face >= 0:
                h_hit = land(s, walls, cell, face, pos, at.StepLengths(h_hit, h, near), ray, axis)
                if h_hit < 0.0:
                    return False, count, turns, code
                last = last and h_hit == h
                h = h_hit
        pos = span if last else pos + h
        h = h_next
        _accept_step(ray, n_eq)
        if face >= SURFACE:
            if pos < span:  # in the receiver's plane it is the end, not a reflection
                hit = at.AT_SURFACE if face == SURFACE else at.AT_BOTTOM
        elif s.kind == at.LINEAR and face >= 0:
            ok, cell = _next_cell(s, walls, cell, face, pos, ray, axis)
            if not ok:
                return False, count, turns, code
        count += 1
        new_down = axis.sb + K[0, at.W] * axis.cb
        z = _depth(axis, pos, y)
        if n_eq == at.N_FAN:
            _note_extremes(y)
            if z < lowest and y[at.GONE] == 0.0 and rule.kind == at.OPEN:
                note_exit(walls, axis, pos, z, y, K)
        if s.kind == at.SMOOTH:
            cell = at.Cell(cell.column, move_level(s.depth, cell.layer, z))
            if at_levels:
                h = min(h, step_to_level(s, cell.layer, z, new_down))
        turns += 1 if new_down * down < 0.0 else 0
        if new_down != 0.0:
            down = new_down
        if record:
            if count >= path.shape[0]:
                return False, count, turns, code
            record_node(path[count], pos, y, K[0], axis, hit)
    return pos >= span, count, turns, code


@inlined
def _fourth_root(ratio):
    """Fourth root, because the error of a step per its length is of fourth order in its length."""
    return math.sqrt(math.sqrt(ratio))


@inlined
def _accept_step(ray, n_eq):
    """Replace the state of a ray and its derivative by those after a step; count its caustics."""
    y, K = ray.y, ray.K
    if n_eq == at.N_FULL and y[at.XI] * ray.ynew[at.XI] < 0.0:
        y[at.CAUSTICS_PASSED] += 1.0
    for i in range(n_eq):
        y[i] = ray.ynew[i]
        K[0, i] = K[6, i]


@inlined
def _on_aimed_face(s, walls, cell, faces, pos, lengths, ray, axis):
    """
    Move the end of a step onto the face faces[2] at which it aimed, unless it crosses another one;
    return the face or -1, and the step.
    """
    if crossing(s, walls, cell, faces, pos, lengths.first, ray, axis)[0] < 0:
        h = settle(s, walls, cell, faces[2], pos, lengths, ray, axis)
        if h > 0.0:
            return faces[2], h
    return -1, lengths.first


@inlined
def _note_extremes(y):
    """
    Update the largest variation of a ray of a fan, and the extreme offsets of its path with the
    variation there.
    """
    y[at.GROWN] = max(y[at.GROWN], abs(y[at.XI]))
    if y[at.W] < y[at.HIGHEST]:
        y[at.HIGHEST], y[at.HIGHEST_RATE] = y[at.W], y[at.XI]
    elif y[at.W] > y[at.LOWEST]:
        y[at.LOWEST], y[at.LOWEST_RATE] = y[at.W], y[at.XI]


@inlined
def _depth(axis, pos, y):
    """Depth of a ray."""
    return axis.z_source + pos * axis.sb + y[at.W] * axis.cb


@inlined
def _launch(s, walls, course, angle, q0, ray):
    """
    Start a ray; return True if it enters the water, its cell, and its downward rate along the axis.
    """
    y, K, axis = ray.y, ray.K, course.axis
    z_source, cb, sb, _ = axis
    for i in range(at.N_STATE):
        y[i] = 0.0
    y[at.P] = math.sin(angle)
    y[at.ETA] = math.cos(angle)
    y[at.Q] = q0
    cell = at.Cell(0, find_level(s, z_source))
    if s.kind == at.LINEAR:
        cell = start_cell(s, axis, math.tan(angle))
    if not derivative(s, cell, 0.0, y, K[0], K.shape[1], axis):
        return False, cell, 0.0
    down = sb + K[0, at.W] * cb
    if course.rule.kind != at.OPEN:
        point = at.Point(0.0, 0.0, K[0, at.W], 0.0, 0.0)
        gap, rate = face_distance(s, walls, cell, SURFACE, point, axis, 0.0)
        if gap <= 0.0 and rate < 0.0:
            return False, cell, down
        if (
            walls.held < 0.0
            and face_distance(s, walls, cell, BOTTOM, point, axis, 0.0)[0] <= 0.0 < down
        ):
            return False, cell, down
    return True, cell, down


@kernel
def _reflected(s, walls, rule, axis, cell, point, reflections, ray):
    """
    Reflect a ray; return True if this is allowed and the ray continues forward, the code of its
    reflections, and the axis of its next leg.

    point contains its range and the boundary; reflections contains the numbers at both boundaries,
    including this one, and their code.
    """
    y = ray.y
    pos, hit = point
    surface, bottom, code = reflections
    too_many = surface > rule.max_surface or bottom > rule.max_bottom
    if too_many and ray.K.shape[1] == at.N_FAN and rule.kind == at.FORWARD and y[at.GONE] == 0.0:
        y[at.GONE] = pos
    if surface > rule.max_surface + rule.spare or bottom > rule.max_bottom + rule.spare:
        return False, code, axis
    _, cb, sb, c_ref = axis
    z = _depth(axis, pos, y)
    new_sb = -sb if rule.kind == at.LEGS else sb
    r = pos * cb - y[at.W] * sb
    mark = (
        landed(walls, r, y[at.Y], bottom) + 2
        if hit == at.AT_BOTTOM
        else mark_of(walls, r, y[at.Y], False)
    )
    ok = reflect(s, walls, cell, pos, ray, axis, hit, new_sb)
    return ok, append_code(code, mark), at.Axis(z, cb, new_sb, c_ref)


@kernel
def _next_cell(s, walls, cell, face, pos, ray, axis):
    """
    Move a ray through a face of its LINEAR cell; return True if it continues, and the next cell.

    The variation jumps with the field's gradient, because neighbouring rays cross the face a little
    earlier or later.
    """
    y, K = ray.y, ray.K
    _, cb, sb, _ = axis
    before = K[0, at.P]
    rate = face_distance(
        s, walls, cell, face, at.Point(pos, y[at.W], K[0, at.W], 0.0, 0.0), axis, 0.0
    )[1]
    b, k = cell
    weight = cb
    if face == TOP:
        k -= 1
    elif face == UNDERSIDE:
        k += 1
        weight = -cb
    elif face == NEAR:
        b -= 1
        weight = -sb
    elif face == FAR:
        b += 1
        weight = sb
    cell = at.Cell(b, k)
    if not derivative(s, cell, pos, y, K[0], K.shape[1], axis):
        return False, cell
    if rate < 0.0:
        y[at.ETA] += (before - K[0, at.P]) * (-weight * y[at.XI] / rate)
        derivative(s, cell, pos, y, K[0], K.shape[1], axis)
    return True, cell


@kernel
def note_exit(walls, axis, pos, z, y, K):
    """
    Record the point and steepness at which a ray of a fan left the water, by a straight line from
    there, if it did.
    """
    _, cb, sb, _ = axis
    r = pos * cb - y[at.W] * sb
    top = surface_at(walls, r, 0.0, r)[0]
    if z >= top:
        return
    down = sb + K[0, at.W] * cb
    y[at.GONE], y[at.GONE_RATE], y[at.GONE_BEND] = pos, math.nan, math.nan
    if down < 0.0:
        back = (top - z) / down
        y[at.GONE] = max(pos + back, 1e-9)
        y[at.GONE_RATE] = -(y[at.XI] + back * K[0, at.XI]) * cb / down
        rise = -down - back * K[0, at.P] * cb
        if rise > 0.0:
            y[at.GONE_BEND] = -(K[0, at.XI] + K[0, at.P] * y[at.GONE_RATE]) * cb / rise


@kernel
def step_to_level(s, k, z, down):
    """
    Length of the step to the next level of a SMOOTH section; the error estimate cannot detect a
    level inside a step of a steep ray.
    """
    ahead = 1 if down > 0.0 else 0
    thickness = s.depth[k + 1] - s.depth[k]
    gap = abs(s.depth[k + ahead] - z)
    if gap < 1e-3 * thickness:
        next_k = min(max(k + (1 if down > 0.0 else -1), 0), s.depth.size - 2)
        gap += s.depth[next_k + 1] - s.depth[next_k]
    return (gap + 1e-4 * thickness) / max(abs(down), 1e-9)


@kernel
def record_node(row, pos, y, dy, axis, boundary):
    """Write one point of a full ray to a row of a path."""
    _, cb, sb, _ = axis
    h = 1.0 / dy[at.DY_DQ]
    row[at.TIME] = y[at.TAU]
    row[at.RANGE] = pos * cb - y[at.W] * sb
    row[at.DEPTH] = _depth(axis, pos, y)
    row[at.SIDE] = y[at.Y]
    row[at.P_RANGE] = h * cb - y[at.P] * sb
    row[at.P_DEPTH] = h * sb + y[at.P] * cb
    row[at.P_SIDE] = y[at.Q]
    row[at.BOUNDARY] = boundary
