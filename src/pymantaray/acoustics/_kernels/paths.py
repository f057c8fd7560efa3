"""Single rays and sections for pictures, and the travel time along the straight chord."""

import math

from pymantaray.acoustics._kernels.bounced import STEEPEST_FORWARD
from pymantaray.acoustics._kernels.boundary import (
    AT_SURFACE,
    BOUNDARY,
    DEPTH,
    P_DEPTH,
    P_RANGE,
    P_SIDE,
    RANGE,
    SIDE,
    TIME,
    Floor,
    bottom_at,
)
from pymantaray.acoustics._kernels.field import field_at
from pymantaray.acoustics._kernels.limits import is_steep, speed_extremes, turning_limits
from pymantaray.acoustics._kernels.section import LINEAR, cut_section, line_breaks, sort_head
from pymantaray.acoustics._kernels.trace import FORWARD, LEGS, OPEN, Rule, trace
from pymantaray.compile import entry, kernel


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
def baseline(medium, bed, source, unit, horizontal, work):
    """Section and sea bed along a baseline."""
    s = cut_section(medium, source[0], source[1], unit[0], unit[1], horizontal, work)
    n = line_breaks(
        bed.north,
        bed.east,
        source[0],
        source[1],
        unit[0],
        unit[1],
        0.0,
        max(horizontal, 1e-6),
        work.floor_breaks,
    )
    return s, Floor(
        bed.north,
        bed.east,
        bed.depth,
        source[0],
        source[1],
        unit[0],
        unit[1],
        work.floor_breaks,
        n,
        1.0,
        work.cells,
        -1.0,
    )


@kernel
def trace_arrival(medium, bed, source, receiver, slowness, n_surface, n_bottom, tol, work):
    """Trace one eigenray again, launched with a slowness, into work.path; return the steps and c at the source."""
    dn, de = receiver[0] - source[0], receiver[1] - source[1]
    z0, z1 = source[2], receiver[2]
    horizontal = math.hypot(dn, de)
    length = math.hypot(horizontal, z1 - z0)
    unit = (1.0, 0.0)
    if horizontal > 0.0:
        unit = (dn / horizontal, de / horizontal)
    s, floor = baseline(medium, bed, source, unit, horizontal, work)
    c0 = field_at(s, 0.0, z0)
    forward = (slowness[0] * unit[0] + slowness[1] * unit[1]) * c0
    side = (slowness[1] * unit[0] - slowness[0] * unit[1]) * c0
    down = slowness[2] * c0
    cb, sb, span = 1.0, 0.0, horizontal
    rule = Rule(OPEN, 0, 0, 0, 0, 0.0, 0)
    if n_surface + n_bottom == 0:
        slope = math.atan2(z1 - z0, horizontal)
        variation = speed_extremes(s, work.extremes)
        up, low = turning_limits(s, c0, z0, z1, horizontal, variation, work.extremes)
        if is_steep(slope, max(up, low)):
            cb, sb, span = math.cos(slope), math.sin(slope), length
    elif abs(down) < math.sin(STEEPEST_FORWARD) and forward > 0.0:
        rule = Rule(FORWARD, n_surface, n_bottom, 0, 0, 0.0, 0)
    else:
        legs = n_surface + n_bottom + 1
        rule = Rule(LEGS, n_surface, n_bottom, 0, legs, z1, 0)
        cb, sb, span = 0.0, 1.0 if down > 0.0 else -1.0, legs * 1e3
    angle = math.asin(min(max(down * cb - forward * sb, -1.0), 1.0))
    axis = (z0, cb, sb, c0)
    _, steps, _, _, _, _ = trace(
        s, floor, rule, angle, side, span, axis, tol, work.y, work.K, work.ynew, work.path
    )
    return steps, c0


