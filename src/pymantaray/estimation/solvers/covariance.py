"""Pose covariances at fixed epochs, from batch solves and from dead reckoning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.geometry.se3 import hat, matrix_from_quaternion
from pymantaray.records import Measurements, PoseCovariances


@dataclass(frozen=True, eq=False)
class EpochCovariances:
    """
    Covariances of one solve, with the fields of `PoseCovariances`.

    Position covariances are joint, in the world's axes; pose covariances are in the tangents of the
    estimates.
    """

    position: Array  # (n_epochs, n_vehicles, 3, n_vehicles, 3) [m2]
    pose: Array  # (n_epochs, n_vehicles, 6, 6) [rad, m]
    range_nis: Array
    range_dimension: Indices

    @classmethod
    def unknown(cls, n_epochs: int, n_vehicles: int) -> EpochCovariances:
        """Covariances of NaN, for a solve without any."""
        return cls(
            np.full((n_epochs, n_vehicles, 3, n_vehicles, 3), np.nan),
            np.full((n_epochs, n_vehicles, 6, 6), np.nan),
            np.full(n_epochs, np.nan),
            np.zeros(n_epochs, dtype=np.intp),
        )


def fixed_epochs(time: Array, interval: float) -> Indices:
    """
    Samples nearest to each multiple of an interval, and the last sample.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        Increasing times since the start. [s]
    interval : float
        Time between epochs. [s]

    Returns
    -------
    ndarray of int, shape (n_epochs,)
        Samples in ascending order.

    Raises
    ------
    EstimationError
        If the interval is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.estimation import fixed_epochs
    >>> fixed_epochs(np.arange(0.0, 4000.0, 600.0), interval=1800.0)
    array([3, 6])
    """
    if not interval > 0.0:
        raise EstimationError(f"interval of epochs is {interval:g} s; it must be positive")
    multiple = np.arange(interval, time[-1] * (1.0 + 1e-12), interval)
    nearest = np.abs(time[None, :] - multiple[:, None]).argmin(axis=1)
    return np.unique([*nearest, time.size - 1])


def dead_reckoning_covariances(
    measurements: Measurements, samples: Indices, trajectory: tuple[Array, Array]
) -> EpochCovariances:
    r"""
    First-order covariances of dead reckoning at samples, from what `dead_reckon` returned; vehicles
    are independent.

    Each step :math:`T_{j-1} D_j` has the error :math:`\exp(q_j)` in the tangent of its second pose.
    At pose k the error is
    :math:`\sum_{j \le k} \mathrm{Ad}(T_k^{-1} T_j) q_j`.
    """
    n_epochs = len(samples)
    position, quaternion = trajectory
    rotation = matrix_from_quaternion(quaternion)
    vehicles = np.arange(measurements.name.size)
    # errors of all steps up to a sample, in the world's axes, relative to each vehicle's first
    # position
    adjoint = np.zeros((*position.shape[:2], 6, 6))
    adjoint[..., :3, :3] = adjoint[..., 3:, 3:] = rotation
    adjoint[..., 3:, :3] = hat(position - position[:, :1]) @ rotation
    adjoint *= np.concatenate(
        [measurements.first_sigma[:, None], measurements.odometry_sigma], axis=1
    )[:, :, None]
    about_start = np.cumsum(adjoint @ np.swapaxes(adjoint, 2, 3), axis=1)[:, samples]
    translation, to_world = np.zeros((2, vehicles.size, n_epochs, 6, 6))
    translation[..., range(6), range(6)] = 1.0
    translation[..., 3:, :3] = -hat(position[:, samples] - position[:, :1])
    world = np.moveaxis(translation @ about_start @ np.swapaxes(translation, 2, 3), 0, 1)
    to_world[..., :3, :3] = to_world[..., 3:, 3:] = rotation[:, samples]
    to_world = np.moveaxis(to_world, 0, 1)
    pose = np.swapaxes(to_world, 2, 3) @ world @ to_world
    joint = np.zeros((n_epochs, vehicles.size, 3, vehicles.size, 3))
    joint[:, vehicles, :, vehicles, :] = np.moveaxis(world[..., 3:, 3:], 1, 0)
    return EpochCovariances(
        joint, pose, np.full(n_epochs, np.nan), np.zeros(n_epochs, dtype=np.intp)
    )


def effective_degrees_of_freedom(covariance: Array) -> float:
    """
    Effective degrees of freedom of a sum of squared errors with a joint covariance: tr(P)^2 /
    tr(P^2).

    It is the number of independent errors of equal variance whose sum of squares has the same mean
    and variance.

    Parameters
    ----------
    covariance : ndarray
        Joint covariance P, of any shape (..., n, ..., n) that is square when flattened, such as
        (n_vehicles, 3, n_vehicles, 3).

    Returns
    -------
    float
        From 1, for errors that are fully correlated, to the number of errors.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.estimation import effective_degrees_of_freedom
    >>> effective_degrees_of_freedom(np.diag([4.0, 4.0, 0.0]))
    2.0
    """
    size = round(np.sqrt(covariance.size))
    matrix = covariance.reshape(size, size)
    return float(np.trace(matrix) ** 2 / np.sum(matrix**2))


def rmse_standard_error(
    rmse: ArrayLike, degrees_of_freedom: ArrayLike, n_realizations: int
) -> Array:
    """
    Standard error of an RMSE over independent realizations: RMSE / sqrt(2 n nu).

    Parameters
    ----------
    rmse : array_like
        Root mean square error. [m]
    degrees_of_freedom : array_like
        Effective degrees of freedom nu of the squared errors of one realization, from
        `effective_degrees_of_freedom`.
    n_realizations : int
        Number n of realizations.

    Returns
    -------
    ndarray
        Standard error, first order in 1/(n nu). [m]

    Examples
    --------
    >>> from pymantaray.estimation import rmse_standard_error
    >>> print(rmse_standard_error(2.0, degrees_of_freedom=50.0, n_realizations=4))
    0.1
    """
    count = 2.0 * n_realizations * np.asarray(degrees_of_freedom, dtype=float)
    return np.asarray(np.asarray(rmse, dtype=float) / np.sqrt(count))


def checked_conditions(solutions: Sequence[Mapping[str, Any]]) -> list[str]:
    """Conditions of all realizations, which must be the same."""
    if not solutions:
        raise EstimationError("no realization to collect; at least one is needed")
    conditions = list(solutions[0])
    odd = next((i for i, s in enumerate(solutions) if list(s) != conditions), None)
    if odd is not None:
        raise EstimationError(
            f"realization {odd} has conditions {list(solutions[odd])}, realization 0 {conditions};"
            " all must have the same conditions"
        )
    return conditions


def collect_covariances(
    measurements: Measurements,
    samples: Indices,
    solutions: Sequence[Mapping[str, EpochCovariances | None]],
) -> PoseCovariances:
    """
    Collect the covariances of all realizations in one record.

    Parameters
    ----------
    measurements : Measurements
        Measurements of any realization, for names and times.
    samples : ndarray of int, shape (n_epochs,)
        Samples of the covariances.
    solutions : sequence of mapping of str to EpochCovariances or None
        One mapping for each realization, by condition; None if a solve was not usable.

    Returns
    -------
    PoseCovariances

    Raises
    ------
    EstimationError
        If there is no realization, or two of them have different conditions.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import collect_covariances, solve_conditions
    >>> samples = np.array([1])
    >>> solutions = solve_conditions(noisy, ["straight"], covariance_samples=samples)
    >>> own = {name: solution.covariances for name, solution in solutions.items()}
    >>> covariances = collect_covariances(noisy, samples, [own])
    >>> print(np.sqrt(np.diagonal(covariances.pose_covariance[0, 0, 0, 0]))[3:].round(2))
    [5.32 7.5  0.01]
    """
    conditions = checked_conditions(solutions)
    nothing = EpochCovariances.unknown(len(samples), measurements.name.size)

    def table(attribute: str) -> NDArray[Any]:
        return np.array(
            [
                [getattr(solution[name] or nothing, attribute) for solution in solutions]
                for name in conditions
            ]
        )

    return PoseCovariances(
        condition=np.array(conditions),
        realization=np.arange(len(solutions)),
        name=measurements.name,
        sample=samples,
        time=measurements.time[samples],
        start=measurements.start,
        position_covariance=table("position"),
        pose_covariance=table("pose"),
        range_nis=table("range_nis"),
        range_dimension=table("range_dimension"),
    )
