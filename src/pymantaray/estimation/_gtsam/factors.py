"""From a solver-free graph to GTSAM factors, values and orderings."""

from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix

Array = NDArray[np.float64]


class FactorBuilder:
    """
    Builds GTSAM graphs, and keeps what successive graphs of one study share.

    Realizations differ in what is measured, rarely in noise levels, structure or starting point; noise
    models, orderings and initial values are therefore kept and used again where their inputs are equal.
    Variable ``i`` of the graph has the GTSAM key ``i``.
    """

    def __init__(self) -> None:
        self._noise: dict[str, tuple[Array, list[Any]]] = {}
        self._ordering: dict[tuple[Any, ...], Any] = {}
        self._values: tuple[GraphValues, Any] | None = None

    def base(self, graph: FactorGraph) -> Any:
        """
        All factors but the ranges.

        Parameters
        ----------
        graph : FactorGraph

        Returns
        -------
        gtsam.NonlinearFactorGraph
        """
        out = gtsam.NonlinearFactorGraph()
        add, between, gps = out.add, gtsam.BetweenFactorPose3, gtsam.GPSFactor
        for key, pose, noise in zip(
            graph.prior_pose.tolist(),
            _poses(graph.prior_quaternion, graph.prior_position),
            self._models("prior", graph.prior_covariance),
            strict=True,
        ):
            add(gtsam.PriorFactorPose3(key, pose, noise))
        for key, fix, noise in zip(
            graph.fix_pose.tolist(),
            graph.fix_position,
            self._models("fix", graph.fix_covariance),
            strict=True,
        ):
            add(gps(key, fix, noise))
        # GPSFactor with zero precision across: a pose prior would live in the body's tangent and, on a
        # turned body, let depth pull sideways
        level = np.zeros((graph.depth.size, 3))
        level[:, 2] = graph.depth
        for key, fix, noise in zip(
            graph.depth_pose.tolist(), level, self._vertical_models(graph.depth_variance), strict=True
        ):
            add(gps(key, fix, noise))
        for key, survey, noise in zip(
            (graph.survey_landmark + graph.n_poses).tolist(),
            graph.survey_position,
            self._models("survey", graph.survey_covariance),
            strict=True,
        ):
            add(gtsam.PriorFactorPoint3(key, survey, noise))
        for first, second, pose, noise in zip(
            graph.edge_from.tolist(),
            graph.edge_to.tolist(),
            _poses(graph.edge_quaternion, graph.edge_translation),
            self._models("edge", graph.edge_covariance),
            strict=True,
        ):
            add(between(first, second, pose, noise))
        return out

    def with_ranges(self, base: Any, graph: FactorGraph) -> Any:
        """
        A graph that shares the factors of ``base`` and has the ranges of ``graph`` besides.

        Parameters
        ----------
        base : gtsam.NonlinearFactorGraph
            Stays as it is.
        graph : FactorGraph

        Returns
        -------
        gtsam.NonlinearFactorGraph
        """
        out = gtsam.NonlinearFactorGraph()
        out.push_back(base)
        n = graph.n_poses
        # pose-pose, pose-landmark and landmark-landmark
        kinds = (gtsam.RangeFactorPose3, gtsam.RangeFactor3D, gtsam.RangeFactor3)
        kind = (graph.range_first >= n).astype(int) + (graph.range_second >= n)
        noise = self._models("range", graph.range_variance[:, None, None])
        for k, first, second, distance, model in zip(
            kind.tolist(),
            graph.range_first.tolist(),
            graph.range_second.tolist(),
            graph.range_distance.tolist(),
            noise,
            strict=True,
        ):
            out.add(kinds[k](first, second, distance, model))
        return out

    def ordering(self, graph: FactorGraph, factors: Any) -> Any:
        """
        COLAMD elimination ordering, computed once for each structure.

        Parameters
        ----------
        graph : FactorGraph
            What ``factors`` was made from.
        factors : gtsam.NonlinearFactorGraph

        Returns
        -------
        gtsam.Ordering
        """
        tables = (graph.edge_from, graph.edge_to, graph.range_first, graph.range_second)
        key = (factors.size(), graph.n_poses, graph.landmark_name.size, *(t.tobytes() for t in tables))
        if key not in self._ordering:
            self._ordering[key] = gtsam.Ordering.ColamdNonlinearFactorGraph(factors)
        return self._ordering[key]

    def values(self, initial: GraphValues) -> Any:
        """
        GTSAM values of a starting point.

        Parameters
        ----------
        initial : GraphValues

        Returns
        -------
        gtsam.Values
            Shared between calls; not to be changed.
        """
        if self._values is not None and _same(self._values[0], initial):
            return self._values[1]
        out = gtsam.Values()
        for key, pose in enumerate(_poses(initial.quaternion, initial.position)):
            out.insert(key, pose)
        for key, point in enumerate(initial.landmark_position, start=initial.position.shape[0]):
            out.insertPoint3(key, point)
        self._values = (initial, out)
        return out

    def _models(self, name: str, covariance: Array) -> list[Any]:
        kept = self._noise.get(name)
        if kept is None or not np.array_equal(kept[0], covariance):
            self._noise[name] = kept = (covariance, _noise_models(covariance))
        return kept[1]

    def _vertical_models(self, variance: Array) -> list[Any]:
        kept = self._noise.get("depth")
        if kept is None or not np.array_equal(kept[0], variance):
            distinct, which = np.unique(variance, return_inverse=True)
            models = [gtsam.noiseModel.Diagonal.Precisions(np.array([0.0, 0.0, 1.0 / v])) for v in distinct]
            self._noise["depth"] = kept = (variance, [models[i] for i in which.tolist()])
        return kept[1]


