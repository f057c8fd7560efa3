"""
Rays through horizontally uniform layers with constant gradients of sound speed, as circular arcs in
closed form.

With the ray parameter ``a = cos(theta) / c``, sine and cosine of a ray's angle (positive down) at
every level follow from the sound speed there and the values at the source. Between two points of
one layer, ``dr = dz (cos + cos') / (sin + sin')``; across a turning point, ``dr = (sin - sin') / (a
g)``. The time is ``2 / g asinh(g d / (2 sqrt(c c')))`` for a chord d. Derivatives by the launch
angle are at fixed depth up to the last level, and at fixed range at the end. No formula divides by
a gradient that may be zero, and errors do not accumulate over layers.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import ON_SURFACE, append_code, landed, surface_at
from pymantaray.acoustics._kernels.field import find_level
from pymantaray.compile import inlined, kernel

_MAX_PIECES = 5_000
_BEYOND_ALL = 1e9  # m; depth beyond all rays
_MIN_SINE = 1e-12
_BEYOND = 0.2
# m; longer pieces of a path get an even number of intermediate nodes, so none is at a turning point
_NODE = 2e3


@kernel
def fits(s, walls, course, q0):
    """
    True if arcs can trace a ray: layered water, horizontal axis, no cross-track slowness, flat
    boundaries if they reflect.
    """
    rule = course.rule
    flat = walls.bed.depth.size == 1 and walls.surface.depth.size == 1 and walls.held < 0.0
    kind = rule.kind == at.OPEN or (rule.kind == at.FORWARD and flat)
    return s.layered and kind and course.axis.sb == 0.0 and abs(q0) < _MIN_SINE


@inlined
def layer_at(s, k):
    """
    Depths of a layer's upper and lower face, and the sound speed there.

    Above and below the levels, the gradient continues until the sound speed has changed by a fifth;
    beyond, it is constant.
    """
    n = s.depth.size
    if 0 <= k < n - 1:
        return s.depth[k], s.depth[k + 1], s.data[0, k, 0], s.data[0, k + 1, 0]
    edge, near, sign = 0, 1, -1.0
    if k > 0:
        edge, near, sign = n - 1, n - 2, 1.0
    c = s.data[0, edge, 0]
    rise = (c - s.data[0, near, 0]) / abs(s.depth[edge] - s.depth[near])
    scale = min(_BEYOND * c / max(abs(rise), 1e-9), _BEYOND_ALL)
    z0, z1, c1 = s.depth[edge], s.depth[edge] + sign * scale, c + rise * scale
    if k < -1 or k > n - 1:
        z0, z1, c = z1, z1 + sign * _BEYOND_ALL, c1
    return (z0, z1, c, c1) if k > 0 else (z1, z0, c1, c)


@inlined
def bounded(layer, top, bottom):
    """Return the part of a layer between two depths."""
    z0, z1, c0, c1 = layer
    g = (c1 - c0) / (z1 - z0)
    if z0 < top:
        z0, c0 = top, c0 + g * (top - z0)
    if z1 > bottom:
        z1, c1 = bottom, c1 - g * (z1 - bottom)
    return z0, z1, c0, c1, g


@inlined
def _time(g, dr, dz, c0, c1):
    """Travel time between two points of a layer."""
    half = 0.5 * math.hypot(dr, dz) / math.sqrt(c0 * c1)
    return 2.0 * (math.asinh(g * half) / g if g != 0.0 else half)


@inlined
def _record(row, tau, r, z, slowness, boundary):
    """Write a node of a path."""
    row[at.TIME], row[at.RANGE], row[at.DEPTH], row[at.SIDE] = tau, r, z, 0.0
    row[at.P_RANGE], row[at.P_DEPTH], row[at.P_SIDE] = slowness[0], slowness[1], 0.0
    row[at.BOUNDARY] = boundary


@kernel
def _end(here, rates, g, a, da, left):
    """
    Depth, sine and their derivatives, and cosine, after a range ``left`` in a layer; ``rates`` are
    at fixed depth.
    """
    z, _, s, cos = here
    ds, dcos, dr = rates
    s1 = s - a * g * left
    ds1 = ds - da * g * left + a * g * dr
    cos1 = math.sqrt(max((1.0 - s1) * (1.0 + s1), 1e-12))
    dcos1 = -s1 * ds1 / cos1
    rise = (s + s1) / (cos + cos1)
    drise = ((ds + ds1) - rise * (dcos + dcos1)) / (cos + cos1)
    return z + left * rise, left * drise - dr * rise, s1, ds1, cos1


@kernel
def _fill(path, count, here, point, g, a, dr, c_ref):
    """Record intermediate points of an arc; return the number of rows in use minus one."""
    z, c, _, _ = here
    r, tau = point
    n = min(2 * int(dr / _NODE), path.shape[0] - 3 - count)
    for i in range(1, n + 1):
        step = dr * i / (n + 1)
        z1, _, s1, _, cos1 = _end(here, at.ArcRates(0.0, 0.0, 0.0), g, a, 0.0, step)
        c1 = cos1 / a
        time = tau + c_ref * _time(g, step, z1 - z, c, c1)
        _record(path[count + i], time, r + step, z1, (a * c_ref, c_ref * s1 / c1), at.IN_WATER)
    return count + max(n, 0)


@kernel
def turn_back(walls, rule, ray, r, hit, reflections):
    """
    Count a reflection; return True if the ray continues, and its reflections at both boundaries
    with their code.
    """
    surface, bottom, code = reflections
    surface += 1 if hit == at.AT_SURFACE else 0
    bottom += 1 if hit == at.AT_BOTTOM else 0
    too_many = surface > rule.max_surface or bottom > rule.max_bottom
    if too_many and ray.K.shape[1] == at.N_FAN and ray.y[at.GONE] == 0.0:
        ray.y[at.GONE] = r
    if surface > rule.max_surface + rule.spare or bottom > rule.max_bottom + rule.spare:
        return False, at.Reflections(surface, bottom, code)
    mark = landed(walls, r, 0.0, bottom) + 2 if hit == at.AT_BOTTOM else ON_SURFACE
    return True, at.Reflections(surface, bottom, append_code(code, mark))


@inlined
def _face(layer, here, way, top):
    """
    Next face that a ray reaches: depth, sound speed, sine of the angle, range to it, and True if
    the ray turns before it.
    """
    z0, z1, c0, c1, g = layer
    z, _, sine, cosine = here
    a, _, start, c_ref = way
    down = sine > 0.0 or (sine == 0.0 and (g < 0.0 or (g == 0.0 and z <= top)))
    c_end = c1 if down else c0
    turning = start + a * a * (c_ref - c_end) * (c_ref + c_end) < 0.0
    down = down != turning
    z_end, c_end = (z1, c1) if down else (z0, c0)
    s_end = math.sqrt(max(start + a * a * (c_ref - c_end) * (c_ref + c_end), _MIN_SINE**2))
    s_end = s_end if down else -s_end
    step = (
        (sine - s_end) / (a * g) if turning else (z_end - z) * (cosine + a * c_end) / (sine + s_end)
    )
    return z_end, c_end, s_end, step, turning


@inlined
def _rates(face, here, rates, way, g):
    """Derivatives of sine, cosine and range at a face, from those at the previous face."""
    z_end, c_end, s_end, step, turning = face
    z, _, sine, _ = here
    ds, dcos, dr = rates
    a, da, _, _ = way
    dcos_end = da * c_end
    ds_end = -(a * c_end) * dcos_end / s_end
    if turning:
        return at.ArcRates(ds_end, dcos_end, dr + ((ds - ds_end) / (a * g) - step * da / a))
    change = (z_end - z) * (dcos + dcos_end) - step * (ds + ds_end)
    return at.ArcRates(ds_end, dcos_end, dr + change / (sine + s_end))


@kernel
def arrive(course, here, rates, way, g, point, ray):
    """
    Write the state of a ray at the end of the course; return the number of rows of its path minus
    one.
    """
    r, tau, count = point
    a, da, _, c_ref = way
    y, path = ray.y, ray.path
    left = course.length - r
    z, dz, sine, ds, _ = _end(here, rates, g, a, da, left)
    c = here.speed + g * (z - here.depth)
    n = c_ref / c
    y[at.W], y[at.P], y[at.XI] = z - course.axis.z_source, n * sine, dz
    y[at.ETA] = n * (ds - sine * g * dz / c)
    y[at.GROWN] = max(y[at.GROWN], abs(dz))
    if ray.K.shape[1] == at.N_FAN:
        return count
    y[at.TAU], y[at.DY_DQ] = (
        tau + c_ref * _time(g, left, z - here.depth, here.speed, c),
        course.length / (c_ref * a),
    )
    y[at.Y], y[at.Q], y[at.Y_ANGLE], y[at.W_Q] = 0.0, 0.0, 0.0, 0.0
    if path.shape[0] > 0:
        count = _fill(path, count, here, (r, tau), g, a, left, c_ref) + 1
        _record(
            path[count], y[at.TAU], course.length, z, (c_ref * a, c_ref * sine / c), at.IN_WATER
        )
    return count


@inlined
def _above(walls, here, face, way, g, r):
    """
    True if a direct ray is above the water at a face at range r, or above ice of constant draft
    before it.
    """
    if walls.surface.depth.size > 1:
        return face[0] < surface_at(walls, r, 0.0, r)[0]
    highest = here.depth + (1.0 / way.a - here.speed) / g if face[4] else face[0]
    return highest < walls.surface.depth[0, 0]


@kernel
def trace_arcs(s, walls, course, angle, ray):
    """Trace a ray as `trace.trace` does, if `fits` is True."""
    rule, y, path, c_ref = course.rule, ray.y, ray.path, course.axis.c_ref
    z, sine, cosine = course.axis.z_source, math.sin(angle), math.cos(angle)
    top, bottom = -2.0 * _BEYOND_ALL, 2.0 * _BEYOND_ALL
    if rule.kind == at.FORWARD:
        top, bottom = walls.surface.depth[0, 0], walls.bed.depth[0, 0]
    way = at.Snell(cosine / c_ref, -sine / c_ref, sine * sine, c_ref)
    here = at.ArcPoint(z, c_ref, sine, cosine)
    rates = at.ArcRates(cosine, -sine, 0.0)
    r, tau = 0.0, 0.0
    k, count, turns, reflections = find_level(s, z), 0, 0, at.Reflections(0, 0, 0)
    xi, caustics = 0.0, 0  # in a layer, XI passes through zero at most once
    y[at.GONE], y[at.GONE_RATE], y[at.GONE_BEND], y[at.GROWN] = 0.0, math.nan, math.nan, 0.0
    room = path.shape[0] - 3 if ray.K.shape[1] == at.N_FULL else -1
    if room > 0:
        _record(path[0], 0.0, 0.0, z, (cosine, sine), at.IN_WATER)
    ok = not (z <= top and sine < 0.0) and not (z >= bottom and sine > 0.0)
    for _ in range(_MAX_PIECES):
        if not ok or 0 < room < count + 1:
            break
        layer = bounded(layer_at(s, k), top, bottom)
        g = layer[4]
        face = _face(layer, here, way, top)
        z, c, sine, step, turning = face
        down = sine > 0.0
        if z == here.depth and not turning:  # the ray starts on a level
            k += 1 if down else -1
            ok = top < z < bottom
            continue
        if not r + step < course.length:
            count = arrive(course, here, rates, way, g, (r, tau, count), ray)
            y[at.CAUSTICS_PASSED] = caustics + (1 if xi * y[at.XI] < 0.0 else 0)
            return True, count, turns + (1 if here.sine * y[at.P] < 0.0 else 0), reflections.code
        rates = _rates(face, here, rates, way, g)
        if room > 0:
            count = _fill(path, count, here, (r, tau), g, way.a, step, c_ref) + 1
            tau += c_ref * _time(g, step, z - here.depth, here.speed, c)
        r += step
        turns += 1 if turning else 0
        if y[at.GONE] == 0.0 and rule.kind == at.OPEN and _above(walls, here, face, way, g, r):
            y[at.GONE] = r
        here = at.ArcPoint(z, c, sine, way.a * c)
        before, xi = xi, -rates.range * sine / here.cosine
        caustics += 1 if before * xi < 0.0 else 0
        y[at.GROWN] = max(y[at.GROWN], abs(xi))
        hit = at.IN_WATER
        if z >= bottom if down else z <= top:
            hit = at.AT_BOTTOM if down else at.AT_SURFACE
            if room > 0:  # a reflection has two nodes
                _record(path[count], tau, r, z, (c_ref * way.a, c_ref * here.sine / c), hit)
                count += 1
            here, xi = at.ArcPoint(z, c, -sine, here.cosine), -xi
            rates = at.ArcRates(-rates.sine, rates.cosine, rates.range)
            ok, reflections = turn_back(walls, rule, ray, r, hit, reflections)
        else:
            k += 1 if down else -1
        if room > 0:
            _record(path[count], tau, r, z, (c_ref * way.a, c_ref * here.sine / c), hit)
    return False, count, turns, reflections.code
