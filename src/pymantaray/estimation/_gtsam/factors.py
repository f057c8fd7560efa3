"""
Convert graphs to GTSAM factors and values, for incremental solves.

`_maker` chooses a generator of GTSAM factors by `Residual`, ends and columns; a new kind with one
of these residuals needs no change here.
"""

from collections.abc import Callable, Iterator
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


def graph_factors(graph: FactorGraph, loss: Loss | None = None) -> Any:
    """
    Convert all factors, ranges last and under a loss; variable ``i`` of the graph has the key
    ``i``.
    """
    out = gtsam.NonlinearFactorGraph()
    for factor in _in_plane(graph) if graph.planar else ():
        out.add(factor)
    for factors in graph.of_residual(*(r for r in Residual if r is not Residual.DISTANCE)):
        make = _maker(factors.kind)
        noise = _models(_noise_of(factors.kind), factors.covariance)
        for factor in make(factors, noise):
            out.add(factor)
    for factors in graph.of_residual(Residual.DISTANCE):
        noise = _models(_gaussian, factors.covariance)
        if loss is not None:
            robust = _m_estimator(loss)
            noise = [gtsam.noiseModel.Robust.Create(robust, model) for model in noise]
        for factor in _ranges(factors, noise, graph.n_poses):
            out.add(factor)
    return out


def _maker(kind: FactorKind) -> Callable[[Factors, list[Any]], Iterator[Any]]:
    """Generator of the factors of a kind other than ranges."""
    if kind.residual is Residual.SIGHTING:
        return _sightings
    if kind.residual is Residual.POSITION:
        return _depths if kind.is_depth else _positions
    if len(kind.ends) == 2:
        return _edges
    return _priors if "position" in kind.columns_at else _attitudes


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


def _priors(factors: Factors, noise: list[Any]) -> Iterator[Any]:
    poses = poses_of(factors.column("quaternion"), factors.column("position"))
    for key, pose, model in zip(factors.subject.tolist(), poses, noise, strict=True):
        yield gtsam.PriorFactorPose3(key, pose, model)


def _positions(factors: Factors, noise: list[Any]) -> Iterator[Any]:
    make = gtsam.GPSFactor if factors.kind.ends == ("pose",) else gtsam.PriorFactorPoint3
    for row in zip(factors.subject.tolist(), factors.column("position"), noise, strict=True):
        yield make(*row)


def _depths(factors: Factors, noise: list[Any]) -> Iterator[Any]:
    """
    Position fixes with zero horizontal precision.

    A pose prior is in the body's tangent, so on a tilted body depth would pull sideways.
    """
    level = np.zeros((len(factors), 3))
    level[:, 2] = factors.column("depth")
    for key, position, model in zip(factors.subject.tolist(), level, noise, strict=True):
        yield gtsam.GPSFactor(key, position, model)


def _attitudes(factors: Factors, noise: list[Any]) -> Iterator[Any]:
    rotations = matrix_from_quaternion(factors.column("quaternion"))
    for key, rotation, model in zip(factors.subject.tolist(), rotations, noise, strict=True):
        yield gtsam.PoseRotationPrior3D(key, gtsam.Rot3(rotation), model)


def _edges(factors: Factors, noise: list[Any]) -> Iterator[Any]:
    steps = poses_of(factors.column("quaternion"), factors.column("position"))
    for (first, second), step, model in zip(factors.variables.tolist(), steps, noise, strict=True):
        yield gtsam.BetweenFactorPose3(first, second, step, model)


def _sightings(factors: Factors, noise: list[Any]) -> Iterator[Any]:
    """
    Factors in Python, because GTSAM 4.3 does not wrap its own; the second variable is a landmark or
    a pose.
    """
    error = _stride_error if factors.kind.ends == ("pose", "pose") else _sighting_error
    for ends, position, model in zip(
        factors.variables.tolist(), factors.column("position"), noise, strict=True
    ):
        yield gtsam.CustomFactor(model, ends, partial(error, position))


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


def _ranges(factors: Factors, noise: list[Any], n_poses: int) -> Iterator[Any]:
    # pose-pose, pose-landmark and landmark-landmark
    kinds = (gtsam.RangeFactorPose3, gtsam.RangeFactor3D, gtsam.RangeFactor3)
    kind = (factors.variables >= n_poses).sum(axis=1)
    for k, (first, second), distance, model in zip(
        kind.tolist(),
        factors.variables.tolist(),
        factors.column("distance").tolist(),
        noise,
        strict=True,
    ):
        yield kinds[k](first, second, distance, model)


def _gaussian(covariance: Array) -> Any:
    if np.count_nonzero(covariance) <= len(covariance):
        return gtsam.noiseModel.Diagonal.Sigmas(np.sqrt(np.diagonal(covariance)))
    return gtsam.noiseModel.Gaussian.Covariance(covariance)


def _vertical(covariance: Array) -> Any:
    return gtsam.noiseModel.Diagonal.Precisions(np.array([0.0, 0.0, 1.0 / covariance[0, 0]]))


def _m_estimator(loss: Loss) -> Any:
    kinds = gtsam.noiseModel.mEstimator
    kind: Any = {
        "huber": kinds.Huber,
        "cauchy": kinds.Cauchy,
        "geman-mcclure": kinds.GemanMcClure,
        "tukey": kinds.Tukey,
        "welsch": kinds.Welsch,
    }[loss.kind]
    return kind.Create(loss.scale)


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
