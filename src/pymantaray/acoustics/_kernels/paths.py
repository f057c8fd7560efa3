"""Single rays and sections for pictures, and the travel time along the straight chord."""

import math

from pymantaray.acoustics._kernels.boundary import bottom_at
from pymantaray.acoustics._kernels.compile import kernel, sort_head
from pymantaray.acoustics._kernels.field import field_at
from pymantaray.acoustics._kernels.section import LINEAR, cut_section
from pymantaray.acoustics._kernels.step import N_FULL
from pymantaray.acoustics._kernels.trace import trace


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
def trace_path(medium, source, unit, horizontal, slope, length, angle, side, tol, work):
    """Trace one ray along the chord into work.path; return the steps that it took before it ended or was lost."""
    s = cut_section(medium, source[0], source[1], unit[0], unit[1], horizontal, work)
    c0 = field_at(s, 0.0, source[2])
    axis = (source[2], math.cos(slope), math.sin(slope), c0)
    _, steps, _ = trace(
        s, angle - slope, side, length, axis, tol, N_FULL, work.y, work.K, work.ynew, work.path
    )
    return steps


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
