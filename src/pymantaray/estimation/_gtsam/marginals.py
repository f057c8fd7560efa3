"""Joint covariances at the optimum, how ranges fit them, and where a graph is weak or strained."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from pymantaray.estimation._gtsam.factors import FactorBuilder
from pymantaray.estimation._gtsam.optimize import SMALLEST_PIVOT
from pymantaray.estimation.covariance import EpochCovariances
from pymantaray.estimation.graph import FactorGraph, GraphValues

Array = NDArray[np.float64]

_DAMPING = 1e-15  # of the scaled information matrix, whose diagonal is 1: a singular one stays solvable
_STEPS = 6  # of inverse iteration; each takes away what is not the weakest by the ratio of the eigenvalues
_EXPLAINED = 1e-8  # a direction whose residual keeps less of its variance is not predicted by anything else


def group_marginals(
    factors: Any, values: Any, groups: NDArray[np.intp], n_poses: int, first_range: int | None = None
) -> EpochCovariances:
    r"""
    Covariances of groups of poses, shape (n_epochs, n_agents), at an optimum, joint within each group.

    One partial elimination takes out all variables but those asked for and landmarks that they are ranged with:
    half the time of GTSAM's own ``Marginals``, and the same blocks.

    With whitened residuals :math:`b` of the ranges of a group at the optimum, their Jacobian :math:`A` and the
    covariance :math:`P`, residuals have the covariance :math:`S = I - A P A^\top`, and
    :math:`b^\top S^{-1} b` is the squared innovation :math:`\nu^\top (I + A P_- A^\top)^{-1} \nu` of the same ranges
    predicted from everything else, past and future: :math:`P^{-1} = P_-^{-1} + A^\top A` gives
    :math:`S = (I + A P_- A^\top)^{-1}` and :math:`b = S \nu`.
    """
    linear = factors.linearize(values)
    chosen = groups.ravel().tolist()
    blocks = _range_blocks(linear, groups, n_poses, first_range)
    more = sorted({key for rows in blocks for keys, _, _ in rows for key in keys if key >= n_poses})
    left = _eliminated(linear, [*chosen, *more])
    covariance = None if left is None else _inverse(left[0])
    if left is None or covariance is None:
        return EpochCovariances.unknown(*groups.shape)
    step = covariance @ left[1]  # to the optimum of the linear system: none but what the solver left
    n_groups, members = groups.shape
    size = 6 * members
    shared = getattr(factors, "shared", None)
    diagonal = np.stack(
        [covariance[size * g : size * (g + 1), size * g : size * (g + 1)] for g in range(n_groups)]
    )
    width = [6] * len(chosen) + [3] * len(more)
    if shared is not None and shared in more:
        width[-1] += len(covariance) - sum(width)  # the largest key
    edge = np.concatenate([[0], np.cumsum(width)]).tolist()
    place = {key: slice(edge[i], edge[i + 1]) for i, key in enumerate([*chosen, *more])}
    fits = [_innovation(rows, covariance, step, place) for rows in blocks]
    joint = diagonal.reshape(n_groups, members, 6, members, 6)
    turn = np.array([values.atPose3(key).rotation().matrix() for key in chosen]).reshape(*groups.shape, 3, 3)
    agents = np.arange(members)
    return EpochCovariances(
        position=np.einsum("eaij,eajbk,eblk->eaibl", turn, joint[:, :, 3:, :, 3:], turn),
        pose=np.moveaxis(joint[:, agents, :, agents, :], 0, 1),
        range_nis=np.array([nis for nis, _ in fits]),
        range_dimension=np.array([dimension for _, dimension in fits], dtype=np.intp),
    )


def vector_marginal(factors: Any, values: Any, key: int) -> Array:
    """Covariance of one vector at an optimum; NaN if the system is singular."""
    left = _eliminated(factors.linearize(values), [key])
    covariance = None if left is None else _inverse(left[0])
    n = values.atVector(key).size
    return np.full((n, n), np.nan) if covariance is None else covariance


def _range_blocks(
    linear: Any, groups: NDArray[np.intp], n_poses: int, first_range: int | None
) -> list[list[tuple[list[int], Array, Array]]]:
    """Keys, whitened Jacobian and right-hand side of the range factors of each group."""
    blocks: list[list[tuple[list[int], Array, Array]]] = [[] for _ in groups]
    if first_range is None:
        return blocks
    group = {key: g for g, keys in enumerate(groups.tolist()) for key in keys}
    for i in range(first_range, linear.size()):
        factor = linear.at(i)
        keys = [int(key) for key in factor.keys()]  # noqa: SIM118 (no mapping)
        ends = {group.get(key, -1) for key in keys if key < n_poses}
        if len(ends) == 1 and (g := ends.pop()) >= 0:
            blocks[g].append((keys, *factor.jacobian()))
    return blocks


def _eliminated(linear: Any, keep: Sequence[int]) -> tuple[Array, Array] | None:
    """Information matrix and vector of some variables when all others are eliminated; None if one of those is free."""
    ordering = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(linear, list(keep))
    first, last = gtsam.Ordering(), gtsam.Ordering()
    for i in range(ordering.size() - len(keep)):
        first.push_back(ordering.at(i))
    for key in keep:
        last.push_back(key)
    try:
        _, rest = linear.eliminatePartialSequential(first)
    except RuntimeError:  # GTSAM's IndeterminantLinearSystemException, also for a pivot below 1e-6
        return None
    information, vector = rest.hessian(last)
    return np.asarray(information, dtype=float), np.ravel(vector)


def _inverse(information: Array) -> Array | None:
    """Inverse of a symmetric matrix that has to be safely positive definite, scaled to a unit diagonal first."""
    diagonal = np.diagonal(information)
    if not (diagonal > 0.0).all():  # NaN does not pass
        return None
    scale = 1.0 / np.sqrt(diagonal)
    try:
        root = np.linalg.cholesky(information * scale[:, None] * scale)
    except np.linalg.LinAlgError:
        return None
    if not (np.diagonal(root) / scale).min() >= SMALLEST_PIVOT:
        return None
    half = np.linalg.solve(root, np.diag(scale))
    return np.asarray(half.T @ half)


def _innovation(
    rows: list[tuple[list[int], Array, Array]], covariance: Array, step: Array, place: dict[int, slice]
) -> tuple[float, int]:
    """Squared innovation of the ranges of a group and its dimension."""
    if not rows:
        return np.nan, 0
    residual = np.concatenate([np.ravel(b) for _, _, b in rows])
    jacobian = np.zeros((residual.size, covariance.shape[0]))
    top = 0
    for keys, block, b in rows:
        columns = np.concatenate([np.arange(place[key].start, place[key].stop) for key in keys])
        jacobian[top : top + b.size, columns] = block
        top += b.size
    values, vectors = np.linalg.eigh(np.eye(residual.size) - jacobian @ covariance @ jacobian.T)
    usable = values > _EXPLAINED
    if not usable.any():
        return np.nan, 0
    along = (residual - jacobian @ step) @ vectors[:, usable]
    return float(np.sum(along**2 / values[usable])), int(usable.sum())


class Weakest(NamedTuple):
    """Variable that may stray the furthest, whether by turning, and how far at least; eigenvalue of its direction."""

    variable: int
    turns: bool
    sigma: float  # m or rad
    eigenvalue: float  # of the information matrix scaled to a unit diagonal


def weakest_direction(graph: FactorGraph, values: GraphValues) -> Weakest:
    """Find what is determined least at some values, by inverse iteration; infinite for what is not measured at all."""
    builder = FactorBuilder()
    linear = builder.factors(graph).linearize(builder.values(values))
    dimension = np.where(np.arange(graph.n_poses + graph.landmark_name.size) < graph.n_poses, 6, 3)
    used = np.isin(np.arange(dimension.size), np.array(linear.keyVector(), dtype=int))
    if not used.all():
        return Weakest(int(np.argmin(used)), turns=False, sigma=np.inf, eigenvalue=0.0)
    # columns are in the order of the variables; in a pose, rotation comes first
    variable = np.repeat(np.arange(dimension.size), dimension)
    turns = np.concatenate(
        [np.tile([True] * 3 + [False] * 3, graph.n_poses), np.zeros(3 * graph.landmark_name.size, bool)]
    )
    row, column, entry = linear.sparseJacobian_()
    place = (row.astype(int) - 1, column.astype(int) - 1)
    with_rhs = csc_array((entry, place), shape=(int(row.max()), variable.size + 1))
    jacobian = with_rhs[:, :-1]
    information = (jacobian.T @ jacobian).tocsc()
    diagonal = information.diagonal()
    if not (diagonal > 0.0).all():
        free = int(np.argmin(diagonal > 0.0))
        return Weakest(int(variable[free]), bool(turns[free]), np.inf, 0.0)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = diags_array(scale) @ information @ diags_array(scale)
    factors = splu((scaled + _DAMPING * eye_array(scale.size)).tocsc())
    x = np.random.default_rng(0).standard_normal(scale.size)
    for _ in range(_STEPS):
        x = factors.solve(x)
        x /= np.linalg.norm(x)
    eigenvalue = float(np.dot(x, np.asarray(scaled @ x)))
    stray = np.abs(x * scale) / np.sqrt(max(eigenvalue, _DAMPING))
    furthest = int(np.argmax(stray > 0.999 * stray.max()))
    return Weakest(int(variable[furthest]), bool(turns[furthest]), float(stray[furthest]), eigenvalue)


def worst_factor(graph: FactorGraph, values: GraphValues) -> tuple[list[int], float]:
    """Variables and cost of the factor that fits some values worst."""
    builder = FactorBuilder()
    factors, at = builder.factors(graph), builder.values(values)
    costs = np.array([factors.at(i).error(at) for i in range(factors.size())])
    worst = int(np.argmax(costs))
    return [int(key) for key in factors.at(worst).keys()], float(costs[worst])  # noqa: SIM118 (no mapping)
