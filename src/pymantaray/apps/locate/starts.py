"""
Initial positions of nodes: robust estimates from straight ranges, from several initial guesses.
"""

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
    Position of each node (n_nodes, 3) from straight ranges to the platform, or its prior if there
    are too few. [m]
    """
    near, away = transducers(survey, np.array(survey.lever.offset))
    middle = 0.5 * (near + away)
    out = np.array([node.position for node in survey.nodes])
    for k, node in enumerate(survey.nodes):
        rows = (survey.node == k) & (survey.partner < 0) & ~survey.flagged
        if rows.sum() < 3 or not any(node.sigma[:2]):
            continue
        speed = mean_speed(medium, float(np.median(middle[rows, 2])), node.position[2])
        two_way = survey.direction[rows] == TravelDirection.TWO_WAY
        time = survey.travel_time[rows]
        ranges = speed * np.where(two_way, 0.5 * (time - node.turn_around), time)
        out[k] = _from_ranges(middle[rows], ranges, node, biased=not two_way.all())
    return out


def _from_ranges(points: Array, ranges: Array, node: Node, *, biased: bool) -> Array:
    """Position with the lowest robust cost after descents from several guesses."""
    depth = node.position[2]
    reach = float(np.median(np.sqrt(np.maximum(ranges**2 - (depth - points[:, 2]) ** 2, 0.0))))
    around = np.linspace(0.0, 2.0 * np.pi, _GUESSES, endpoint=False)
    centre = points[:, :2].mean(axis=0)
    guesses = [np.array(node.position[:2]), centre]
    guesses += [centre + reach * np.array([np.cos(a), np.sin(a)]) for a in around]
    ends = [
        _descend(points, ranges, np.append(guess, depth), node, biased=biased) for guess in guesses
    ]
    best = choose(
        ends, lambda end: _descend(points, ranges, end.position, node, biased=biased, bias=end.bias)
    )
    return best.position


class _End(NamedTuple):
    """End of a descent."""

    position: Array
    bias: float
    cost: float
    converged: bool


def _descend(
    points: Array, ranges: Array, start: Array, node: Node, *, biased: bool, bias: float = 0.0
) -> _End:
    """Minimize a Cauchy loss with the node's prior by iteratively re-weighted steps."""
    loss = LOSSES["cauchy"]
    x = np.array(start)
    mean = np.append(node.position, 0.0)
    sd = np.append(
        np.maximum(node.sigma, 1e-3), max(1500.0 * node.offset_sigma, 1e-6) if biased else 1e-6
    )
    cost = np.inf
    for _ in range(_MAX_STEPS):
        step = x - points
        distance = np.maximum(np.linalg.norm(step, axis=1), 1e-6)
        residual = ranges - distance + bias
        scale = max(
            MAD_TO_SIGMA * float(np.median(np.abs(residual - np.median(residual) * biased))),
            _MIN_SCALE,
        )
        weight = loss.weight(residual / scale) / scale**2
        rows = np.column_stack([step / distance[:, None], np.full(len(points), -1.0)])
        normal = rows.T @ (weight[:, None] * rows) + np.diag(sd**-2.0)
        right = rows.T @ (weight * residual) + (mean - np.append(x, bias)) / sd**2
        move = np.linalg.solve(normal, right)
        move *= min(1.0, float(np.median(ranges)) / max(float(np.linalg.norm(move[:3])), 1e-9))
        x = x + move[:3]
        bias = bias + move[3]
        x[2] = max(x[2], 0.1)
        cost = float(np.sum(np.log1p((residual / scale) ** 2)) + 2.0 * len(ranges) * np.log(scale))
        if np.linalg.norm(move) < _CONVERGED:
            return _End(x, bias, cost, converged=True)
    return _End(x, bias, cost, converged=False)
