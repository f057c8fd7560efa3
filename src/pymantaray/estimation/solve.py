"""Solves of factor graphs, each passed through the health gate; gtsam is loaded at first use."""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.covariance import factor_covariances
from pymantaray.estimation.diagnose import refuse_sharp_depths
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.losses import LOSSES, Loss
from pymantaray.estimation.outer import Outcome, OuterIterations
from pymantaray.estimation.range_models import BelievedRanges, UnknownsEstimate
from pymantaray.estimation.replay import replay
from pymantaray.estimation.solution import Method, Progress, Solution, SolveOptions, gate, judged
from pymantaray.records import SolveStatus


class GraphSolver:
    """
    Solves factor graphs; keeps noise models, orderings and starting values that successive graphs share.

    One solver belongs to one process. Results do not depend on what it has solved before.
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
        method: Method | None = None,
        model_is_right: bool = True,
        believed: BelievedRanges | None = None,
        covariance_poses: NDArray[np.intp] | None = None,
    ) -> Solution:
        """
        Solve one graph.

        Parameters
        ----------
        graph : FactorGraph
        initial : GraphValues
            Where to start. Where a loss is not convex the end depends on it: judge from dead reckoning, for
            the truth hides local minima.
        method : Method, optional
            By default a batch of least squares. Costs under a loss are robust ones, without an expectation.
        model_is_right : bool
            Whether the final cost of least squares in a batch has to lie within its chi-square bounds.
        believed : BelievedRanges, optional
            Range model and what was measured, for outer iterations. By default the graph's ranges are
            distances.
        covariance_poses : ndarray of int, shape (n_epochs, n_agents), optional
            Poses whose covariances are wanted. By default none are computed. Under a robust loss they are
            those of the ranges as they are weighted at the end, as if the weights were known.

        Returns
        -------
        Solution
            Of any status; `diagnose` says why one is not usable.

        Raises
        ------
        EstimationError
            If a measurement or a noise level of the graph cannot be used, or the starting point does not fit
            the graph or is not finite, or what is believed is of other ranges; or if the solver fails for
            depths that are too well known, with the least standard deviation that it needs.
        """
        check_graph(graph)
        check_values(graph, initial)
        method = method or Method()
        loss = method.loss
        if method.incremental:
            solution, end = self._replayed(graph, initial, loss, believed)
        else:
            end = self._batch(graph, initial, loss, believed)
            solution = self._judged(graph, end, model_is_right=model_is_right, believed=believed)
        if solution.status == SolveStatus.FAILED:
            refuse_sharp_depths(graph, initial)
        if covariance_poses is not None and solution.usable:
            first_range = self._builder.common(graph).size() if loss is None else None
            covariances = factor_covariances(end.problem, end.values, graph, covariance_poses, first_range)
            solution = replace(solution, covariances=covariances)
        return solution

    def _batch(
        self, graph: FactorGraph, initial: GraphValues, loss: Loss | None, believed: BelievedRanges | None
    ) -> Outcome:
        from pymantaray.estimation._gtsam.problems import Distances
        from pymantaray.estimation._gtsam.robust import optimize_robust

        if believed is not None:
            return OuterIterations(self._builder, graph, believed, loss).solve(initial, self.options)
        problem = Distances(self._builder, graph, loss)
        start, ordering = self._builder.values(initial), self._builder.ordering(graph)
        values, progress = optimize_robust(problem, start, ordering, self.options)
        return Outcome(values, progress, problem)

    def _replayed(
        self, graph: FactorGraph, initial: GraphValues, loss: Loss | None, believed: BelievedRanges | None
    ) -> tuple[Solution, Outcome]:
        from pymantaray.estimation._gtsam.problems import Distances

        if believed is not None:
            raise EstimationError("a replay takes ranges as distances; choose constant or transmitter")
        solution = replay(graph, initial, loss=loss, options=self.options, builder=self._builder).solution
        values = self._builder.values(solution.values) if solution.usable else None
        progress = Progress(solution.iterations, solution.initial_cost, solution.final_cost)
        return solution, Outcome(values, progress, Distances(self._builder, graph, loss))

    def _judged(
        self, graph: FactorGraph, end: Outcome, *, model_is_right: bool, believed: BelievedRanges | None
    ) -> Solution:
        """Values and verdict of a batch; a robust cost has no chi-square distribution, whether there are outliers or not."""
        from pymantaray.estimation._gtsam.factors import to_graph_values

        gated = 0 if end.possible is None else int(np.count_nonzero(~end.possible))
        expected = math.nan if end.problem.loss is not None else (graph.degrees_of_freedom - gated) / 2.0
        status = gate(end.progress, self.options, expected_cost=expected if model_is_right else math.nan)
        solution = judged(to_graph_values(end.values, graph), end.progress, status, expected)
        solution = replace(solution, gated_links=gated, expansions=end.expansions)
        if solution.usable and believed is not None:
            solution = replace(solution, unknowns=_unknowns(believed, end))
        return solution


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "batch": Method(),
        **{name: Method(loss) for name, loss in LOSSES.items()},
        "incremental": Method(incremental=True),
    }
)
"""Ways to solve a graph whose ranges are distances, by name."""


def _unknowns(believed: BelievedRanges, end: Outcome) -> UnknownsEstimate | None:
    """What the solve says of the unknowns, in their units."""
    unknowns = believed.unknowns
    if unknowns is None or end.shared is None:
        return None
    from pymantaray.estimation._gtsam.marginals import vector_marginal

    sigma = unknowns.sigma
    covariance = sigma[:, None] * vector_marginal(end.problem, end.values, end.shared) * sigma
    value = sigma * np.array(end.values.atVector(end.shared), dtype=float)
    return UnknownsEstimate(unknowns.name, unknowns.unit, sigma, value, covariance)
