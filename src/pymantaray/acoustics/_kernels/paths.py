"""Single rays and sections for pictures, and the travel time along the straight chord."""

import math

from pymantaray.acoustics._kernels.bounced import STEEPEST_FORWARD
from pymantaray.acoustics._kernels.boundary import Floor, bottom_at
from pymantaray.acoustics._kernels.compile import kernel, sort_head
from pymantaray.acoustics._kernels.field import field_at
from pymantaray.acoustics._kernels.limits import is_steep, speed_extremes, turning_limits
from pymantaray.acoustics._kernels.section import LINEAR, cut_section, line_breaks
from pymantaray.acoustics._kernels.trace import FORWARD, LEGS, OPEN, Rule, trace


@kernel
def chord_travel_time(s, length, horizontal, z0, z1, cuts):
    """Travel time along the straight chord: Gauss-Legendre between all levels and columns it crosses."""
    x = (-0.906179845938664, -0.5384693101056831, 0.0, 0.5384693101056831, 0.906179845938664)
    w = (
        0.23692688505618908,
        0.47862867049936647,
        0.5688888888888889,
        0.47862867049936647,
        0.23692688505618908,
    )
    n = 0
    cuts[n] = 0.0
    n += 1
    if z1 != z0:
        for k in range(s.depth.size):
            t = (s.depth[k] - z0) / (z1 - z0)
            if 0.0 < t < 1.0:
                cuts[n] = t
                n += 1
    if horizontal > 0.0:
        for i in range(s.n_range + 1):
            r = s.breaks[i] if s.kind == LINEAR else s.r_first + i * s.r_step
            t = r / horizontal
            if 0.0 < t < 1.0 and n < cuts.size - 1:
                cuts[n] = t
                n += 1
    cuts[n] = 1.0
    n += 1
    sort_head(cuts, n)
    total = 0.0
    for i in range(n - 1):
        h = 0.5 * (cuts[i + 1] - cuts[i])
        if h <= 0.0:
            continue
        mid = 0.5 * (cuts[i + 1] + cuts[i])
        for q in range(5):
            t = mid + h * x[q]
            total += w[q] * h / field_at(s, t * horizontal, z0 + t * (z1 - z0))
    return total * length


@kernel
def baseline(medium, bathymetry, source, unit, horizontal, work):
    """Section and sea bed along a baseline."""
    north, east = medium[1], medium[2]
    s = cut_section(medium, source[0], source[1], unit[0], unit[1], horizontal, work)
    n = line_breaks(
        north,
        east,
        source[0],
        source[1],
        unit[0],
        unit[1],
        0.0,
        max(horizontal, 1e-6),
        work.floor_breaks,
    )
    return s, Floor(north, east, bathymetry, source[0], source[1], unit[0], unit[1], work.floor_breaks, n)


@kernel
def trace_arrival(medium, bathymetry, source, receiver, slowness, n_surface, n_bottom, tol, work):
    """Trace one eigenray again, launched with a slowness, into work.path; return the steps and c at the source."""
    dn, de = receiver[0] - source[0], receiver[1] - source[1]
    z0, z1 = source[2], receiver[2]
    horizontal = math.hypot(dn, de)
    length = math.hypot(horizontal, z1 - z0)
    unit = (1.0, 0.0)
    if horizontal > 0.0:
        unit = (dn / horizontal, de / horizontal)
    s, floor = baseline(medium, bathymetry, source, unit, horizontal, work)
    c0 = field_at(s, 0.0, z0)
    forward = (slowness[0] * unit[0] + slowness[1] * unit[1]) * c0
    side = (slowness[1] * unit[0] - slowness[0] * unit[1]) * c0
    down = slowness[2] * c0
    cb, sb, span = 1.0, 0.0, horizontal
    rule = Rule(OPEN, 0, 0, 0, 0.0)
    if n_surface + n_bottom == 0:
        slope = math.atan2(z1 - z0, horizontal)
        variation = speed_extremes(s, work.extremes)
        up, low = turning_limits(s, c0, z0, z1, horizontal, variation, work.extremes)
        if is_steep(slope, max(up, low)):
            cb, sb, span = math.cos(slope), math.sin(slope), length
    elif abs(down) < math.sin(STEEPEST_FORWARD) and forward > 0.0:
        rule = Rule(FORWARD, n_surface, n_bottom, 0, 0.0)
    else:
        legs = n_surface + n_bottom + 1
        rule = Rule(LEGS, n_surface, n_bottom, legs, z1)
        cb, sb, span = 0.0, 1.0 if down > 0.0 else -1.0, legs * 1e3
    angle = math.asin(min(max(down * cb - forward * sb, -1.0), 1.0))
    axis = (z0, cb, sb, c0)
    _, steps, _, _, _, _ = trace(
        s, floor, rule, angle, side, span, axis, tol, work.y, work.K, work.ynew, work.path
    )
    return steps, c0


@kernel
def trace_launch(medium, bathymetry, source, unit, distance, angle, max_surface, max_bottom, tol, work):
    """Trace one ray of a fan into work.path; return the steps and c at the source."""
    s, floor = baseline(medium, bathymetry, source, unit, distance, work)
    c0 = field_at(s, 0.0, source[2])
    rule = Rule(FORWARD, max_surface, max_bottom, 0, 0.0)
    axis = (source[2], 1.0, 0.0, c0)
    _, steps, _, _, _, _ = trace(
        s, floor, rule, angle, 0.0, distance, axis, tol, work.y, work.K, work.ynew, work.path
    )
    return steps, c0


@kernel
def section_grid(medium, bathymetry, source, unit, horizontal, ranges, depths, speed, floor, work):
    """Sound speed (range, depth) and sea bed along a baseline."""
    north, east = medium[1], medium[2]
    s = cut_section(medium, source[0], source[1], unit[0], unit[1], horizontal, work)
    for i in range(ranges.size):
        r = ranges[i]
        floor[i] = bottom_at(north, east, bathymetry, source[0] + r * unit[0], source[1] + r * unit[1])
        for k in range(depths.size):
            speed[i, k] = field_at(s, r, depths[k])
