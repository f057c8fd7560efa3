"""Initial positions of nodes: robust estimates from straight ranges."""

from typing import NamedTuple

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.survey import Node, Survey, TravelDirection
from pymantaray.apps.locate.travel_times import transducers
from pymantaray.arrays import Array
from pymantaray.estimation import LOSSES
from pymantaray.estimation.solvers.descents import choose
from pymantaray.geometry.spread import MAD_TO_SIGMA

_MAX_STEPS = 60
_CONVERGED = 1e-2  # m
_GUESSES = 8  # around the pings, in addition to their middle and the prior
_MIN_SCALE = 1.0  # m


def mean_speed(medium: Medium, top: float, bottom: float) -> float:
    """Harmonic mean of the sound speed between two depths in the middle of a medium. [m/s]"""
    low, high = sorted((max(top, 0.0), max(bottom, 0.0)))
    depth = np.linspace(low, max(high, low + 1.0), 201)
    column = medium.sound_speed[medium.north.size // 2, medium.east.size // 2]
    return float(1.0 / np.mean(1.0 / np.interp(depth, medium.depth, column)))


def start_positions(survey: Survey, medium: Medium) -> Array:
    """
    Position of each node (n_nodes, 3) from straight ranges, or its prior if these are few. [m]
    """
    transmit_position, receive_position = transducers(survey, np.array(survey.lever.offset))
    middle = 0.5 * (transmit_position + receive_position)
    positions = np.array([node.position for node in survey.nodes])
    for k, node in enumerate(survey.nodes):
        rows = (survey.node == k) & (survey.partner < 0) & ~survey.flagged
        sigma_north, sigma_east, _ = node.sigma
        if rows.sum() < 3 or not (sigma_north or sigma_east):
            continue
        speed = mean_speed(medium, float(np.median(middle[rows, 2])), node.position[2])
        two_way = survey.direction[rows] == TravelDirection.TWO_WAY
        time = survey.travel_time[rows]
        ranges = speed * np.where(two_way, 0.5 * (time - node.turn_around), time)
        positions[k] = _from_ranges(middle[rows], ranges, node, has_bias=not two_way.all())
    return positions


def _from_ranges(points: Array, ranges: Array, node: Node, *, has_bias: bool) -> Array:
    """Position with the lowest robust cost after descents from several guesses."""
    north, east, depth = node.position
    radius = float(np.median(np.sqrt(np.maximum(ranges**2 - (depth - points[:, 2]) ** 2, 0.0))))
    angles = np.linspace(0.0, 2.0 * np.pi, _GUESSES, endpoint=False)
    centre = points[:, :2].mean(axis=0)
    guesses = [np.array([north, east]), centre]
    guesses += [centre + radius * np.array([np.cos(angle), np.sin(angle)]) for angle in angles]

    def descend(start: Array, bias: float = 0.0) -> _End:
        return _descend(points, ranges, start, node, has_bias=has_bias, bias=bias)

    ends = [descend(np.append(guess, depth)) for guess in guesses]
    return choose(ends, lambda end: descend(end.position, end.bias)).position


class _End(NamedTuple):
    """End of a descent."""

    position: Array
    bias: float
    cost: float
    converged: bool


def _descend(
    points: Array, ranges: Array, start: Array, node: Node, *, has_bias: bool, bias: float = 0.0
) -> _End:
    """Minimize a Cauchy loss with the node's prior by iteratively re-weighted steps."""
    loss = LOSSES["cauchy"]
    position = np.array(start)
    mean = np.append(node.position, 0.0)
    sd = np.append(
        np.maximum(node.sigma, 1e-3), max(1500.0 * node.offset_sigma, 1e-6) if has_bias else 1e-6
    )
    cost = np.inf
    for _ in range(_MAX_STEPS):
        step = position - points
        distance = np.maximum(np.linalg.norm(step, axis=1), 1e-6)
        residual = ranges - distance + bias
        scale = max(
            MAD_TO_SIGMA * float(np.median(np.abs(residual - np.median(residual) * has_bias))),
            _MIN_SCALE,
        )
        weight = loss.weight(residual / scale) / scale**2
        rows = np.column_stack([step / distance[:, None], np.full(len(points), -1.0)])
        normal = rows.T @ (weight[:, None] * rows) + np.diag(sd**-2.0)
        right = rows.T @ (weight * residual) + (mean - np.append(position, bias)) / sd**2
        change = np.linalg.solve(normal, right)
        # a step is at most as long as the median range
        length = max(float(np.linalg.norm(change[:-1])), 1e-9)
        change *= min(1.0, float(np.median(ranges)) / length)
        position = position + change[:-1]
        bias = bias + change[-1]
        position[2] = max(position[2], 0.1)
        cost = float(np.sum(np.log1p((residual / scale) ** 2)) + 2.0 * len(ranges) * np.log(scale))
        if np.linalg.norm(change) < _CONVERGED:
            return _End(position, bias, cost, converged=True)
    return _End(position, bias, cost, converged=False)
