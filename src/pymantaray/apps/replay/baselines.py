"""Predictions without an ocean: speeds learned from the other pairs, and last measured times."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.apps.replay.clocks import gross_of
from pymantaray.apps.replay.summary import pairs_of_depths, quantile_of
from pymantaray.arrays import Array

CONSTANT = "constant sound speed"
BY_DEPTHS = "one speed per pair of depths"
LAST = "last measured time of the way"
_HORIZONS = {"below 20 s": 20.0, "20 to 60 s": 60.0, "1 to 10 min": 600.0, "10 to 60 min": 3600.0}
_BEYOND, _FIRST = "above 1 h", "first of a way"


def baseline_table(events: pd.DataFrame) -> pd.DataFrame:
    """
    Errors of the prediction and of three baselines without an ocean.

    ``constant sound speed`` divides the distance by the median apparent speed of all events of
    other pairs. ``one speed per pair of depths`` uses only the events of other pairs whose depths,
    rounded to 10 m, are the same; without any, it has no prediction. ``last measured time of the
    way`` is persistence, see `last_measured`.

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
    last = (events["measured_s"] - last_measured(events)["predicted_s"]).to_numpy()
    errors[LAST] = last * np.nanmedian(speed)
    rows = []
    is_echo = (events["source"] == events["receiver"]).to_numpy(dtype=bool)
    for name, error in errors.items():
        if name in (CONSTANT, BY_DEPTHS):
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


def last_measured(events: pd.DataFrame) -> pd.DataFrame:
    """
    Last measured time of the same source and receiver, times the change of their distance.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`.

    Returns
    -------
    pandas.DataFrame
        ``elapsed_s`` since the last event of the way, infinite for the first, and ``predicted_s``,
        NaN for the first.
    """
    distance = events["distance_m"].where(events["distance_m"] > 0.0, 1.0)  # 1 for echoes
    columns = ["source", "receiver", "time_s"]
    table = events[columns].assign(slowness=events["measured_s"] / distance)
    ordered = table.sort_values("time_s", kind="stable")
    before = ordered.groupby(["source", "receiver"], sort=False).shift()
    return pd.DataFrame(
        {
            "elapsed_s": (events["time_s"] - before["time_s"]).fillna(np.inf),
            "predicted_s": before["slowness"] * distance,
        }
    )


def horizon_table(events: pd.DataFrame) -> pd.DataFrame:
    """
    Errors of the prediction and of the last measured time, by the time since this one.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`.

    Returns
    -------
    pandas.DataFrame
        One row per horizon, and ``all``: ``events``, median and 90 % quantile of the size of both
        errors (a missing prediction counts as infinite), and of predictions with an interval the
        percentage ``within_95`` and the mean ``log_likelihood``. With learning, ``not_modelled`` is
        the percentage of events whose predicted arrival no draw has.
    """
    last = last_measured(events)
    speed = (events["residual_m"] / events["residual_s"]).median()
    persistence = ((events["measured_s"] - last["predicted_s"]).abs() * speed).fillna(np.inf)
    size = events["residual_m"].abs().fillna(np.inf)
    number = horizon_of(last["elapsed_s"].to_numpy())
    rows = []
    for k, name in enumerate(["all", *_HORIZONS, _BEYOND, _FIRST]):
        member = (number == k - 1) | (name == "all")
        if not member.any():
            continue
        row = {
            "since_last": name,
            "events": int(member.sum()),
            "median_size_m": quantile_of(size[member].to_numpy(), 0.5),
            "q90_size_m": quantile_of(size[member].to_numpy(), 0.9),
            "last_median_m": quantile_of(persistence[member].to_numpy(), 0.5),
            "last_q90_m": quantile_of(persistence[member].to_numpy(), 0.9),
        }
        if "low_s" in events:
            part = events[member & events["residual_s"].notna()]
            inside = part["measured_s"].between(part["low_s"], part["high_s"])
            row["within_95"] = 100.0 * float(inside.mean())
            row["log_likelihood"] = float(part["log_likelihood"].mean())
        if "not_modelled" in events:
            row["not_modelled"] = 100.0 * float(events["not_modelled"][member].mean())
        rows.append(row)
    return pd.DataFrame(rows)


def horizon_of(elapsed: Array) -> NDArray[np.int64]:
    """Number of the horizon of each time since the last event, from 0; the last without any."""
    return np.searchsorted([*_HORIZONS.values(), np.finfo(float).max], elapsed, "right")


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
