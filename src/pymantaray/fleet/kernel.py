"""
Compiled fixed-step integrators of vehicles with a body twist, swimmers and floats in currents.

Vehicles do not affect each other, so each is integrated separately from start to end, and its path
is independent of the rest of the fleet. Sample k is the state after exactly k times `steps` steps.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.compile import entry, kernel
from pymantaray.geometry.boundary_kernels import BoundaryGrid, depth_at, interval_of
from pymantaray.records.status import VehicleStatus

ACTIVE = int(VehicleStatus.ACTIVE)
GROUNDED = int(VehicleStatus.GROUNDED)
LEFT_DOMAIN = int(VehicleStatus.LEFT_DOMAIN)

TOUCH = 1e-6  # m; tolerance for rounding of a vehicle on the sea bed or at its target depth
_SAME_NODE = 1e-6  # of a cell; closer nodes count as one
_SMALL_ANGLE = 1e-4  # rad; below it Taylor series replace the closed forms


class OceanArrays(NamedTuple):
    """
    Arrays of an ocean for the kernels: axes, and currents (time, north, east, depth) with one time
    if constant.
    """

    north: np.ndarray
    east: np.ndarray
    depth: np.ndarray
    time: np.ndarray
    current_north: np.ndarray
    current_east: np.ndarray
    bed: BoundaryGrid
    surface: BoundaryGrid
    """Sea surface, or the underside of ice."""


@entry
def place(water, north, east, depth):
    """
    Return the status of a vehicle at a position; the edge of the domain and, within `TOUCH`, the
    sea floor are inside.
    """
    if not (water.north[0] <= north <= water.north[-1] and water.east[0] <= east <= water.east[-1]):
        return LEFT_DOMAIN
    if depth > bed_depth(water, north, east) + TOUCH:
        return GROUNDED
    return ACTIVE


@entry
def bed_depth(water, north, east):
    """Depth of the sea bed by bilinear interpolation, constant beyond its edges. [m]"""
    return _depth(water.bed, north, east)


@entry
def surface_depth(water, north, east):
    """
    Depth of the surface or the ice's underside by bilinear interpolation, constant beyond its
    edges. [m]
    """
    if water.surface.depth.size == 1:
        return water.surface.depth[0, 0]
    return _depth(water.surface, north, east)


@kernel
def _depth(boundary, north, east):
    """Depth of a boundary at a position, which is limited to its grid. [m]"""
    return depth_at(boundary, _within(boundary.north, north), _within(boundary.east, east))


@kernel
def _within(axis, x):
    """Coordinate limited to an axis. [m]"""
    return min(max(x, axis[0]), axis[axis.size - 1])


@kernel
def _cell_of(axis, x):
    """
    Return the cell of an axis that contains a coordinate, the cells per metre there, and the
    fraction in it; limited to the axis.
    """
    x = _within(axis, x)
    i = interval_of(axis, x)
    per_metre = 1.0 / (axis[i + 1] - axis[i])
    return i, per_metre, (x - axis[i]) * per_metre


@kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _exponential(omega, v, dt):
    """Return quaternion and translation after a time under a constant body twist."""
    phi = (omega[0] * dt, omega[1] * dt, omega[2] * dt)
    rho = (v[0] * dt, v[1] * dt, v[2] * dt)
    t2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    t = math.sqrt(t2)
    if t < _SMALL_ANGLE:
        half = 0.5 - t2 / 48.0
        b = 0.5 - t2 / 24.0
        c = 1.0 / 6.0 - t2 / 120.0
    else:
        half = math.sin(0.5 * t) / t
        b = (1.0 - math.cos(t)) / t2
        c = (t - math.sin(t)) / (t2 * t)
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
    """Rotate a vector from body to world by a unit quaternion."""
    axis = (q[1], q[2], q[3])
    s = _cross(axis, a)
    s = (s[0] + q[0] * a[0], s[1] + q[0] * a[1], s[2] + q[0] * a[2])
    s = _cross(axis, s)
    return a[0] + 2.0 * s[0], a[1] + 2.0 * s[1], a[2] + 2.0 * s[2]


@kernel
def _compose(water, q, p, quaternion, translation):
    """
    Move a pose by a motion in its body frame; the vehicle cannot rise out of the water or into the
    ice.
    """
    moved = _rotate(q, translation)
    w = q[0] * quaternion[0] - q[1] * quaternion[1] - q[2] * quaternion[2] - q[3] * quaternion[3]
    x = q[0] * quaternion[1] + q[1] * quaternion[0] + q[2] * quaternion[3] - q[3] * quaternion[2]
    y = q[0] * quaternion[2] - q[1] * quaternion[3] + q[2] * quaternion[0] + q[3] * quaternion[1]
    z = q[0] * quaternion[3] + q[1] * quaternion[2] - q[2] * quaternion[1] + q[3] * quaternion[0]
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    turned = (w / norm, x / norm, y / norm, z / norm)
    north = p[0] + moved[0]
    east = p[1] + moved[1]
    return turned, (north, east, max(p[2] + moved[2], surface_depth(water, north, east)))


@kernel
def _write(sample, q, p, state, position, quaternion, status):
    for a in range(3):
        position[sample, a] = p[a]
    for a in range(4):
        quaternion[sample, a] = q[a]
    status[sample] = state


@kernel
def _current(water, north, east, depth, now):
    """
    Current at a position, limited to the ocean, and a time, by linear interpolation in space and
    time.
    """
    near = min(np.searchsorted(water.depth, depth), water.depth.size - 2)
    (i, j, k), _, _, _, (x, y, z) = _enclosing(water, north, east, depth, near)
    before = 0
    if water.time.size > 1:
        before = min(
            max(np.searchsorted(water.time, now, side="right") - 1, 0), water.time.size - 2
        )
    form_u, form_v = _forms(water, before, i, j, k)
    u = _evaluate(form_u, x, y, z)
    v = _evaluate(form_v, x, y, z)
    if water.time.size > 1:
        rate_u, rate_v = _rates(water, before, before + 1, i, j, k)
        since = now - water.time[before]
        u += since * _evaluate(rate_u, x, y, z)
        v += since * _evaluate(rate_v, x, y, z)
    return u, v


@kernel
def _carry(water, p, swum, now, dt):
    """
    Position after a step in a current that is constant at its value in the middle of the step.
    """
    north = 0.5 * (p[0] + swum[0])
    east = 0.5 * (p[1] + swum[1])
    depth = 0.5 * (p[2] + swum[2])
    middle = now + 0.5 * dt
    u, v = _current(water, north, east, depth, middle)
    u, v = _current(water, north + 0.5 * dt * u, east + 0.5 * dt * v, depth, middle)
    north = swum[0] + u * dt
    east = swum[1] + v * dt
    return north, east, max(swum[2], surface_depth(water, north, east))


@entry
def run_twist(water, twist, carried, dt, steps, position, quaternion, status):
    """
    Integrate a constant body twist, with or without the current; row 0 of the poses is the start,
    the other rows are output.
    """
    p = (position[0, 0], position[0, 1], position[0, 2])
    q = (quaternion[0, 0], quaternion[0, 1], quaternion[0, 2], quaternion[0, 3])
    turn, move = _exponential((twist[0], twist[1], twist[2]), (twist[3], twist[4], twist[5]), dt)
    state = ACTIVE
    for sample in range(1, position.shape[0]):
        for step in range(steps if state == ACTIVE else 0):
            next_q, next_p = _compose(water, q, p, turn, move)
            if carried:
                next_p = _carry(water, p, next_p, ((sample - 1) * steps + step) * dt, dt)
            state = place(water, next_p[0], next_p[1], next_p[2])
            if state != ACTIVE:
                break
            q = next_q
            p = next_p
        _write(sample, q, p, state, position, quaternion, status)


@kernel
def _pursue(q, p, point, turn_rate, dt):
    """
    Angular velocity, within the limit, that turns body x towards a point by the shortest rotation.
    """
    inverse = (q[0], -q[1], -q[2], -q[3])
    aim = _rotate(inverse, (point[0] - p[0], point[1] - p[1], point[2] - p[2]))
    across = math.sqrt(aim[1] * aim[1] + aim[2] * aim[2])
    rate = min(math.atan2(across, aim[0]) / dt, turn_rate)
    if across > 0.0:
        return 0.0, -rate * aim[2] / across, rate * aim[1] / across
    # straight ahead (rate 0), or straight astern, where all rotations are equally short
    return 0.0, 0.0, rate


class Route(NamedTuple):
    """Waypoints (n, 3) of a swimmer, its speed and limits, and whether the current carries it."""

    points: np.ndarray
    speed: float
    turn_rate: float
    capture_radius: float
    loop: bool
    carried: bool


@entry
def run_waypoints(water, route, dt, steps, position, quaternion, status):
    """
    Integrate a swim from waypoint to waypoint; row 0 of the poses is the start, the other rows are
    output.
    """
    points = route.points
    p = (position[0, 0], position[0, 1], position[0, 2])
    q = (quaternion[0, 0], quaternion[0, 1], quaternion[0, 2], quaternion[0, 3])
    state = ACTIVE
    leg = 0
    for sample in range(1, position.shape[0]):
        for step in range(steps if state == ACTIVE else 0):
            if leg < points.shape[0]:
                away = (points[leg, 0] - p[0], points[leg, 1] - p[1], points[leg, 2] - p[2])
                if away[0] ** 2 + away[1] ** 2 + away[2] ** 2 <= route.capture_radius**2:
                    leg += 1
                    if route.loop and leg == points.shape[0]:
                        leg = 0
            next_q = q
            next_p = p
            if leg < points.shape[0]:
                omega = _pursue(q, p, points[leg], route.turn_rate, dt)
                turn, move = _exponential(omega, (route.speed, 0.0, 0.0), dt)
                next_q, next_p = _compose(water, q, p, turn, move)
            elif not route.carried:
                break
            if route.carried:
                next_p = _carry(water, p, next_p, ((sample - 1) * steps + step) * dt, dt)
            state = place(water, next_p[0], next_p[1], next_p[2])
            if state != ACTIVE:
                break
            q = next_q
            p = next_p
        _write(sample, q, p, state, position, quaternion, status)


class Cycle(NamedTuple):
    """Cycle of a float, with times in steps."""

    target: float
    surface: float
    start: float
    """Depth until the first descent."""
    speed: float
    gain: float
    delay: int
    hold_depth: int
    hold_surface: int
    drogue: float
    """Depth of the current that acts on the float, relative to the float."""


@kernel
def _shallowest(water, i, j):
    """Smallest depth of the sea bed under a cell of the ocean, that of a grid point. [m]"""
    bed = water.bed
    shallowest = math.inf
    start, stop = _under(bed.north, water.north[i], water.north[i + 1] - water.north[i])
    left, right = _under(bed.east, water.east[j], water.east[j + 1] - water.east[j])
    for a in range(start, stop):
        for b in range(left, right):
            shallowest = min(shallowest, bed.depth[a, b])
    return shallowest


@kernel
def _under(axis, near, side):
    """First grid point of the sea bed under a cell of the ocean, and the one after the last."""
    start = interval_of(axis, near + _SAME_NODE * side)
    return start, min(interval_of(axis, near + (1.0 - _SAME_NODE) * side) + 2, axis.size)


@kernel
def _form(values, i, j, k, thickness):
    """Coefficients of the trilinear interpolant of a cell: for 1, x, y, xy, and these times z."""
    a = values[i, j, k]
    b = values[i + 1, j, k] - a
    c = values[i, j + 1, k] - a
    d = values[i + 1, j + 1, k] - a - b - c
    e = values[i, j, k + 1]
    f = values[i + 1, j, k + 1] - e
    g = values[i, j + 1, k + 1] - e
    h = values[i + 1, j + 1, k + 1] - e - f - g
    return (
        a,
        b,
        c,
        d,
        (e - a) / thickness,
        (f - b) / thickness,
        (g - c) / thickness,
        (h - d) / thickness,
    )


@kernel
def _change(before, after, per_second):
    """Rates of change of the coefficients between two instants."""
    a, b, c, d, e, f, g, h = after
    return (
        (a - before[0]) * per_second,
        (b - before[1]) * per_second,
        (c - before[2]) * per_second,
        (d - before[3]) * per_second,
        (e - before[4]) * per_second,
        (f - before[5]) * per_second,
        (g - before[6]) * per_second,
        (h - before[7]) * per_second,
    )


@kernel
def _evaluate(form, x, y, z):
    a, b, c, d, e, f, g, h = form
    return a + b * x + (c + d * x) * y + (e + f * x + (g + h * x) * y) * z


@kernel
def _level(depth, k, z):
    """Return the layer that contains a depth; the search starts from layer k."""
    while k > 0 and z < depth[k]:
        k -= 1
    while k < depth.size - 2 and z >= depth[k + 1]:
        k += 1
    return k


@kernel
def _phase_at(cycle, phase, step, depth, top):
    """
    State of a float below a surface at depth ``top``: descending, holding, last step of the hold,
    and target depth.
    """
    down, holding, until, aim = phase
    short = max(aim, top) - depth if down else depth - max(aim, top)
    if holding:
        if step >= until:
            down = not down
            holding = False
            aim = cycle.target if down else cycle.surface
    elif short <= TOUCH:
        holding = True
        until = step + (cycle.hold_depth if down else cycle.hold_surface)
    return down, holding, until, aim


@kernel
def _forms(water, instant, i, j, k):
    """Coefficients of both components of the current in a cell at an instant, north and east."""
    thickness = water.depth[k + 1] - water.depth[k]
    u = _form(water.current_north[instant], i, j, k, thickness)
    return u, _form(water.current_east[instant], i, j, k, thickness)


@kernel
def _rates(water, before, after, i, j, k):
    """Rates of change of both components of the current in a cell between two instants."""
    per_second = 1.0 / (water.time[after] - water.time[before])
    u, v = _forms(water, before, i, j, k)
    next_u, next_v = _forms(water, after, i, j, k)
    return _change(u, next_u, per_second), _change(v, next_v, per_second)


@kernel
def _enclosing(water, north, east, depth, k):
    """
    Return the cell that contains a position limited to the ocean (indices, corner [m], cells per
    metre, thickness [m]), and the position in it.
    """
    i, per_north, x = _cell_of(water.north, north)
    j, per_east, y = _cell_of(water.east, east)
    z = min(max(depth, water.depth[0]), water.depth[-1])
    k = _level(water.depth, k, z)
    upper = water.depth[k]
    corner = (water.north[i], water.east[j], upper)
    return (i, j, k), corner, (per_north, per_east), water.depth[k + 1] - upper, (x, y, z - upper)


@kernel
def _instants_around(time, now, before, after):
    """
    Consecutive instants before and after a time, from those before and after an earlier one (equal
    if there was none), and True if they are the same.
    """
    same = True
    while after == before or (now >= time[after] and after < time.size - 1):
        before, after = after, after + 1
        same = False
    return before, after, same


@kernel
def _in_cell(corner, per_metre, north, east, depth):
    """Position in a cell: north and east in parts of its sides, depth below its top [m]."""
    x = (north - corner[0]) * per_metre[0]
    y = (east - corner[1]) * per_metre[1]
    return x, y, depth - corner[2]


def _float_kernel(varying):
    """
    Return an integrator of floats; two variants exist so that constant currents need no
    interpolation in time.
    """

    @entry
    def run_float(water, cycle, dt, steps, position, status):
        north, east, depth = position[0]
        k = 0
        corner = (0.0, 0.0, 0.0)
        per_metre = (0.0, 0.0)
        shallowest = 0.0
        thickness = -1.0  # no cell yet: no depth is inside
        form_u = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        form_v, rate_u, rate_v = form_u, form_u, form_u
        # instants before and after the middle of the step, and time since the first
        before, after, since = 0, 0, 0.0
        # the first evaluation is at the start because no current predicts the middle yet
        u, v, half = 0.0, 0.0, 0.0
        state = ACTIVE
        step = 0
        # a step ends at the goal at the latest, so no gain is unstable
        gain = min(cycle.gain, 1.0 / dt)
        phase = (False, True, cycle.delay, cycle.start)
        for sample in range(1, position.shape[0]):
            for _ in range(steps if state == ACTIVE else 0):
                top = surface_depth(water, north, east)  # under ice, a float holds at the underside
                phase = _phase_at(cycle, phase, step, depth, top)
                goal = max(phase[3], top)
                w = min(max(gain * (goal - depth), -cycle.speed), cycle.speed)
                for _ in range(2 if step == 0 else 1):
                    if varying:
                        now = step * dt + half
                        before, after, same = _instants_around(water.time, now, before, after)
                        thickness = thickness if same else -1.0  # no depth is in an old cell
                        since = now - water.time[before]
                    at_north = north + half * u
                    at_east = east + half * v
                    at_depth = depth + cycle.drogue + half * w
                    x, y, z = _in_cell(corner, per_metre, at_north, at_east, at_depth)
                    if not (0.0 <= x <= 1.0 and 0.0 <= y <= 1.0 and 0.0 <= z <= thickness):
                        (i, j, k), corner, per_metre, thickness, (x, y, z) = _enclosing(
                            water, at_north, at_east, at_depth, k
                        )
                        form_u, form_v = _forms(water, before, i, j, k)
                        if varying:
                            rate_u, rate_v = _rates(water, before, after, i, j, k)
                        shallowest = _shallowest(water, i, j)
                    u, v = _evaluate(form_u, x, y, z), _evaluate(form_v, x, y, z)
                    if varying:
                        u += since * _evaluate(rate_u, x, y, z)
                        v += since * _evaluate(rate_v, x, y, z)
                    half = 0.5 * dt
                new_north, new_east = north + u * dt, east + v * dt
                new_depth = max(depth + w * dt, surface_depth(water, new_north, new_east))
                x, y, _ = _in_cell(corner, per_metre, new_north, new_east, new_depth)
                if not (0.0 <= x <= 1.0 and 0.0 <= y <= 1.0 and new_depth <= shallowest):
                    state = place(water, new_north, new_east, new_depth)
                    if state != ACTIVE:
                        break
                north, east, depth = new_north, new_east, new_depth
                step += 1
            position[sample, 0], position[sample, 1], position[sample, 2] = north, east, depth
            status[sample] = state

    return run_float


_run_float_still = _float_kernel(False)
_run_float_varying = _float_kernel(True)


def run_float(
    water: OceanArrays,
    cycle: Cycle,
    dt: float,
    steps: int,
    position: NDArray[np.float64],
    status: NDArray[np.int8],
) -> None:
    """
    Integrate a float; row 0 of `position` is its start, the other rows are output.

    A step uses the current at its middle in space and time, where the current of the previous step
    predicts the position. This is second order with one interpolation per step. The body does not
    rotate, so the exponential map of the body twist ``R^T u`` is the translation ``u dt``. A float
    stays in one cell of the ocean for thousands of steps. The integrator therefore keeps the
    coefficients of the cell, their rates of change, the limits of the cell and its smallest sea-bed
    depth.
    """
    run = _run_float_still if water.time.size == 1 else _run_float_varying
    run(water, cycle, dt, steps, position, status)
