"""Baselines of a replay: speeds learned from the other pairs, without an ocean."""

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
    for name, group in ((CONSTANT, np.zeros(len(events))), (BY_DEPTHS, pairs_of_depths(events)[1])):
        prediction = events["distance_m"] / _median_speeds(events, speed, group)
        errors[name] = (events["measured_s"] - prediction).to_numpy() * np.nanmedian(speed)
    rows = []
    is_echo = (events["source"] == events["receiver"]).to_numpy(dtype=bool)
    for name, error in errors.items():
        if name != "rays":
            error = np.where(is_echo, np.nan, error)
        size = np.abs(error)
        has_error = ~np.isnan(size)
        every = np.where(has_error, size, np.inf)
        row = {
            "prediction": name,
            "events": len(events),
            "predicted": has_error.sum(),
            "percent": 100.0 * has_error.mean(),
            "median_size_m": float(np.median(size[has_error])) if has_error.any() else np.nan,
            "median_all_m": quantile_of(every, 0.5),
            "p90_all_m": quantile_of(every, 0.9),
        }
        rows.append(row)
    return pd.DataFrame(rows)


def pairs_of_depths(events: pd.DataFrame) -> tuple[list[str], NDArray[np.int64]]:
    """Unordered pairs of rounded depths, such as ``30 and 90 m``, and that of each event."""
    depths = np.sort(events[["source_depth_m", "receiver_depth_m"]].to_numpy(), axis=1)
    rounded = _DEPTH_STEP * np.round(depths / _DEPTH_STEP)
    pairs, number = np.unique(rounded, axis=0, return_inverse=True)
    names = [f"{first:g} and {second:g} m" for first, second in pairs.tolist()]
    return names, np.asarray(number.reshape(-1), dtype=np.int64)


def _median_speeds(
    events: pd.DataFrame, speed: "pd.Series[float]", group: Array | NDArray[np.int64]
) -> Array:
    """Median speed of a group's events in other pairs, for each event; NaN without any. [m/s]"""
    speeds = np.full(len(events), np.nan)
    pair = events["pair"].to_numpy(dtype=str)
    good = (~gross_of(events) & (events["source"] != events["receiver"])).to_numpy(dtype=bool)
    values = speed.to_numpy()
    for number in np.unique(group):
        members = group == number
        for name in np.unique(pair[members]):
            others = values[members & good & (pair != name)]
            if others.size:
                speeds[members & (pair == name)] = np.median(others)
    return speeds
