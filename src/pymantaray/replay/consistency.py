"""Consistency of each node's position with the ranges of all its pairs, and clocks without the effect of wrong positions."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.geometry.spread import MAD_TO_SIGMA
from pymantaray.replay.clocks import gross_of
from pymantaray.replay.switching import fit_clocks

Array = NDArray[np.float64]
_MIN_PAIRS = 3  # of a node whose offset, two numbers, leaves something to check
_SUSPECT_SIGMAS, _SUSPECT_OFFSET = 4.0, 2.0  # standard errors, m; of the offset of a suspect node
_SUSPECT_SHARE = 0.5  # of the squared residuals of its pairs, which its offset must explain
_MAX_ITERATIONS = 20  # of clocks and positions
_SETTLED = 1e-3  # m; change of the ranges after which they are final


def fit_clocks_and_nodes(
    events: pd.DataFrame, candidates: pd.DataFrame, *, reference: str | None = None, drift: bool = False
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """
    Fit clocks with candidates and offsets of nodes in turn, until the offsets of suspect nodes do not change.

    A wrong position changes the candidates that appear to be nearest, differently in both directions, and shifts the clocks by
    milliseconds. The clocks are therefore fitted to residuals without the effect of suspect positions.

    Parameters
    ----------
    events, candidates : pandas.DataFrame
        Tables of a `Replay`.
    reference, drift
        As in `clock_table`.

    Returns
    -------
    clocks, taken : pandas.DataFrame
        As from `fit_clocks`; the residuals of ``taken`` contain the effect of the positions.
    nodes : pandas.DataFrame
        As from `node_table`.
    """
    late = np.zeros(len(events))
    for _ in range(_MAX_ITERATIONS):
        right = events.assign(measured_s=events["measured_s"] - late, residual_s=events["residual_s"] - late)
        clocks, taken = fit_clocks(right, candidates, reference=reference, drift=drift)
        taken = taken.assign(
            taken_residual_s=taken["taken_residual_s"] + late, taken_time_s=taken["taken_time_s"] + late
        )
        nodes = node_table(events, taken)
        before, late = late, position_errors(events, nodes)
        if np.nanmax(np.abs(late - before) * _speed(events), initial=0.0) < _SETTLED:
            break
    return clocks, taken, nodes


def position_errors(events: pd.DataFrame, nodes: pd.DataFrame) -> Array:
    """Part of each measured travel time that is due to the offsets of suspect nodes. [s]"""
    bearing = np.radians(events["bearing_deg"].to_numpy())
    table, longer = nodes[nodes["suspect"]].set_index("node"), np.zeros(len(events))
    for end, sign in (("receiver", 1.0), ("source", -1.0)):
        north, east = (events[end].map(table[name]).fillna(0.0).to_numpy() for name in ("north_m", "east_m"))
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
        One row per node: number of ``pairs`` and ``events``; ``north_m`` and ``east_m``, the offset of the true position from the
        stated one, with ``standard_error_m`` (the larger semi-axis); ``explained``, the share of the squared residuals of its pairs
        that the offset explains; ``scatter_m``, the standard deviation of range errors that vary in time and are due to this node; and
        ``suspect``.

    Notes
    -----
    A node at the offset :math:`\delta` from its stated position changes the range of a pair by :math:`u \cdot \delta`, where u is
    the direction from the other node. The median residuals of the pairs of a node, in metres, determine its offset by least squares.
    The residual scale of all pairs gives the standard errors. The most significant node is suspect if its offset is above 2 m and
    4 standard errors and explains half of its squared residuals. Its part is then removed from all pairs, and the others are examined
    again: a wrong node affects one pair of every other node. A node with fewer than three pairs is not examined. A wrong sound
    speed, which lengthens all ranges, differs from an offset only if the pairs of the node have several directions.
    """
    pairs = _pair_residuals(events, taken)
    names = sorted(set(events["source"]) | set(events["receiver"]))
    residual = pairs["residual_m"].to_numpy(dtype=float).copy()
    found: dict[str, tuple[Array, float, float]] = {}
    while True:
        fits = {name: _offset(pairs, residual, name) for name in names if name not in found}
        worst = max(fits, key=lambda name: _significance(fits[name]), default=None)
        if worst is None or not _is_suspect(fits[worst]):
            break
        found[worst] = fits[worst]
        residual = residual - _directions(pairs, worst) @ fits[worst][0]
    scatter = _scatter(events, taken, names)
    count = pd.concat([events["source"], events["receiver"]]).value_counts()
    rows = []
    for k, name in enumerate(names):
        offset, error, explained = found.get(name) or fits[name]
        of = (pairs["first"] == name) | (pairs["second"] == name)
        rows.append((name, of.sum(), count[name], *offset, error, explained, scatter[k], name in found))
    columns = ["node", "pairs", "events", "north_m", "east_m", "standard_error_m", "explained", "scatter_m"]
    return pd.DataFrame(rows, columns=[*columns, "suspect"])


