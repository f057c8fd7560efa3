"""Launch angles worth a look: how steep a ray may be that turns within reach of a link, and the first fan."""

import math

from pymantaray.acoustics._kernels.field import level_speed
from pymantaray.acoustics._kernels.section import SMOOTH, sort_head
from pymantaray.compile import kernel

STEEP = 0.08  # rad beyond the Snell limit from which a link has one ray only
BEYOND = 0.02  # rad; the fan goes beyond the steepest ray that may arrive by this


@kernel
def fan_nodes(lo, hi, spacing, closest, s, c_source, nodes):
    """Launch angles of the first fan: equal spacing, and the angles at which rays turn at the levels.

    What a profile does between two levels a ray feels when it turns there: the miss has structure on
    the scale of these angles, and in a LINEAR section singularities exactly at them.
    """
    count = max(int(math.ceil((hi - lo) / spacing)), 2) + 1
    count = min(count, nodes.size // 2)
    for i in range(count):
        nodes[i] = lo + (hi - lo) * i / (count - 1)
    n = count
    for k in range(s.depth.size):
        c_first = 0.0
        for cell in range(s.n_range):
            c = level_speed(s, cell, k)
            c_first = c if cell == 0 else c_first
            if c > c_source and n < nodes.size - 2:
                angle = math.acos(c_source / c)
                if angle < hi:
                    nodes[n] = angle
                    n += 1
                if -angle > lo:
                    nodes[n] = -angle
                    n += 1
            if s.kind == SMOOTH or (cell > 0 and abs(c - c_first) < 1e-9):
                break
    sort_head(nodes, n)
    m = 1
    for i in range(1, n):
        if nodes[i] - nodes[m - 1] > closest:
            nodes[m] = nodes[i]
            m += 1
    return m


@kernel
def speed_extremes(s, extremes):
    """Least and largest sound speed of each layer over the section, and by how much a layer's varies at most along it."""
    variation = 0.0
    n = s.depth.size
    for k in range(n - 1):
        h = s.depth[k + 1] - s.depth[k]
        extremes[0, k], extremes[1, k] = math.inf, 0.0
        first = 0.0
        for i in range(s.n_range):
            c0, c1 = s.data[i, k, 0], s.data[i, k + 1, 0] if k + 1 < s.data.shape[1] else 0.0
            if s.kind == SMOOTH:
                d1, d2, d3 = s.data[i, k, 1], s.data[i, k, 2], s.data[i, k, 3]
                c1 = c0 + h * (d1 + h * (d2 + h * d3))
                root = d2 * d2 - 3.0 * d1 * d3
                if root > 0.0:  # extrema inside the layer
                    q = -(d2 + math.copysign(math.sqrt(root), d2))
                    for x in (q / (3.0 * d3) if d3 != 0.0 else -1.0, d1 / q if q != 0.0 else -1.0):
                        if 0.0 < x < h:
                            c = c0 + x * (d1 + x * (d2 + x * d3))
                            extremes[0, k] = min(extremes[0, k], c)
                            extremes[1, k] = max(extremes[1, k], c)
            extremes[0, k] = min(extremes[0, k], min(c0, c1))
            extremes[1, k] = max(extremes[1, k], max(c0, c1))
            if i == 0:
                first = c0
            variation = max(variation, abs(c0 - first))
    return variation


@kernel
def snell_limit(s, c_source, top, low, variation, extremes):
    """Steepest angle from the horizontal at which a ray can turn between two depths, and at which it may be there.

    Snell's law: arccos of the sound speed at the source over the fastest within, raised by what the field
    varies along the section.
    """
    slowest, fastest = c_source, c_source
    for k in range(s.depth.size - 1):
        if s.depth[k + 1] >= top and s.depth[k] <= low:
            slowest = min(slowest, extremes[0, k])
            fastest = max(fastest, extremes[1, k])
    if fastest > c_source:
        fastest += variation
    return math.acos(c_source / fastest), math.acos(slowest / fastest)


@kernel
def turning_limits(s, c_source, z0, z1, horizontal, variation, extremes):
    """Steepest launch angles upwards and downwards at which a ray can turn within reach of a link."""
    up, down, steep_up, steep_down = 0.6, 0.6, 0.6, 0.6
    for _ in range(3):
        reach = 0.5 * horizontal * math.tan(steep_up) + 1.0
        up, steep_up = snell_limit(s, c_source, min(z0, z1) - reach, z0, variation, extremes)
        reach = 0.5 * horizontal * math.tan(steep_down) + 1.0
        down, steep_down = snell_limit(s, c_source, z0, max(z0, z1) + reach, variation, extremes)
    return up, down


@kernel
def is_steep(slope, limit):
    """Whether a link's chord is so steep that one direct ray joins its ends, traced along the chord."""
    return abs(slope) > max(limit + STEEP, 0.3)
