"""Rays through horizontally uniform layers with a constant gradient of sound speed each: arcs of circles, in closed form.

With the ray parameter ``a = cos(theta) / c`` sine and cosine of a ray's angle (positive down) at every level follow from the
sound speed there and those at the source. Between two places of one layer ``dr = dz (cos + cos') / (sin + sin')``, across a turning point
``dr = (sin - sin') / (a g)``, and the time is ``2 / g asinh(g d / (2 sqrt(c c')))`` for a chord d. Derivatives by the launch
angle are taken at fixed depth as far as the last level, and at fixed range at the end. Nothing is divided by a gradient that may
vanish, no error is passed on from layer to layer.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import ON_SURFACE, append_code, landed, surface_at
from pymantaray.acoustics._kernels.field import ABOVE_SCALE, BELOW_SCALE, find_level
from pymantaray.compile import inlined, kernel

_MOST_PIECES = 5_000
_FAR = 1e9  # m
_LEAST_SINE = 1e-12
_NODE = 2e3  # m; longer pieces of a path get two nodes on the way or more, an even number: none is where a ray turns


@kernel
def fits(s, walls, course, q0):
    """Whether a ray may be traced here: in layers, along the horizontal and in its plane, its boundaries flat if they reflect."""
    rule = course.rule
    flat = walls.bed.depth.size == 1 and walls.ice.depth.size == 1 and walls.held < 0.0
    kind = rule.kind == at.OPEN or (rule.kind == at.FORWARD and flat)
    return s.layered and kind and course.axis[2] == 0.0 and abs(q0) < _LEAST_SINE


@inlined
def _layer(s, k):
    """Depths of a layer's upper and lower face, and the sound speed there.

    Above and below the levels the gradient goes on for a while, see `field`; then sound speed is constant.
    """
    n = s.depth.size
    if 0 <= k < n - 1:
        return s.depth[k], s.depth[k + 1], s.data[0, k, 0], s.data[0, k + 1, 0]
    edge, near, scale, sign = 0, 1, ABOVE_SCALE, -1.0
    if k > 0:
        edge, near, scale, sign = n - 1, n - 2, BELOW_SCALE, 1.0
    c = s.data[0, edge, 0]
    rise = (c - s.data[0, near, 0]) / abs(s.depth[edge] - s.depth[near])
    scale = min(scale, 0.2 * c / max(abs(rise), 1e-9))
    z0, z1, c1 = s.depth[edge], s.depth[edge] + sign * scale, c + rise * scale
    if k < -1 or k > n - 1:
        z0, z1, c = z1, z1 + sign * _FAR, c1
    return (z0, z1, c, c1) if k > 0 else (z1, z0, c1, c)


@inlined
def _bounded(layer, top, bottom):
    """Give the part of a layer between two depths."""
    z0, z1, c0, c1 = layer
    g = (c1 - c0) / (z1 - z0)
    if z0 < top:
        z0, c0 = top, c0 + g * (top - z0)
    if z1 > bottom:
        z1, c1 = bottom, c1 - g * (z1 - bottom)
    return z0, z1, c0, c1, g


@inlined
def _time(g, dr, dz, c0, c1):
    """Time between two places of a layer."""
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
    """Depth, its derivative, sine with its own and cosine at a range further on in a layer; rates are those at fixed depth."""
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
def _fill(path, count, here, place, g, a, dr, c_ref):
    """Record places on the way along an arc; return the rows in use, less one."""
    z, c, _, _ = here
    r, tau = place
    n = min(2 * int(dr / _NODE), path.shape[0] - 2 - count)
    for i in range(1, n + 1):
        step = dr * i / (n + 1)
        z1, _, s1, _, cos1 = _end(here, (0.0, 0.0, 0.0), g, a, 0.0, step)
        c1 = cos1 / a
        time = tau + c_ref * _time(g, step, z1 - z, c, c1)
        _record(path[count + i], time, r + step, z1, (a * c_ref, c_ref * s1 / c1), at.IN_WATER)
    return count + max(n, 0)


@kernel
def _turn_back(walls, rule, ray, r, hit, so_far):
    """Count a reflection; return whether the ray goes on, and its reflections at both boundaries and their code."""
    surface, bottom, code = so_far
    surface += 1 if hit == at.AT_SURFACE else 0
    bottom += 1 if hit == at.AT_BOTTOM else 0
    too_many = surface > rule.max_surface or bottom > rule.max_bottom
    if too_many and ray.K.shape[1] == at.N_FAN and ray.y[at.GONE] == 0.0:
        ray.y[at.GONE] = r
    if surface > rule.max_surface + rule.spare or bottom > rule.max_bottom + rule.spare:
        return False, (surface, bottom, code)
    mark = landed(walls, r, 0.0, bottom) + 2 if hit == at.AT_BOTTOM else ON_SURFACE
    return True, (surface, bottom, append_code(code, mark))


@kernel
def trace_arcs(s, walls, course, angle, ray):
    """Trace a ray as `trace.trace` does, where `fits` says so."""
    rule, length, y, path = course.rule, course.length, ray.y, ray.path
    z, c_ref = course.axis[0], course.axis[3]
    full, record = ray.K.shape[1] == at.N_FULL, ray.K.shape[1] == at.N_FULL and path.shape[0] > 0
    top, bottom = -2.0 * _FAR, 2.0 * _FAR
    lowest = walls.ice.depth[0, 0] if walls.ice.depth.size == 1 else math.inf
    if rule.kind == at.FORWARD:
        top, bottom = walls.ice.depth[0, 0], walls.bed.depth[0, 0]
    c, sine, cosine = c_ref, math.sin(angle), math.cos(angle)
    a, da = cosine / c_ref, -sine / c_ref
    start = sine * sine
    ds, dcos, r, dr, tau = cosine, -sine, 0.0, 0.0, 0.0
    grown, gone = 0.0, 0.0
    y[at.GONE], y[at.GONE_RATE], y[at.GONE_BEND] = 0.0, math.nan, math.nan
    k, count, turns, so_far = find_level(s, z), 0, 0, (0, 0, 0)
    ok = not (z <= top and sine < 0.0) and not (z >= bottom and sine > 0.0)
    if record:
        _record(path[0], 0.0, 0.0, z, (cosine, sine), at.IN_WATER)
    for piece in range(_MOST_PIECES):
        ok = ok and piece < _MOST_PIECES - 1 and (not record or count < path.shape[0] - 3)
        if not ok:
            break
        z0, z1, c0, c1, g = _bounded(_layer(s, k), top, bottom)
        down = sine > 0.0 or (sine == 0.0 and (g < 0.0 or (g == 0.0 and z <= top)))
        c_end = c1 if down else c0
        turning = start + a * a * (c_ref - c_end) * (c_ref + c_end) < 0.0
        down = down != turning
        z_end, c_end = (z1, c1) if down else (z0, c0)
        if z_end == z and not turning:  # it starts on a level
            k += 1 if down else -1
            ok = top < z < bottom
            continue
        cos_end = a * c_end
        s_end = math.sqrt(max(start + a * a * (c_ref - c_end) * (c_ref + c_end), _LEAST_SINE**2))
        s_end = s_end if down else -s_end
        total = sine + s_end
        step = (sine - s_end) / (a * g) if turning else (z_end - z) * (cosine + cos_end) / total
        if not r + step < length:
            break
        dcos_end = da * c_end
        ds_end = -cos_end * dcos_end / s_end
        if turning:
            turns += 1
            dr += (ds - ds_end) / (a * g) - step * da / a
            if z + (1.0 / a - c) / g < lowest and gone == 0.0:
                gone = r + step
        else:
            dr += ((z_end - z) * (dcos + dcos_end) - step * (ds + ds_end)) / total
        if full:
            if record:
                count = _fill(path, count, (z, c, sine, cosine), (r, tau), g, a, step, c_ref)
            tau += c_ref * _time(g, step, z_end - z, c, c_end)
        r += step
        z, c, sine, cosine, ds, dcos = z_end, c_end, s_end, cos_end, ds_end, dcos_end
        grown = max(grown, abs(dr * sine / cosine))
        hit = at.IN_WATER
        if z >= bottom if down else z <= top:
            hit = at.AT_BOTTOM if down else at.AT_SURFACE
            sine, ds = -sine, -ds
            ok, so_far = _turn_back(walls, rule, ray, r, hit, so_far)
        else:
            k += 1 if down else -1
            if gone == 0.0 and (z < lowest) and rule.kind == at.OPEN and z < surface_at(walls, r, 0.0, r)[0]:
                gone = r
        if record:
            count += 1
            _record(path[count], tau, r, z, (c_ref * a, c_ref * sine / c), hit)
    if not ok:
        return False, count, turns, so_far[2]
    left = length - r
    z_end, dz, s_end, ds_end, _ = _end((z, c, sine, cosine), (ds, dcos, dr), g, a, da, left)
    c_end = c + g * (z_end - z)
    if record:
        count = _fill(path, count, (z, c, sine, cosine), (r, tau), g, a, left, c_ref) + 1
    if full:
        tau += c_ref * _time(g, left, z_end - z, c, c_end)
        y[at.TAU], y[at.DY_DQ] = tau, length / (c_ref * a)
        y[at.Y], y[at.Q] = 0.0, 0.0
    n = c_ref / c_end
    y[at.W], y[at.P], y[at.XI] = z_end - course.axis[0], n * s_end, dz
    y[at.ETA] = n * (ds_end - s_end * g * dz / c_end)
    y[at.GROWN] = max(grown, abs(dz))
    if gone > 0.0:
        y[at.GONE] = gone
    if record:
        _record(path[count], tau, length, z_end, (c_ref * a, c_ref * s_end / c_end), at.IN_WATER)
    return True, count, turns + (1 if sine * s_end < 0.0 else 0), so_far[2]
