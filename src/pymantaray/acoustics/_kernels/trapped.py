"""
Launch angles of rays that remain in a duct of a LINEAR section and never meet the receiver.

A ray near a sound-speed minimum at a level crosses the level thousands of times, so it takes many
steps, and its slowness at the end says nothing about that of its neighbours. Energy excludes such
rays without tracing them. Let D be the excess of the sound speed over the least one between the
walls of a duct at the same range. The energy ``E = c_source sin^2(angle) / 2 + D`` at the source
changes along a ray by at most ``|dD/dr|``. For a positive constant ``soft``, ``E + soft`` therefore
grows at most by the factor ``exp(sum of max |d ln(D + soft)|)``. A ray whose E stays below D at
both walls does not pass them. D is linear in depth between levels, so levels and walls have its
largest relative changes.
"""

import math

from pymantaray.acoustics._kernels.field import find_level, linear_full, sort_head
from pymantaray.compile import kernel

_WIDTHS = 1, 2, 4, 8  # levels from the source to each wall of a duct
# constants `soft`, as shares of the lower wall; almost zero for a duct with its axis at one level
_SOFT_SHARES = 1e-9, 1.0 / 16.0, 0.25
_SAMPLES = 4  # of each cell of the section
# by which E is multiplied: for extrema between samples, rays out of the plane, and n^2 instead of D
_SAFETY = 1.5


@kernel
def trapped_angle(s, link, work):
    """
    Launch angle such that no flatter ray leaves a duct about the source or meets the receiver; 0
    without such a duct. [rad]
    """
    most = 0.0
    for width in _WIDTHS:
        n = _put_duct(s, link, width, work.acc[0])
        if n == 0:
            break
        wall, start, _ = _along_duct(s, link, n, 1.0, work)
        if wall <= start:
            continue
        for share in _SOFT_SHARES:
            soft = share * wall
            growth = _along_duct(s, link, n, soft, work)[2]
            most = max(most, (wall + soft) * math.exp(-growth) / _SAFETY - soft - start)
    return math.sqrt(2.0 * most / link.c0)


@kernel
def _put_duct(s, link, width, depths):
    """
    Put the depths of the levels of a duct about the source, and its walls first and last, into
    depths; return their number, 0 if a wall is outside the levels or at the source.

    The receiver's depth is a wall if the receiver is nearer than the level.
    """
    last = s.depth.size - 1
    below = find_level(s, link.z0) + 1
    above = below - 2 if s.depth[below - 1] == link.z0 else below - 1
    top, low = above - width + 1, below + width - 1
    if top < 0 or low > last or not s.depth[top] < link.z0 < s.depth[low] or link.z1 == link.z0:
        return 0
    n = 0
    for k in range(top, low + 1):
        z = s.depth[k]
        if link.z1 < link.z0 and z < link.z1:
            z = link.z1
        if link.z1 > link.z0 and z > link.z1:
            z = link.z1
        if n == 0 or z > depths[n - 1]:
            depths[n] = z
            n += 1
        else:
            depths[n - 1] = z
    return n


@kernel
def _along_duct(s, link, n, soft, work):
    """
    Least D at both walls of a duct along the section, D at the source, and the growth of the
    logarithm of E + soft.
    """
    depths, speed, before = work.acc[0], work.acc[1], work.acc[2]
    wall, start, growth, axis_before = math.inf, math.inf, 0.0, 0.0
    for b in range(s.n_range):
        first, end = max(s.breaks[b], 0.0), min(s.breaks[b + 1], link.horizontal)
        if first >= end:
            continue
        for i in range(_SAMPLES + 1):
            r = first + (end - first) * i / _SAMPLES
            axis = math.inf
            for j in range(n):
                speed[j] = linear_full(s, b, find_level(s, depths[j]), r, depths[j])[0]
                axis = min(axis, speed[j])
            largest = 0.0
            for j in range(n):
                excess = speed[j] - axis + soft
                if axis_before > 0.0:
                    largest = max(largest, abs(math.log(excess / before[j])))
                before[j] = excess
            if axis_before > 0.0:
                growth += largest + 3.0 * abs(axis - axis_before) / axis
            else:
                start = link.c0 - axis
            wall = min(wall, speed[0] - axis, speed[n - 1] - axis)
            axis_before = axis
    return wall, start, growth


@kernel
def leave_out_trapped(n, angle, nodes):
    """
    Replace those of the first n launch angles that are flatter than an angle by two rays at this
    angle; return their number.
    """
    m = 0
    for i in range(n):
        if abs(nodes[i]) > angle:
            nodes[m] = nodes[i]
            m += 1
    nodes[m], nodes[m + 1] = -angle, angle
    sort_head(nodes, m + 2)
    return m + 2
