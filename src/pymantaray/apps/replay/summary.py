"""Coverage and residuals of groups of events, with bootstrap intervals over pairs."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.arrays import Array, Indices
from pymantaray.geometry import stream
from pymantaray.records import RayStatus

RESAMPLES = 1000
_CONFIDENCE = 95.0  # percent
_DEPTH_STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0)  # m
_RANGE_STEPS = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4, 2e4, 5e4, 1e5)  # m
_MAX_DEPTH_GROUPS = 12
_MAX_RANGE_GROUPS = 8
_VALUES_PER_BLOCK = 4_000_000  # of resamples


def summary_table(events: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """
    Coverage and residuals of all events, and by pair, by the depths of both ends and by range.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`.
    seed : int
        Seed of the bootstrap.

    Returns
    -------
    pandas.DataFrame
        One row per group, named by ``by`` and ``group``: number of ``pairs`` and ``events``, number
        and percentage of ``predicted`` ones, the number of others by status, and of the residuals
        in metres the median and the median absolute value with their 95 % intervals, the mean and
        the root mean square. The bootstrap resamples pairs and not events, because the events of a
        pair share their errors; a single pair has no interval. Depths and ranges are rounded to the
        finest step of 1, 2 and 5 that makes at most 12 and 8 groups.
    """
    others = [status.name.lower() for status in RayStatus if status != RayStatus.OK]
    present = [name for name in others if (events["status"] == name).any()]
    rows = []
    for by, group_of, names in _groupings(events):
        for number, group in enumerate(names):
            part = events[group_of == number]
            ok = part["residual_m"].notna()
            residual = part["residual_m"][ok].to_numpy()
            pair = part["pair"][ok].to_numpy(dtype=str)
            (low, high), (size_low, size_high) = _bootstrap(residual, pair, seed, (by, group))
            row = {
                "by": by,
                "group": group,
                "pairs": part["pair"].nunique(),
                "events": len(part),
                "predicted": int(ok.sum()),
                "percent": 100.0 * float(ok.mean()),
                **{name: int((part["status"] == name).sum()) for name in present},
                "median_m": _of(np.median, residual),
                "median_low_m": low,
                "median_high_m": high,
                "median_size_m": _of(np.median, np.abs(residual)),
                "median_size_low_m": size_low,
                "median_size_high_m": size_high,
                "mean_m": _of(np.mean, residual),
                "rms_m": np.sqrt(_of(np.mean, residual**2)),
            }
            rows.append(row)
    return pd.DataFrame(rows)


def percentiles(values: Array) -> tuple[float, float]:
    """Ends of the 95 % interval of resampled values."""
    tail = 0.5 * (100.0 - _CONFIDENCE)
    low, high = np.percentile(values, (tail, 100.0 - tail))
    return float(low), float(high)


def ratio_interval(sums: Array, rng: np.random.Generator) -> tuple[float, float]:
    """
    Confidence interval of the ratio of two sums (n_pairs, 2) over resampled pairs.

    It is NaN for a single pair.
    """
    if len(sums) < 2:
        return np.nan, np.nan
    over, under = sums[rng.integers(0, len(sums), (RESAMPLES, len(sums)))].sum(axis=1).T
    return percentiles(over / under)


def quantile_of(size: Array, level: float) -> float:
    """Smallest size that is not below a fraction of all sizes, some of which may be infinite."""
    return float(np.quantile(size, level, method="inverted_cdf")) if size.size else np.nan


def pairs_of_depths(
    events: pd.DataFrame, step: float = 10.0
) -> tuple[list[str], NDArray[np.int64]]:
    """
    Unordered pairs of depths, rounded to multiples of a step [m], such as ``30 and 90 m``, and that
    of each event.
    """
    depths = np.sort(events[["source_depth_m", "receiver_depth_m"]].to_numpy(), axis=1)
    pairs, number = np.unique(step * np.round(depths / step), axis=0, return_inverse=True)
    names = [f"{first:g} and {second:g} m" for first, second in pairs.tolist()]
    return names, np.asarray(number.reshape(-1), dtype=np.int64)


def _groupings(events: pd.DataFrame) -> Iterator[tuple[str, NDArray[np.int64], list[str]]]:
    """Name of each way to group the events, the group of each event, and the groups' names."""
    yield "all", np.zeros(len(events), dtype=np.int64), ["all"]
    pairs, group_of = np.unique(events["pair"].to_numpy(dtype=str), return_inverse=True)
    yield "pair", group_of, pairs.tolist()
    for step in _DEPTH_STEPS:
        names, group_of = pairs_of_depths(events, step)
        if len(names) <= _MAX_DEPTH_GROUPS:
            break
    yield "depths", group_of, names
    for step in _RANGE_STEPS:
        cells, group_of = np.unique(
            np.floor(events["distance_m"].to_numpy() / step), return_inverse=True
        )
        if cells.size <= _MAX_RANGE_GROUPS:
            break
    yield (
        "range",
        group_of,
        [f"{1e-3 * step * cell:g} to {1e-3 * step * (cell + 1.0):g} km" for cell in cells],
    )


def _of(statistic: object, values: Array) -> float:
    return float(statistic(values)) if values.size else float("nan")  # type: ignore[operator]


def _resampled_medians(values: Array, pair: Indices, counts: NDArray[np.int64]) -> Array:
    """Median of each resample, in which values occur as often as their pair (resamples, pairs)."""
    order = np.argsort(values, kind="stable")
    values, pair = values[order], pair[order]
    medians = np.empty(len(counts))
    rows = max(_VALUES_PER_BLOCK // values.size, 1)
    for start in range(0, len(counts), rows):
        total = np.cumsum(counts[start : start + rows, pair], axis=1)
        n = total[:, -1:]
        # the middle value, or both middle values of an even number
        lower, upper = (np.sum(total < rank, axis=1) for rank in ((n + 1) // 2, n // 2 + 1))
        medians[start : start + rows] = 0.5 * (values[lower] + values[upper])
    return medians


def _bootstrap(
    residual: Array, pair: NDArray[np.str_], seed: int, names: tuple[str, str]
) -> list[tuple[float, float]]:
    """
    Intervals of the median and of the median absolute value over resampled pairs; NaN for a single
    pair.
    """
    pairs, pair_of = np.unique(pair, return_inverse=True)
    if pairs.size < 2:
        return [(np.nan, np.nan)] * 2
    draws = stream(seed, 0, "replay", "bootstrap", *names).integers(
        0, pairs.size, (RESAMPLES, pairs.size)
    )
    counts = np.zeros((RESAMPLES, pairs.size), dtype=np.int64)
    np.add.at(counts, (np.arange(RESAMPLES)[:, None], draws), 1)
    return [
        percentiles(_resampled_medians(values, pair_of, counts))
        for values in (residual, np.abs(residual))
    ]
