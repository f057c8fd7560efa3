"""
From a solver-free graph to GTSAM factors, values and orderings.

A kind of factor of `graph.KINDS` has its constructor in `_MAKERS`, which gives the factors of a table one by
one; and, where its noise is not that of its covariance as it stands, its noise model in `_NOISE`.
"""

from collections.abc import Callable, Iterator
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.graph import KINDS, FactorGraph, Factors, GraphValues
from pymantaray.estimation.losses import Loss
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix

Array = NDArray[np.float64]


class FactorBuilder:
    """
    Builds GTSAM graphs, and keeps noise models, orderings and values, to use them again where their inputs are equal.

    Variable ``i`` of the graph has the GTSAM key ``i``.
    """

    def __init__(self) -> None:
        self._noise: dict[str, tuple[Array, list[Any]]] = {}
        self._ordering: dict[tuple[Any, ...], Any] = {}
        self._values: tuple[GraphValues, Any] | None = None
        self._common: tuple[dict[str, Factors], Any] | None = None

    def common(self, graph: FactorGraph) -> Any:
        """All factors but the ranges; the same object, not to be changed, while those are the same tables."""
        tables = {name: graph[name] for name in KINDS if name != "range"}
        if self._common is None or any(
            factors is not self._common[0][name] and len(factors) + len(self._common[0][name])
            for name, factors in tables.items()
        ):
            out = gtsam.NonlinearFactorGraph()
            for name, factors in tables.items():
                self._add(out, name, factors, graph.n_poses)
            self._common = tables, out
        return self._common[1]

    def factors(self, graph: FactorGraph, loss: Loss | None = None) -> Any:
        """All factors, the ranges last and under a loss."""
        out = gtsam.NonlinearFactorGraph()
        out.push_back(self.common(graph))
        self._add(out, "range", graph["range"], graph.n_poses, loss)
        return out

    def ordering(self, graph: FactorGraph) -> Any:
        """COLAMD elimination ordering, computed once for each structure."""
        pairs = [graph[name].variables for name, kind in KINDS.items() if len(kind.ends) == 2]
        size = sum(len(graph[name]) for name in KINDS)
        key = (size, graph.n_poses, graph.n_variables, *(p.tobytes() for p in pairs))
        if key not in self._ordering:
            self._ordering[key] = gtsam.Ordering.ColamdNonlinearFactorGraph(self.factors(graph))
        return self._ordering[key]

    def values(self, initial: GraphValues) -> Any:
        """GTSAM values of a starting point; shared between calls, not to be changed."""
        if self._values is not None and _same(self._values[0], initial):
            return self._values[1]
        out = gtsam.Values()
        for key, pose in enumerate(poses_of(initial.quaternion, initial.position)):
            out.insert(key, pose)
        for key, point in enumerate(initial.landmark_position, start=initial.position.shape[0]):
            out.insertPoint3(key, point)
        self._values = (initial, out)
        return out

    def _add(self, out: Any, name: str, factors: Factors, n_poses: int, loss: Loss | None = None) -> None:
        if not len(factors):
            return
        noise = self._models(name, factors.covariance)
        if loss is not None:
            robust = _m_estimator(loss)
            under = {id(model): gtsam.noiseModel.Robust.Create(robust, model) for model in noise}
            noise = [under[id(model)] for model in noise]
        for factor in _MAKERS[name](factors, noise, n_poses):
            out.add(factor)

    def _models(self, name: str, covariance: Array) -> list[Any]:
        """One model for each matrix; equal ones share theirs."""
        last = self._noise.get(name)
        if last is None or not np.array_equal(last[0], covariance):
            make = _NOISE.get(name, _gaussian)
            models: dict[bytes, Any] = {}
            out = []
            for matrix in covariance:
                key = matrix.tobytes()
                if key not in models:
                    models[key] = make(matrix)
                out.append(models[key])
            self._noise[name] = last = (covariance, out)
        return last[1]


def _priors(factors: Factors, noise: list[Any], _n_poses: int) -> Iterator[Any]:
    poses = poses_of(factors.column("quaternion"), factors.column("position"))
    for key, pose, model in zip(factors.subject.tolist(), poses, noise, strict=True):
        yield gtsam.PriorFactorPose3(key, pose, model)


def _places(make: Any) -> Callable[[Factors, list[Any], int], Iterator[Any]]:
    """Constructor of the factors of a kind that measures the position of one variable."""

    def places(factors: Factors, noise: list[Any], _n_poses: int) -> Iterator[Any]:
        for row in zip(factors.subject.tolist(), factors.column("position"), noise, strict=True):
            yield make(*row)

    return places


