"""
Fans of rays in a trilinear field from a grid: an oracle for direct rays that shares no code with
the solver.
"""

import numpy as np
from numba import njit


@njit
def _cell(axis, x):
    k = min(max(np.searchsorted(axis, x, side="right") - 1, 0), axis.size - 2)
    width = axis[k + 1] - axis[k]
    return k, (x - axis[k]) / width, width


@njit
def _field(axes, speed, x, y, z):
    """Sound speed and its gradient."""
    i, a, wx = _cell(axes[0], x)
    j, b, wy = _cell(axes[1], y)
    k, d, wz = _cell(axes[2], z)
    c000, c001 = speed[i, j, k], speed[i, j, k + 1]
    c010, c011 = speed[i, j + 1, k], speed[i, j + 1, k + 1]
    c100, c101 = speed[i + 1, j, k], speed[i + 1, j, k + 1]
    c110, c111 = speed[i + 1, j + 1, k], speed[i + 1, j + 1, k + 1]
    c00, c01 = c000 + a * (c100 - c000), c001 + a * (c101 - c001)
    c10, c11 = c010 + a * (c110 - c010), c011 + a * (c111 - c011)
    c0, c1 = c00 + b * (c10 - c00), c01 + b * (c11 - c01)
    west = (1 - b) * ((1 - d) * c000 + d * c001) + b * ((1 - d) * c010 + d * c011)
    east = (1 - b) * ((1 - d) * c100 + d * c101) + b * ((1 - d) * c110 + d * c111)
    along_y = (1 - d) * (c10 - c00) + d * (c11 - c01)
    return c0 + d * (c1 - c0), (east - west) / wx, along_y / wy, (c1 - c0) / wz


@njit
def _rates(axes, speed, s):
    """Change of position, slowness and time along the path."""
    c, cx, cy, cz = _field(axes, speed, s[0], s[1], s[2])
    f = -1.0 / (c * c)
    return c * s[3], c * s[4], c * s[5], f * cx, f * cy, f * cz, 1.0 / c


@njit
def _moved(s, h, k):
    return (
        s[0] + h * k[0],
        s[1] + h * k[1],
        s[2] + h * k[2],
        s[3] + h * k[3],
        s[4] + h * k[4],
        s[5] + h * k[5],
        s[6] + h * k[6],
    )


@njit
def _trace(axes, speed, source, launch, along, distance, step, out):
    """
    Offset east and north, depth and time of rays in the plane at a distance; NaN outside the water
    or after a turn.
    """
    x0, y0 = source[0], source[1]
    for n in range(launch.shape[0]):
        c = _field(axes, speed, x0, y0, source[2])[0]
        s = (x0, y0, source[2], launch[n, 0] / c, launch[n, 1] / c, launch[n, 2] / c, 0.0)
        out[n] = np.nan
        last = False
        while not last:
            left = distance - (s[0] - x0) * along[0] - (s[1] - y0) * along[1]
            k1 = _rates(axes, speed, s)
            forward = k1[0] * along[0] + k1[1] * along[1]
            if not (forward > 0.1 and s[2] >= 0.0):
                break
            last = step * forward >= left
            h = left / forward if last else step
            k2 = _rates(axes, speed, _moved(s, 0.5 * h, k1))
            k3 = _rates(axes, speed, _moved(s, 0.5 * h, k2))
            k4 = _rates(axes, speed, _moved(s, h, k3))
            s = _moved(_moved(s, h / 6.0, k1), h / 3.0, k2)
            s = _moved(_moved(s, h / 3.0, k3), h / 6.0, k4)
        if last:
            out[n, 0], out[n, 1], out[n, 2], out[n, 3] = s[0] - x0, s[1] - y0, s[2], s[6]


def _fan(axes, speed, ends, elevations, step):
    """
    Depths below the receiver and travel times of rays that end in the vertical line through it.
    """
    source, receiver = ends
    distance = np.hypot(*(receiver - source)[:2])
    along = (receiver - source)[:2] / distance
    across = np.array([-along[1], along[0]])
    turn, out = np.zeros(elevations.size), np.empty((elevations.size, 4))
    for _ in range(4):
        flat = np.cos(turn)[:, None] * along + np.sin(turn)[:, None] * across
        launch = np.column_stack([np.cos(elevations)[:, None] * flat, np.sin(elevations)])
        _trace(axes, speed, source, launch, along, distance, step, out)
        aside = out[:, :2] @ across
        turn = np.where(np.isfinite(aside), turn - aside / distance, turn)
    return out[:, 2] - receiver[2], out[:, 3]


def first_direct_time(axes, speed, source, receiver, half_angle=0.17, count=1601):
    """
    Least travel time of the rays of a fan that meet a receiver [s]; NaN without a ray.

    A second fan with a shorter step looks about each pair of neighbours on both sides of the
    receiver.
    """
    ends = np.asarray(source, dtype=float), np.asarray(receiver, dtype=float)
    coarse = np.linspace(-half_angle, half_angle, count)
    miss, _ = _fan(axes, speed, ends, coarse, 4.0)
    times = []
    for i in np.flatnonzero(miss[:-1] * miss[1:] <= 0.0):
        fine = np.linspace(coarse[max(i - 2, 0)], coarse[min(i + 3, count - 1)], 201)
        miss_fine, time = _fan(axes, speed, ends, fine, 1.0)
        for j in np.flatnonzero(miss_fine[:-1] * miss_fine[1:] <= 0.0):
            part = miss_fine[j] / (miss_fine[j] - miss_fine[j + 1])
            times.append(time[j] + part * (time[j + 1] - time[j]))
    return min(times, default=np.nan)
