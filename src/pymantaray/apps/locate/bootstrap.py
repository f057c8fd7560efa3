"""
Bootstrap of positions: resample independent residuals with replacement and solve the linear system.
"""

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
    s = solution
    rows = np.concatenate(list(s.whitened()))
    sd = s.unknowns.scaled_sd(
        dict.fromkeys(s.unknowns.groups, 1.0) | dict(s.posterior.hyperparameters)
    )
    active = np.flatnonzero(sd > 0.0)
    design = rows[:, active] * (sd[active] / s.posterior.sigma)
    residual = rows[:, -1] / s.posterior.sigma
    size = len(rows)
    offset = ((s.unknowns.prior_mean - s.values)[active]) / sd[active]

    def draw(number: int) -> Array:
        rng = stream(seed, number, "locate", "bootstrap")
        count = np.bincount(rng.integers(0, size, size), minlength=size).astype(float)
        normal = (design * count[:, None]).T @ design + np.eye(active.size)
        change = np.zeros(s.unknowns.size)
        change[active] = sd[active] * np.linalg.solve(
            normal, design.T @ (count * residual) + offset
        )
        return s.unknowns.positions(s.values + change)

    out = []
    with (
        threadpool_limits(limits=1, user_api="blas"),
        ThreadPoolExecutor(threads or os.cpu_count()) as pool,
    ):
        for i, place in enumerate(pool.map(draw, range(draws)), 1):
            out.append(place)
            if progress is not None:
                progress(i, draws)
    return np.array(out)
