"""Compiled fixed-step integrators of vehicles that swim: a body twist a step, carried over by its exponential map.

Vehicles do not act on each other, so each is integrated on its own from start to end and its path
cannot depend on the rest of the fleet. Sample k is written after exactly k times `steps` steps.
"""

import math
from typing import NamedTuple

import numpy as np

from pymantaray.compile import entry, kernel
from pymantaray.records.status import VehicleStatus

ACTIVE = int(VehicleStatus.ACTIVE)
GROUNDED = int(VehicleStatus.GROUNDED)
LEFT_DOMAIN = int(VehicleStatus.LEFT_DOMAIN)

_SMALL = 1e-4  # rad; below it Taylor series replace the closed forms


class Water(NamedTuple):
    """
    Ocean as the kernels read it: uniform horizontal axes, currents and the sea floor on axes of its own.

    Currents have the axes time, north, east and depth; they are linear between the instants. Water that
    stands still in time has one.
    """

    north: float
    east: float
    per_north: float
    per_east: float
    depth: np.ndarray
    time: np.ndarray
    current_north: np.ndarray
    current_east: np.ndarray
    floor_north: float
    floor_east: float
    floor_per_north: float
    floor_per_east: float
    floor: np.ndarray


@entry
def place(water, north, east, depth):
    """Tell the status of a vehicle at a position; the domain's edge and the sea floor are inside."""
    x = (north - water.north) * water.per_north
    y = (east - water.east) * water.per_east
    _, n, m, _ = water.current_north.shape
    if not (0.0 <= x <= n - 1.0 and 0.0 <= y <= m - 1.0):
        return LEFT_DOMAIN
    if depth > floor_depth(water, north, east):
        return GROUNDED
    return ACTIVE


@entry
def floor_depth(water, north, east):
    """Interpolate the depth of the sea floor bilinearly; constant outside the domain."""
    i, x = cell_of((north - water.floor_north) * water.floor_per_north, water.floor.shape[0])
    j, y = cell_of((east - water.floor_east) * water.floor_per_east, water.floor.shape[1])
    near = water.floor[i, j] * (1.0 - y) + water.floor[i, j + 1] * y
    far = water.floor[i + 1, j] * (1.0 - y) + water.floor[i + 1, j + 1] * y
    return near * (1.0 - x) + far * x


@kernel
def cell_of(x, n):
    """Find the cell of an axis that holds a coordinate, counted in cells, and the place in it; clamped."""
    x = min(max(x, 0.0), n - 1.0)
    i = min(int(x), n - 2)
    return i, x - i


@kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _exponential(omega, v, dt):
    """Give the quaternion and translation of a body twist held for a time."""
    phi = (omega[0] * dt, omega[1] * dt, omega[2] * dt)
    rho = (v[0] * dt, v[1] * dt, v[2] * dt)
    t2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    t = math.sqrt(t2)
    if t < _SMALL:
        half, b, c = 0.5 - t2 / 48.0, 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
    else:
        half, b, c = math.sin(0.5 * t) / t, (1.0 - math.cos(t)) / t2, (t - math.sin(t)) / (t2 * t)
    first = _cross(phi, rho)
    second = _cross(phi, first)
    quaternion = (math.cos(0.5 * t), half * phi[0], half * phi[1], half * phi[2])
    translation = (
        rho[0] + b * first[0] + c * second[0],
        rho[1] + b * first[1] + c * second[1],
        rho[2] + b * first[2] + c * second[2],
    )
    return quaternion, translation


@kernel
def _rotate(q, a):
    """Turn a body vector into the world by a unit quaternion."""
    axis = (q[1], q[2], q[3])
    s = _cross(axis, a)
    s = (s[0] + q[0] * a[0], s[1] + q[0] * a[1], s[2] + q[0] * a[2])
    s = _cross(axis, s)
    return a[0] + 2.0 * s[0], a[1] + 2.0 * s[1], a[2] + 2.0 * s[2]


