"""Bootstrap of positions: resample residuals with replacement and solve the linear system."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from threadpoolctl import threadpool_limits

from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.geometry import stream

_MAX_DRAWS = 1_000_000


def bootstrap_positions(
    solution: SurveySolution,
    draws: int,
    *,
    seed: int,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Array:
    """
    Estimate positions (draws, n_nodes, 3) from resampled surveys. [m]

    The function resamples rows of the whitened system, which includes correlated noise and errors
    of the platform. Positions change by at most metres. Travel times are linear to micrometres over
    that distance, so no ray is traced again.
    """
    if not 1 < draws <= _MAX_DRAWS:
        raise LocateError(f"bootstrap is {draws}; it must be 2 to {_MAX_DRAWS:,} draws")
    rows = np.concatenate(list(solution.whitened_rows()))
    sd = solution.unknowns.scaled_sd(solution.posterior.hyperparameters)
    active = np.flatnonzero(sd > 0.0)
    design = rows[:, active] * (sd[active] / solution.posterior.sigma)
    residual = rows[:, -1] / solution.posterior.sigma
    size = len(rows)
    offset = ((solution.unknowns.prior_mean - solution.values)[active]) / sd[active]

    def draw(number: int) -> Array:
        rng = stream(seed, number, "locate", "bootstrap")
        count = np.bincount(rng.integers(0, size, size), minlength=size).astype(float)
        normal = (design * count[:, None]).T @ design + np.eye(active.size)
        change = np.zeros(solution.unknowns.size)
        change[active] = sd[active] * np.linalg.solve(
            normal, design.T @ (count * residual) + offset
        )
        return solution.unknowns.positions(solution.values + change)

    positions = []
    with (
        threadpool_limits(limits=1, user_api="blas"),
        ThreadPoolExecutor(threads or os.cpu_count()) as pool,
    ):
        for i, position in enumerate(pool.map(draw, range(draws)), 1):
            positions.append(position)
            if progress is not None:
                progress(i, draws)
    return np.array(positions)
