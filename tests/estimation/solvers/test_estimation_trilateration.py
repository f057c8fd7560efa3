"""Places of a point from its ranges: every minimum, in space, in a plane and on a line."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from pymantaray.estimation import FactorGraph, GraphValues
from pymantaray.estimation.solvers.trilateration import trilaterate


@pytest.mark.parametrize("spread", [(1.0, 1.0, 1.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_trilateration_lists_every_minimum_of_the_ranges(spread, as_stored):
    """Against many descents from random points, of points in space, in a plane and on a line."""
    rng = np.random.default_rng(1)
    point, landmark = 10.0 * rng.normal(size=(12, 3)) * spread, np.array([5.0, -8.0, 12.0])
    distance = np.linalg.norm(point - landmark, axis=1)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (12, 1))
    graph = FactorGraph(
        vehicle_name=np.array(["A"]),
        landmark_name=np.array(["L0"]),
        pose_vehicle=np.zeros(12, int),
        pose_number=np.arange(12),
        pose_time=np.arange(12.0),
    )
    pairs = np.column_stack([np.arange(12), np.full(12, 12)])
    graph = graph.with_factors(
        range=graph["range"].kind.table(pairs, [distance], np.ones((12, 1, 1)))
    )
    found = trilaterate(graph, GraphValues(point, level, np.zeros((1, 3))))[12]
    assert min(np.linalg.norm(x - landmark) for x in found) < (1e-5 if spread[1] else 10.0)
    for x in found[: 2 if spread[1] else None]:
        if not spread[2]:
            np.testing.assert_allclose(np.linalg.norm(point - x, axis=1), distance, atol=1e-5)
    if spread == (1.0, 1.0, 0.0):
        np.testing.assert_allclose(sorted(x[2] for x in found[:2]), [-12.0, 12.0], atol=1e-5)
    ends = [
        least_squares(
            lambda x: np.linalg.norm(x - point, axis=1) - distance, 20.0 * rng.normal(size=3)
        )
        for _ in range(20)
    ]
    least = min(np.sum((np.linalg.norm(found[0] - point, axis=1) - distance) ** 2) / 2, np.inf)
    assert least <= min(end.cost for end in ends) + 1e-9
    if spread[2]:
        as_stored(found)
