"""
Absolute trajectory errors without alignment: per pose, per vehicle, per realization and pooled.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from pymantaray.arrays import AnyArray, Array
from pymantaray.errors import EvaluationError
from pymantaray.estimation import FactorGraph, GraphValues, rmse_standard_error
from pymantaray.evaluation.bound import DegreesOfFreedom
from pymantaray.geometry.se3 import lengths, matrix_from_quaternion, so3_log
from pymantaray.records import Estimates, SolveStatus, Trajectories

USABLE = tuple(status for status in SolveStatus if status.usable)
_PERCENTILES = (5, 25, 75, 95)
_AXES = {"condition": 0, "realization": 1, "vehicle": 2}


def ape(estimate_position: ArrayLike, truth_position: ArrayLike) -> Array:
    """
    Distance of each estimated position from the true one.

    The trajectories are not aligned, so a shift of the frame is an error.

    Parameters
    ----------
    estimate_position : array_like, shape (..., n_times, 3)
        Estimated positions. [m]
    truth_position : array_like, shape (..., n_times, 3)
        True positions; they broadcast with the estimates. [m]

    Returns
    -------
    ndarray, shape (..., n_times)
        Distances. [m]

    Raises
    ------
    EvaluationError
        If the last two dimensions differ.
    """
    estimate = np.asarray(estimate_position, dtype=float)
    truth = np.asarray(truth_position, dtype=float)
    if (
        estimate.ndim < 2
        or truth.ndim < 2
        or estimate.shape[-2:] != truth.shape[-2:]
        or truth.shape[-1] != 3
    ):
        raise EvaluationError(
            f"positions of shape {estimate.shape} against {truth.shape}; both need (..., n_times,"
            " 3), n_times equal"
        )
    return lengths(estimate - truth)


def ate_statistics(errors: ArrayLike) -> dict[str, float]:
    """
    Statistics of absolute trajectory errors, pooled over all entries.

    Parameters
    ----------
    errors : array_like
        Errors; NaN entries are ignored. [m]

    Returns
    -------
    dict of str to float
        ``n``, ``mean_m``, ``median_m``, ``rmse_m``, ``p5_m``, ``p25_m``, ``p75_m``, ``p95_m`` and
        ``max_m``.
    """
    e = np.asarray(errors, dtype=float).ravel()
    e = e[~np.isnan(e)]
    if e.size == 0:
        nothing = ("mean_m", "median_m", "rmse_m", *(f"p{p}_m" for p in _PERCENTILES), "max_m")
        return {"n": 0, **dict.fromkeys(nothing, float("nan"))}
    percentiles = np.percentile(e, _PERCENTILES)
    return {
        "n": int(e.size),
        "mean_m": float(e.mean()),
        "median_m": float(np.median(e)),
        "rmse_m": float(np.sqrt(np.mean(e * e))),
        **{f"p{p}_m": float(v) for p, v in zip(_PERCENTILES, percentiles, strict=True)},
        "max_m": float(e.max()),
    }


def graph_errors(
    graph: FactorGraph,
    values: GraphValues,
    truth: GraphValues | None,
    freedom: Mapping[str, float] | None = None,
) -> dict[str, dict[str, float]]:
    """
    Absolute trajectory errors of the values of a graph without alignment, by vehicle and pooled.

    Parameters
    ----------
    graph : FactorGraph
        Graph with the names of the vehicles.
    values : GraphValues
        Estimated values.
    truth : GraphValues, optional
        True values.
    freedom : mapping of str to float, optional
        Result of `graph_degrees_of_freedom`, for standard errors.

    Returns
    -------
    dict of str to dict
        For each vehicle's name and ``"(all)"``: ``n``, ``mean_m``, ``median_m``, ``rmse_m``,
        ``p5_m``, ``p25_m``, ``p75_m``, ``p95_m`` and ``max_m`` of the errors, and with ``freedom``
        also ``rmse_standard_error_m``; empty without a truth.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import graph_errors
    >>> exact = GraphValues(
    ...     truth.position.reshape(-1, 3), truth.quaternion.reshape(-1, 4), np.empty((0, 3))
    ... )
    >>> round(graph_errors(graph, start, exact)["(all)"]["rmse_m"], 1)
    10.2
    """
    if truth is None:
        return {}
    errors = ape(values.position, truth.position)
    table = {
        str(n): ate_statistics(errors[graph.pose_vehicle == a])
        for a, n in enumerate(graph.vehicle_name)
    }
    table["(all)"] = ate_statistics(errors)
    for name, nu in (freedom or {}).items():
        table[name]["rmse_standard_error_m"] = standard_error(table[name]["rmse_m"], nu, 1)
    return table


def trajectory_errors(truth: Trajectories, estimates: Estimates) -> Array:
    """
    Absolute trajectory errors of all solves.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.

    Returns
    -------
    ndarray, shape (n_conditions, n_realizations, n_vehicles, n_times)
        Position errors; NaN for a failed solve. [m]

    Raises
    ------
    EvaluationError
        If truth and estimates have different vehicles or times, or a usable solve has poses that
        are not finite.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import trajectory_errors
    >>> print(np.nanmean(trajectory_errors(truth, estimates), axis=(1, 2, 3)).round(1))
    [6.9 4.3 4.4]
    """
    if truth.name.tolist() != estimates.name.tolist():
        raise EvaluationError(
            f"estimates are of vehicles {list(estimates.name)}, the truth of {list(truth.name)}"
        )
    if not np.array_equal(truth.time, estimates.time):
        raise EvaluationError("estimates and truth have different sample times")
    errors = ape(estimates.position, truth.position)
    usable = np.isin(estimates.solve_status, USABLE)
    lost = usable & np.isnan(errors).any(axis=(2, 3))
    if lost.any():
        condition, realization = np.argwhere(lost)[0]
        raise EvaluationError(
            f"condition {estimates.condition[condition]}, realization"
            f" {estimates.realization[realization]}: status is good but poses are NaN"
        )
    errors[~usable] = np.nan
    return errors


def error_table(
    truth: Trajectories,
    estimates: Estimates,
    by: Sequence[str] = (),
    *,
    freedom: Mapping[str, DegreesOfFreedom] | None = None,
) -> pd.DataFrame:
    """
    Error statistics for each condition, and optionally for each vehicle or realization.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.
    by : sequence of {"realization", "vehicle"}
        Further columns to group by. The errors of all poses of a group are pooled.
    freedom : mapping of str to DegreesOfFreedom, optional
        Degrees of freedom of each condition, for standard errors.

    Returns
    -------
    pandas.DataFrame
        Columns ``condition``, those of ``by``, ``solves`` and ``failed_solves`` (numbers of usable
        and failed realizations), and those of `graph_errors`. With ``freedom`` also
        ``rmse_standard_error_m``, the standard error of ``rmse_m`` [m], which is an upper estimate
        if the estimator is biased.

    Raises
    ------
    EvaluationError
        If ``by`` contains another word, or `trajectory_errors` raises it.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import error_table
    >>> error_table(truth, estimates)[["condition", "solves", "rmse_m"]].round(2)
       condition  solves  rmse_m
    0   odometry       3    9.81
    1   straight       3    6.98
    2  refracted       3    7.07
    """
    if not set(by) <= {"realization", "vehicle"}:
        raise EvaluationError(f"by={list(by)}; allowed are 'realization' and 'vehicle'")
    errors = trajectory_errors(truth, estimates)
    usable = np.isin(estimates.solve_status, USABLE)
    keys = ["condition", *by]
    names: dict[str, AnyArray] = {
        "condition": estimates.condition,
        "realization": estimates.realization,
        "vehicle": estimates.name,
    }
    rows = []
    for index in np.ndindex(*(names[k].size for k in keys)):
        place: list[Any] = [slice(None)] * 3
        for k, i in zip(keys, index, strict=True):
            place[_AXES[k]] = i
        good = np.atleast_1d(usable[tuple(place[:2])])
        row = (
            {k: names[k][i] for k, i in zip(keys, index, strict=True)}
            | {"solves": int(good.sum()), "failed_solves": int((~good).sum())}
            | ate_statistics(errors[tuple(place)])
        )
        if freedom is not None:
            own = freedom[row["condition"]]
            nu = (
                float(own.vehicle[index[keys.index("vehicle")]]) if "vehicle" in keys else own.fleet
            )
            row["rmse_standard_error_m"] = standard_error(row["rmse_m"], nu, row["solves"])
        rows.append(row)
    return pd.DataFrame(rows)


def standard_error(rmse: float, degrees_of_freedom: float, realizations: int) -> float:
    """Standard error of an RMSE; NaN without realizations."""
    return (
        float(rmse_standard_error(rmse, degrees_of_freedom, realizations))
        if realizations
        else np.nan
    )


def spread_standard_error(mean_squares: ArrayLike) -> float:
    """
    Standard error of an RMSE from the spread of the mean squares of independent realizations, to
    first order.

    Parameters
    ----------
    mean_squares : array_like, shape (n_realizations,)
        Mean square error of each realization. [m²]

    Returns
    -------
    float
        NaN for fewer than two realizations. [m]
    """
    squares = np.asarray(mean_squares, dtype=float)
    if squares.size < 2:
        return np.nan
    of_mean_square = float(np.std(squares, ddof=1)) / np.sqrt(squares.size)
    return of_mean_square / (2.0 * np.sqrt(squares.mean())) if of_mean_square > 0.0 else 0.0


def attitude_table(
    truth: Trajectories, estimates: Estimates, freedom: Mapping[str, DegreesOfFreedom] | None = None
) -> pd.DataFrame:
    """
    Errors of the estimated attitudes for each condition, pooled over vehicles, times and
    realizations.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.
    freedom : mapping of str to DegreesOfFreedom, optional
        Degrees of freedom of each condition, for standard errors.

    Returns
    -------
    pandas.DataFrame
        Columns ``condition``, ``tilt_rmse_deg`` (per horizontal axis) and ``heading_rmse_deg``; NaN
        if all solves failed. With ``freedom`` also their standard errors,
        ``tilt_rmse_standard_error_deg`` and ``heading_rmse_standard_error_deg``.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import attitude_table
    >>> attitude_table(truth, estimates).round(3)
       condition  tilt_rmse_deg  heading_rmse_deg
    0   odometry          0.014             0.006
    1   straight          0.014             0.006
    2  refracted          0.014             0.006
    """
    usable = np.isin(estimates.solve_status, USABLE)
    rotation = matrix_from_quaternion(truth.quaternion)
    rows = []
    for c, condition in enumerate(estimates.condition.tolist()):
        body = matrix_from_quaternion(estimates.quaternion[c, usable[c]])
        turn = np.degrees(so3_log(rotation @ np.swapaxes(body, -1, -2)))
        tilt, heading = (
            np.sqrt(np.mean(t**2)) if t.size else np.nan for t in (turn[..., :2], turn[..., 2])
        )
        row = {"condition": condition, "tilt_rmse_deg": tilt, "heading_rmse_deg": heading}
        if freedom is not None:
            own = freedom[condition]
            count = int(usable[c].sum())
            row["tilt_rmse_standard_error_deg"] = standard_error(tilt, own.tilt, count)
            row["heading_rmse_standard_error_deg"] = standard_error(heading, own.heading, count)
        rows.append(row)
    return pd.DataFrame(rows)
