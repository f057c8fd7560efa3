"""Clocks from residuals: offsets and drifts, gross errors, and differences by direction."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.estimation.graph.graph import joined_parts

# s, and share of the travel time; a larger difference is no sound path
_GROSS_TIME = 0.05
_GROSS_SHARE = 0.05
_DRIFT_COLUMNS = ["drift", "standard_error_drift"]
_MAX_NAMES = 8  # in a sentence
_RECIPROCITY = [
    *("pair", "forth", "back", "matched", "mean_s", "sd_s", "clocks_s", "left_s"),
    "standard_error_s",
]


def clock_table(
    events: pd.DataFrame,
    residual: "pd.Series[float]",
    *,
    reference: str | None = None,
    drift: bool = False,
) -> pd.DataFrame:
    r"""
    Offsets of the nodes' clocks, and their drifts, by least squares on residuals.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`. Those with a residual and without a gross error are used, weighted by
        ``sigma_s`` if all have one, else equally.
    residual : pandas.Series
        Residual of each event: measured travel time minus that of an arrival. [s]
    reference : str, optional
        Node with the reference clock. By default, and in a group of nodes without it, the mean of
        each connected group.
    drift : bool
        True to fit a constant rate of each clock too. Offsets are then those at the mean time of
        the events.

    Returns
    -------
    pandas.DataFrame
        One row per node: ``offset_s`` of its clock (ahead is positive), number of ``events``,
        ``group`` of connected nodes, and ``standard_error_s``: the larger one of that of
        independent events, scaled by their scatter, and that of errors that all events of a pair
        share (a sandwich estimator over pairs, if there are more pairs than clocks). With drift
        also ``drift``, the rate of each clock [s/s], ``standard_error_drift`` by the same rule,
        and ``mean_time_s``.

    Notes
    -----
    A residual is :math:`o_r - o_s + e` with the offsets of receiver and source. Only differences
    are observable: the solution of least norm has mean zero over each connected group. An error
    that both directions of a pair share (a wrong sound speed, a later candidate) does not affect
    offsets if there are events in both directions, and does if there is only one.
    """
    # an echo has one clock
    has = residual.notna() & ~gross_of(events) & (events["source"] != events["receiver"])
    used = events[has]
    times = residual[has].to_numpy()
    names = sorted(set(events["source"]) | set(events["receiver"]))
    source, receiver = (np.searchsorted(names, used[end]) for end in ("source", "receiver"))
    n = len(used)
    k = len(names)
    mean_time = float(used["time_s"].mean()) if n else 0.0
    elapsed = used["time_s"].to_numpy() - mean_time
    design = np.zeros((n, 2 * k if drift else k))
    for node, sign in ((receiver, 1.0), (source, -1.0)):
        design[np.arange(n), node] = sign
        if drift:
            design[np.arange(n), k + node] = sign * elapsed
    longest = max(float(np.abs(elapsed).max(initial=0.0)), 1.0)
    scale = np.repeat([1.0, longest], k)[: design.shape[1]]
    sigma = used["sigma_s"].to_numpy()
    weight = 1.0 / sigma**2 if np.isfinite(sigma).all() else np.ones(n)
    unit = design / scale
    inverse: Array = np.asarray(np.linalg.pinv(unit.T @ (weight[:, None] * unit), hermitian=True))
    inverse /= np.outer(scale, scale)
    clock = inverse @ (design.T @ (weight * times))
    group = _groups(k, source, receiver)
    count = np.bincount(np.concatenate([source, receiver]), minlength=k)
    # the solution of least norm has mean zero over each group; with a reference, subtract its clock
    if reference is not None:
        member = group == group[names.index(reference)]
        right = np.arange(k) == names.index(reference)
        gauge = np.kron(np.eye(2 if drift else 1), np.eye(k) - np.outer(member, right))
        clock = gauge @ clock
        inverse = gauge @ inverse @ gauge.T
    remaining = times - design @ clock
    # one clock of each connected group cannot be observed
    n_clocks = int(np.count_nonzero(count)) - np.unique(group[count > 0]).size
    n_clocks = 2 * n_clocks if drift else n_clocks
    scatter = float(np.sum(weight * remaining**2)) / (n - n_clocks) if n > n_clocks else np.nan
    independent = np.sqrt(np.diag(inverse) * scatter)
    over_pairs = _over_pairs(
        design * (weight * remaining)[:, None], used["pair"].to_numpy(dtype=str), inverse, n_clocks
    )
    error = np.fmax(independent, over_pairs)
    columns = {"node": names, "offset_s": clock[:k], "standard_error_s": error[:k]}
    if drift:
        columns |= dict(zip(_DRIFT_COLUMNS, (clock[k:], error[k:]), strict=True))
    table = pd.DataFrame(columns)
    table.loc[count == 0, table.columns.drop("node")] = np.nan
    table["events"] = count
    table["group"] = group
    return table.assign(mean_time_s=mean_time) if drift else table


def clock_errors(events: pd.DataFrame, clocks: pd.DataFrame) -> Array:
    """Part of each measured travel time that is due to the clocks, receiver minus source. [s]"""
    table = clocks.set_index("node")
    total = np.zeros(len(events))
    for end, sign in (("receiver", 1.0), ("source", -1.0)):
        total += sign * events[end].map(table["offset_s"]).to_numpy()
        if "drift" in table:
            elapsed = events["time_s"].to_numpy() - float(table["mean_time_s"].iloc[0])
            total += sign * elapsed * events[end].map(table["drift"]).to_numpy()
    return total


def gross_of(events: pd.DataFrame) -> "pd.Series[bool]":
    """Flags of gross errors of events; False where they were not examined."""
    return events["gross"] if "gross" in events else pd.Series(data=False, index=events.index)


def find_gross_errors(events: pd.DataFrame, candidates: pd.DataFrame) -> "pd.Series[bool]":
    """
    Events whose measured time no sound path explains.

    The measured time differs from that of the straight line, ``chord_s``, by more than 0.05 s and
    by more than 5 %, and from every candidate by more than 0.05 s. Such a difference is a wrong
    clock, a wrong event or a wrong position. An event outside the water has no time of the straight
    line and no flag.

    Parameters
    ----------
    events, candidates : pandas.DataFrame
        Of a `Replay`.

    Returns
    -------
    pandas.Series
        True for a gross error.
    """
    chord = events["chord_s"]
    measured_time = events["measured_s"]
    is_far = (measured_time - chord).abs() > np.maximum(_GROSS_TIME, _GROSS_SHARE * chord)
    event = candidates["event"].to_numpy(dtype=np.int64)
    is_near = (
        np.abs(measured_time.to_numpy()[event] - candidates["travel_time_s"].to_numpy())
        <= _GROSS_TIME
    )
    has_candidate = np.bincount(event[is_near], minlength=len(events)) > 0
    return (is_far & ~has_candidate).rename("gross")


def gross_note(events: pd.DataFrame) -> str | None:
    """Sentence about the gross errors of events, None without any."""
    wrong = events[gross_of(events)]
    if wrong.empty:
        return None
    largest = wrong.iloc[(wrong["measured_s"] - wrong["chord_s"]).abs().argmax()]
    return (
        f"{len(wrong)} of {len(events)} measured times are no travel times of sound, such as"
        f" {largest['measured_s']:.3g} s instead of {largest['chord_s']:.3g} s from"
        f" {largest['source']} to {largest['receiver']}: check clocks and events. Clocks and"
        " baselines ignore them."
    )


def known_clocks(
    events: pd.DataFrame, clocks: pd.DataFrame, *, reference: str | None = None
) -> pd.DataFrame:
    """
    Clocks that the events determine.

    An error of the sound speed or of a position acts like a clock offset unless a pair was measured
    in both directions. Offsets are therefore relative to the nodes that are connected by such
    pairs, and unknown (NaN) for all other nodes.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`.
    clocks : pandas.DataFrame
        From `clock_table`.
    reference : str, optional
        Node with the reference clock. Default: the mean of each group.

    Returns
    -------
    pandas.DataFrame
        Like ``clocks``, with the column ``both_ways``: number of pairs of the node that were
        measured in both directions.
    """
    used = events[events["residual_s"].notna() & ~gross_of(events)]
    ways = used.groupby("pair")["source"].nunique()
    two_way = used[used["pair"].isin(ways.index[ways > 1])]
    names = clocks["node"].to_list()
    source, receiver = (np.searchsorted(names, two_way[end]) for end in ("source", "receiver"))
    group = _groups(len(names), source, receiver)
    first = two_way.drop_duplicates("pair")
    count = pd.concat([first["source"], first["receiver"]]).value_counts()
    table = clocks.assign(group=group, both_ways=[int(count.get(name, 0)) for name in names])
    values = [name for name in ("offset_s", "predicted_offset_s", "drift") if name in table]
    if reference is None or table.loc[table["node"] == reference, "both_ways"].iloc[0] == 0:
        table[values] -= table.groupby("group")[values].transform("mean")
    else:
        for number in np.unique(group):
            members = table["group"] == number
            right = table["node"] == reference
            zero = table.loc[right if (members & right).any() else members, values].mean()
            table.loc[members, values] -= zero
    errors = [name for name in table if str(name).startswith("standard_error")]
    table.loc[table["both_ways"] == 0, [*values, *errors]] = np.nan
    return table


def unknown_clocks_note(clocks: pd.DataFrame) -> str | None:
    """Sentence about the clocks that cannot be known, None if all are known."""
    active = clocks[clocks["events"] > 0]
    isolated = active.loc[active["both_ways"] == 0, "node"].to_list()
    groups = active.loc[active["both_ways"] > 0, "group"].nunique()
    lines = []
    if isolated:
        names = ", ".join(isolated[:_MAX_NAMES])
        names += ", ..." if len(isolated) > _MAX_NAMES else ""
        lines.append(
            f"The clock offsets of {names} cannot be known: none of their pairs was measured in"
            " both directions, so that an error of the sound speed or of a position has the same"
            " effect."
        )
    if groups > 1:
        lines.append(
            f"Clock offsets are known within {groups} groups of nodes, not between the groups."
        )
    return " ".join(lines) or None


def _groups(k: int, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the connected group of each of k nodes, by the links between them; from 1."""
    return joined_parts(k, np.stack([first, second], axis=1)).astype(np.int64) + 1


def _over_pairs(score: Array, pair: NDArray[np.str_], inverse: Array, clocks: int) -> Array:
    """Standard errors of clocks from the sums of scores over each pair."""
    names, pair_of = np.unique(pair, return_inverse=True)
    if names.size <= clocks:
        return np.full(len(inverse), np.nan)
    sums = np.zeros((names.size, len(inverse)))
    np.add.at(sums, pair_of, score)
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
        Maximum time between paired events. The partner of an event is the nearest in time of the
        other direction; each is used once. [s]

    Returns
    -------
    pandas.DataFrame
        One row per pair: number of events with a residual ``forth`` and ``back``, number
        ``matched``, ``mean_s`` and ``sd_s`` of the difference (first name to second, minus second
        to first), ``clocks_s``, the part due to clock offsets, and ``left_s``, the rest with its
        ``standard_error_s``. The rest is zero in water at rest; a current v over a distance d
        causes about -2 d v / c^2.
    """
    table = events.assign(clocks=clock_errors(events, clocks))
    rows = []
    for pair, part in table.assign(time=times)[times.notna()].groupby("pair", sort=True):
        first = min(part["source"].iloc[0], part["receiver"].iloc[0])
        second = max(part["source"].iloc[0], part["receiver"].iloc[0])
        forth = part[part["source"] == first]
        back = part[part["source"] == second]
        forth_rows, back_rows = _match(
            forth["time_s"].to_numpy(), back["time_s"].to_numpy(), window
        )
        difference = forth["time"].to_numpy()[forth_rows] - back["time"].to_numpy()[back_rows]
        n = difference.size
        mean = float(difference.mean()) if n else np.nan
        sd = float(difference.std(ddof=1)) if n > 1 else np.nan
        clock_difference = (
            forth["clocks"].to_numpy()[forth_rows] - back["clocks"].to_numpy()[back_rows]
        )
        by_clocks = float(clock_difference.mean()) if n else np.nan
        rows.append(
            {
                "pair": pair,
                "forth": len(forth),
                "back": len(back),
                "matched": n,
                "mean_s": mean,
                "sd_s": sd,
                "clocks_s": by_clocks,
                "left_s": mean - by_clocks,
                "standard_error_s": sd / np.sqrt(max(n, 1)),
            }
        )
    return pd.DataFrame(rows, columns=_RECIPROCITY)


def _match(time: Array, other: Array, window: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Rows of events and of their nearest partners in time.

    A partner of several events goes to the nearest of them.
    """
    if not time.size or not other.size:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    order = np.argsort(other, kind="stable")
    after = np.clip(np.searchsorted(other[order], time), 1, max(other.size - 1, 1))
    neighbours = order[np.stack([after - 1, np.minimum(after, other.size - 1)])]
    gap = np.abs(other[neighbours] - time)
    partner = neighbours[np.argmin(gap, axis=0), np.arange(time.size)]
    gap = gap.min(axis=0)
    nearest = np.lexsort((gap, partner))
    _, first = np.unique(partner[nearest], return_index=True)
    rows = nearest[first]
    rows = np.sort(rows[gap[rows] <= window])
    return rows, partner[rows]
