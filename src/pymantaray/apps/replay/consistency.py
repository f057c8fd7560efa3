"""Consistency of each node's position with the ranges of its pairs, and clocks without it."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from pymantaray.apps.replay.clocks import gross_of
from pymantaray.apps.replay.switching import fit_clocks
from pymantaray.arrays import Array
from pymantaray.geometry.spread import MAD_TO_SIGMA

_MIN_PAIRS = 3  # of a node whose offset, two numbers, leaves something to check
_SUSPECT_OFFSET = 2.0  # m, of a suspect node
_SUSPECT_SHARE = 0.5  # of the squared residuals of its pairs, which its offset must explain
_SUSPECT_LEVEL = 0.03  # probability that one of the right nodes of a campaign is suspect
_CONFIRMED = 0.5  # of the significance limit, which must be exceeded without any one pair too
# of the variance of a pair's residual, due to the assumed water; it grows with distance
_WATER_SHARE = 0.5
_SHARED_WATER = 2.0 / 3.0  # of that part, the same for all pairs of a node
_WEAK = 0.05  # singular value of directions that are almost parallel
_POSITION_SHARE = 0.5  # of the variance, due to the usual errors of the positions of both nodes
_MAX_ITERATIONS = 20  # of clocks and positions
_SETTLED = 1e-3  # m; change of the ranges after which they are final


class _Offset(NamedTuple):
    """Offset of a node that its pairs suggest; NaN if unknown."""

    offset: Array
    """North and east. [m]"""
    error: float
    """Standard error along the worst direction. [m]"""
    explained: float
    """Share of the squared residuals of its pairs that the offset explains."""
    significance: float
    """
    F statistic over its limit. Above 1, the smallest of it and those without any one pair, over
    their own limit.
    """

    @property
    def suspect(self) -> bool:
        """True if the offset is large, significant and explains the residuals."""
        large = float(np.hypot(*self.offset)) > _SUSPECT_OFFSET
        return bool(large and self.explained > _SUSPECT_SHARE and self.significance > 1.0)


_UNKNOWN = _Offset(np.full(2, np.nan), np.nan, np.nan, -1.0)


class ClockFit(NamedTuple):
    """Clocks, candidates and offsets of nodes."""

    clocks: pd.DataFrame
    """As from `fit_clocks`."""
    taken: pd.DataFrame
    """As from `fit_clocks`; the residuals contain the effect of the positions."""
    nodes: pd.DataFrame
    """As from `node_table`."""


def fit_clocks_and_nodes(
    events: pd.DataFrame,
    candidates: pd.DataFrame,
    *,
    reference: str | None = None,
    drift: bool = False,
) -> ClockFit:
    """
    Fit clocks with candidates and offsets of nodes in turn.

    A wrong position changes the candidates that appear to be nearest, differently in both
    directions, and shifts the clocks by milliseconds. The clocks are therefore fitted to residuals
    without the effect of suspect positions.

    Parameters
    ----------
    events, candidates : pandas.DataFrame
        Tables of a `Replay`.
    reference, drift
        As in `clock_table`.

    Returns
    -------
    ClockFit
        Fit whose offsets of suspect nodes do not change any more.
    """
    by_position = np.zeros(len(events))
    for _ in range(_MAX_ITERATIONS):
        right = events.assign(
            measured_s=events["measured_s"] - by_position,
            residual_s=events["residual_s"] - by_position,
        )
        clocks, taken = fit_clocks(right, candidates, reference=reference, drift=drift)
        taken = taken.assign(
            taken_residual_s=taken["taken_residual_s"] + by_position,
            taken_time_s=taken["taken_time_s"] + by_position,
        )
        nodes = node_table(events, taken)
        before = by_position
        by_position = position_errors(events, nodes)
        change = np.asarray(np.abs(by_position - before) * _speed(events))
        # NaN for an event without a prediction
        if change[np.isfinite(change)].max(initial=0.0) < _SETTLED:
            break
    return ClockFit(clocks, taken, nodes)


def position_errors(events: pd.DataFrame, nodes: pd.DataFrame) -> Array:
    """Part of each measured travel time that is due to the offsets of suspect nodes. [s]"""
    bearing = np.radians(events["bearing_deg"].to_numpy())
    table = nodes[nodes["suspect"]].set_index("node")
    longer = np.zeros(len(events))
    for end, sign in (("receiver", 1.0), ("source", -1.0)):
        north, east = (
            events[end].map(table[name]).fillna(0.0).to_numpy() for name in ("north_m", "east_m")
        )
        longer += sign * (np.cos(bearing) * north + np.sin(bearing) * east)
    return np.asarray(np.where(longer == 0.0, 0.0, longer / _speed(events)))


def node_table(events: pd.DataFrame, taken: pd.DataFrame) -> pd.DataFrame:
    r"""
    Horizontal offset of each node from its stated position that its ranges suggest.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`.
    taken : pandas.DataFrame
        Candidates that they took, with residuals after the clock correction.

    Returns
    -------
    pandas.DataFrame
        One row per node: number of ``pairs`` and ``events``; ``north_m`` and ``east_m``, the offset
        of the true position from the stated one, with ``standard_error_m`` (the larger semi-axis,
        with the errors that events share); ``explained``, the share of the squared residuals of its
        pairs that the offset explains; ``scatter_m``, the standard deviation of range errors that
        vary in time and are due to this node; and ``suspect``.

    Notes
    -----
    A node at the offset :math:`\delta` from its stated position changes the range of a pair by
    :math:`u \cdot \delta`, where u is the direction from the other node. The median residuals of
    the pairs of a node, in metres, determine its offset by generalized least squares. Residuals of
    pairs of one node are correlated: they share the error of the assumed water, which grows with
    the distance d. For the variance :math:`s^2` of a residual, the covariance of two pairs of a
    node is :math:`s^2 r_i r_j / 3` with r = d over the rms distance; the rest is independent. The
    variance is that of the residuals of all pairs after the fit, which also contains ice, wrong
    arrivals and clocks. The offset of a right node is not zero: half of the variance, :math:`s^2 /
    4` per axis and node, is attributed to usual errors of positions.

    The most significant node is suspect if its offset is above 2 m, explains half of its squared
    residuals, and has an F statistic above its 3 % limit (divided by the number of nodes), and
    above half of this limit without any one of its pairs, so that one wrong arrival is not enough.
    Its part is then removed from all pairs, and the others are examined again: a wrong node affects
    one pair of every other node. A node with fewer than three pairs is not examined.
    """
    pairs = _pair_residuals(events, taken)
    names = sorted(set(events["source"]) | set(events["receiver"]))
    residual = pairs["residual_m"].to_numpy(dtype=float).copy()
    free = len(pairs) - 2 - _clocks_from_one_way(events, pairs)
    suspects: dict[str, _Offset] = {}
    while True:
        fits = {
            name: _offset(pairs, residual, name, free) for name in names if name not in suspects
        }
        wrong = [name for name in fits if fits[name].suspect]
        if not wrong:
            break
        worst = max(wrong, key=lambda name: fits[name].significance)
        suspects[worst] = fits[worst]
        residual = residual - _directions(pairs, worst) @ fits[worst].offset
    scatter = _scatter(events, taken, names)
    count = pd.concat([events["source"], events["receiver"]]).value_counts()
    rows = []
    for k, name in enumerate(names):
        fit = suspects.get(name) or fits[name]
        north, east = fit.offset
        has_node = (pairs["first"] == name) | (pairs["second"] == name)
        row = {
            "node": name,
            "pairs": has_node.sum(),
            "events": count[name],
            "north_m": north,
            "east_m": east,
            "standard_error_m": fit.error,
            "explained": fit.explained,
            "scatter_m": scatter[k],
            "suspect": name in suspects,
        }
        rows.append(row)
    return pd.DataFrame(rows)


def node_note(nodes: pd.DataFrame) -> str | None:
    """Sentence about nodes whose position disagrees with their ranges, None without any."""
    wrong = nodes[nodes["suspect"]]
    if wrong.empty:
        return None
    words = [
        f"{row.node} ({row.north_m:+.1f} m north, {row.east_m:+.1f} m east,"
        f" +-{row.standard_error_m:.1f} m)"
        for row in wrong.itertuples()
    ]
    return (
        f"Positions that disagree with the ranges of all their pairs: {', '.join(words)}; check"
        " them."
    )


def _residuals_m(events: pd.DataFrame, taken: pd.DataFrame) -> "pd.Series[float]":
    """Residuals after the clock correction as lengths; NaN if unknown or gross. [m]"""
    return (taken["taken_residual_s"] * _speed(events)).where(~gross_of(events))


def _speed(events: pd.DataFrame) -> "pd.Series[float]":
    """Mean sound speed along the straight line of each event, NaN outside the water. [m/s]"""
    return events["distance_m"] / events["chord_s"]


def _pair_residuals(events: pd.DataFrame, taken: pd.DataFrame) -> pd.DataFrame:
    """Median residual of each pair [m], its nodes, and the direction between them."""
    ends = np.sort(events[["source", "receiver"]].to_numpy(dtype=str), axis=1)
    is_reversed = ends[:, 0] != events["source"].to_numpy(dtype=str)
    bearing = np.radians(events["bearing_deg"].to_numpy()) + np.pi * is_reversed
    table = events[["pair"]].assign(
        first=ends[:, 0],
        second=ends[:, 1],
        residual_m=_residuals_m(events, taken),
        distance_m=events["distance_m"],
        north=np.cos(bearing),
        east=np.sin(bearing),
    )
    table = table[table["residual_m"].notna() & (events["distance_m"] > 0.0)]
    return table.groupby("pair", sort=True).agg(
        {
            "first": "first",
            "second": "first",
            "residual_m": "median",
            "distance_m": "mean",
            "north": "mean",
            "east": "mean",
        }
    )


def _clocks_from_one_way(events: pd.DataFrame, pairs: pd.DataFrame) -> int:
    """
    Number of clock offsets that were fitted to pairs with events in one direction only.

    These pairs have smaller residuals.
    """
    used = events[events["pair"].isin(pairs.index)]
    is_two_way = used.groupby("pair")["source"].nunique() > 1

    def rank(table: pd.DataFrame) -> int:
        names = sorted({*table["first"], *table["second"]})
        if not names:
            return 0
        return int(np.linalg.matrix_rank(np.array([_membership(table, name) for name in names])))

    return rank(pairs) - rank(pairs[is_two_way.reindex(pairs.index)])


def _membership(pairs: pd.DataFrame, name: str) -> Array:
    """1 for pairs to a node, -1 for pairs from it, otherwise 0."""
    return np.asarray(
        (pairs["second"] == name).astype(float) - (pairs["first"] == name).astype(float)
    )


def _directions(pairs: pd.DataFrame, name: str) -> Array:
    """Unit vectors from the other node of each pair to a node, zero for pairs without it."""
    return pairs[["north", "east"]].to_numpy() * _membership(pairs, name)[:, None]


def _offset(pairs: pd.DataFrame, residual: Array, name: str, free: int) -> _Offset:
    """
    Offset of a node from the residuals of all pairs [m], of which some are free after the fit.
    """
    from scipy.stats import f as f_distribution

    design = _directions(pairs, name)
    distance = pairs["distance_m"].to_numpy()
    rows = np.flatnonzero(design.any(axis=1))
    if rows.size < _MIN_PAIRS or free < 1 or np.linalg.matrix_rank(design[rows], tol=1e-6) < 2:
        return _UNKNOWN
    relative = distance / np.sqrt(np.mean(distance**2))
    offset, covariance = _least_squares(design[rows], relative[rows], residual[rows])
    remaining = residual - design @ offset
    before = float(np.sum(residual[rows] ** 2))
    scale = float(np.sum(remaining**2)) / free
    if before == 0.0:
        return _UNKNOWN
    nodes = len({*pairs["first"], *pairs["second"]})
    limit = float(f_distribution.isf(_SUSPECT_LEVEL / nodes, 2, free))
    significance = _f_statistic(offset, covariance, scale) / limit
    # one wrong arrival is not enough: the offset must be significant without any one pair too
    for pair in rows if significance > 1.0 else ():
        others = rows[rows != pair]
        if np.linalg.matrix_rank(design[others], tol=_WEAK) < 2:
            significance = 0.0
            break
        fit = _least_squares(design[others], relative[others], residual[others])
        significance = min(significance, _f_statistic(*fit, scale) / (_CONFIRMED * limit))
    largest = float(np.linalg.eigvalsh(covariance)[-1]) / (1.0 - 0.5 * _POSITION_SHARE)
    error = float(np.sqrt(scale * largest * free / max(free - 2, 1)))
    return _Offset(offset, error, 1.0 - float(np.sum(remaining[rows] ** 2)) / before, significance)


def _least_squares(design: Array, distance: Array, residual: Array) -> tuple[Array, Array]:
    """
    Offset by generalized least squares, and its covariance for residuals of variance 1.

    Distances are relative.
    """
    water = (1.0 - _SHARED_WATER) * np.diag(distance**2)
    water = water + _SHARED_WATER * np.outer(distance, distance)
    independent = (1.0 - _WATER_SHARE - 0.5 * _POSITION_SHARE) * np.eye(distance.size)
    noise = independent + _WATER_SHARE * water
    whitened = np.linalg.solve(noise, design)
    covariance = np.linalg.inv(design.T @ whitened)
    return np.asarray(covariance @ (whitened.T @ residual)), np.asarray(covariance)


def _f_statistic(offset: Array, covariance: Array, scale: float) -> float:
    """
    Squared offset over its variance with the usual error of a position, per axis.

    It is infinite without noise.
    """
    usual = covariance + 0.5 * _POSITION_SHARE * np.eye(2)
    size = float(offset @ np.linalg.solve(usual, offset)) / 2.0
    return size / scale if scale > 0.0 else np.inf


def _scatter(events: pd.DataFrame, taken: pd.DataFrame, names: list[str]) -> Array:
    """
    Standard deviation of range errors that each node contributes. [m]

    The squared scatter of a pair is the sum of two.
    """
    from scipy.optimize import nnls

    residual = _residuals_m(events, taken)
    pair = events["pair"]
    deviation = residual - residual.groupby(pair).transform("median")
    size = deviation.abs().groupby(pair).median().dropna() * MAD_TO_SIGMA
    if len(size) <= len(names):
        return np.full(len(names), np.nan)
    ends = events.drop_duplicates("pair").set_index("pair").loc[size.index, ["source", "receiver"]]
    design = (ends.to_numpy(dtype=str)[:, :, None] == np.array(names)).any(axis=1).astype(float)
    return np.sqrt(nnls(design, size.to_numpy() ** 2)[0])
