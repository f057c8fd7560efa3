"""Scores of a design over an ensemble of waters, and the Pareto front of designs."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.apps.plan.evaluate import Scores

COLUMNS = {
    "error": "error_m",
    "lost": "lost_percent",
    "heard_by_two": "heard_by_two_percent",
    "cost": "cost",
}
"""Score of each objective."""
LARGER_IS_BETTER = frozenset(["heard_by_two_percent"])
WORST = 0.1
"""Share of the waters that ``worst_score`` takes."""


def mean_score(scores: Sequence[Scores], column: str) -> float:
    """Mean of a score over the waters; NaN if the design fails in one."""
    return float(np.mean([getattr(one, column) for one in scores]))


def worst_score(scores: Sequence[Scores], column: str) -> float:
    """
    Mean of a score over the worst tenth of the waters, at least one; NaN if the design fails in one
    water.
    """
    values = np.sort([getattr(one, column) for one in scores])
    if column not in LARGER_IS_BETTER:
        values = values[::-1]
    worst = values[: int(np.ceil(WORST * len(values)))]
    return float(worst.mean()) if np.isfinite(values).all() else np.nan


def loss_of(objective: str, scores: Sequence[Scores], ranked_by: str = "mean") -> float:
    """Value that an objective minimizes: the mean over the waters, or that over the worst tenth."""
    column = COLUMNS[objective]
    value = mean_score(scores, column) if ranked_by == "mean" else worst_score(scores, column)
    return (-1.0 if column in LARGER_IS_BETTER else 1.0) * value


def pareto_front(losses: ArrayLike) -> NDArray[np.bool_]:
    """
    Mask of the designs that no other design dominates.

    Parameters
    ----------
    losses : array_like, shape (n_designs, n_objectives)
        Each objective is minimized. A design with NaN is not on the front.

    Returns
    -------
    ndarray of bool, shape (n_designs,)

    Examples
    --------
    >>> pareto_front([[1.0, 3.0], [2.0, 2.0], [2.0, 4.0]]).tolist()
    [True, True, False]
    """
    values = np.asarray(losses, dtype=float)
    usable: NDArray[np.bool_] = np.isfinite(values).all(axis=1)
    front: NDArray[np.bool_] = usable.copy()
    for k in np.flatnonzero(usable):
        no_worse = (values[usable] <= values[k]).all(axis=1)
        front[k] = not (no_worse & (values[usable] < values[k]).any(axis=1)).any()
    return front
