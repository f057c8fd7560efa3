"""
Effect of refraction on ranges: signed errors, their two causes, and dropouts, by kind of link.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
import pandas as pd

from pymantaray.arrays import AnyArray, Array, Mask
from pymantaray.errors import EvaluationError
from pymantaray.records import Measurements, RangingTruth, RayStatus, Trajectories
from pymantaray.records.status import ARRIVES

ALL_LINKS = "all links"
"""Category of the table rows that include all links."""
_KINDS = ("landmark", "station-keeping", "float", "vehicle")
_KIND_OF_ROLE = {"station": "station-keeping", "float": "float"}
_TAILS = (1, 5, 95, 99)


@dataclass(frozen=True, eq=False)
class RangeErrors:
    """
    Signed range errors of all attempts, and their exact split into two parts; NaN for a dropout.

    Parameters
    ----------
    total : ndarray, shape (n_ranges,)
        Refracted minus straight range. [m]
    reference_speed : ndarray, shape (n_ranges,)
        Part due to the difference between the sound speed at the transmitter and the mean along the
        chord: this sound speed times the travel time along the chord, minus the distance. [m]
    bending : ndarray, shape (n_ranges,)
        Part due to the difference between ray and chord: the same sound speed times the difference
        of the travel times. By Fermat's principle, it is never positive for the globally earliest
        arrival. [m]
    """

    total: Array
    reference_speed: Array
    bending: Array


def check_same_vehicles(truth: Trajectories, measurements: Measurements) -> None:
    """Raise an error if the vehicles of two records differ."""
    if truth.name.tolist() != measurements.name.tolist():
        raise EvaluationError(
            f"measurements of vehicles {list(measurements.name)}, truth of {list(truth.name)}"
        )


def range_errors(ranging_truth: RangingTruth) -> RangeErrors:
    """
    Signed errors of the refracted ranges.

    Parameters
    ----------
    ranging_truth : RangingTruth
        True values of all range attempts.

    Returns
    -------
    RangeErrors
        Errors and their two parts, shape (n_ranges,). [m]

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import range_errors
    >>> errors = range_errors(ranging.truth)
    >>> print(errors.total.round(2), errors.reference_speed.round(2), errors.bending.round(2))
    [-12.13   4.99] [-12.04   5.08] [-0.09 -0.09]
    """
    t = ranging_truth
    received = np.isfinite(t.travel_time)
    chord = t.sound_speed * t.chord_travel_time
    return RangeErrors(
        total=t.refracted_range - t.distance,
        reference_speed=np.where(received, chord - t.distance, np.nan),
        bending=t.refracted_range - chord,
    )


def link_categories(measurements: Measurements, truth: Trajectories) -> AnyArray:
    """
    Category of each range attempt by the behaviours at both ends, such as "station-keeping to
    float".

    Parameters
    ----------
    measurements : Measurements
        Range attempts.
    truth : Trajectories
        Vehicles with their behaviours.

    Returns
    -------
    ndarray of str, shape (n_ranges,)
        Categories, which do not depend on the end that transmits.

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ.
    """
    check_same_vehicles(truth, measurements)
    kinds = [_KIND_OF_ROLE.get(r, "vehicle") for r in truth.role.tolist()]
    rank = np.array(
        [_KINDS.index(k) for k in kinds] + [0] * measurements.landmark_name.size, dtype=int
    )
    one = rank[measurements.range_transmitter]
    other = rank[measurements.range_receiver]
    names = np.array([[f"{a} to {b}" for b in _KINDS] for a in _KINDS])
    return np.asarray(names[np.minimum(one, other), np.maximum(one, other)])


def range_error_table(
    measurements: Measurements, ranging_truth: RangingTruth, truth: Trajectories
) -> pd.DataFrame:
    """
    Statistics of the signed range error by kind of link.

    Parameters
    ----------
    measurements : Measurements
        Range attempts; ``range_sigma`` is the standard deviation that the estimator assumes.
    ranging_truth : RangingTruth
        True values of the same attempts.
    truth : Trajectories
        Vehicles with their behaviours.

    Returns
    -------
    pandas.DataFrame
        One row for each category and one for all links: ``category``, ``attempts``, ``n`` (received
        ranges), ``mean_m``, ``sd_m``, ``skewness``, ``excess_kurtosis`` (from the moments, without
        small-sample correction), ``p1_m``, ``p5_m``, ``p95_m``, ``p99_m``, ``min_m``, ``max_m``,
        ``percent_beyond_3_sigma``.

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import range_error_table
    >>> table = range_error_table(measurements, ranging.truth, truth)
    >>> table[["category", "n", "mean_m", "percent_beyond_3_sigma"]].round(2)
                                 category  n  mean_m  percent_beyond_3_sigma
    0  station-keeping to station-keeping  2   -3.57                   100.0
    1                           all links  2   -3.57                   100.0
    """
    errors = range_errors(ranging_truth).total
    rows = []
    for category, mask in _groups(measurements, truth):
        e = errors[mask]
        sigma = measurements.range_sigma[mask]
        received = ~np.isnan(e)
        beyond = np.abs(e[received]) > 3.0 * sigma[received]
        e = e[received]
        rows.append(
            {
                "category": category,
                "attempts": int(mask.sum()),
                "n": int(e.size),
                **_moments(e),
                **_shape(e),
                **_tails(e),
                "percent_beyond_3_sigma": 100.0 * float(beyond.mean()) if e.size else np.nan,
            }
        )
    return pd.DataFrame(rows)


def range_split_table(
    measurements: Measurements, ranging_truth: RangingTruth, truth: Trajectories
) -> pd.DataFrame:
    """
    Range error split into reference speed and bending, by kind of link.

    Parameters
    ----------
    measurements : Measurements
        Range attempts.
    ranging_truth : RangingTruth
        True values of the same attempts.
    truth : Trajectories
        Vehicles with their behaviours.

    Returns
    -------
    pandas.DataFrame
        One row for each category of links and each ``part``: "total", "reference speed", "bending";
        columns ``category``, ``part``, ``n``, ``mean_m``, ``sd_m``, ``p1_m``, ``p5_m``, ``p95_m``,
        ``p99_m``, ``min_m``, ``max_m``.

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import range_split_table
    >>> table = range_split_table(measurements, ranging.truth, truth)
    >>> table[["category", "part", "mean_m"]].round(2)
                                 category             part  mean_m
    0  station-keeping to station-keeping            total   -3.57
    1  station-keeping to station-keeping  reference speed   -3.48
    2  station-keeping to station-keeping          bending   -0.09
    3                           all links            total   -3.57
    4                           all links  reference speed   -3.48
    5                           all links          bending   -0.09
    """
    errors = range_errors(ranging_truth)
    parts = {
        "total": errors.total,
        "reference speed": errors.reference_speed,
        "bending": errors.bending,
    }
    rows = []
    for category, mask in _groups(measurements, truth):
        for part, values in parts.items():
            e = values[mask]
            e = e[~np.isnan(e)]
            rows.append(
                {"category": category, "part": part, "n": int(e.size), **_moments(e), **_tails(e)}
            )
    return pd.DataFrame(rows)


def dropout_table(measurements: Measurements, truth: Trajectories) -> pd.DataFrame:
    """
    Dropouts by kind of link and by cause.

    Parameters
    ----------
    measurements : Measurements
        Range attempts with their status.
    truth : Trajectories
        Vehicles with their behaviours.

    Returns
    -------
    pandas.DataFrame
        ``category``, ``attempts``, ``dropouts``, ``percent``, and one column per `RayStatus` except
        OK, with its name in lower case and its count. Columns of sound without a ray, which is not
        a dropout, are absent if their counts are zero.

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import dropout_table
    >>> dropout_table(measurements, truth)[["category", "attempts", "dropouts", "percent"]]
                                 category  attempts  dropouts  percent
    0  station-keeping to station-keeping         2         0      0.0
    1                           all links         2         0      0.0
    """
    rows: list[dict[str, Any]] = []
    present = set(measurements.range_status.tolist())
    named = [s for s in RayStatus if s not in ARRIVES or (s in present and s != RayStatus.OK)]
    for category, mask in _groups(measurements, truth):
        status = measurements.range_status[mask]
        dropouts = int(np.count_nonzero(~np.isin(status, ARRIVES)))
        rows.append(
            {
                "category": category,
                "attempts": int(status.size),
                "dropouts": dropouts,
                "percent": 100.0 * dropouts / status.size if status.size else np.nan,
            }
            | {s.name.lower(): int(np.count_nonzero(status == s)) for s in named}
        )
    return pd.DataFrame(rows)


def _groups(measurements: Measurements, truth: Trajectories) -> Iterator[tuple[str, Mask]]:
    category = link_categories(measurements, truth)
    for one, other in combinations_with_replacement(_KINDS, 2):
        name = f"{one} to {other}"
        if (mask := category == name).any():
            yield name, mask
    yield ALL_LINKS, np.ones(category.size, dtype=bool)


def _moments(e: Array) -> dict[str, float]:
    return {
        "mean_m": float(e.mean()) if e.size else np.nan,
        "sd_m": float(e.std(ddof=1)) if e.size > 1 else np.nan,
    }


def _shape(e: Array) -> dict[str, float]:
    """Skewness and excess kurtosis; NaN if all values are equal."""
    if not (e.size > 1 and np.ptp(e) > 0.0):
        return {"skewness": np.nan, "excess_kurtosis": np.nan}
    square = (e - e.mean()) ** 2
    variance = square.mean()
    third = (square * (e - e.mean())).mean()
    fourth = (square**2).mean()
    return {
        "skewness": float(third / variance**1.5),
        "excess_kurtosis": float(fourth / variance**2.0 - 3.0),
    }


def _tails(e: Array) -> dict[str, float]:
    if e.size == 0:
        return dict.fromkeys([*(f"p{p}_m" for p in _TAILS), "min_m", "max_m"], np.nan)
    return {f"p{p}_m": float(v) for p, v in zip(_TAILS, np.percentile(e, _TAILS), strict=True)} | {
        "min_m": float(e.min()),
        "max_m": float(e.max()),
    }
