"""Influence of each factor of a solved graph: whitened residual, leverage and Cook's distance."""

from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np
import pandas as pd

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import (
    KINDS,
    FactorGraph,
    Factors,
    GraphValues,
    Residual,
    dimension,
)
from pymantaray.estimation.solvers.losses import Loss, whitened_ranges
from pymantaray.estimation.solvers.normal_equations import SIZE
from pymantaray.estimation.solvers.optimize import check_convergence
from pymantaray.estimation.solvers.problems import GraphState, distance_problem
from pymantaray.geometry.se3 import matrix_from_quaternion, se3_log, so3_exp, so3_log

MEASURES = {
    "residual_sigmas": "whitened residual",
    "leverage": "leverage",
    "cook_distance": "Cook's distance",
}
"""Names of the measures of influence by column of `factor_influence`."""
_ANGLE = 1e-6  # rad, m; steps of central differences, whose error is below 1e-6 of a derivative
_LENGTH = 1e-2
_MIN_FREE = 1e-9  # share of a residual's variance below which a factor alone determines a direction


def factor_influence(
    graph: FactorGraph,
    values: GraphValues,
    loss: Loss | None = None,
    *,
    kinds: Collection[str] = tuple(KINDS),
) -> pd.DataFrame:
    r"""
    Measure the influence of factors on a least-squares solution.

    Parameters
    ----------
    graph : FactorGraph
        Graph whose ranges are distances.
    values : GraphValues
        Solution.
    loss : Loss, optional
        Robust loss of the ranges, whose weights apply to residuals and derivatives.
    kinds : collection of str
        Kinds of factors, names in `KINDS`. Default: all.

    Returns
    -------
    pandas.DataFrame
        One row per factor, in the order of `KINDS`: ``kind``, ``first`` and ``second`` variable,
        ``time_s``, ``residual_sigmas``, ``leverage``, ``cook_distance``, and ``successive`` for a
        factor between successive poses of a vehicle.

    Raises
    ------
    EstimationError
        If the graph does not determine some direction at the values.

    Notes
    -----
    With the whitened residual :math:`r` of a factor of m rows, its Jacobian :math:`A`, the
    covariance :math:`P` of the solution and :math:`H = A P A^\top`, the size of the residual is
    :math:`\sqrt{r^\top r}`, the leverage :math:`\operatorname{tr} H / m`, from 0 (the other factors
    determine what it measures) to 1 (it alone does), and Cook's distance [1]_ :math:`r^\top (I -
    H)^{-1} H (I - H)^{-1} r / n` with the number n of unknowns: the squared change of the
    linearized solution without the factor, in the metric of its covariance. NaN if the factor alone
    determines a direction.

    References
    ----------
    .. [1] R. D. Cook, "Detection of influential observation in linear regression", Technometrics
       19(1), 1977, 15-18.
    """
    pairs = np.concatenate(
        [graph[name].variables for name, kind in KINDS.items() if len(kind.ends) == 2]
    )
    problem = distance_problem(graph, loss)
    state = GraphState.of(values)
    last = check_convergence(problem, state).last
    if last is None:
        raise EstimationError(
            "influence: some direction of the graph is not determined at the solution"
        )
    own, between = last.factor.inverse_of_pairs(pairs.astype(np.intp))
    weight = (
        np.ones(len(graph["range"]))
        if loss is None
        else loss.weight(whitened_ranges(graph, values))
    )
    tables = []
    done = 0
    for name, kind in KINDS.items():
        factors = graph[name]
        count = len(factors) if len(kind.ends) == 2 else 0
        done += count
        if not len(factors) or name not in kinds:
            continue
        white, jacobian = _linearized(factors, state, planar=graph.planar)
        if name == "range":
            white = white * np.sqrt(weight)[:, None]
            jacobian = jacobian * np.sqrt(weight)[:, None, None]
        covariance = _joint(own, between[done - count : done], factors.variables)
        tables.append(
            _named(graph, factors).assign(
                **_measures(white, jacobian, covariance, dimension(graph))
            )
        )
    return pd.concat(tables, ignore_index=True)


def worst_factors(influence: pd.DataFrame, measure: str, count: int) -> pd.DataFrame:
    """
    Factors with the largest value of a measure, largest first, without those between successive
    poses of a vehicle.

    Such a factor holds the chain of poses together, so its leverage is close to 1 whatever it
    measures.

    Parameters
    ----------
    influence : pandas.DataFrame
        From `factor_influence`.
    measure : {"residual_sigmas", "leverage", "cook_distance"}
    count : int
        Number of factors.

    Returns
    -------
    pandas.DataFrame
    """
    return influence[~influence["successive"]].nlargest(count, measure).reset_index(drop=True)


def _named(graph: FactorGraph, factors: Factors) -> pd.DataFrame:
    """Kind, variables and time of each factor."""
    ends = [[graph.variable_name(v) for v in end] for end in factors.variables.T.tolist()]
    time = np.append(graph.pose_time, np.full(graph.landmark_name.size, np.nan))[factors.variables]
    last = np.where(np.isnan(time), -np.inf, time).max(axis=1)
    return pd.DataFrame(
        {
            "kind": factors.kind.what,
            "first": ends[0],
            "second": ends[1] if len(ends) > 1 else "-",
            "time_s": np.where(np.isinf(last), np.nan, last),
            "successive": _successive(graph, factors),
        }
    )


