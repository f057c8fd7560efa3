"""
Convert graphs to GTSAM factors and values, and solve them by its batch optimizer.

`_maker` chooses GTSAM's factor by `Residual`, ends and columns; a new kind with one of these
residuals needs no change here.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import gtsam
import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.graph.graph import (
    FactorGraph,
    FactorKind,
    Factors,
    GraphValues,
    Residual,
)
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix

_M_ESTIMATORS = {
    "huber": "Huber",
    "cauchy": "Cauchy",
    "geman-mcclure": "GemanMcClure",
    "tukey": "Tukey",
    "welsch": "Welsch",
}


def graph_factors(graph: FactorGraph, loss: Loss | None = None) -> Any:
    """
    Convert all factors, ranges last and under a loss; variable ``i`` of the graph has the key
    ``i``.
    """
    out = gtsam.NonlinearFactorGraph()
    for factor in _in_plane(graph) if graph.planar else ():
        out.add(factor)
    for factors in graph.of_residual(*(r for r in Residual if r is not Residual.DISTANCE)):
        make, measured = _maker(factors)
        noise = _models(_noise_of(factors.kind), factors.covariance)
        for ends, value, model in zip(factors.variables.tolist(), measured, noise, strict=True):
            out.add(make(*ends, value, model))
    for factors in graph.of_residual(Residual.DISTANCE):
        noise = _models(_gaussian, factors.covariance)
        if loss is not None:
            kind = getattr(gtsam.noiseModel.mEstimator, _M_ESTIMATORS[loss.kind])
            robust = kind.Create(loss.scale)
            noise = [gtsam.noiseModel.Robust.Create(robust, model) for model in noise]
        # pose-pose, pose-landmark and landmark-landmark
        kinds = (gtsam.RangeFactorPose3, gtsam.RangeFactor3D, gtsam.RangeFactor3)
        number = (factors.variables >= graph.n_poses).sum(axis=1).tolist()
        distance = factors.column("distance").tolist()
        for k, ends, *rest in zip(number, factors.variables.tolist(), distance, noise, strict=True):
            out.add(kinds[k](*ends, *rest))
    return out


def _maker(factors: Factors) -> tuple[Callable[..., Any], Iterable[Any]]:
    """
    GTSAM's factor, of the ends, a measured value and a noise model, and the values of factors other
    than ranges.
    """
    kind = factors.kind
    if kind.residual is Residual.SIGHTING:
        # in Python, because GTSAM 4.3 does not wrap its own
        error = _stride_error if kind.ends == ("pose", "pose") else _sighting_error
        return partial(_sighting, error), factors.column("position")
    if kind.is_depth:
        # position fixes with zero horizontal precision; a pose prior is in the body's tangent, so
        # on a tilted body depth would pull sideways
        level = np.zeros((len(factors), 3))
        level[:, 2] = factors.column("depth")
        return gtsam.GPSFactor, level
    if kind.residual is Residual.POSITION:
        make: Any = gtsam.GPSFactor if kind.ends == ("pose",) else gtsam.PriorFactorPoint3
        return make, factors.column("position")
    quaternion = factors.column("quaternion")
    if "position" not in kind.columns_at:
        return gtsam.PoseRotationPrior3D, map(gtsam.Rot3, matrix_from_quaternion(quaternion))
    make = gtsam.BetweenFactorPose3 if len(kind.ends) == 2 else gtsam.PriorFactorPose3
    return make, poses_of(quaternion, factors.column("position"))


def _noise_of(kind: FactorKind) -> Callable[[Array], Any]:
    """Noise model of a covariance; rows that the kind does not measure have no precision."""
    if kind.is_depth:
        return _vertical
    if not kind.is_partial:
        return _gaussian
    at = np.ix_(kind.measured, kind.measured)

    def partial_noise(covariance: Array) -> Any:
        root = np.zeros((len(kind.column_rows),) * 2)
        # upper triangular: GTSAM takes a lower triangular root for a diagonal one
        root[at] = np.linalg.cholesky(np.linalg.inv(covariance)).T
        return gtsam.noiseModel.Gaussian.SqrtInformation(root)

    return partial_noise


def values_of(initial: GraphValues) -> Any:
    """Convert starting values."""
    out = gtsam.Values()
    for key, pose in enumerate(poses_of(initial.quaternion, initial.position)):
        out.insert(key, pose)
    for key, point in enumerate(initial.landmark_position, start=initial.position.shape[0]):
        out.insertPoint3(key, point)
    return out


def _models(make: Callable[[Array], Any], covariance: Array) -> list[Any]:
    """One noise model for each matrix; equal matrices share one."""
    models: dict[bytes, Any] = {}
    out = []
    for matrix in covariance:
        key = matrix.tobytes()
        if key not in models:
            models[key] = make(matrix)
        out.append(models[key])
    return out


def _sighting(
    error: Callable[..., Array], first: int, second: int, position: Array, model: Any
) -> Any:
    """Factor of a sighting of a landmark or a pose from a pose."""
    return gtsam.CustomFactor(model, [first, second], partial(error, position))


def _sighting_error(
    measured: Array, factor: Any, values: Any, jacobians: list[Array] | None
) -> Array:
    pose, landmark = factor.keys()
    at = values.atPose3(pose)
    rotation = at.rotation().matrix().T
    seen = rotation @ (values.atPoint3(landmark) - at.translation())
    if jacobians is not None:
        jacobians[0] = np.hstack([gtsam.Rot3.Hat(seen), -np.eye(3)])
        jacobians[1] = rotation
    return np.asarray(seen - measured)


def _stride_error(
    measured: Array, factor: Any, values: Any, jacobians: list[Array] | None
) -> Array:
    """
    Error of the position of one pose in the body frame of another; the other pose moves in its own
    body frame.
    """
    at, to = (values.atPose3(key) for key in factor.keys())  # noqa: SIM118  a method of GTSAM
    rotation = at.rotation().matrix().T
    seen = rotation @ (to.translation() - at.translation())
    if jacobians is not None:
        jacobians[0] = np.hstack([gtsam.Rot3.Hat(seen), -np.eye(3)])
        jacobians[1] = np.hstack([np.zeros((3, 3)), rotation @ to.rotation().matrix()])
    return np.asarray(seen - measured)


def _in_plane(graph: FactorGraph) -> Iterator[Any]:
    """Priors that hold a planar graph in its plane, without effect on the solution."""
    upright = gtsam.noiseModel.Diagonal.Precisions(np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
    for key in range(graph.n_poses):
        yield gtsam.PriorFactorPose3(key, gtsam.Pose3(), upright)
    for key in range(graph.n_poses, graph.n_variables):
        yield gtsam.PriorFactorPoint3(key, np.zeros(3), _vertical(np.eye(1)))


def _gaussian(covariance: Array) -> Any:
    if np.count_nonzero(covariance) <= len(covariance):
        return gtsam.noiseModel.Diagonal.Sigmas(np.sqrt(np.diagonal(covariance)))
    return gtsam.noiseModel.Gaussian.Covariance(covariance)


def _vertical(covariance: Array) -> Any:
    return gtsam.noiseModel.Diagonal.Precisions(np.array([0.0, 0.0, 1.0 / covariance[0, 0]]))


def graph_values(values: Any, graph: FactorGraph) -> GraphValues:
    """Convert GTSAM values to arrays in the order of the graph's variables."""
    table = gtsam.utilities.extractPose3(values)
    landmarks = [values.atPoint3(key) for key in range(graph.n_poses, graph.n_variables)]
    return GraphValues(
        position=table[:, 9:],
        quaternion=quaternion_from_matrix(table[:, :9].reshape(-1, 3, 3)),
        landmark_position=np.array(landmarks).reshape(-1, 3),
    )


def poses_of(quaternion: Array, translation: Array) -> list[Any]:
    """GTSAM poses, one for each row."""
    matrix = np.zeros((translation.shape[0], 4, 4))
    matrix[:, :3, :3] = matrix_from_quaternion(quaternion)
    matrix[:, :3, 3] = translation
    matrix[:, 3, 3] = 1.0
    return [gtsam.Pose3(m) for m in matrix]


def optimize(factors: Any, start: Any, *, converged: bool) -> tuple[Any, int]:
    """
    Minimize a graph's cost; return the values and the number of iterations.

    With the default parameters GTSAM stops once the cost falls by less than 1e-5 of itself.
    ``converged`` continues until no damping lowers the cost.
    """
    parameters = gtsam.LevenbergMarquardtParams()
    if converged:
        parameters.setRelativeErrorTol(0.0)
        parameters.setAbsoluteErrorTol(0.0)
    optimizer = gtsam.LevenbergMarquardtOptimizer(factors, start, parameters)
    return optimizer.optimize(), optimizer.iterations()
