"""
Rays between points above an uneven sea bed: blocked exactly if the straight line meets the bed.
"""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.records import RayStatus

NORTH = np.linspace(-3e3, 3e3, 13)
EAST = np.linspace(-2e3, 2e3, 9)
DEPTH = np.array([0.0, 100.0, 200.0, 300.0])


def least_gap(bed: np.ndarray, source: np.ndarray, receiver: np.ndarray) -> np.ndarray:
    """
    Smallest distance in depth between straight lines and a bilinear bed, from 4,001 points of each.
    [m]
    """
    depth_of = RegularGridInterpolator((NORTH, EAST), bed)
    t = np.linspace(0.0, 1.0, 4001)[:, None]
    return np.array(
        [
            np.min(depth_of((a + t * (b - a))[:, :2]) - (a + t * (b - a))[:, 2])
            for a, b in zip(source, receiver, strict=True)
        ]
    )


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_straight_rays_are_blocked_exactly_where_they_meet_the_bed(interpolation: str) -> None:
    rng = np.random.default_rng(7)
    bed = rng.uniform(150.0, 300.0, (NORTH.size, EAST.size))
    speed = np.full((NORTH.size, EAST.size, DEPTH.size), 1500.0)
    medium = Medium.from_grid(
        NORTH, EAST, DEPTH, speed, bathymetry=bed, interpolation=interpolation
    )
    n = 600
    # up to the edges of the grid, where the rays near the bed are not known from its cells
    ends = [
        np.column_stack(
            [rng.uniform(-3e3, 3e3, n), rng.uniform(-2e3, 2e3, n), rng.uniform(1.0, 250.0, n)]
        )
        for _ in range(2)
    ]
    depth_of = RegularGridInterpolator((NORTH, EAST), bed)
    in_water = np.all([depth_of(end[:, :2]) > end[:, 2] + 0.01 for end in ends], axis=0)
    source, receiver = (end[in_water] for end in ends)
    gap = least_gap(bed, source, receiver)
    status = np.asarray(find_eigenrays(medium, source, receiver).status)
    sure = np.abs(gap) > 0.05
    assert (gap[sure] < 0.0).sum() > 50
    assert (gap[sure] > 20.0).sum() > 50
    np.testing.assert_array_equal(
        status[sure], np.where(gap[sure] < 0.0, RayStatus.BLOCKED, RayStatus.OK)
    )
