"""Surface and sea bed: depth of the bottom, and how near a ray comes to either."""

import math

from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.cubic import cubic
from pymantaray.acoustics._kernels.section import bilinear_weights

TOUCH = 1e-6  # m; a ray this far beyond a boundary still touches it only


@kernel
def bottom_at(north, east, bathymetry, n, e):
    """Bilinear depth of the sea bed."""
    i, j, sn, se, _, _ = bilinear_weights(north, east, n, e, n, e)
    di = 1 if north.size > 1 else 0
    dj = 1 if east.size > 1 else 0
    b00 = bathymetry[i, j]
    b10 = bathymetry[i + di, j]
    b01 = bathymetry[i, j + dj]
    b11 = bathymetry[i + di, j + dj]
    return (b00 * (1.0 - sn) + b10 * sn) * (1.0 - se) + (b01 * (1.0 - sn) + b11 * sn) * se


@kernel
def clearances(path, steps, axis, n0, e0, un, ue, north, east, bathymetry, breaks, n_breaks):
    """Least distances of a traced ray from the surface and from the sea bed, negative beyond. [m]

    Every step's cubic Hermite is sampled, at nine points, at its turning point and at each edge of the
    bathymetry's cells, where its peaks are.
    """
    z_source, cb, sb, _ = axis
    below_surface, above_bottom = math.inf, math.inf
    for i in range(steps):
        s0, w0, d0 = path[i, 0], path[i, 1], path[i, 2]
        h = path[i + 1, 0] - s0
        w1, d1 = path[i + 1, 1], path[i + 1, 2]
        if h <= 0.0:
            continue
        r0 = s0 * cb - w0 * sb
        r1 = (s0 + h) * cb - w1 * sb
        extra = 0
        first = 0
        while first < n_breaks and breaks[first] <= min(r0, r1):
            first += 1
        while first + extra < n_breaks and breaks[first + extra] < max(r0, r1):
            extra += 1
        z_0 = path[i, 3]
        z_1 = path[i + 1, 3]
        turning = z_0 * z_1 < 0.0
        for j in range(9 + extra + 1):
            if j < 9:
                t = j / 8.0
            elif j < 9 + extra:
                t = (breaks[first + j - 9] - r0) / (r1 - r0)
            elif turning:
                t = z_0 / (z_0 - z_1)
            else:
                continue
            w = cubic(t, h, w0, d0, w1, d1)
            s = s0 + t * h
            r = s * cb - w * sb
            z = z_source + s * sb + w * cb
            floor = bottom_at(north, east, bathymetry, n0 + r * un, e0 + r * ue)
            below_surface = min(below_surface, z)
            above_bottom = min(above_bottom, floor - z)
    return below_surface, above_bottom
