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
    event = candidates["event"].to_numpy(dtype=np.int64)
    time = candidates["travel_time_s"].to_numpy()
    difference = (events["measured_s"].to_numpy() - clock)[event] - time
    n = len(events)
    count = np.bincount(event, minlength=n)
    start = np.cumsum(count) - count
    has = np.flatnonzero(count)
    position = np.arange(event.size) - start[event]

    def best(distance: Array) -> NDArray[np.int64]:
        """Row of the candidate of least distance of each event that has one."""
        order = np.lexsort((distance, event))
        return np.asarray(order[start[has]])

    nearest = best(np.abs(difference))
    predicted = best(np.abs(time - events["predicted_s"].to_numpy()[event]))
    taken, residual, shortest = (np.full(n, np.nan) for _ in range(3))
    taken[has] = position[nearest] - position[predicted]
    residual[has] = difference[nearest]
    # candidates are sorted by event and time: successive ones of an event are nearest in time
    is_later = np.flatnonzero(np.diff(event) == 0) + 1
    shortest[event[is_later]] = np.inf
    np.minimum.at(shortest, event[is_later], time[is_later] - time[is_later - 1])
    columns = {
        "n_candidates": count,
        "taken": taken,
        "taken_residual_s": residual,
        "apart_s": shortest,
    }
    return pd.DataFrame(columns | {"taken_time_s": residual + clock}).astype({"taken": "Int64"})


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
    size = taken["taken_residual_s"].abs()
    clear = taken["apart_s"] > _MIN_SEPARATION * MAD_TO_SIGMA * size.dropna().median()
    clear_events = pd.concat(
        [events[["pair", "source", "receiver", "time_s"]], taken["taken"]], axis=1
    )[clear]
    parts = []
    for (pair, *_), way in clear_events.groupby(["pair", "source", "receiver"], sort=True):
        way = way.sort_values("time_s", kind="stable")
        step = np.diff(way["time_s"])
        changes = np.diff(way["taken"].to_numpy(dtype=np.int64)) != 0
        is_near = step <= window
        n = len(way)
        shares = way["taken"].value_counts().to_numpy()
        alike = float(np.sum(shares * (shares - 1)) / (n * (n - 1))) if n > 1 else np.nan
        parts.append(
            {
                "pair": pair,
                "steps": is_near.sum(),
                "changes": changes[is_near].sum(),
                "independent": is_near.sum() * (1.0 - alike) if n > 1 else 0.0,
                "seconds": step[is_near].sum(),
            }
        )
    columns = ["pair", "steps", "changes", "independent", "seconds"]
    pairs = pd.DataFrame(parts, columns=columns).groupby("pair", sort=True).sum()
    pairs = pairs[pairs["steps"] > 0]
    rng = stream(seed, 0, "replay", "bootstrap", "switching")
    interval = ratio_interval(pairs[["changes", "steps"]].to_numpy(dtype=float), rng)
    rows = [_row("all", pairs.sum(), interval)]
    rows += [_row(str(pair), sums, (np.nan, np.nan)) for pair, sums in pairs.iterrows()]
    return pd.DataFrame(rows)


def _row(pair: str, sums: "pd.Series[float]", interval: tuple[float, float]) -> dict[str, object]:
    """Rates of a pair from its sums over steps; NaN without any."""
    steps = float(sums["steps"])
    rate, independent, step = (
        float(sums[name]) / steps if steps else np.nan
        for name in ("changes", "independent", "seconds")
    )
    low, high = interval if steps else (np.nan, np.nan)
    return {
        "pair": pair,
        "steps": int(steps),
        "rate": rate,
        "rate_low": low,
        "rate_high": high,
        "independent_rate": independent,
        "step_s": step,
        "correlation_s": _correlation_time(rate, independent, step),
    }


def _correlation_time(rate: float, independent: float, step: float) -> float:
    """Correlation time of a Markov chain with both rates of change over a step [s]."""
    if not independent > 0.0:
        return np.nan
    stays = 1.0 - rate / independent
    if stays <= 0.0:
        return 0.0
    if stays == 1.0:
        return np.inf
    return float(-step / np.log(stays))
