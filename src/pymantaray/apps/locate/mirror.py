"""
Second solution of a survey along one line: the mirror image of the node in the vertical plane
through the line.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pymantaray.apps.locate.solve import Solver, SurveySolution
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.estimation.solvers.descents import lowest

_MAX_WIDTH = 0.15  # width over length of a line for which mirror solutions are computed
_MIN_DIFFERENCE = 25.0  # chi-square; with a smaller difference, the data do not decide


@dataclass(frozen=True)
class Mirror:
    """
    Mirrored position of a node, and the excess of its chi-square; `undecided` if the data do not
    exclude it.
    """

    node: str
    north: float
    east: float
    depth: float
    chi_square_difference: float
    undecided: bool


class _Candidate(NamedTuple):
    """Solution with its chi-square, and its description as a mirror of another solution."""

    cost: float
    solution: SurveySolution
    mirror: Mirror | None = None

    @property
    def converged(self) -> bool:
        """True if the positions have converged."""
        return self.solution.settled


def with_mirrors(solver: Solver, solution: SurveySolution) -> tuple[SurveySolution, list[Mirror]]:
    """
    Solution of the lowest chi-square, and the mirror solutions of its nodes whose pings are along
    one line.
    """
    for _ in solver.survey.names:
        mirrored = _mirrored(solver, solution)
        best = lowest([_Candidate(_cost(solution, solution), solution), *mirrored])
        if best.solution is solution:
            break
        solution = best.solution
        mirrored = []
    mirrored = mirrored or _mirrored(solver, solution)
    return solution, [candidate.mirror for candidate in mirrored if candidate.mirror is not None]


def _mirrored(solver: Solver, solution: SurveySolution) -> list[_Candidate]:
    """Solutions from the mirror image of one node after the other."""
    survey = solver.survey
    near, away = solution.transducers()
    result = []
    for k, name in enumerate(survey.names):
        rows = solution.used & (survey.node == k) & (survey.partner < 0)
        if (
            rows.sum() < 3
            or solution.unknowns.arrangement != "free"
            or not any(survey.nodes[k].sigma[:2])
        ):
            continue
        points = 0.5 * (near + away)[rows, :2]
        centre = points.mean(axis=0)
        _, extent, axes = np.linalg.svd(points - centre, full_matrices=False)
        if extent[1] > _MAX_WIDTH * extent[0]:
            continue
        across = axes[1]
        offset = float((solution.positions[k, :2] - centre) @ across)
        values = solution.values.copy()
        values[3 * k : 3 * k + 2] -= 2.0 * offset * across
        if abs(offset) < 2.0 * extent[1] / np.sqrt(rows.sum()):
            continue  # the node is on the line
        mirrored = _descend(solver, solution, values)
        if mirrored is None:
            continue
        place = mirrored.positions[k]
        cost = _cost(mirrored, solution)
        difference = cost - _cost(solution, solution)
        apart = float(np.linalg.norm(place[:2] - solution.positions[k, :2]))
        if apart < abs(offset):  # it converged to the first solution
            continue
        north, east, depth = map(float, place)
        mirror = Mirror(name, north, east, depth, difference, bool(difference < _MIN_DIFFERENCE))
        result.append(_Candidate(cost, mirrored, mirror))
    return result


def _descend(solver: Solver, solution: SurveySolution, values: Array) -> SurveySolution | None:
    """Solve from mirrored values with the same model."""
    fit = solution.posterior
    try:
        return solver.settle(solution.unknowns, values, solution.correlation, fit)
    except LocateError:
        return None


def _cost(solution: SurveySolution, main: SurveySolution) -> float:
    """
    Chi-square of residuals and prior positions with the main solution's noise; gross errors count
    with the limit.
    """
    survey = solution.unknowns.survey
    fit = main.posterior
    level = fit.sigma * np.sqrt(main.correlation.variance) * solution.linear.weight
    size = np.where(solution.legs.possible, np.abs(solution.linear.residual) / level, np.inf)
    limit = float((np.abs(main.linear.residual) / level)[main.used].max())
    at = solution.unknowns.slices["position"]
    sd = solution.unknowns.prior_sd[at]
    mean = solution.unknowns.prior_mean[at]
    known = sd <= 0.0
    prior = np.where(known, 0.0, (solution.values[at] - mean) / np.where(known, 1.0, sd))
    return float(np.sum(np.minimum(size, limit)[~survey.flagged] ** 2) + np.sum(prior**2))
