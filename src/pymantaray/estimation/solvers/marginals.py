"""Joint covariances at the optimum, and normalized innovations of ranges."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.solvers.covariance import EpochCovariances
from pymantaray.estimation.solvers.normal_equations import POSITION, ROTATION, SIZE
from pymantaray.estimation.solvers.optimize import LastStep, check_convergence
from pymantaray.estimation.solvers.problems import GraphState, LinearTerm, Problem, distance_problem

# share of the variance of a residual; directions below it have no independent prediction
_MIN_VARIANCE = 1e-8


def check_poses(graph: FactorGraph, poses: Indices) -> Indices:
    """Check that each pose occurs once and has a prior or odometry."""
    used = [
        table.variables.ravel()
        for table in graph.tables.values()
        if set(table.kind.ends) == {"pose"}
    ]
    if np.unique(poses).size != poses.size or not np.isin(poses, np.concatenate(used)).all():
        raise EstimationError(
            "covariances: each pose must have a prior or odometry, and must be given once"
        )
    return poses.astype(np.intp)


def covariances_at(
    graph: FactorGraph, values: GraphValues, poses: Indices, *, innovations: bool = True
) -> EpochCovariances:
    """
    Covariances of poses in a graph whose ranges are distances, linearized at the given values.

    Parameters
    ----------
    graph : FactorGraph
        Graph.
    values : GraphValues
        Values for the linearization.
    poses : ndarray of int, shape (n_epochs, n_vehicles)
        Each pose needs a prior or odometry.
    innovations : bool
        Compute the innovations of the ranges, too; else they are NaN. With many ranges per epoch
        they take most of the time.

    Returns
    -------
    EpochCovariances
        Joint within each epoch.

    Raises
    ------
    EstimationError
        If some direction is undetermined at the values.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import covariances_at
    >>> covariances = covariances_at(graph, start, np.array([[1, 3]]))
    >>> print(np.sqrt(np.diagonal(covariances.pose[0, 0]))[3:].round(2))
    [5.32 7.5  0.01]
    """
    poses = check_poses(graph, poses)
    groups = epoch_groups(
        poses, graph["range"].variables, graph.n_poses, np.empty(0, dtype=np.intp)
    )
    problem = distance_problem(graph, groups=groups)
    last = check_convergence(problem, GraphState.of(values)).last
    if last is None:
        raise EstimationError(
            "covariances: some direction of the graph is not determined at these values"
        )
    return group_marginals(problem, last, poses, groups, innovations=innovations)


class PoseCovariance:
    """Joint covariance of all poses of a graph, linearized at the given values, as an operator."""

    def __init__(self, graph: FactorGraph, values: GraphValues) -> None:
        problem = distance_problem(graph)
        self._row = problem.structure.row
        self._n_poses = graph.n_poses
        state = GraphState.of(values)
        self._rotation = state.rotation[: self._n_poses]
        self._last = check_convergence(problem, state).last

    def positions(self, vectors: Array) -> Array:
        """
        Products of the positions' part with vectors in the world's axes, (count, n_poses, 3). [m2]

        NaN if some direction is not determined.
        """
        return self._product(vectors, POSITION)

    def rotations(self, vectors: Array) -> Array:
        """
        Products of the rotations' part with vectors in the world's axes, (count, n_poses, 3); NaN
        as for positions. [rad2]
        """
        # the solver's rotations are about the body's axes
        body = np.einsum("pji,kpj->kpi", self._rotation, vectors)
        world: Array = np.einsum("pij,kpj->kpi", self._rotation, self._product(body, ROTATION))
        return world

    def _product(self, vectors: Array, part: slice) -> Array:
        if self._last is None:
            return np.full(vectors.shape, np.nan)
        z = np.zeros((self._row.size, SIZE, len(vectors)))
        rows = self._row[: self._n_poses]
        z[rows, part] = np.ascontiguousarray(np.moveaxis(vectors, 0, 2))
        solution = self._last.factor.solve(z, overwrite=True)[rows, part]
        return np.ascontiguousarray(np.moveaxis(solution, 2, 0))


def epoch_groups(
    poses: Indices, pairs: NDArray[Any], n_poses: int, shared: Indices
) -> list[Indices]:
    """
    Variables to connect for each epoch: its poses, the landmarks that these range to, and shared
    unknowns.
    """
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    return [
        np.concatenate([epoch, np.unique(ends[ends >= n_poses]), shared])
        for epoch in poses
        for ends in [pairs[np.isin(pairs[:, 0], epoch), 1]]
    ]


def group_marginals(
    problem: Problem,
    last: LastStep,
    poses: Indices,
    groups: list[Indices],
    *,
    innovations: bool = True,
) -> EpochCovariances:
    r"""
    Covariances of poses, shape (n_epochs, n_vehicles), joint within each epoch, from the factor of
    the last step.

    With whitened residuals :math:`b` of the ranges of a group at the optimum, their Jacobian
    :math:`A` and the covariance :math:`P`, residuals have the covariance :math:`S = I - A P
    A^\top`, and
    :math:`b^\top S^{-1} b` is the squared innovation :math:`\nu^\top (I + A P_- A^\top)^{-1} \nu`
    of the same ranges predicted from everything else, past and future: :math:`P^{-1} = P_-^{-1} +
    A^\top A` gives
    :math:`S = (I + A P_- A^\top)^{-1}` and :math:`b = S \nu`. Under a loss there are none.
    """
    n_epochs, members = poses.shape
    inverse = last.factor.inverse(groups)
    joint = np.stack([matrix[: SIZE * members, : SIZE * members] for matrix in inverse])
    joint = joint.reshape(n_epochs, members, SIZE, members, SIZE)
    vehicles = np.arange(members)
    own = np.moveaxis(joint[:, vehicles, :, vehicles, :], 0, 1)
    rotation = np.tile(np.eye(SIZE), (n_epochs, members, 1, 1))
    # from the world's axes to the body's
    rotation[..., POSITION, POSITION] = last.state.rotation[poses]
    fits = [(np.nan, 0)] * n_epochs
    if innovations and problem.loss is None:
        among = problem.ranges.linear_among(last.state, np.unique(np.concatenate(groups)))
        terms = _by_group(among, poses, problem.factors.n_poses)
        step = last.step[problem.structure.row]
        fits = [_innovation(*each, step) for each in zip(terms, inverse, groups, strict=True)]
    return EpochCovariances(
        position=joint[:, :, POSITION, :, POSITION],
        pose=np.swapaxes(rotation, -1, -2) @ own @ rotation,
        range_nis=np.array([nis for nis, _ in fits]),
        range_dimension=np.array([dimension for _, dimension in fits], dtype=np.intp),
    )


def _by_group(terms: list[LinearTerm], poses: Indices, n_poses: int) -> list[list[LinearTerm]]:
    """Terms of ranges between the poses of each group, or from these to landmarks."""
    out: list[list[LinearTerm]] = [[] for _ in poses]
    group = {pose: g for g, members in enumerate(poses.tolist()) for pose in members}
    for term in terms:
        ends = {group.get(v, -1) for v in term.variables.tolist() if v < n_poses}
        if len(ends) == 1 and (g := ends.pop()) >= 0:
            out[g].append(term)
    return out


def _innovation(
    terms: list[LinearTerm], covariance: Array, group: Indices, step: Array
) -> tuple[float, int]:
    """Squared innovation of the ranges of a group and its dimension."""
    if not terms:
        return np.nan, 0
    position = {variable: SIZE * i for i, variable in enumerate(group.tolist())}
    residual = np.concatenate([term.residual for term in terms])
    jacobian = np.zeros((residual.size, covariance.shape[0]))
    top = 0
    for term in terms:
        below = top + term.residual.size
        for i, variable in enumerate(term.variables.tolist()):
            left = position[variable]
            jacobian[top:below, left : left + SIZE] = term.jacobian[:, SIZE * i : SIZE * (i + 1)]
        top = below
    values, vectors = np.linalg.eigh(np.eye(residual.size) - jacobian @ covariance @ jacobian.T)
    usable = values > _MIN_VARIANCE
    if not usable.any():
        return np.nan, 0
    along = (residual + jacobian @ step[group].ravel()) @ vectors[:, usable]
    return float(np.sum(along**2 / values[usable])), int(usable.sum())
