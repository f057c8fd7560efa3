"""Bootstrap of positions: independent residuals are drawn again with replacement, and the linear system is solved."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pymantaray.errors import LocateError
from pymantaray.geometry import stream
from pymantaray.locate.solve import Solution

Array = NDArray[np.float64]
_MOST = 1_000_000


def bootstrap_positions(
    solution: Solution,
    draws: int,
    *,
    seed: int,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Array:
    """
    Positions (draws, n_nodes, 3) of resampled surveys. [m]

    Rows of the whitened system are drawn, so that correlated noise and errors of the platform are resampled as one block each.
    Positions move by metres at most, where the times are linear to micrometres, so that no ray is traced again.
    """
    if not 1 < draws <= _MOST:
        raise LocateError(f"bootstrap: {draws} draws; 2 to {_MOST:,} are possible")
    s = solution
    platform = s.unknowns.survey.platform_error
    rows = np.concatenate(
        [block for block, _ in s.linear.whitened(s.used, s.correlation, platform, s.posterior.sigma)]
    )
    sd = s.unknowns.scaled_sd(dict.fromkeys(s.unknowns.groups, 1.0) | dict(s.posterior.hyperparameters))
    active = np.flatnonzero(sd > 0.0)
    design = rows[:, active] * (sd[active] / s.posterior.sigma)
    residual, size = rows[:, -1] / s.posterior.sigma, len(rows)
    offset = ((s.unknowns.prior_mean - s.values)[active]) / sd[active]

    def draw(number: int) -> Array:
        rng = stream(seed, number, "locate", "bootstrap")
        count = np.bincount(rng.integers(0, size, size), minlength=size).astype(float)
        normal = (design * count[:, None]).T @ design + np.eye(active.size)
        change = np.zeros(s.unknowns.size)
        change[active] = sd[active] * np.linalg.solve(normal, design.T @ (count * residual) + offset)
        return s.unknowns.positions(s.values + change)

    out = []
    with threadpool_limits(limits=1, user_api="blas"), ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        for i, place in enumerate(pool.map(draw, range(draws)), 1):
            out.append(place)
            if progress is not None:
                progress(i, draws)
    return np.array(out)
