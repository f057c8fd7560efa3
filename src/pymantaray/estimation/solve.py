"""Solves of factor graphs, each passed through the health gate."""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from pymantaray.errors import EstimationError
from pymantaray.estimation.fixed_lag import smooth_with_lag
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.losses import LOSSES, Loss
from pymantaray.estimation.marginals import check_poses, epoch_groups, group_marginals
from pymantaray.estimation.normal_equations import Indices
from pymantaray.estimation.outer import Outcome, OuterIterations
from pymantaray.estimation.problems import Problem, ProblemCache, State, distance_problem
from pymantaray.estimation.range_models import BelievedRanges, Unknowns, UnknownsEstimate
from pymantaray.estimation.replay import replay
from pymantaray.estimation.robust import optimize_robust
from pymantaray.estimation.solution import Method, Solution, SolveOptions, gate, judged


class GraphSolver:
    """
    Solves factor graphs; keeps what successive graphs share: orders of elimination, and factors.

    One solver belongs to one process. Results do not depend on what it has solved before.
    """

    def __init__(self, options: SolveOptions | None = None) -> None:
        self.options = options or SolveOptions()
        self._cache = ProblemCache()

    def solve(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        *,
        method: Method | None = None,
        model_is_right: bool = True,
        believed: BelievedRanges | None = None,
        covariance_poses: Indices | None = None,
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
        covariance_poses : ndarray of int, shape (n_epochs, n_vehicles), optional
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
            the graph or is not finite, or what is believed is of other ranges.
        """
        check_graph(graph)
        check_values(graph, initial)
        method = method or Method()
        loss, poses = method.loss, np.empty((0, 0), dtype=np.intp)
        if covariance_poses is not None:
            poses = check_poses(graph, covariance_poses)
        if (method.incremental or method.lag is not None) and believed is not None:
            raise EstimationError("a replay takes ranges as distances; choose constant or transmitter")
        if method.lag is not None:
            if loss is not None:
                raise EstimationError("a fixed-lag smoother has no robust loss; leave one of them out")
            return smooth_with_lag(
                graph, initial, method.lag, options=self.options.replay, covariance_poses=covariance_poses
            )
        if method.incremental:
            solution, end = self._replayed(graph, initial, loss, poses)
        else:
            end = self._batch(graph, initial, loss, believed, poses)
            solution = self._judged(graph, end, model_is_right=model_is_right, believed=believed)
        last = end.optimum.last
        if covariance_poses is not None and solution.usable and last is not None:
            solution = replace(solution, covariances=group_marginals(end.problem, last, poses, end.groups))
        return solution

    def _batch(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        loss: Loss | None,
        believed: BelievedRanges | None,
        poses: Indices,
    ) -> Outcome:
        if believed is not None:
            return OuterIterations(self._cache, graph, believed, loss, poses).solve(initial, self.options)
        problem, groups = self._distances(graph, loss, poses)
        return Outcome(optimize_robust(problem, State.of(initial), self.options), problem, groups)

    def _distances(
        self, graph: FactorGraph, loss: Loss | None, poses: Indices
    ) -> tuple[Problem, list[Indices]]:
        """What is minimized where ranges are distances, and the groups whose covariances are wanted."""
        groups = epoch_groups(poses, graph["range"].variables, graph.n_poses, np.empty(0, dtype=np.intp))
        return distance_problem(graph, loss, cache=self._cache, groups=groups), groups

    def _replayed(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        loss: Loss | None,
        poses: Indices,
    ) -> tuple[Solution, Outcome]:
        problem, groups = self._distances(graph, loss, poses)
        end = replay(graph, initial, loss=loss, options=self.options, problem=problem)
        return end.solution, Outcome(end.proof, problem, groups)

    def _judged(
        self, graph: FactorGraph, end: Outcome, *, model_is_right: bool, believed: BelievedRanges | None
    ) -> Solution:
        """Values and verdict of a batch; a robust cost has no chi-square distribution, whether there are outliers or not."""
        gated = 0 if end.possible is None else int(np.count_nonzero(~end.possible))
        expected = math.nan if end.problem.loss is not None else (graph.degrees_of_freedom - gated) / 2.0
        progress = end.optimum.progress
        status = gate(progress, self.options, expected_cost=expected if model_is_right else math.nan)
        solution = judged(end.optimum.state.values(graph), progress, status, expected)
        solution = replace(solution, gated_links=gated, expansions=end.expansions)
        if (
            solution.usable
            and believed is not None
            and believed.unknowns is not None
            and believed.unknowns.name
        ):
            solution = replace(solution, unknowns=_unknowns(believed.unknowns, end))
        return solution


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "batch": Method(),
        **{name: Method(loss) for name, loss in LOSSES.items()},
        "incremental": Method(incremental=True),
    }
)
"""Ways to solve a graph whose ranges are distances, by name."""


def _unknowns(unknowns: Unknowns, end: Outcome) -> UnknownsEstimate:
    """What the solve says of the unknowns that have names, in their units."""
    n, optimum, factors = len(unknowns.name), end.optimum, end.problem.factors
    sigma = unknowns.sigma[:n]
    assert optimum.last is not None  # or it would not be usable
    shared = np.arange(factors.n_variables, end.problem.structure.row.size)
    (inverse,) = optimum.last.factor.inverse([shared])
    covariance = sigma[:, None] * inverse[:n, :n] * sigma
    return UnknownsEstimate(unknowns.name, unknowns.unit, sigma, sigma * optimum.state.shared[:n], covariance)