@entry
def trace_arrivals(medium, bed, ends, units, turned, slowness, times, bounces, tol, work, nodes, counts):
    """Trace eigenrays into rows of nodes, in the local frame and from the source, as long as there is room for any.

    ends (n, 2, 3) holds source and receiver, units (n, 2) the direction of the baseline from the end of launch, which is the
    receiver where turned; slowness is that of launch. counts takes the nodes of each ray. Returns the number traced.
    """
    n = 0
    for i in range(ends.shape[0]):
        if n + work.path.shape[0] > nodes.shape[0]:
            return i
        if not math.isfinite(slowness[i, 0] + slowness[i, 1] + slowness[i, 2]):  # the ends coincide
            nodes[n, 0], nodes[n, 7] = 0.0, 0.0
            for k in range(3):
                nodes[n, 1 + k], nodes[n, 4 + k] = ends[i, 0, k], math.nan
            counts[i] = 1
            n += 1
            continue
        a = 1 if turned[i] else 0
        start, end = ends[i, a], ends[i, 1 - a]
        steps, c = trace_arrival(
            medium, bed, start, end, slowness[i], bounces[i, 0], bounces[i, 1], tol, work
        )
        m = min(steps + 1, work.path.shape[0])
        for j in range(m):
            row = n + m - 1 - j if turned[i] else n + j
            _local_node(work.path[j], start, units[i, 0], units[i, 1], c, nodes[row])
        last = n if turned[i] else n + m - 1
        nodes[last, 0] = times[i]
        if turned[i]:
            for j in range(n, n + m):
                nodes[j, 0] = times[i] - nodes[j, 0]
                for k in range(4, 7):
                    nodes[j, k] = -nodes[j, k]
        for k in range(3):
            nodes[n, 1 + k], nodes[n + m - 1, 1 + k] = ends[i, 0, k], ends[i, 1, k]
        counts[i] = m
        n += m
    return ends.shape[0]


@entry
def trace_launches(
    medium, bed, source, unit, distance, angles, max_surface, max_bottom, tol, work, nodes, counts
):
    """Trace a fan of rays into rows of nodes, in the local frame, as long as there is room for any; return the number traced."""
    s, floor = baseline(medium, bed, source, unit, distance, work)
    c = field_at(s, 0.0, source[2])
    rule = Rule(FORWARD, max_surface, max_bottom, 0, 0, 0.0, 0)
    axis = (source[2], 1.0, 0.0, c)
    n = 0
    for i in range(angles.size):
        if n + work.path.shape[0] > nodes.shape[0]:
            return i
        _, steps, _, _, _, _ = trace(
            s, floor, rule, angles[i], 0.0, distance, axis, tol, work.y, work.K, work.ynew, work.path
        )
        counts[i] = min(steps + 1, work.path.shape[0])
        for j in range(counts[i]):
            _local_node(work.path[j], source, unit[0], unit[1], c, nodes[n + j])
        n += counts[i]
    return angles.size


@kernel
def _local_node(row, start, un, ue, c, node):
    """Bring a row of a path into the local frame: travel time, position, slowness, boundary."""
    r, y, p_r, p_y = row[RANGE], row[SIDE], row[P_RANGE], row[P_SIDE]
    node[0] = row[TIME] / c
    node[1] = start[0] + r * un - y * ue
    node[2] = start[1] + r * ue + y * un
    node[3] = 0.0 if row[BOUNDARY] == AT_SURFACE else row[DEPTH]  # the last nanometres
    node[4] = (p_r * un - p_y * ue) / c
    node[5] = (p_r * ue + p_y * un) / c
    node[6] = row[P_DEPTH] / c
    node[7] = row[BOUNDARY]


@entry
def section_grid(medium, bed, source, unit, horizontal, ranges, depths, speed, floor, work):
    """Sound speed (range, depth) and sea bed along a baseline."""
    s = cut_section(medium, source[0], source[1], unit[0], unit[1], horizontal, work)
    for i in range(ranges.size):
        r = ranges[i]
        floor[i] = bottom_at(bed, source[0] + r * unit[0], source[1] + r * unit[1])
        for k in range(depths.size):
            speed[i, k] = field_at(s, r, depths[k])