@kernel
def _compose(q, p, quaternion, translation):
    """Move a pose by a motion in its body frame; a vehicle does not rise out of the water."""
    moved = _rotate(q, translation)
    w = q[0] * quaternion[0] - q[1] * quaternion[1] - q[2] * quaternion[2] - q[3] * quaternion[3]
    x = q[0] * quaternion[1] + q[1] * quaternion[0] + q[2] * quaternion[3] - q[3] * quaternion[2]
    y = q[0] * quaternion[2] - q[1] * quaternion[3] + q[2] * quaternion[0] + q[3] * quaternion[1]
    z = q[0] * quaternion[3] + q[1] * quaternion[2] - q[2] * quaternion[1] + q[3] * quaternion[0]
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    turned = (w / norm, x / norm, y / norm, z / norm)
    return turned, (p[0] + moved[0], p[1] + moved[1], max(p[2] + moved[2], 0.0))


@kernel
def _write(sample, q, p, state, position, quaternion, status):
    for a in range(3):
        position[sample, a] = p[a]
    for a in range(4):
        quaternion[sample, a] = q[a]
    status[sample] = state


@entry
def run_twist(water, twist, dt, steps, position, quaternion, status):
    """Integrate a constant body twist; row 0 of the poses is the start, the others are filled."""
    p = (position[0, 0], position[0, 1], position[0, 2])
    q = (quaternion[0, 0], quaternion[0, 1], quaternion[0, 2], quaternion[0, 3])
    turn, move = _exponential((twist[0], twist[1], twist[2]), (twist[3], twist[4], twist[5]), dt)
    state = ACTIVE
    for sample in range(1, position.shape[0]):
        for _ in range(steps if state == ACTIVE else 0):
            next_q, next_p = _compose(q, p, turn, move)
            state = place(water, next_p[0], next_p[1], next_p[2])
            if state != ACTIVE:
                break
            q, p = next_q, next_p
        _write(sample, q, p, state, position, quaternion, status)


@kernel
def _pursue(q, p, point, turn_rate, dt):
    """Angular velocity that turns body x towards a point by the shortest way, within the limit."""
    inverse = (q[0], -q[1], -q[2], -q[3])
    aim = _rotate(inverse, (point[0] - p[0], point[1] - p[1], point[2] - p[2]))
    across = math.sqrt(aim[1] * aim[1] + aim[2] * aim[2])
    rate = min(math.atan2(across, aim[0]) / dt, turn_rate)
    if across > 0.0:
        return 0.0, -rate * aim[2] / across, rate * aim[1] / across
    return 0.0, 0.0, rate  # dead ahead (rate 0), or dead astern, where any way round is as short


@entry
def run_waypoints(
    water, points, speed, turn_rate, capture_radius, loop, dt, steps, position, quaternion, status
):
    """Integrate a swim from point to point; row 0 of the poses is the start, the others are filled."""
    p = (position[0, 0], position[0, 1], position[0, 2])
    q = (quaternion[0, 0], quaternion[0, 1], quaternion[0, 2], quaternion[0, 3])
    state = ACTIVE
    leg = 0
    for sample in range(1, position.shape[0]):
        for _ in range(steps if state == ACTIVE else 0):
            if leg < points.shape[0]:
                away = (points[leg, 0] - p[0], points[leg, 1] - p[1], points[leg, 2] - p[2])
                if away[0] ** 2 + away[1] ** 2 + away[2] ** 2 <= capture_radius**2:
                    leg += 1
                    if loop and leg == points.shape[0]:
                        leg = 0
            if leg == points.shape[0]:
                break
            omega = _pursue(q, p, points[leg], turn_rate, dt)
            turn, move = _exponential(omega, (speed, 0.0, 0.0), dt)
            next_q, next_p = _compose(q, p, turn, move)
            state = place(water, next_p[0], next_p[1], next_p[2])
            if state != ACTIVE:
                break
            q, p = next_q, next_p
        _write(sample, q, p, state, position, quaternion, status)
