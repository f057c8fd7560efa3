"""
Baselines of a replay: a constant sound speed, and one speed per pair of depths, both learned from
the other pairs.
"""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.apps.replay.clocks import gross_of
from pymantaray.apps.replay.summary import quantile_of
from pymantaray.arrays import Array

CONSTANT = "constant sound speed"
BY_DEPTHS = "one speed per pair of depths"
_DEPTH_STEP = 10.0  # m; ends whose depths round to the same multiples have the same pair of depths


def baseline_table(events: pd.DataFrame) -> pd.DataFrame:
    """
    Errors of the prediction by rays and of two baselines without an ocean.

    ``constant sound speed`` divides the distance by the median apparent speed of all events of
    other pairs. ``one speed per pair of depths`` uses only the events of other pairs whose depths,
    rounded to 10 m, are the same; without any, it has no prediction.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`. Events with gross errors teach nothing, but count.

    Returns
    -------
    pandas.DataFrame
        One row per prediction: number of ``events`` and of ``predicted`` ones, ``percent``, the
        median absolute error ``median_size_m`` of the predicted ones, and the median and the 90 %
        quantile over all events, ``median_all_m`` and ``p90_all_m``, for which a missing prediction
        is an infinite error. Clock offsets are not removed.
    """
    speed = events["distance_m"] / events["measured_s"]
    errors = {"rays": events["residual_m"].to_numpy()}
    for name, group in ((CONSTANT, np.zeros(len(events))), (BY_DEPTHS, _pairs_of_depths(events))):
        errors[name] = (
            events["measured_s"] - events["distance_m"] / _learned(events, speed, group)
        ).to_numpy()
        errors[name] = errors[name] * np.nanmedian(speed)
    rows = []
    for name, error in errors.items():
        size = np.abs(error)
        known = ~np.isnan(size)
        every = np.where(known, size, np.inf)
        median = float(np.median(size[known])) if known.any() else np.nan
        quantiles = [quantile_of(every, q) for q in (0.5, 0.9)]
        rows.append((name, len(events), known.sum(), 100.0 * known.mean(), median, *quantiles))
    columns = [
        "prediction",
        "events",
        "predicted",
        "percent",
        "median_size_m",
        "median_all_m",
        "p90_all_m",
    ]
    return pd.DataFrame(rows, columns=columns)


def _pairs_of_depths(events: pd.DataFrame) -> NDArray[np.int64]:
    """Number of the unordered pair of rounded depths of each event."""
    depths = np.sort(events[["source_depth_m", "receiver_depth_m"]].to_numpy(), axis=1)
    _, number = np.unique(np.round(depths / _DEPTH_STEP), axis=0, return_inverse=True)
    return np.asarray(number.reshape(-1), dtype=np.int64)


def _learned(
    events: pd.DataFrame, speed: "pd.Series[float]", group: Array | NDArray[np.int64]
) -> Array:
    """
    Median speed of the events of a group in other pairs, for each event; NaN without any. [m/s]
    """
    learned = np.full(len(events), np.nan)
    pair = events["pair"].to_numpy(dtype=str)
    good = ~gross_of(events).to_numpy(dtype=bool)
    values = speed.to_numpy()
    for number in np.unique(group):
        own = group == number
        for name in np.unique(pair[own]):
            others = values[own & good & (pair != name)]
            if others.size:
                learned[own & (pair == name)] = np.median(others)
    return learned