def _successive(graph: FactorGraph, factors: Factors) -> Mask:
    """True for factors between successive poses of a vehicle."""
    if factors.kind.ends != ("pose", "pose"):
        return np.zeros(len(factors), dtype=np.bool_)
    first, second = factors.variables.T
    number = graph.pose_number.astype(int)
    return np.asarray(
        (graph.pose_vehicle[first] == graph.pose_vehicle[second])
        & (number[second] - number[first] == 1)
    )


def _measures(
    white: Array, jacobian: Array, covariance: Array, n_unknowns: int
) -> dict[str, Array]:
    """
    Measures of factors with whitened residuals (n, m), derivatives (n, m, k) and covariances (n, k,
    k).
    """
    hat = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    size = np.sqrt(np.sum(white**2, axis=1))
    share, axes = np.linalg.eigh(0.5 * (hat + np.swapaxes(hat, 1, 2)))
    along = np.einsum("nij,ni->nj", axes, white)
    free = 1.0 - share
    usable = free > _MIN_FREE
    ratio = share * (along / np.where(usable, free, np.nan)) ** 2
    return {
        "residual_sigmas": size,
        "leverage": np.trace(hat, axis1=1, axis2=2) / white.shape[1],
        "cook_distance": ratio.sum(axis=1) / n_unknowns,
    }


def _joint(own: Array, between: Array, variables: Indices) -> Array:
    """Covariances of the ends of factors, (n, 6 k, 6 k)."""
    if variables.shape[1] == 1:
        return np.asarray(own[variables[:, 0]])
    first, second = own[variables.T]
    return np.block([[first, between], [np.swapaxes(between, 1, 2), second]])


class _Ends(NamedTuple):
    """Rotations (n, 3, 3) and positions (n, 3) of one end of factors."""

    rotation: Array
    position: Array


def _linearized(factors: Factors, state: GraphState, *, planar: bool) -> tuple[Array, Array]:
    """
    Whitened residuals (n, m) of factors and their derivatives (n, m, 6 k) by the blocks of their
    ends.
    """
    kind = factors.kind
    rows = kind.rows_in("rad m", planar=planar)
    root = np.linalg.cholesky(factors.covariance[:, rows][:, :, rows])
    residual = _RESIDUALS[kind.residual]
    measured = [kind.measured[row] for row in rows]
    ends = [_Ends(state.rotation[v], state.position[v]) for v in factors.variables.T]

    def residual_at(end: int, axis: int, step: float) -> Array:
        """
        Residual after a step of one end: a rotation about an axis of the body, or a displacement
        along an axis of the world.
        """
        trial = list(ends)
        rotation, position = ends[end]
        vector = step * np.eye(3)[axis % 3]
        trial[end] = (
            _Ends(rotation @ so3_exp(vector), position)
            if axis < 3
            else _Ends(rotation, position + vector)
        )
        return residual(factors, trial)[:, measured]

    columns = []
    for end, axis in np.ndindex(len(ends), SIZE):
        step = _ANGLE if axis < 3 else _LENGTH
        difference = residual_at(end, axis, step) - residual_at(end, axis, -step)
        columns.append(difference / (2.0 * step))
    white = np.linalg.solve(root, residual(factors, ends)[:, measured][..., None])[..., 0]
    return white, np.linalg.solve(root, np.stack(columns, axis=-1))


def _pose(factors: Factors, ends: list[_Ends]) -> Array:
    """Logarithm of the error of a relative pose, or of a pose or attitude in the world."""
    to_measured = np.swapaxes(matrix_from_quaternion(factors.column("quaternion")), 1, 2)
    last = ends[-1]
    rotation = last.rotation
    translation = last.position
    if len(ends) == 2:
        to_body = np.swapaxes(ends[0].rotation, 1, 2)
        rotation = to_body @ rotation
        translation = np.einsum("nij,nj->ni", to_body, translation - ends[0].position)
    if "position" not in factors.kind.columns_at:
        return so3_log(to_measured @ rotation)
    error = np.einsum("nij,nj->ni", to_measured, translation - factors.column("position"))
    return se3_log(to_measured @ rotation, error)


def _sighting(factors: Factors, ends: list[_Ends]) -> Array:
    """Error of the position of the second end in the body frame of the first."""
    offset = ends[1].position - ends[0].position
    return np.asarray(
        np.einsum("nji,nj->ni", ends[0].rotation, offset) - factors.column("position")
    )


def _position(factors: Factors, ends: list[_Ends]) -> Array:
    """Error of a position or a depth."""
    if "position" in factors.kind.columns_at:
        return np.asarray(ends[0].position - factors.column("position"))
    return np.asarray(ends[0].position[:, 2:] - factors.column("depth")[:, None])


def _distance(factors: Factors, ends: list[_Ends]) -> Array:
    """Error of a distance."""
    length = np.linalg.norm(ends[1].position - ends[0].position, axis=1)
    return np.asarray(length - factors.column("distance"))[:, None]


_RESIDUALS: dict[Residual, Callable[[Factors, list[_Ends]], Array]] = {
    Residual.POSE: _pose,
    Residual.SIGHTING: _sighting,
    Residual.POSITION: _position,
    Residual.DISTANCE: _distance,
}
