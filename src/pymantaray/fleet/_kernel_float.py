"""Compiled fixed-step integrator of floats, carried by currents that stand still or vary in time."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.compile import entry, kernel
from pymantaray.fleet._kernel import ACTIVE, Water, cell_of, place

_SAME = 1e-6  # of a cell; nodes closer than this are one


class Cycle(NamedTuple):
    """A float's cycle, times counted in steps."""

    target: float
    surface: float
    speed: float
    gain: float
    tolerance: float
    delay: int
    hold_depth: int
    hold_surface: int


@kernel
def _shallowest(water, i, j):
    """Find the shallowest node of the sea floor under a cell of the ocean; it rises nowhere above that."""
    start, stop = _under(i, water.north - water.floor_north, water.per_north, water.floor_per_north)
    left, right = _under(j, water.east - water.floor_east, water.per_east, water.floor_per_east)
    n, m = water.floor.shape
    shallowest = math.inf
    for a in range(max(start, 0), min(stop, n)):
        for b in range(max(left, 0), min(right, m)):
            shallowest = min(shallowest, water.floor[a, b])
    return shallowest


@kernel
def _under(i, offset, per_metre, floor_per_metre):
    """Nodes of the sea floor, first and one past the last, between which a cell's edges lie."""
    near = (offset + i / per_metre) * floor_per_metre
    far = (offset + (i + 1) / per_metre) * floor_per_metre
    return math.floor(near + _SAME), math.ceil(far - _SAME) + 1


@kernel
def _form(values, i, j, k, thickness):
    """Write the trilinear interpolant of a cell as a polynomial: 1, x, y, xy and the same times z."""
    a = values[i, j, k]
    b = values[i + 1, j, k] - a
    c = values[i, j + 1, k] - a
    d = values[i + 1, j + 1, k] - a - b - c
    e = values[i, j, k + 1]
    f = values[i + 1, j, k + 1] - e
    g = values[i, j + 1, k + 1] - e
    h = values[i + 1, j + 1, k + 1] - e - f - g
    return a, b, c, d, (e - a) / thickness, (f - b) / thickness, (g - c) / thickness, (h - d) / thickness


@kernel
def _change(before, after, per_second):
    """Write how fast a polynomial changes from one instant to the next."""
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
    """Find the layer that holds a depth, starting from the one last visited."""
    while k > 0 and z < depth[k]:
        k -= 1
    while k < depth.size - 2 and z >= depth[k + 1]:
        k += 1
    return k


def _float_kernel(varying):
    """
    Compile the float's integrator for currents that stand still or vary in time.

    Two functions, so that a float in still currents pays nothing for time.
    """

    @entry
    def run_float(water, cycle, dt, steps, position, status):
        _, n, m, _ = water.current_north.shape
        level = water.depth
        north, east, depth = position[0]
        per_north, per_east = water.per_north, water.per_east
        k = 0
        cell_north, cell_east, cell_depth, shallowest = 0.0, 0.0, 0.0, 0.0
        thickness = -1.0  # no cell visited yet: no depth lies in it
        form_u = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        form_v, rate_u, rate_v = form_u, form_u, form_u
        before, after, since = 0, 0, 0.0  # instants about the step's middle, and the time since the first
        u, v = 0.0, 0.0
        half = 0.0  # the first evaluation is at the start itself: nothing predicts its middle yet
        state = ACTIVE
        down, holding, until = False, True, cycle.delay
        wanted = cycle.surface
        step = 0
        for sample in range(1, position.shape[0]):
            for _ in range(steps if state == ACTIVE else 0):
                if holding:
                    if step >= until:
                        down, holding = not down, False
                        wanted = cycle.target if down else cycle.surface
                elif abs(wanted - depth) <= cycle.tolerance:
                    holding = True
                    until = step + (cycle.hold_depth if down else cycle.hold_surface)
                w = min(max(cycle.gain * (wanted - depth), -cycle.speed), cycle.speed)
                for _ in range(2 if step == 0 else 1):
                    if varying:
                        now = step * dt + half
                        while after == before or (now >= water.time[after] and after < water.time.size - 1):
                            before, after = after, after + 1
                            thickness = -1.0  # the cell's interpolants are of other instants
                        since = now - water.time[before]
                    x = (north + half * u - cell_north) * per_north
                    y = (east + half * v - cell_east) * per_east
                    z = depth + half * w - cell_depth
                    if not (0.0 <= x <= 1.0 and 0.0 <= y <= 1.0 and 0.0 <= z <= thickness):
                        i, x = cell_of((north + half * u - water.north) * per_north, n)
                        j, y = cell_of((east + half * v - water.east) * per_east, m)
                        z = min(max(depth + half * w, level[0]), level[-1])
                        k = _level(level, k, z)
                        z -= level[k]
                        thickness = level[k + 1] - level[k]
                        cell_north, cell_east = water.north + i / per_north, water.east + j / per_east
                        cell_depth = level[k]
                        form_u = _form(water.current_north[before], i, j, k, thickness)
                        form_v = _form(water.current_east[before], i, j, k, thickness)
                        if varying:
                            per_second = 1.0 / (water.time[after] - water.time[before])
                            next_u = _form(water.current_north[after], i, j, k, thickness)
                            next_v = _form(water.current_east[after], i, j, k, thickness)
                            rate_u = _change(form_u, next_u, per_second)
                            rate_v = _change(form_v, next_v, per_second)
                        shallowest = _shallowest(water, i, j)
                    u, v = _evaluate(form_u, x, y, z), _evaluate(form_v, x, y, z)
                    if varying:
                        u += since * _evaluate(rate_u, x, y, z)
                        v += since * _evaluate(rate_v, x, y, z)
                    half = 0.5 * dt
                new_north, new_east = north + u * dt, east + v * dt
                new_depth = max(depth + w * dt, 0.0)
                x = (new_north - cell_north) * per_north
                y = (new_east - cell_east) * per_east
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
    water: Water, cycle: Cycle, dt: float, steps: int, position: NDArray[np.float64], status: NDArray[np.int8]
) -> None:
    """
    Integrate a float; row 0 of `position` is its start, the others are filled.

    The current of a step is that at its middle, in place and time, which last step's current predicts: second
    order with one interpolation. The body never turns, so the exponential map of the body twist ``R^T u`` is
    the translation ``u dt`` itself, and the rotation drops out. A float stays in one cell of the ocean for
    thousands of steps, so the cell's interpolant, its rate of change, box and shallowest corner are kept.
    """
    run = _run_float_still if water.time.size == 1 else _run_float_varying
    run(water, cycle, dt, steps, position, status)