def _depths(factors: Factors, noise: list[Any], _n_poses: int) -> Iterator[Any]:
    """
    Fixes with zero precision across.

    A pose prior would live in the body's tangent and, on a turned body, let depth pull sideways.
    """
    level = np.zeros((len(factors), 3))
    level[:, 2] = factors.column("depth")
    for key, place, model in zip(factors.subject.tolist(), level, noise, strict=True):
        yield gtsam.GPSFactor(key, place, model)


def _attitudes(factors: Factors, noise: list[Any], _n_poses: int) -> Iterator[Any]:
    rotations = matrix_from_quaternion(factors.column("quaternion"))
    for key, rotation, model in zip(factors.subject.tolist(), rotations, noise, strict=True):
        yield gtsam.PoseRotationPrior3D(key, gtsam.Rot3(rotation), model)


def _edges(factors: Factors, noise: list[Any], _n_poses: int) -> Iterator[Any]:
    steps = poses_of(factors.column("quaternion"), factors.column("position"))
    for (first, second), step, model in zip(factors.variables.tolist(), steps, noise, strict=True):
        yield gtsam.BetweenFactorPose3(first, second, step, model)


def _ranges(factors: Factors, noise: list[Any], n_poses: int) -> Iterator[Any]:
    # pose-pose, pose-landmark and landmark-landmark
    kinds = (gtsam.RangeFactorPose3, gtsam.RangeFactor3D, gtsam.RangeFactor3)
    kind = (factors.variables >= n_poses).sum(axis=1)
    for k, (first, second), distance, model in zip(
        kind.tolist(), factors.variables.tolist(), factors.column("distance").tolist(), noise, strict=True
    ):
        yield kinds[k](first, second, distance, model)


def _gaussian(covariance: Array) -> Any:
    if np.count_nonzero(covariance) <= len(covariance):
        return gtsam.noiseModel.Diagonal.Sigmas(np.sqrt(np.diagonal(covariance)))
    return gtsam.noiseModel.Gaussian.Covariance(covariance)


def _vertical(covariance: Array) -> Any:
    return gtsam.noiseModel.Diagonal.Precisions(np.array([0.0, 0.0, 1.0 / covariance[0, 0]]))


_MAKERS: dict[str, Callable[[Factors, list[Any], int], Iterator[Any]]] = {
    "prior": _priors,
    "fix": _places(gtsam.GPSFactor),
    "depth": _depths,
    "survey": _places(gtsam.PriorFactorPoint3),
    "edge": _edges,
    "attitude": _attitudes,
    "range": _ranges,
}
_NOISE: dict[str, Callable[[Array], Any]] = {"depth": _vertical}


def _m_estimator(loss: Loss) -> Any:
    kinds = gtsam.noiseModel.mEstimator
    kind: Any = {"huber": kinds.Huber, "cauchy": kinds.Cauchy, "geman-mcclure": kinds.GemanMcClure}[loss.kind]
    return kind.Create(loss.scale)


def with_shared(values: Any, ordering: Any, key: int, dimension: int) -> tuple[Any, Any]:
    """Copies of values and ordering with a vector that all ranges share: zero, and eliminated last."""
    more = gtsam.Values(values)
    more.insert(key, np.zeros(dimension))
    longer = gtsam.Ordering()
    for i in range(ordering.size()):
        longer.push_back(ordering.at(i))
    longer.push_back(key)
    return more, longer


def to_graph_values(values: Any, graph: FactorGraph) -> GraphValues:
    """Numbers of GTSAM values, in the order of the graph's variables."""
    table = gtsam.utilities.extractPose3(values)
    landmarks = [values.atPoint3(key) for key in range(graph.n_poses, graph.n_variables)]
    return GraphValues(
        position=table[:, 9:],
        quaternion=quaternion_from_matrix(table[:, :9].reshape(-1, 3, 3)),
        landmark_position=np.array(landmarks).reshape(-1, 3),
    )


def poses_of(quaternion: Array, translation: Array) -> list[Any]:
    """GTSAM's poses, one for each row."""
    matrix = np.zeros((translation.shape[0], 4, 4))
    matrix[:, :3, :3] = matrix_from_quaternion(quaternion)
    matrix[:, :3, 3] = translation
    matrix[:, 3, 3] = 1.0
    return [gtsam.Pose3(m) for m in matrix]


def _same(a: GraphValues, b: GraphValues) -> bool:
    names = "position", "quaternion", "landmark_position"
    return a is b or all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)
