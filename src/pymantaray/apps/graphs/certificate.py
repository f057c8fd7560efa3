r"""
Certificate of global optimality for pose graphs and range-aided graphs, by Lagrangian duality.

It belongs to the problem of `chordal_problem`, whose certificate matrix S gives the cost of every
feasible Y,

.. math:: f(Y) = f(X) + \tfrac12 \mathrm{tr}(Y^\top S Y),

so X is a global minimum if S has no negative eigenvalue. With free positions eliminated from S,
rows of rotations and unit vectors have a constant sum of squares m, and :math:`f(Y) \ge f(X) +
\frac{m}{2} \lambda_{\min}`. The same bound at a global minimum of the relaxation (`staircase`) is
the largest one.
"""

from dataclasses import dataclass

import numpy as np

from pymantaray.apps.graphs.chordal_problem import ChordalProblem, not_quadratic
from pymantaray.apps.graphs.staircase import (
    can_relax,
    descend,
    gap,
    least_eigenpair,
    lower_bound,
    relax,
)
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues

_CRITICAL = 1e-6  # relative; a larger Newton decrement is not at a critical point


@dataclass(frozen=True)
class Certificate:
    """
    Result of `certify`.

    Parameters
    ----------
    certified : bool
        True if the critical point next to the estimate is a global minimum of the certificate's
        problem.
    least_eigenvalue : float
        Least eigenvalue of the certificate matrix; NaN if there is no certificate.
    cost : float
        Cost of the certificate's problem at that critical point. [-]
    lower_bound : float
        Lower bound of this cost over all values. [-]
    distance : float
        Largest distance between positions of the estimate and of the critical point. [m]
    reason : str or None
        Why there is no certificate; None if there is one or a negative eigenvalue.
    """

    certified: bool
    least_eigenvalue: float = np.nan
    cost: float = np.nan
    lower_bound: float = np.nan
    distance: float = np.nan
    reason: str | None = None

    @property
    def text(self) -> str:
        """One line for people."""
        if self.reason is not None:
            return f"no certificate: {self.reason}"
        if self.certified:
            return f"certified: global minimum, cost {self.cost:.6g} of the chordal problem"
        return (
            f"not certified: least eigenvalue {self.least_eigenvalue:.3g}; cost {self.cost:.6g} of"
            f" the chordal problem, lower bound {self.lower_bound:.6g}"
        )


def certify(graph: FactorGraph, values: GraphValues) -> Certificate:
    """
    Certify that an estimate is a global minimum, or compute the least eigenvalue of the certificate
    matrix.

    The estimate is first refined for the problem of the certificate, whose weights are isotropic
    and whose rotation residuals are chordal; ``distance`` is how far that moves it. The estimate is
    certified if its cost is within 0.1 % (and 0.0001) of a lower bound. The least eigenvalue gives
    a bound; if it is negative in a small graph, `relax` computes a better one. Without a
    certificate, the estimate is a local minimum, or the relaxation is not tight.

    Parameters
    ----------
    graph : FactorGraph
        A graph of two or three dimensions; with factors of a coordinate alone, such as depths,
        there is no certificate.
    values : GraphValues
        The estimate.

    Returns
    -------
    Certificate
    """
    if others := not_quadratic(graph):
        return Certificate(False, reason=f"{', '.join(others)} are not quadratic in the relaxation")
    problem = ChordalProblem(graph)
    start = problem.matrix(values)
    point, decrement = descend(problem, start)
    cost = problem.cost(point)
    moved = problem.positions(point) - problem.positions(start)
    distance = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    if decrement > _CRITICAL * (1.0 + cost):
        return Certificate(
            False,
            cost=cost,
            distance=distance,
            reason="no critical point of the chordal problem found",
        )
    least, _ = least_eigenpair(problem, point)
    if not np.isfinite(least):
        return Certificate(
            False, cost=cost, distance=distance, reason="the Lanczos iteration did not converge"
        )
    bound = lower_bound(problem, cost, least)
    if cost - bound > gap(cost) and can_relax(graph):
        bound = max(bound, relax(problem, point).lower_bound)
    return Certificate(cost - bound <= gap(cost), least, cost, bound, distance)
