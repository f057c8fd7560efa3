"""
Steps that floats of the paper's authors' program hold, as steps of a study's float with the same
depths over time.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array

DEPTH_GAIN = 10.0
"""Vertical speed per depth error of the program. [1/s]"""
_ARRIVAL_STEPS = 1  # in which the program finds that it has arrived; a hold counts from the next
_CHUNK = 1 << 20  # steps to add at once
_TOUCH = 1e-6  # m, at which a float of a study has arrived


class Holds(NamedTuple):
    """
    Steps by which holds of a study's float are longer than those that the program counts; None if
    it never arrives.
    """

    depth: int | None
    """Steps at the target depth."""
    surface: int | None
    """Steps at the surface."""


@lru_cache(maxsize=256)
def counted_steps(seconds: float, step: float) -> int:
    """Steps after which a sum of them, with its rounding, is at least a duration."""
    total = 0.0
    count = 1
    while True:
        sums = _sums(total, step, _CHUNK)
        count += int(np.searchsorted(sums[1:], seconds))
        if sums[-1] >= seconds:
            return count
        total = float(sums[-1])


def _sums(start: float, step: float, count: int) -> Array:
    """Sums after each of a number of steps, with the rounding of one addition after another."""
    return np.cumsum(np.concatenate([[start], np.full(count, step)]))


def extra_steps(
    start: float, target: float, surface: float, speed: float, step: float, limit: int
) -> Holds:
    """
    Compare the steps of a dive and an ascent in the program with those of a study's float.

    The program moves by whole steps until it has passed a depth; a study's float stops at it. The
    first dive and ascent give the depths between which the program moves later. At most ``limit``
    steps are compared.
    """
    ours = _reached(target - start, speed, step), _reached(target - surface, speed, step)
    depth, dive = _passed(start, target, speed, step, limit)
    if dive is None:
        return Holds(None, None)
    first = Holds(dive - ours[0] + _ARRIVAL_STEPS, _ARRIVAL_STEPS)
    if dive == limit:
        return first
    depth, ascent = _passed(depth, surface, speed, step, limit)
    if ascent is None:
        return first._replace(surface=None)
    depth, dive = _passed(depth, target, speed, step, limit)
    _, ascent = _passed(depth, surface, speed, step, limit)
    if dive is None or ascent is None:
        return first
    return Holds(dive - ours[1] + _ARRIVAL_STEPS, ascent - ours[1] + _ARRIVAL_STEPS)


def _passed(
    depth: float, goal: float, speed: float, step: float, limit: int
) -> tuple[float, int | None]:
    """
    Depth at which the program has passed a goal, and its steps; None if a step no longer changes
    the depth.
    """
    sign = 1.0 if goal > depth else -1.0
    count = 0
    while count <= limit:
        if sign * (depth - goal) >= 0.0:
            return depth, count
        # far from the goal the speed is its limit
        far = (abs(goal - depth) - speed / DEPTH_GAIN) / (speed * step) - 2.0
        if far > 1.0:
            full = int(min(far, _CHUNK, limit - count + 1))
            before, depth = _sums(depth, sign * speed * step, full)[[0, -1]].tolist()
            if depth == before:
                return depth, None
            count += full
            continue
        moved = depth + sign * min(DEPTH_GAIN * abs(goal - depth), speed) * step
        if moved == depth:
            return depth, None
        depth = moved
        count += 1
    return depth, limit


def _reached(distance: float, speed: float, step: float) -> int:
    """Steps of a study's float over a vertical distance."""
    part = min(DEPTH_GAIN * step, 1.0)
    count = 0
    while distance > _TOUCH:
        full = int(distance / (speed * step)) - 2  # far from the goal the speed is its limit
        if full > 1 and distance - full * speed * step > speed / DEPTH_GAIN + speed * step:
            count += full
            distance -= full * speed * step
        distance -= min(part * distance, speed * step)
        count += 1
    return count
