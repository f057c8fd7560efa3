"""Consistency of estimators: NEES, range innovations and coverage with their 95 % bounds."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import special

from pymantaray.arrays import AnyArray, Array
from pymantaray.errors import EvaluationError
from pymantaray.evaluation.trajectory_error import USABLE
from pymantaray.geometry.se3 import matrix_from_quaternion, so3_log
from pymantaray.records import Estimates, PoseCovariances, Trajectories

_AXES = ("north", "east", "down")
_SIGMAS = (1.0, 3.0)


class Errors(NamedTuple):
    """
    Errors at the epochs, shape (conditions, realizations, epochs, vehicles, 3 or 6); NaN if a solve
    is not usable.
    """

    position: Array
    """Estimate minus truth. [m]"""
    pose: Array
    """
    From the estimate to the truth: rotation vector, then translation in the body frame. [rad, m]
    """


def nees(error: ArrayLike, covariance: ArrayLike) -> Array:
    """
    Normalized estimation error squared; its expectation is the length of the last axis. NaN if
    error or covariance is not finite.
    """
    e = np.asarray(error, dtype=float)
    p = np.asarray(covariance, dtype=float)
    if p.shape != (*e.shape, e.shape[-1]):
        raise EvaluationError(
            f"covariance of shape {p.shape} for errors of {e.shape}; it must have shape"
            f" {(*e.shape, e.shape[-1])}"
        )
    out = np.full(e.shape[:-1], np.nan)
    good = np.isfinite(e).all(axis=-1) & np.isfinite(p).all(axis=(-2, -1))
    e = e[good]
    p = p[good]
    variance = np.diagonal(p, axis1=-2, axis2=-1)
    scale = 1.0 / np.sqrt(np.where(variance > 0.0, variance, 1.0))
    try:
        root = np.linalg.cholesky(p * scale[..., :, None] * scale[..., None, :])
    except np.linalg.LinAlgError:
        raise EvaluationError("a covariance is not positive definite, as NEES requires") from None
    out[good] = np.sum(np.linalg.solve(root, (e * scale)[..., None])[..., 0] ** 2, axis=-1)
    return out


def mean_chi_square_bounds(
    degrees_of_freedom: ArrayLike, confidence: float = 0.95
) -> tuple[Array, Array]:
    """
    Central confidence interval of a chi-square variable divided by its degrees of freedom; NaN for
    0 degrees of freedom.
    """
    k = np.asarray(degrees_of_freedom, dtype=float)
    k = np.where(k > 0.0, k, np.nan)
    low, high = (2.0 * special.gammaincinv(k / 2.0, p) / k for p in _tail_probabilities(confidence))
    return np.asarray(low), np.asarray(high)


def epoch_errors(truth: Trajectories, estimates: Estimates, covariances: PoseCovariances) -> Errors:
    """
    Errors of positions and poses at the epochs of the covariances, with separate rotation and
    translation.

    The twist of the whole motion has the same covariance only to first order. Half a rotation error
    of 1e-2 rad times metres of horizontal error is a vertical error of centimetres. Depth is known
    to one centimetre, so NEES would be up to ten times too large.
    """
    c = covariances
    for what, a, b in (
        ("vehicles", estimates.name, truth.name),
        ("vehicles", c.name, truth.name),
        ("sample times", estimates.time, truth.time),
        ("conditions", c.condition, estimates.condition),
        ("realizations", c.realization, estimates.realization),
    ):
        if not np.array_equal(a, b):
            raise EvaluationError(f"truth, estimates and covariances have different {what}")
    if c.sample.size and not (c.sample.min() >= 0 and c.sample.max() < truth.time.size):
        raise EvaluationError(
            f"covariances at sample {c.sample.max()}; the truth has {truth.time.size}"
        )

    def at_epochs(values: Array) -> Array:
        return np.asarray(np.swapaxes(values[..., c.sample, :], -3, -2))

    position = at_epochs(estimates.position)
    true_position = at_epochs(truth.position)
    lost = ~np.isin(estimates.solve_status, USABLE)
    position[lost] = np.nan
    fine = np.asarray(np.isfinite(position).all(axis=-1))
    quaternion = np.where(fine[..., None], at_epochs(estimates.quaternion), [1.0, 0.0, 0.0, 0.0])
    to_body = np.swapaxes(matrix_from_quaternion(quaternion), -1, -2)
    turn = to_body @ matrix_from_quaternion(at_epochs(truth.quaternion))
    moved = np.einsum("...ij,...j->...i", to_body, true_position - position)
    pose = np.where(fine[..., None], np.concatenate([so3_log(turn), moved], axis=-1), np.nan)
    return Errors(position - true_position, pose)


def consistency_table(
    truth: Trajectories,
    estimates: Estimates,
    covariances: PoseCovariances,
    *,
    by_vehicle: bool = False,
    confidence: float = 0.95,
) -> pd.DataFrame:
    """
    NEES and range innovations of each condition at each epoch, with their chi-square bounds.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.
    covariances : PoseCovariances
        Marginal covariances of the same solves.
    by_vehicle : bool
        If True, one row for each vehicle instead of one for the fleet.
    confidence : float
        Confidence level of the bounds. [-]

    Returns
    -------
    pandas.DataFrame
        Columns ``condition``, ``vehicle`` (with ``by_vehicle``), ``time_h``, ``statistic``,
        ``realizations``, ``degrees_of_freedom`` (dimension times realizations), ``ratio`` (sum over
        the realizations divided by the degrees of freedom, expectation 1), ``low`` and ``high``
        (bounds of the ratio), ``inside`` and ``p_value`` (two-sided). Statistics of the fleet are
        ``horizontal`` and ``position``, with 2 and 3 dimensions per vehicle and the joint
        covariance of all vehicles, and ``ranges``, the innovation of all ranges of the epoch.
        Statistics of a vehicle are ``horizontal``, ``position`` and ``pose`` (6 dimensions).

    Raises
    ------
    EvaluationError
        If the records do not belong together, or a covariance is not positive definite.

    Notes
    -----
    Ranges correlate the vehicles of one epoch, and odometry correlates the epochs of one run. Only
    realizations are independent. Therefore the fleet has one joint statistic for each epoch, and
    epochs are not pooled.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import consistency_table
    >>> table = consistency_table(truth, estimates, covariances)
    >>> table[["condition", "statistic", "ratio", "low", "high", "inside"]].round(2)
       condition   statistic  ratio   low  high  inside
    0   odometry  horizontal   1.46  0.37  1.94    True
    1   odometry    position   1.14  0.46  1.75    True
    2   straight  horizontal   1.08  0.37  1.94    True
    3   straight    position   1.28  0.46  1.75    True
    4   straight      ranges   1.70  0.21  2.41    True
    5  refracted  horizontal   5.49  0.37  1.94   False
    6  refracted    position   4.22  0.46  1.75   False
    7  refracted      ranges  85.27  0.21  2.41   False
    """
    errors = epoch_errors(truth, estimates, covariances)
    statistics = _by_vehicle(errors, covariances) if by_vehicle else _of_fleet(errors, covariances)
    parts = []
    for name, (value, dimension) in statistics.items():
        good = np.isfinite(value) & (dimension > 0)
        freedom = np.sum(np.where(good, dimension, 0), axis=1)
        place = np.nonzero(freedom)  # condition, epoch and, with by_vehicle, vehicle
        k = freedom[place]
        total = np.sum(np.where(good, value, 0.0), axis=1)[place]
        ratio = total / k
        upper = special.chdtrc(k, total)
        low, high = mean_chi_square_bounds(k, confidence)
        columns = {
            "order": place[0],
            "condition": covariances.condition[place[0]],
            **({"vehicle": covariances.name[place[2]]} if by_vehicle else {}),
            "time_h": covariances.time[place[1]] / 3600.0,
            "statistic": name,
            "realizations": good.sum(axis=1)[place],
            "degrees_of_freedom": k,
            "ratio": ratio,
            "low": low,
            "high": high,
            "inside": (low <= ratio) & (ratio <= high),
            "p_value": 2.0 * np.minimum(upper, 1.0 - upper),
        }
        parts.append(pd.DataFrame(columns))
    table = pd.concat(parts).sort_values("order", kind="stable", ignore_index=True)
    return table.drop(columns="order")


def consistency_summary(table: pd.DataFrame) -> pd.DataFrame:
    """
    Verdict on each condition from the rows of all its epochs.

    Parameters
    ----------
    table : pandas.DataFrame
        From `consistency_table`.

    Returns
    -------
    pandas.DataFrame
        Columns ``condition``, ``statistic``, ``tests`` (number of rows), ``inside`` (number of rows
        within their bounds), ``median_ratio``, ``min_ratio``, ``max_ratio``, ``p_bonferroni``
        (smallest p-value times tests, at most 1) and ``consistent`` (True if ``p_bonferroni`` is at
        least 0.05).

    Notes
    -----
    Bonferroni's correction is valid for any dependence between the tests, such as that between
    epochs of one run. Of 20 epochs of a consistent estimator, one is expected outside its bounds.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import consistency_summary, consistency_table
    >>> summary = consistency_summary(consistency_table(truth, estimates, covariances))
    >>> summary[["condition", "statistic", "inside", "consistent"]]
       condition   statistic  inside  consistent
    0   odometry  horizontal       1        True
    1   odometry    position       1        True
    2   straight  horizontal       1        True
    3   straight    position       1        True
    4   straight      ranges       1        True
    5  refracted  horizontal       0       False
    6  refracted    position       0       False
    7  refracted      ranges       0       False
    """
    summary = (
        table.groupby(["condition", "statistic"], sort=False)
        .agg(
            tests=("inside", "size"),
            inside=("inside", "sum"),
            median_ratio=("ratio", "median"),
            min_ratio=("ratio", "min"),
            max_ratio=("ratio", "max"),
            p_bonferroni=("p_value", "min"),
        )
        .reset_index()
    )
    summary["p_bonferroni"] = (summary["p_bonferroni"] * summary["tests"]).clip(upper=1.0)
    return summary.assign(consistent=summary["p_bonferroni"] >= 0.05)


def coverage_table(
    truth: Trajectories,
    estimates: Estimates,
    covariances: PoseCovariances,
    *,
    confidence: float = 0.95,
) -> pd.DataFrame:
    r"""
    Share of position errors within 1 and 3 sigma, for each condition, epoch and axis, with binomial
    bounds.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.
    covariances : PoseCovariances
        Marginal covariances of the same solves.
    confidence : float
        Confidence level of the bounds. [-]

    Returns
    -------
    pandas.DataFrame
        Columns ``condition``, ``time_h``, ``axis``, ``sigmas``, ``n`` (vehicles times
        realizations), ``effective_n``, ``share``, ``expected``, ``low``, ``high`` and ``inside``.

    Raises
    ------
    EvaluationError
        If the records do not belong together.

    Notes
    -----
    Errors of the vehicles at one epoch have the correlations :math:`\rho_{ij}` of their joint
    covariance, so the events :math:`|x_i| < k` are correlated too. If the covariance is correct,
    the share of one realization has the variance :math:`n^{-2} \sum_{ij} [P(|x_i| < k, |x_j| < k) -
    p^2]`. The bounds are those of a binomial distribution with ``effective_n`` draws: the number of
    draws with this variance, rounded down.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import coverage_table
    >>> table = coverage_table(truth, estimates, covariances)
    >>> table[table["condition"] == "straight"][["axis", "sigmas", "share", "inside"]].round(2)
         axis  sigmas  share  inside
    6   north     1.0   1.00    True
    7   north     3.0   1.00    True
    8    east     1.0   0.33    True
    9    east     3.0   1.00    True
    10   down     1.0   0.67    True
    11   down     3.0   1.00    True
    """
    errors = epoch_errors(truth, estimates, covariances)
    c = covariances
    joint = np.einsum("creaibi->creiab", c.position_covariance)
    rows = []
    for i, e, axis in np.ndindex(c.condition.size, c.sample.size, 3):
        block = joint[i, :, e, axis]
        error = errors.position[i, :, e, :, axis]
        good = np.isfinite(block).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
        if not good.any():
            continue
        sigma = np.sqrt(np.diagonal(block[good], axis1=1, axis2=2))
        z = np.abs(error[good]) / sigma
        rho = np.mean(block[good] / (sigma[:, :, None] * sigma[:, None, :]), axis=0)
        for k in _SIGMAS:
            p = float(special.chdtr(1, k * k))
            effect = float(np.sum(_hit_covariance(rho, k)) / (p * (1.0 - p) * len(rho)))
            n = max(int(z.size / effect + 1e-9), 1)
            low, high = (
                np.searchsorted(
                    special.bdtr(np.arange(n + 1), n, p), _tail_probabilities(confidence)
                )
                / n
            )
            share = float(np.mean(z <= k))
            keys = (str(c.condition[i]), float(c.time[e] / 3600.0), _AXES[axis], k, z.size, n)
            rows.append((*keys, share, p, float(low), float(high), bool(low <= share <= high)))
    columns = ["condition", "time_h", "axis", "sigmas", "n", "effective_n"]
    columns += ["share", "expected", "low", "high", "inside"]
    return pd.DataFrame(rows, columns=columns)


def _of_fleet(errors: Errors, c: PoseCovariances) -> dict[str, tuple[Array, AnyArray]]:
    """Statistics of the fleet and their dimensions by condition, realization and epoch."""
    out: dict[str, tuple[Array, AnyArray]] = {}
    for name, axes in (("horizontal", 2), ("position", 3)):
        error = errors.position[..., :axes]
        size = error.shape[-2] * axes
        covariance = c.position_covariance[..., :axes, :, :axes].reshape(
            *error.shape[:-2], size, size
        )
        value = nees(error.reshape(*error.shape[:-2], size), covariance)
        out[name] = value, np.full(value.shape, size)
    out["ranges"] = np.asarray(c.range_nis), np.asarray(c.range_dimension)
    return out


def _by_vehicle(errors: Errors, c: PoseCovariances) -> dict[str, tuple[Array, AnyArray]]:
    """Statistics of vehicles and their dimensions by condition, realization, epoch and vehicle."""
    block = np.einsum("creaiaj->creaij", c.position_covariance)
    statistics = {
        "horizontal": nees(errors.position[..., :2], block[..., :2, :2]),
        "position": nees(errors.position, block),
        "pose": nees(errors.pose, c.pose_covariance),
    }
    dimension = {"horizontal": 2, "position": 3, "pose": 6}
    return {
        name: (value, np.full(value.shape, dimension[name])) for name, value in statistics.items()
    }


def _tail_probabilities(confidence: float) -> tuple[float, float]:
    """Cumulative probabilities at the lower and upper limit of a central interval."""
    return 0.5 - confidence / 2.0, 0.5 + confidence / 2.0


@cache
def _quadrature() -> tuple[Array, Array]:
    """
    Gauss-Legendre nodes and weights, cached because their computation takes longer than their use.
    """
    return np.polynomial.legendre.leggauss(200)


def _hit_covariance(rho: Array, k: float) -> Array:
    """Covariance of the events that two normal variables with a correlation are within k sigma."""
    x, weight = (k * values for values in _quadrature())
    p = special.chdtr(1, k * k)
    r = np.minimum(np.abs(rho), 1.0)[..., None]
    s = np.sqrt(np.maximum(1.0 - r * r, 1e-12))
    within = special.ndtr((k - r * x) / s) - special.ndtr((-k - r * x) / s)
    both = np.sum(weight * np.exp(-(x**2) / 2.0) / np.sqrt(2.0 * np.pi) * within, axis=-1)
    return np.asarray(np.where(r[..., 0] > 1.0 - 1e-12, p, both) - p * p)
