"""Clocks from residuals: the offset of each node, and differences between both directions."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]


def clock_table(
    events: pd.DataFrame, residual: "pd.Series[float]", *, reference: str | None = None
) -> pd.DataFrame:
    r"""
    Offsets of the nodes' clocks by least squares on residuals.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`. Those with a residual are used, weighted by ``sigma_s`` if all have one, else equally.
    residual : pandas.Series
        Residual of each event: measured travel time minus that of an arrival. [s]
    reference : str, optional
        Node with the reference clock. By default, and in a group of nodes without it, the mean of each connected group.

    Returns
    -------
    pandas.DataFrame
        One row per node: ``offset_s`` of its clock (ahead is positive), number of ``events``, ``group`` of connected nodes, and two
        standard errors: ``standard_error_s`` for independent events, scaled by their scatter, and ``standard_error_pairs_s`` for
        errors that all events of a pair share (a sandwich estimator over pairs, NaN unless there are more pairs than clocks).

    Notes
    -----
    A residual is :math:`o_r - o_s + e` with the offsets of receiver and source. Only differences are observable: the
    solution of least norm has mean zero over each connected group. An error that both directions of a pair share (a wrong sound
    speed, a later candidate) does not affect offsets if there are events in both directions, and does if there is only one.
    """
    has = residual.notna()
    used, times = events[has], residual[has].to_numpy()
    names = sorted(set(events["source"]) | set(events["receiver"]))
    source, receiver = (np.searchsorted(names, used[end]) for end in ("source", "receiver"))
    n, k = len(used), len(names)
    design = np.zeros((n, k))
    design[np.arange(n), receiver] = 1.0
    design[np.arange(n), source] = -1.0
    sigma = used["sigma_s"].to_numpy()
    weight = 1.0 / sigma**2 if np.isfinite(sigma).all() else np.ones(n)
    inverse: Array = np.asarray(np.linalg.pinv(design.T @ (weight[:, None] * design), hermitian=True))
    offset = inverse @ (design.T @ (weight * times))
    group, count = _groups(k, source, receiver), np.bincount(np.concatenate([source, receiver]), minlength=k)
    if reference is not None:
        member, right = group == group[names.index(reference)], np.arange(k) == names.index(reference)
        gauge = np.eye(k) - np.outer(member, right)
        offset, inverse = gauge @ offset, gauge @ inverse @ gauge.T
    left = times - design @ offset
    seen = int(np.count_nonzero(count)) - np.unique(group[count > 0]).size
    scatter = float(np.sum(weight * left**2)) / (n - seen) if n > seen else np.nan
    score = design * (weight * left)[:, None]
    table = pd.DataFrame(
        {
            "node": names,
            "offset_s": offset,
            "standard_error_s": np.sqrt(np.diag(inverse) * scatter),
            "standard_error_pairs_s": _over_pairs(score, used["pair"].to_numpy(dtype=str), inverse, seen),
            "events": count,
            "group": group,
        }
    )
    table.loc[table["events"] == 0, table.columns[1:4]] = np.nan
    return table


def _groups(k: int, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the connected group of each of k nodes, by the links between them; from 1."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(first.size), (first, second)), shape=(k, k))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64) + 1


def _over_pairs(score: Array, pair: NDArray[np.str_], inverse: Array, clocks: int) -> Array:
    """Standard errors of clocks from the sums of scores over each pair."""
    names, of = np.unique(pair, return_inverse=True)
    if names.size <= clocks:
        return np.full(len(inverse), np.nan)
    sums = np.zeros((names.size, len(inverse)))
    np.add.at(sums, of, score)
    covariance = inverse @ (sums.T @ sums) @ inverse * names.size / (names.size - clocks)
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def reciprocity_table(
    events: pd.DataFrame, times: "pd.Series[float]", clocks: pd.DataFrame, *, window: float
) -> pd.DataFrame:
    """
    Difference of residuals between opposite directions, of events near in time.

    Parameters
    ----------
    events, clocks : pandas.DataFrame
        Tables of a `Replay`.
    times : pandas.Series
        Residual of each event, including clock errors. [s]
    window : float
        Maximum time between paired events. The partner of an event is the nearest in time of the other direction; each is used once. [s]

    Returns
    -------
    pandas.DataFrame
        One row per pair: number of events with a residual ``forth`` and ``back``, number ``matched``, ``mean_s`` and ``sd_s`` of the
        difference (first name to second, minus second to first), ``clocks_s``, the part due to clock offsets, and ``left_s``, the
        rest with its ``standard_error_s``. The rest is zero in water at rest; a current v over a distance d causes about
        -2 d v / c^2.
    """
    offset = dict(zip(clocks["node"], clocks["offset_s"], strict=True))
    rows = []
    for pair, part in events.assign(time=times)[times.notna()].groupby("pair", sort=True):
        first = min(part["source"].iloc[0], part["receiver"].iloc[0])
        second = max(part["source"].iloc[0], part["receiver"].iloc[0])
        forth, back = part[part["source"] == first], part[part["source"] == second]
        one, other = _matched(forth["time_s"].to_numpy(), back["time_s"].to_numpy(), window)
        difference = forth["time"].to_numpy()[one] - back["time"].to_numpy()[other]
        n = difference.size
        mean = float(difference.mean()) if n else np.nan
        sd = float(difference.std(ddof=1)) if n > 1 else np.nan
        expected = 2.0 * (offset[second] - offset[first])
        rows.append(
            (pair, len(forth), len(back), n, mean, sd, expected, mean - expected, sd / np.sqrt(max(n, 1)))
        )
    names = ["pair", "forth", "back", "matched", "mean_s", "sd_s", "clocks_s", "left_s", "standard_error_s"]
    return pd.DataFrame(rows, columns=names)


def _matched(time: Array, other: Array, window: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of events and of their nearest partners in time; a partner of several events goes to the nearest of them."""
    if not time.size or not other.size:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    order = np.argsort(other, kind="stable")
    after = np.clip(np.searchsorted(other[order], time), 1, max(other.size - 1, 1))
    beside = order[np.stack([after - 1, np.minimum(after, other.size - 1)])]
    apart = np.abs(other[beside] - time)
    partner, apart = beside[np.argmin(apart, axis=0), np.arange(time.size)], apart.min(axis=0)
    nearest = np.lexsort((apart, partner))
    _, first = np.unique(partner[nearest], return_index=True)
    rows = nearest[first]
    rows = np.sort(rows[apart[rows] <= window])
    return rows, partner[rows]