def with_shared(values: Any, ordering: Any, key: int, dimension: int) -> tuple[Any, Any]:
    """
    Put a vector that all ranges share into values and ordering.

    Parameters
    ----------
    values : gtsam.Values
    ordering : gtsam.Ordering
    key, dimension : int

    Returns
    -------
    values : gtsam.Values
        A copy in which the vector is zero.
    ordering : gtsam.Ordering
        A copy in which it comes last: everything else is eliminated before.
    """
    more = gtsam.Values(values)
    more.insert(key, np.zeros(dimension))
    longer = gtsam.Ordering()
    for i in range(ordering.size()):
        longer.push_back(ordering.at(i))
    longer.push_back(key)
    return more, longer


def to_graph_values(values: Any, initial: GraphValues) -> GraphValues:
    """
    Numbers of GTSAM values, in the order of the graph's variables.

    Parameters
    ----------
    values : gtsam.Values
    initial : GraphValues
        Gives the numbers of poses and landmarks.

    Returns
    -------
    GraphValues
    """
    table = gtsam.utilities.extractPose3(values)
    n_poses, n_landmarks = initial.position.shape[0], initial.landmark_position.shape[0]
    landmarks = [values.atPoint3(n_poses + i) for i in range(n_landmarks)]
    return GraphValues(
        position=table[:, 9:],
        quaternion=quaternion_from_matrix(table[:, :9].reshape(-1, 3, 3)),
        landmark_position=np.array(landmarks).reshape(-1, 3),
    )


def _poses(quaternion: Array, translation: Array) -> list[Any]:
    matrix = np.zeros((translation.shape[0], 4, 4))
    matrix[:, :3, :3] = matrix_from_quaternion(quaternion)
    matrix[:, :3, 3] = translation
    matrix[:, 3, 3] = 1.0
    return [gtsam.Pose3(m) for m in matrix]


def _noise_models(covariance: Array) -> list[Any]:
    """One model for each matrix; equal neighbours in the table share theirs."""
    size = covariance.shape[1]
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    diagonal = (np.count_nonzero(covariance, axis=(1, 2)) <= size).tolist()
    models: dict[bytes, Any] = {}
    out = []
    for i, is_diagonal in enumerate(diagonal):
        key = covariance[i].tobytes()
        model = models.get(key)
        if model is None:
            if is_diagonal:
                model = gtsam.noiseModel.Diagonal.Sigmas(sigma[i])
            else:
                model = gtsam.noiseModel.Gaussian.Covariance(covariance[i])
            models[key] = model
        out.append(model)
    return out


def _same(a: GraphValues, b: GraphValues) -> bool:
    return a is b or (
        np.array_equal(a.position, b.position)
        and np.array_equal(a.quaternion, b.quaternion)
        and np.array_equal(a.landmark_position, b.landmark_position)
    )
