"""Differences of position errors between runs, with confidence intervals over realizations."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pandas as pd

from pymantaray.apps.study.figures.register import RunResults
from pymantaray.arrays import Array
from pymantaray.evaluation.comparison import paired_interval

_COLUMNS = ["condition", "run", "baseline", "paired", "realizations", "mean_m", "baseline_mean_m"]
_COLUMNS += ["difference_m", "t_low_m", "t_high_m"]


def run_differences(runs: Mapping[str, RunResults], *, confidence: float = 0.95) -> pd.DataFrame:
    """
    Differences of the mean position error between each two runs, by condition.

    Two runs with one seed have the same noise in each realization. Their difference is then the
    mean over the realizations that both have, with Student's interval of paired samples. The
    interval of other runs is Welch's. ``realizations`` are those of ``run`` and of ``baseline``
    that the difference uses; intervals of fewer than two are NaN.
    """
    rows = []
    for baseline, name in combinations(runs, 2):
        one = runs[name]
        other = runs[baseline]
        paired = one.run.study.seed == other.run.study.seed
        for condition in [c for c in one.errors if c in other.errors]:
            pair = pd.concat([_of_realizations(r, condition) for r in (one, other)], axis=1)
            pair = pair.dropna() if paired else pair
            a, b = (pair[column].dropna().to_numpy() for column in pair)
            counts = str(a.size) if paired else f"{a.size} and {b.size}"
            means = (float(values.mean()) if values.size else np.nan for values in (a, b))
            keys = (condition, name, baseline, "yes" if paired else "no", counts)
            rows.append((*keys, *means, *_interval(a, b, confidence, paired=paired)))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _of_realizations(results: RunResults, condition: str) -> "pd.Series[float]":
    """Mean position error of each realization; NaN if its solve failed. [m]"""
    mean = results.errors[condition].mean(axis=(1, 2))
    return pd.Series(mean, index=results.run.estimates.realization)


def _interval(a: Array, b: Array, confidence: float, *, paired: bool) -> tuple[float, float, float]:
    """Difference of two means, and its confidence interval."""
    from scipy.stats import ttest_ind

    if not a.size or not b.size:
        return np.nan, np.nan, np.nan
    difference = float(a.mean() - b.mean())
    if paired:
        return difference, *paired_interval(a - b, confidence)
    if min(a.size, b.size) < 2:
        return difference, np.nan, np.nan
    low, high = ttest_ind(a, b, equal_var=False).confidence_interval(confidence)
    return difference, float(low), float(high)
