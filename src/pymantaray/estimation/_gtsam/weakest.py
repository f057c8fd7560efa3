"""Where a graph is weak or strained: the direction it determines least, the factor it fits worst."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from pymantaray.estimation._gtsam.factors import FactorBuilder
from pymantaray.estimation.graph import FactorGraph, GraphValues

Array = NDArray[np.float64]

_DAMPING = 1e-15  # of the scaled information matrix, whose diagonal is 1: a singular one stays solvable
_STEPS = 6  # of inverse iteration; each takes away what is not the weakest by the ratio of the eigenvalues


class Weakest(NamedTuple):
    """
    Variable that may stray the furthest, whether by turning, and how far at least. [m or rad]

    The eigenvalue is of the information matrix scaled to a unit diagonal.
    """

    variable: int
    turns: bool
    sigma: float
    eigenvalue: float


def weakest_direction(graph: FactorGraph, values: GraphValues) -> Weakest:
    """
    Find what is determined least at the given values, by inverse iteration.

    Parameters
    ----------
    graph : FactorGraph
        Must pass `check_graph`.
    values : GraphValues

    Returns
    -------
    Weakest
        Sigma is infinite for a variable of which something is not measured at all.
    """
    builder = FactorBuilder()
    linear = builder.with_ranges(builder.base(graph), graph).linearize(builder.values(values))
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
    """
    Find the factor that fits the given values worst.

    Parameters
    ----------
    graph : FactorGraph
        Must pass `check_graph`, and have a factor.
    values : GraphValues

    Returns
    -------
    variables : list of int
        What the factor is about.
    cost : float
        Half its squared whitened residual. [-]
    """
    builder = FactorBuilder()
    factors, at = builder.with_ranges(builder.base(graph), graph), builder.values(values)
    costs = np.array([factors.at(i).error(at) for i in range(factors.size())])
    worst = int(np.argmax(costs))
    return [int(key) for key in factors.at(worst).keys()], float(costs[worst])  # noqa: SIM118 (no mapping)
