"""Paired comparison of ranging conditions: all conditions of a realization have the same noise."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EvaluationError
from pymantaray.evaluation.trajectory_error import trajectory_errors
from pymantaray.geometry import stream
from pymantaray.records import Estimates, Trajectories

PAIRS = (
    ("refracted", "straight"),
    ("straight", "odometry"),
    ("refracted", "odometry"),
    ("straight", "no-ranges"),
    ("refracted", "no-ranges"),
    ("straight-all", "straight"),
)
_RESAMPLES = 2000
_COLUMNS = ["condition", "baseline", "statistic", "realizations", "excluded"]
_COLUMNS += ["pooled_difference_m", "bootstrap_low_m", "bootstrap_high_m"]
_COLUMNS += ["mean_difference_m", "t_low_m", "t_high_m"]


def paired_interval(differences: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """
    Student's confidence interval of the mean of independent differences; NaN for fewer than two.
    """
    d = np.asarray(differences, dtype=float)
    if d.size < 2:
        return float("nan"), float("nan")
    half = float(stdtrit(d.size - 1, 0.5 + confidence / 2.0) * d.std(ddof=1) / np.sqrt(d.size))
    return float(d.mean()) - half, float(d.mean()) + half


def comparison_table(
    truth: Trajectories,
    estimates: Estimates,
    pairs: Sequence[tuple[str, str]] | None = None,
    *,
    confidence: float = 0.95,
    root_seed: int = 0,
) -> pd.DataFrame:
    """
    Differences of trajectory error between conditions, with their confidence intervals over
    realizations.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.
    pairs : sequence of (str, str), optional
        Condition, and baseline to subtract. Default: the pairs of `PAIRS` whose conditions exist in
        the estimates.
    confidence : float
        Confidence level of the intervals. [-]
    root_seed : int
        Seed of the bootstrap.

    Returns
    -------
    pandas.DataFrame
        One row for each pair and each of the statistics ``mean`` and ``rmse`` of the APE.
        ``realizations`` is the number of realizations in which both solves are usable; ``excluded``
        is the number of other realizations. ``pooled_difference_m`` is the difference of the
        statistic pooled over vehicles and realizations, with its bootstrap percentile interval
        ``bootstrap_low_m``, ``bootstrap_high_m`` over realizations. ``mean_difference_m`` is the
        mean over realizations of the difference in each realization, with its Student interval
        ``t_low_m``, ``t_high_m``.

    Raises
    ------
    EvaluationError
        If the estimates lack a condition of a pair, or as `trajectory_errors`.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import comparison_table
    >>> table = comparison_table(truth, estimates, [("refracted", "straight")])
    >>> table[["statistic", "realizations", "pooled_difference_m"]].round(2)
      statistic  realizations  pooled_difference_m
    0      mean             3                 0.06
    1      rmse             3                 0.08
    """
    present = estimates.condition.tolist()
    chosen = [p for p in PAIRS if set(p) <= set(present)] if pairs is None else list(pairs)
    missing = [c for pair in chosen for c in pair if c not in present]
    if missing:
        raise EvaluationError(
            f"condition {missing[0]!r} was not run; there are {', '.join(present)}"
        )
    errors = trajectory_errors(truth, estimates)
    moments = {"mean": errors.mean(axis=(2, 3)), "rmse": (errors**2).mean(axis=(2, 3))}
    rows = []
    for condition, baseline in chosen:
        a = present.index(condition)
        b = present.index(baseline)
        good = ~np.isnan(errors[a]).any(axis=(1, 2)) & ~np.isnan(errors[b]).any(axis=(1, 2))
        n = int(good.sum())
        rng = stream(root_seed, 0, "evaluation", "bootstrap", condition, baseline)
        resample = (
            rng.integers(0, n, (_RESAMPLES, n)) if n else np.zeros((_RESAMPLES, 0), dtype=int)
        )
        for statistic, moment in moments.items():
            own, pooled, again = _differences(
                moment[a, good], moment[b, good], resample, root=statistic == "rmse"
            )
            low, high = paired_interval(own, confidence)
            tails = (50.0 * (1.0 - confidence), 50.0 * (1.0 + confidence))
            ends = np.percentile(again, tails) if n > 1 else np.full(2, np.nan)
            mean = float(own.mean()) if n else np.nan
            keys = (condition, baseline, statistic, n, good.size - n)
            rows.append((*keys, pooled, *map(float, ends), mean, low, high))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _differences(
    a: Array, b: Array, resample: Indices, *, root: bool
) -> tuple[Array, float, Array]:
    """
    Differences of each realization, of the pool, and of resampled pools, from the moments of the
    realizations.
    """
    if a.size == 0:
        return np.empty(0), float("nan"), np.full(resample.shape[0], np.nan)
    finish = np.sqrt if root else np.asarray
    own = finish(a) - finish(b)
    pooled = float(finish(a.mean()) - finish(b.mean()))
    again = finish(a[resample].mean(axis=1)) - finish(b[resample].mean(axis=1))
    return np.asarray(own), pooled, np.asarray(again)
