"""Paths of eigenrays and of rays with given launch angles, and sections for pictures."""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.field import cut_section, field_at
from pymantaray.acoustics._kernels.layout import Baseline, BoundaryRule, Course
from pymantaray.acoustics._kernels.link import baseline, prepare
from pymantaray.acoustics._kernels.trace import (
    direct_course,
    forward_course,
    full_ray,
    legs_course,
    trace,
)
from pymantaray.compile import compact, entry, kernel
from pymantaray.geometry.boundary_kernels import depth_at

_LEG = 1e3  # m; approximate length of a leg
_NEAR_END = 1e-3  # in lengths of the link
_FINER = 1e-3  # factor of the tolerance for a second trace of a ray that ends early


@kernel
def _trace_arrival(domain, source, receiver, slowness, manner, tol, work):
    """
    Trace one eigenray again, with a given slowness at the source, into work.path.

    manner contains its axis and its reflections at the surface and at the bottom. Returns True if
    it reaches the end, the number of steps, and c at the source.
    """
    s, walls, link = prepare(domain, source, receiver, work)
    axis, bounces = manner[0], (manner[1], manner[2])
    forward = (slowness[0] * link.unit_north + slowness[1] * link.unit_east) * link.c0
    side = (slowness[1] * link.unit_north - slowness[0] * link.unit_east) * link.c0
    down = slowness[2] * link.c0
    if axis == at.VERTICAL:
        course = legs_course(
            link, bounces, down > 0.0, link.z1, (bounces[0] + bounces[1] + 1) * _LEG
        )
        ok, steps = _trace_course(s, walls, link, course, (forward, side, down), tol, work)
    elif bounces[0] + bounces[1] > 0:
        course = forward_course(link, bounces, 0, 0, link.z1, False)
        ok, steps = _trace_course(s, walls, link, course, (forward, side, down), tol, work)
    else:
        direct = direct_course(link, axis == at.CHORD, False)
        ok, steps = _trace_course(s, walls, link, direct, (forward, side, down), tol, work)
    return ok, steps, link.c0


@kernel
def _trace_course(s, walls, link, course, slowness, tol, work):
    """
    Trace an eigenray with a given slowness (forward, side, down) along its course; return True if
    it reaches the end, and the number of steps.
    """
    forward, side, down = slowness
    _, cb, sb, _ = course.axis
    angle = math.asin(min(max(down * cb - forward * sb, -1.0), 1.0))
    ok, steps, _, _ = trace(s, walls, course, angle, side, tol, full_ray(work))
    if not ok:
        ok, steps, _, _ = trace(s, walls, course, angle, side, _FINER * tol, full_ray(work))
    if (
        not ok and work.path[steps, at.BOUNDARY] != at.IN_WATER
    ):  # just before a receiver on a boundary it met that
        last = work.path[steps]
        gap = math.hypot(link.horizontal - last[at.RANGE], link.z1 - last[at.DEPTH])
        if gap < _NEAR_END * link.length:
            last[at.BOUNDARY] = at.IN_WATER
            ok = True
    return ok, steps


@entry
@compact
def trace_arrivals(domain, ends, launch, manner, times, tol, work, out):
    """
    Trace eigenrays into rows of nodes in the local frame, from the source, while there is room for
    any ray.

    ends (n, 2, 3) contains source and receiver; launch (n, 4) the slowness at the launch, and 1 for
    a launch from the receiver; manner (n, 3) the axes of the rays and their reflections at both
    boundaries. out receives the nodes, and the number of nodes of each ray, 0 if it ends early.
    Returns the number of traced rays.
    """
    nodes, counts = out
    n = 0
    for i in range(ends.shape[0]):
        if n + work.path.shape[0] > nodes.shape[0]:
            return i
        if not math.isfinite(launch[i, 0] + launch[i, 1] + launch[i, 2]):  # the ends coincide
            nodes[n, at.NODE_TIME], nodes[n, at.NODE_BOUNDARY] = 0.0, 0.0
            for k in range(3):
                nodes[n, at.NODE_POSITION + k], nodes[n, at.NODE_SLOWNESS + k] = (
                    ends[i, 0, k],
                    math.nan,
                )
            counts[i] = 1
            n += 1
            continue
        # trace from the end of the launch
        turned = launch[i, 3] > 0.0
        a = 1 if turned else 0
        start, end = ends[i, a], ends[i, 1 - a]
        ok, steps, c = _trace_arrival(domain, start, end, launch[i, :3], manner[i], tol, work)
        counts[i] = 0
        if not ok:
            continue
        # nodes from source to receiver, with times since the source
        m = min(steps + 1, work.path.shape[0])
        line = _line(start, end)
        for j in range(m):
            row = n + m - 1 - j if turned else n + j
            _local_node(work.path[j], line, c, domain.surface, nodes[row])
        last = n if turned else n + m - 1
        nodes[last, at.NODE_TIME] = times[i]
        if turned:
            for j in range(n, n + m):
                nodes[j, at.NODE_TIME] = times[i] - nodes[j, at.NODE_TIME]
                for k in range(3):
                    nodes[j, at.NODE_SLOWNESS + k] = -nodes[j, at.NODE_SLOWNESS + k]
        # the path ends exactly at source and receiver
        for k in range(3):
            nodes[n, at.NODE_POSITION + k] = ends[i, 0, k]
            nodes[n + m - 1, at.NODE_POSITION + k] = ends[i, 1, k]
        counts[i] = m
        n += m
    return ends.shape[0]


