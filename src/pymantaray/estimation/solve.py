"""Batch solves of factor graphs, each passed through the health gate; gtsam is loaded at first use."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.covariance import factor_covariances
from pymantaray.estimation.diagnose import diagnose
from pymantaray.estimation.gate import Progress, SolveOptions, gate
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.incremental import replay
from pymantaray.estimation.outer import Outcome, iterate, solve_vector_factors, unknowns_at
from pymantaray.estimation.range_weights import BelievedRanges
from pymantaray.estimation.robust import minimize_robust, robust_solution
from pymantaray.estimation.solution import Solution, Variant, judged
from pymantaray.estimation.unknowns import UnknownsEstimate

Array = NDArray[np.float64]


class _Solved(NamedTuple):
    """A solution, and what its covariances are computed from."""

    solution: Solution
    factors: Any
    values: Any
    first_range: int | None
    """Number of the factors before those of ranges whose innovations are to be judged; None if none are."""


class GraphSolver:
    """
    Solves factor graphs; keeps noise models, orderings and starting values that successive graphs share.

    One solver belongs to one process. Results do not depend on what it has solved before.

    Parameters
    ----------
    options : SolveOptions
    """

    def __init__(self, options: SolveOptions | None = None) -> None:
        from pymantaray.estimation._gtsam.factors import FactorBuilder

        self.options = options or SolveOptions()
        self._builder = FactorBuilder()

    def solve(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        *,
        model_is_right: bool = True,
        believed: BelievedRanges | None = None,
        vector_factors: bool = False,
    ) -> Solution:
        """
        Solve one graph.

        Parameters
        ----------
        graph : FactorGraph
        initial : GraphValues
            Where to start.
        model_is_right : bool
            Whether the final cost has to lie within its chi-square bounds.
        believed : BelievedRanges, optional
            Range model and what was measured, for outer iterations. By default the graph's ranges are distances.
        vector_factors : bool
            Solve with nonlinear factors that ask the model at every evaluation instead, one for each ping. Slow: the
            check of the outer iterations.

        Returns
        -------
        Solution
            If not usable, with its ``diagnosis``: one line that names a variable.

        Raises
        ------
        EstimationError
            If a measurement or a noise level of the graph cannot be used, or the starting point does not
            fit the graph or is not finite, or what is believed is of other ranges.
        """
        check_graph(graph)
        check_values(graph, initial)
        solution = self.solve_variants(
            {"": Variant(graph, model_is_right, believed, vector_factors=vector_factors)},
            initial,
        )[""]
        return solution if solution.usable else replace(solution, diagnosis=diagnose(graph, initial))

    def solve_variants(
        self,
        graphs: Mapping[str, Variant | tuple[FactorGraph, bool]],
        initial: GraphValues,
        *,
        covariance_poses: NDArray[np.intp] | None = None,
    ) -> dict[str, Solution]:
        """
        Solve graphs that differ in nothing but their ranges; the common part is built once.

        Parameters
        ----------
        graphs : mapping of str to Variant
            Graphs that pass `check_graph`, and whether the model is right in each.
        initial : GraphValues
            Where to start, for all that have no start of their own.
        covariance_poses : ndarray of int, shape (n_epochs, n_agents), optional
            Poses whose covariances are wanted. By default none are computed. Under a robust loss they are those of the
            ranges as they are weighted at the end, as if the weights were known.

        Returns
        -------
        dict of str to Solution

        Raises
        ------
        EstimationError
            If a starting point does not fit the graphs or is not finite.
        """
        solutions: dict[str, Solution] = {}
        common = None
        for name, given in graphs.items():
            variant = Variant(*given)
            start = initial if variant.initial is None else variant.initial
            if common is None:
                _check_initial(variant.graph, initial)
                common = self._builder.base(variant.graph)
            if variant.initial is not None:
                _check_initial(variant.graph, start)
            if variant.incremental:
                solve = self._replayed
            elif variant.believed is not None:
                solve = self._expanded
            else:
                solve = self._at_distances
            solution, factors, values, first_range = solve(common, variant, start)
            if covariance_poses is not None and solution.usable:
                found = factor_covariances(factors, values, variant.graph, covariance_poses, first_range)
                solution = replace(solution, covariances=found)
            solutions[name] = solution
        return solutions

    def _at_distances(self, common: Any, variant: Variant, start: GraphValues) -> _Solved:
        """Ranges as distances, in a batch."""
        from pymantaray.estimation._gtsam.optimize import optimize
        from pymantaray.estimation._gtsam.robust import robust_factors

        graph, loss = variant.graph, variant.loss
        factors = robust_factors(self._builder, common, graph, loss)
        if loss is not None:
            values, progress = minimize_robust(self._builder, common, graph, loss, start, self.options)
        else:
            ordering = self._builder.ordering(graph, factors)
            values, progress = optimize(factors, self._builder.values(start), ordering, self.options)
        solution = self._solution(variant, start, values, progress)
        return _Solved(solution, factors, values, None if loss is not None else common.size())

    def _expanded(self, common: Any, variant: Variant, start: GraphValues) -> _Solved:
        """Ranges as a model believes them, in outer iterations or by vector factors."""
        assert variant.believed is not None  # asked only then
        problem = (self._builder, common, variant.graph, variant.believed, start, self.options)
        end = (
            solve_vector_factors(*problem) if variant.vector_factors else iterate(*problem, loss=variant.loss)
        )
        gated = int(np.count_nonzero(~end.possible))
        solution = self._solution(variant, start, end.values, end.progress, gated)
        solution = replace(solution, gated_links=gated, expansions=end.expansions)
        if solution.usable:
            solution = replace(solution, unknowns=_unknowns(variant.believed, end))
        # of vector factors the ranges come first
        judged = variant.loss is None and not variant.vector_factors
        return _Solved(solution, end.factors, end.values, common.size() if judged else None)

    def _replayed(self, common: Any, variant: Variant, start: GraphValues) -> _Solved:
        """Ranges as distances, in the order of time."""
        from pymantaray.estimation._gtsam.robust import robust_factors

        if variant.believed is not None:
            raise EstimationError("a replay takes ranges as distances; choose constant or transmitter")
        graph, loss = variant.graph, variant.loss
        solution = replay(graph, start, loss=loss).solution
        factors = robust_factors(self._builder, common, graph, loss)
        end = GraphValues(solution.position, solution.quaternion, solution.landmark_position)
        values = self._builder.values(end) if solution.usable else None
        return _Solved(solution, factors, values, None if loss is not None else common.size())

    def _solution(
        self,
        variant: Variant,
        initial: GraphValues,
        values: object,
        progress: Progress,
        gated: int = 0,
    ) -> Solution:
        """Values and verdict of one solve."""
        from pymantaray.estimation._gtsam.factors import to_graph_values

        found = to_graph_values(values, initial)
        if variant.loss is not None:
            return robust_solution(found, progress, self.options)
        freedom = variant.graph.degrees_of_freedom - gated
        status = gate(progress, freedom, self.options, model_is_right=variant.model_is_right)
        return judged(found, progress, status, freedom / 2.0)


def _unknowns(believed: BelievedRanges, end: Outcome) -> UnknownsEstimate | None:
    """What was found of the unknowns, in their units."""
    unknowns = believed.unknowns
    if unknowns is None or end.shared is None:
        return None
    from pymantaray.estimation._gtsam.marginals import vector_marginal

    sigma = unknowns.sigma
    covariance = sigma[:, None] * vector_marginal(end.factors, end.values, end.shared) * sigma
    value = sigma * unknowns_at(end.values, end.shared)
    return UnknownsEstimate(unknowns.name, unknowns.unit, sigma, value, covariance)


def _check_initial(graph: FactorGraph, initial: GraphValues) -> None:
    found = initial.position.shape[0], initial.landmark_position.shape[0]
    needed = graph.n_poses, graph.landmark_name.size
    if found != needed:
        raise EstimationError(
            f"starting point has {found[0]} poses and {found[1]} landmarks; the graph has {needed[0]} and {needed[1]}"
        )
    fine = np.concatenate(
        [
            np.isfinite(initial.position).all(axis=1) & np.isfinite(initial.quaternion).all(axis=1),
            np.isfinite(initial.landmark_position).all(axis=1),
        ]
    )
    if not fine.all():
        name = graph.variable_name(int(np.argmin(fine)))
        raise EstimationError(f"{name}: starting point is not finite; needs a position and a unit quaternion")