def node_note(nodes: pd.DataFrame) -> str | None:
    """Sentence about nodes whose position disagrees with their ranges, None without any."""
    wrong = nodes[nodes["suspect"]]
    if wrong.empty:
        return None
    words = [
        f"{row.node} ({row.north_m:+.1f} m north, {row.east_m:+.1f} m east, +-{row.standard_error_m:.1f} m)"
        for row in wrong.itertuples()
    ]
    return f"Positions that disagree with the ranges of all their pairs: {', '.join(words)}; check them."


def _residuals_m(events: pd.DataFrame, taken: pd.DataFrame) -> "pd.Series[float]":
    """Residuals of the candidates that events took, after the clock correction, as lengths; NaN if unknown or gross. [m]"""
    return (taken["taken_residual_s"] * _speed(events)).where(~gross_of(events))


def _speed(events: pd.DataFrame) -> "pd.Series[float]":
    """Mean sound speed along the straight line of each event, NaN outside the water. [m/s]"""
    return events["distance_m"] / events["chord_s"]


def _pair_residuals(events: pd.DataFrame, taken: pd.DataFrame) -> pd.DataFrame:
    """Median residual of each pair [m], its nodes, and the direction from the first to the second. [rad]"""
    ends = np.sort(events[["source", "receiver"]].to_numpy(dtype=str), axis=1)
    turned = ends[:, 0] != events["source"].to_numpy(dtype=str)
    bearing = np.radians(events["bearing_deg"].to_numpy()) + np.pi * turned
    table = events[["pair"]].assign(
        first=ends[:, 0],
        second=ends[:, 1],
        residual_m=_residuals_m(events, taken),
        north=np.cos(bearing),
        east=np.sin(bearing),
    )
    table = table[table["residual_m"].notna() & (events["distance_m"] > 0.0)]
    return table.groupby("pair", sort=True).agg(
        {"first": "first", "second": "first", "residual_m": "median", "north": "mean", "east": "mean"}
    )


def _directions(pairs: pd.DataFrame, name: str) -> Array:
    """Unit vectors from the other node of each pair to a node, zero for pairs without it."""
    sign = (pairs["second"] == name).astype(float) - (pairs["first"] == name).astype(float)
    return pairs[["north", "east"]].to_numpy() * sign.to_numpy()[:, None]


def _offset(pairs: pd.DataFrame, residual: Array, name: str) -> tuple[Array, float, float]:
    """Offset of a node [m], its standard error [m], and the share of the squared residuals that it explains; NaN if unknown."""
    design = _directions(pairs, name)
    own = design.any(axis=1)
    if np.count_nonzero(own) < _MIN_PAIRS:
        return np.full(2, np.nan), np.nan, np.nan
    offset, _, rank, _ = np.linalg.lstsq(design[own], residual[own], rcond=1e-6)
    left = residual - design @ offset
    before = float(np.sum(residual[own] ** 2))
    if rank < 2 or before == 0.0:
        return np.full(2, np.nan), np.nan, np.nan
    scale = max(MAD_TO_SIGMA * float(np.median(np.abs(left))), np.sqrt(np.mean(left[own] ** 2)))
    error = scale * float(np.sqrt(np.linalg.eigvalsh(np.linalg.inv(design[own].T @ design[own]))[-1]))
    return np.asarray(offset), error, 1.0 - float(np.sum(left[own] ** 2)) / before


def _significance(fit: tuple[Array, float, float]) -> float:
    offset, error, _ = fit
    size = float(np.hypot(*offset))
    return -1.0 if np.isnan(size) else size / max(error, 1e-9)


def _is_suspect(fit: tuple[Array, float, float]) -> bool:
    size = float(np.hypot(*fit[0]))
    large = size > _SUSPECT_OFFSET and fit[2] > _SUSPECT_SHARE
    return bool(large and _significance(fit) > _SUSPECT_SIGMAS)


def _scatter(events: pd.DataFrame, taken: pd.DataFrame, names: list[str]) -> Array:
    """Standard deviation of range errors that each node contributes: the squared scatter of a pair is the sum of two. [m]"""
    from scipy.optimize import nnls

    residual, pair = _residuals_m(events, taken), events["pair"]
    apart = residual - residual.groupby(pair).transform("median")
    size = apart.abs().groupby(pair).median().dropna() * MAD_TO_SIGMA
    if len(size) <= len(names):
        return np.full(len(names), np.nan)
    ends = events.drop_duplicates("pair").set_index("pair").loc[size.index, ["source", "receiver"]]
    design = (ends.to_numpy(dtype=str)[:, :, None] == np.array(names)).any(axis=1).astype(float)
    return np.sqrt(nnls(design, size.to_numpy() ** 2)[0])