@kernel
def _line(start, end):
    """Baseline from one position to another; northward if one is above the other."""
    dn, de = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dn, de)
    if length > 0.0:
        return Baseline(start[0], start[1], dn / length, de / length)
    return Baseline(start[0], start[1], 1.0, 0.0)


@entry
@compact
def trace_launches(domain, fan, angles, bounces, tol, work, out):
    """
    Trace a fan of rays into rows of nodes in the local frame, while there is room for any ray;
    return the number of traced rays.

    fan contains the source, the direction of the plane and the distance.
    """
    source, unit, distance = fan
    nodes, counts = out
    s, walls = baseline(domain, source, unit, distance, work)
    c = field_at(s, 0.0, source[2])
    rule = BoundaryRule(at.FORWARD, bounces[0], bounces[1], 0, 0, 0.0, 0)
    axis = at.Axis(source[2], 1.0, 0.0, c)
    course = Course(rule, axis, distance, 0.0, False, False)
    n = 0
    for i in range(angles.size):
        if n + work.path.shape[0] > nodes.shape[0]:
            return i
        _, steps, _, _ = trace(s, walls, course, angles[i], 0.0, tol, full_ray(work))
        counts[i] = min(steps + 1, work.path.shape[0])
        for j in range(counts[i]):
            _local_node(work.path[j], walls.line, c, domain.surface, nodes[n + j])
        n += counts[i]
    return angles.size


@kernel
def _local_node(row, line, c, surface, node):
    """Convert a row of a path to the local frame."""
    r, y, p_r, p_y = row[at.RANGE], row[at.SIDE], row[at.P_RANGE], row[at.P_SIDE]
    un, ue = line.unit_north, line.unit_east
    node[at.NODE_TIME] = row[at.TIME] / c
    node[at.NODE_POSITION] = line.north + r * un - y * ue
    node[at.NODE_POSITION + 1] = line.east + r * ue + y * un
    node[at.NODE_POSITION + 2] = row[at.DEPTH]
    if (
        row[at.BOUNDARY] == at.AT_SURFACE and surface.depth.size == 1
    ):  # the last nanometres are missing
        node[at.NODE_POSITION + 2] = surface.depth[0, 0]
    node[at.NODE_SLOWNESS] = (p_r * un - p_y * ue) / c
    node[at.NODE_SLOWNESS + 1] = (p_r * ue + p_y * un) / c
    node[at.NODE_SLOWNESS + 2] = row[at.P_DEPTH] / c
    node[at.NODE_BOUNDARY] = row[at.BOUNDARY]


@entry
def section_grid(domain, fan, ranges, depths, work, out):
    """
    Write sound speed (range, depth), sea bed and surface along a baseline to out; ``fan`` is as in
    `trace_launches`.
    """
    source, unit, distance = fan
    speed, floor, top = out
    line = Baseline(source[0], source[1], unit[0], unit[1])
    s = cut_section(domain, line, distance, work)
    for i in range(ranges.size):
        r = ranges[i]
        n, e = source[0] + r * unit[0], source[1] + r * unit[1]
        floor[i] = depth_at(domain.bed, n, e)
        top[i] = depth_at(domain.surface, n, e)
        for k in range(depths.size):
            speed[i, k] = field_at(s, r, depths[k])
