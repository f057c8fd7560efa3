"""Second solution of a survey along one line: the mirror image of the node."""

from dataclasses import dataclass

import numpy as np

from pymantaray.apps.locate.solve import Solver, SurveySolution
from pymantaray.errors import LocateError

_MAX_WIDTH = 0.15  # width over length of a line for which mirror solutions are computed
_MIN_DIFFERENCE = 25.0  # chi-square; with a smaller difference, the data do not decide
_SAME = 1e-3  # chi-square; smaller differences do not choose between two solutions


@dataclass(frozen=True)
class Mirror:
    """
    Mirrored position of a node, its chi-square, and the excess over that of the reported one.

    It is `undecided` if the data do not exclude it.
    """

    node: str
    north: float
    east: float
    depth: float
    chi_square: float
    chi_square_difference: float
    undecided: bool

    @property
    def reported_chi_square(self) -> float:
        """Chi-square of the reported solution."""
        return self.chi_square - self.chi_square_difference


def with_mirrors(solver: Solver, solution: SurveySolution) -> tuple[SurveySolution, list[Mirror]]:
    """
    Solution of the lowest chi-square, and mirror solutions of nodes with pings along one line.
    """
    # a mirror of lower cost becomes the solution; its other nodes may have better mirrors
    for _ in solver.survey.names:
        mirrors = _mirror_solutions(solver, solution)
        better = [
            (mirror.chi_square_difference, k)
            for k, (_, mirror) in enumerate(mirrors)
            if mirror.chi_square_difference < -_SAME
        ]
        if not better:
            break
        solution, _ = mirrors[min(better)[1]]
    else:
        mirrors = _mirror_solutions(solver, solution)
    return solution, [mirror for _, mirror in mirrors]


def _mirror_solutions(
    solver: Solver, solution: SurveySolution
) -> list[tuple[SurveySolution, Mirror]]:
    """Solutions from the mirror image of one node after the other."""
    survey = solver.survey
    transmit_position, receive_position = solution.transducers()
    out = []
    for k, name in enumerate(survey.names):
        rows = solution.used & (survey.node == k) & (survey.partner < 0)
        is_free = solution.unknowns.arrangement == "free" and any(survey.nodes[k].sigma[:2])
        if rows.sum() < 3 or not is_free:
            continue
        # the line of the pings, and the distance of the node from it
        points = 0.5 * (transmit_position + receive_position)[rows, :2]
        centre = points.mean(axis=0)
        _, extent, axes = np.linalg.svd(points - centre, full_matrices=False)
        offset = float((solution.positions[k, :2] - centre) @ axes[1])
        is_on_line = abs(offset) < 2.0 * extent[1] / np.sqrt(rows.sum())
        if extent[1] > _MAX_WIDTH * extent[0] or is_on_line:
            continue
        # solve from the mirror image with the same model
        values = solution.values.copy()
        columns = solution.unknowns.slices["position"]
        values[columns].reshape(-1, 3)[k, :2] -= 2.0 * offset * axes[1]
        try:
            other = solver.settle(
                solution.unknowns, values, solution.correlation, solution.posterior
            )
        except LocateError:
            continue
        north, east, depth = map(float, other.positions[k])
        if np.hypot(*(other.positions - solution.positions)[k, :2]) < abs(offset):
            continue  # it converged to the first solution
        cost = _cost(other, solution)
        difference = cost - _cost(solution, solution)
        undecided = difference < _MIN_DIFFERENCE
        out.append((other, Mirror(name, north, east, depth, cost, difference, undecided)))
    return out


def _cost(solution: SurveySolution, main: SurveySolution) -> float:
    """
    Chi-square of residuals and prior positions with the main solution's noise.

    Gross errors count with the limit.
    """
    level = main.posterior.sigma * np.sqrt(main.correlation.variance) * solution.linear.weight
    size = np.where(solution.legs.possible, np.abs(solution.linear.residual) / level, np.inf)
    limit = float((np.abs(main.linear.residual) / level)[main.used].max())
    unknowns = solution.unknowns
    columns = unknowns.slices["position"]
    sd = unknowns.prior_sd[columns]
    shift = (solution.values[columns] - unknowns.prior_mean[columns])[sd > 0.0] / sd[sd > 0.0]
    squares = np.minimum(size, limit)[~unknowns.survey.flagged] ** 2
    return float(np.sum(squares) + np.sum(shift**2))
