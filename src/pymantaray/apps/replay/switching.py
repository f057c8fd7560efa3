"""Candidates that receivers took, and how often they change."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.apps.replay.clocks import clock_errors, clock_table
from pymantaray.apps.replay.summary import ratio_interval
from pymantaray.arrays import Array
from pymantaray.geometry import stream
from pymantaray.geometry.spread import MAD_TO_SIGMA

_MIN_SEPARATION = 4.0  # standard deviations between candidates that can be separated
_MAX_ITERATIONS = 50  # of clocks and candidates


def fit_clocks(
    events: pd.DataFrame,
    candidates: pd.DataFrame,
    *,
    reference: str | None = None,
    drift: bool = False,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """
    Fit clocks and candidates in turn until neither changes.

    The first clocks are those by the residuals of the predicted arrivals. If receivers sometimes
    take later candidates, these residuals alone would attribute the scatter of the delays to the
    clocks.

    Parameters
    ----------
    events, candidates : pandas.DataFrame
        Tables of a `Replay`.
    reference, drift
        As in `clock_table`.

    Returns
    -------
    clocks : pandas.DataFrame
        As from `clock_table`, with ``predicted_offset_s``, the offsets by the residuals of the
        predicted arrivals alone.
    taken : pandas.DataFrame
        As from `taken_candidates`.
    """
    clocks = begin = clock_table(events, events["residual_s"], reference=reference, drift=drift)
    taken = taken_candidates(events, candidates, clocks)
    for _ in range(_MAX_ITERATIONS):
        before = taken["taken"]
        clocks = clock_table(events, taken["taken_time_s"], reference=reference, drift=drift)
        taken = taken_candidates(events, candidates, clocks)
        if before.equals(taken["taken"]):
            break
    return clocks.assign(predicted_offset_s=begin["offset_s"]), taken


def taken_candidates(
    events: pd.DataFrame, candidates: pd.DataFrame, clocks: pd.DataFrame
) -> pd.DataFrame:
    """
    Candidate nearest to each event after the clock correction.

    Parameters
    ----------
    events, candidates, clocks : pandas.DataFrame
        Of a `Replay`.

    Returns
    -------
    pandas.DataFrame
        One row per event: ``n_candidates``, ``taken`` (position in time relative to the predicted
        arrival, negative before it), the residual after the clock correction ``taken_residual_s``
        and before it ``taken_time_s``, and ``apart_s``, the shortest time between two candidates.
    """
    clock = clock_errors(events, clocks)
    at = candidates["event"].to_numpy(dtype=np.int64)
    time = candidates["travel_time_s"].to_numpy()
    late = (events["measured_s"].to_numpy() - clock)[at] - time
    n = len(events)
    count = np.bincount(at, minlength=n)
    start = np.cumsum(count) - count
    has = np.flatnonzero(count)
    place = np.arange(at.size) - start[at]

    def best(distance: Array) -> NDArray[np.int64]:
        """Row of the candidate of least distance of each event that has one."""
        order = np.lexsort((distance, at))
        return np.asarray(order[start[has]])

    nearest = best(np.abs(late))
    predicted = best(np.abs(time - events["predicted_s"].to_numpy()[at]))
    taken, left, apart = (np.full(n, np.nan) for _ in range(3))
    taken[has] = place[nearest] - place[predicted]
    left[has] = late[nearest]
    gap = np.diff(time)
    same = at[1:] == at[:-1]
    apart[at[1:][same]] = np.inf
    np.minimum.at(apart, at[1:][same], gap[same])
    columns = {"n_candidates": count, "taken": taken, "taken_residual_s": left, "apart_s": apart}
    return pd.DataFrame(columns | {"taken_time_s": left + clock}).astype({"taken": "Int64"})


def switching_table(
    events: pd.DataFrame, taken: pd.DataFrame, *, window: float, seed: int
) -> pd.DataFrame:
    """
    Rate at which receivers change their candidate from one event to the next.

    Parameters
    ----------
    events, taken : pandas.DataFrame
        Of a `Replay`.
    window : float
        Maximum time between paired events of the same source and receiver. [s]
    seed : int
        Seed of the bootstrap over pairs.

    Returns
    -------
    pandas.DataFrame
        One row for all events and one per pair: number of ``steps`` between events, the fraction
        ``rate`` of steps in which ``taken`` changes with its 95 % interval over pairs,
        ``independent_rate``, the rate of independent draws with the same shares, ``step_s``, the
        mean time between the events, and ``correlation_s``, the correlation time of
        `pymantaray.sensing.draw_picks` with both rates.

    Notes
    -----
    Only events with separable candidates are used: at least two, all further apart than four
    standard deviations of the corrected residuals (by their median absolute deviation).
    """
    left = taken["taken_residual_s"].abs()
    clear = taken["apart_s"] > _MIN_SEPARATION * MAD_TO_SIGMA * left.dropna().median()
    told = pd.concat([events[["pair", "source", "receiver", "time_s"]], taken["taken"]], axis=1)[
        clear
    ]
    parts = []
    for (pair, *_), way in told.groupby(["pair", "source", "receiver"], sort=True):
        way = way.sort_values("time_s", kind="stable")
        step = np.diff(way["time_s"])
        changed = np.diff(way["taken"].to_numpy(dtype=np.int64)) != 0
        near = step <= window
        m = len(way)
        shares = way["taken"].value_counts().to_numpy()
        alike = float(np.sum(shares * (shares - 1)) / (m * (m - 1))) if m > 1 else np.nan
        parts.append(
            (
                pair,
                near.sum(),
                changed[near].sum(),
                near.sum() * (1.0 - alike) if m > 1 else 0.0,
                step[near].sum(),
            )
        )
    ways = pd.DataFrame(parts, columns=["pair", "steps", "changes", "independent", "seconds"])
    pairs = ways.groupby("pair", sort=True).sum()
    pairs = pairs[pairs["steps"] > 0]
    rng = stream(seed, 0, "replay", "bootstrap", "switching")
    rows = [
        _row(
            "all",
            pairs.sum(),
            ratio_interval(pairs[["changes", "steps"]].to_numpy(dtype=float), rng),
        )
    ]
    rows += [_row(str(pair), one, (np.nan, np.nan)) for pair, one in pairs.iterrows()]
    names = [
        "pair",
        "steps",
        "rate",
        "rate_low",
        "rate_high",
        "independent_rate",
        "step_s",
        "correlation_s",
    ]
    return pd.DataFrame(rows, columns=names)


def _row(pair: str, sums: "pd.Series[float]", interval: tuple[float, float]) -> tuple[object, ...]:
    steps = float(sums["steps"])
    if not steps:
        return (pair, 0, *[np.nan] * 6)
    rate, independent, step = (
        float(sums[name]) / steps for name in ("changes", "independent", "seconds")
    )
    correlation = np.nan
    if independent > 0.0:
        stays = 1.0 - rate / independent
        correlation = 0.0 if stays <= 0.0 else np.inf if stays == 1.0 else -step / np.log(stays)
    return (pair, int(steps), rate, *interval, independent, step, correlation)
