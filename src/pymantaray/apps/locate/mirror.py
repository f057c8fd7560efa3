"""Second solution of a survey along one line: the mirror image of the node."""

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
    Mirrored position of a node, and the excess of its chi-square.

    It is `undecided` if the data do not exclude it.
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
    Solution of the lowest chi-square, and mirror solutions of nodes with pings along one line.
    """
    # a mirror of lower cost becomes the solution; its other nodes may have better mirrors
    for _ in solver.survey.names:
        mirrors = _mirror_solutions(solver, solution)
        best = lowest([_Candidate(_cost(solution, solution), solution), *mirrors])
        if best.solution is solution:
            break
        solution = best.solution
        mirrors = []
    mirrors = mirrors or _mirror_solutions(solver, solution)
    return solution, [candidate.mirror for candidate in mirrors if candidate.mirror is not None]


def _mirror_solutions(solver: Solver, solution: SurveySolution) -> list[_Candidate]:
    """Solutions from the mirror image of one node after the other."""
    survey = solver.survey
    transmit_position, receive_position = solution.transducers()
    result = []
    for k, name in enumerate(survey.names):
        rows = solution.used & (survey.node == k) & (survey.partner < 0)
        sigma_north, sigma_east, _ = survey.nodes[k].sigma
        is_free = solution.unknowns.arrangement == "free" and (sigma_north or sigma_east)
        if rows.sum() < 3 or not is_free:
            continue
        points = 0.5 * (transmit_position + receive_position)[rows, :2]
        centre = points.mean(axis=0)
        _, extent, axes = np.linalg.svd(points - centre, full_matrices=False)
        if extent[1] > _MAX_WIDTH * extent[0]:
            continue
        across = axes[1]
        offset = float((solution.positions[k, :2] - centre) @ across)
        if abs(offset) < 2.0 * extent[1] / np.sqrt(rows.sum()):
            continue  # the node is on the line
        values = solution.values.copy()
        columns = solution.unknowns.slices["position"]
        values[columns].reshape(-1, 3)[k, :2] -= 2.0 * offset * across
        mirror_solution = _descend(solver, solution, values)
        if mirror_solution is None:
            continue
        position = mirror_solution.positions[k]
        cost = _cost(mirror_solution, solution)
        difference = cost - _cost(solution, solution)
        distance = float(np.linalg.norm(position[:2] - solution.positions[k, :2]))
        if distance < abs(offset):  # it converged to the first solution
            continue
        north, east, depth = map(float, position)
        mirror = Mirror(name, north, east, depth, difference, bool(difference < _MIN_DIFFERENCE))
        result.append(_Candidate(cost, mirror_solution, mirror))
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
    Chi-square of residuals and prior positions with the main solution's noise.

    Gross errors count with the limit.
    """
    survey = solution.unknowns.survey
    fit = main.posterior
    level = fit.sigma * np.sqrt(main.correlation.variance) * solution.linear.weight
    size = np.where(solution.legs.possible, np.abs(solution.linear.residual) / level, np.inf)
    limit = float((np.abs(main.linear.residual) / level)[main.used].max())
    columns = solution.unknowns.slices["position"]
    sd = solution.unknowns.prior_sd[columns]
    mean = solution.unknowns.prior_mean[columns]
    is_known = sd <= 0.0
    prior = np.where(is_known, 0.0, (solution.values[columns] - mean) / np.where(is_known, 1.0, sd))
    return float(np.sum(np.minimum(size, limit)[~survey.flagged] ** 2) + np.sum(prior**2))
