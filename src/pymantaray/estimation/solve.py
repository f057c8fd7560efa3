"""Solve factor graphs and check every solution."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from pymantaray.arrays import Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.filters.fixed_lag import smooth_with_lag
from pymantaray.estimation.filters.incremental import solve_incrementally
from pymantaray.estimation.filters.kalman import filter_graph
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.ranges.candidates import CandidateModel
from pymantaray.estimation.ranges.range_models import ModelRanges, RangeUnknowns, UnknownsEstimate
from pymantaray.estimation.solvers.losses import LOSSES, Loss
from pymantaray.estimation.solvers.marginals import check_poses, epoch_groups, group_marginals
from pymantaray.estimation.solvers.mixture import MixtureIterations
from pymantaray.estimation.solvers.optimize import check_convergence
from pymantaray.estimation.solvers.outer import BatchOutcome, OuterIterations
from pymantaray.estimation.solvers.problems import (
    GraphState,
    Problem,
    ProblemCache,
    distance_problem,
)
from pymantaray.estimation.solvers.robust import optimize_robust
from pymantaray.estimation.solvers.solution import (
    GraphSolution,
    Method,
    SolveOptions,
    gate,
    make_solution,
)
from pymantaray.estimation.solvers.starts import separated


class GraphSolver:
    """
    Solver of factor graphs that caches what successive graphs share: elimination orders and
    factors.

    Use one solver per process. Results do not depend on earlier solves.

    Parameters
    ----------
    options : SolveOptions, optional

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import GraphSolver
    >>> solution = GraphSolver().solve(graph, start)
    >>> solution.status.name, solution.iterations
    ('OK', 3)
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
        model_ranges: ModelRanges | None = None,
        covariance_poses: Indices | None = None,
        covariances_if: Callable[[GraphSolution], bool] | None = None,
    ) -> GraphSolution:
        """
        Solve one graph.

        Parameters
        ----------
        graph : FactorGraph
        initial : GraphValues
            Starting values. The result of a non-convex loss depends on them: test with dead
            reckoning, because the truth hides local minima.
        method : Method, optional
            By default batch least squares. Robust costs have no expected value.
        model_is_right : bool
            Check that the final cost of batch least squares is within its chi-square bounds.
        model_ranges : ModelRanges, optional
            Range model and measured travel times, for outer iterations. By default the graph's
            ranges are distances.
        covariance_poses : ndarray of int, shape (n_epochs, n_vehicles), optional
            Poses whose covariances to compute. By default none are computed. Under a robust loss
            they use the final weights of the ranges as if these were known.
        covariances_if : callable, optional
            Tells of the solution of a batch whether its covariances are needed. By default they
            are.

        Returns
        -------
        GraphSolution
            Solution of any status; `diagnose` tells why it is not usable.

        Raises
        ------
        EstimationError
            If a measurement or a noise level of the graph is unusable, the starting values do not
            fit the graph or are not finite, or the model has other ranges than the graph.
        """
        check_graph(graph)
        check_values(graph, initial)
        initial = separated(graph, initial)
        method = method or Method()
        loss = method.loss
        poses = np.empty((0, 0), dtype=np.intp)
        if covariance_poses is not None:
            poses = check_poses(graph, covariance_poses)
        if method.uses_distances and model_ranges is not None:
            raise EstimationError(
                "an incremental solve, a fixed-lag solve and GTSAM need ranges as distances;"
                " choose the range model constant or transmitter"
            )
        # a filter or a smoother over time, with covariances of its own
        if method.kalman:
            if method != Method(kalman=True):
                raise EstimationError(
                    "a Kalman filter has no robust loss and no lag; remove the other options of"
                    " the method"
                )
            return filter_graph(graph, model_ranges=model_ranges, covariance_poses=covariance_poses)
        if method.lag is not None:
            if loss is not None:
                raise EstimationError(
                    "a fixed-lag smoother has no robust loss; remove the loss or the lag"
                )
            return smooth_with_lag(
                graph,
                initial,
                method.lag,
                incremental=method.incremental,
                options=self.options,
                covariance_poses=covariance_poses,
            )
        if method.gtsam is not None:
            solution, end = self._by_gtsam(
                graph, initial, method, poses, model_is_right=model_is_right
            )
        elif method.incremental:
            problem, groups = self._distances(graph, loss, poses)
            result = solve_incrementally(
                graph, initial, loss=loss, options=self.options, problem=problem
            )
            solution = result.solution
            end = BatchOutcome(result.optimum, problem, groups)
        else:
            end = self._batch(graph, initial, loss, model_ranges, poses)
            solution = self._batch_solution(
                graph, end, model_is_right=model_is_right, model_ranges=model_ranges
            )
        # marginals by the factor of the last step, whose memory is released
        last = end.optimum.last
        needed = covariance_poses is not None and solution.usable
        if needed and last is not None and (covariances_if is None or covariances_if(solution)):
            solution = replace(
                solution, covariances=group_marginals(end.problem, last, poses, end.groups)
            )
        if last is not None:
            last.factor.release()
        return solution

    def _batch(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        loss: Loss | None,
        model_ranges: ModelRanges | None,
        poses: Indices,
    ) -> BatchOutcome:
        if model_ranges is not None and isinstance(model_ranges.model, CandidateModel):
            if loss is not None:
                raise EstimationError("a mixture of candidates has no robust loss; remove the loss")
            return MixtureIterations(self._cache, graph, model_ranges, poses).solve(
                initial, self.options
            )
        if model_ranges is not None:
            return OuterIterations(self._cache, graph, model_ranges, loss, poses).solve(
                initial, self.options
            )
        problem, groups = self._distances(graph, loss, poses)
        return BatchOutcome(
            optimize_robust(problem, GraphState.of(initial), self.options), problem, groups
        )

    def _distances(
        self, graph: FactorGraph, loss: Loss | None, poses: Indices
    ) -> tuple[Problem, list[Indices]]:
        """Problem of ranges as distances, and the groups of variables of the covariances."""
        groups = epoch_groups(
            poses, graph["range"].variables, graph.n_poses, np.empty(0, dtype=np.intp)
        )
        return distance_problem(graph, loss, cache=self._cache, groups=groups), groups

    def _by_gtsam(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        method: Method,
        poses: Indices,
        *,
        model_is_right: bool,
    ) -> tuple[GraphSolution, BatchOutcome]:
        """
        Solution by GTSAM from the start of the batch solver, and the distance from the solution of
        the latter.
        """
        from pymantaray.estimation._gtsam.factors import (
            graph_factors,
            graph_values,
            optimize,
            values_of,
        )

        if method.loss is not None and method.loss.graduated:
            raise EstimationError("GTSAM's optimizer has no graduated loss; choose another loss")
        try:
            values, iterations = optimize(
                graph_factors(graph, method.loss),
                values_of(initial),
                converged=method.gtsam == "converged",
            )
            at = GraphState.of(graph_values(values, graph))
        except RuntimeError:  # a linear system that is indeterminate
            at = GraphState.of(initial)
            iterations = 0
        ours = self.solve(graph, initial, method=Method(method.loss), model_is_right=False).values
        problem, groups = self._distances(graph, method.loss, poses)
        # one batch step, not applied, measures the distance from the optimum
        optimum = check_convergence(problem, at)
        progress = replace(
            optimum.progress,
            iterations=iterations,
            initial_cost=problem.cost(GraphState.of(initial)),
        )
        limits = self.options
        if method.gtsam == "default":
            limits = replace(limits, end_tolerance=limits.incremental.end_tolerance)
        expected = math.nan if method.loss is not None else graph.degrees_of_freedom / 2.0
        status = gate(progress, limits, expected_cost=expected if model_is_right else math.nan)
        solution = make_solution(at.values(graph), progress, status, expected)
        pairs = (
            (solution.values.position, ours.position),
            (solution.values.landmark_position, ours.landmark_position),
        )
        apart = [np.linalg.norm(theirs - own, axis=1).max(initial=0.0) for theirs, own in pairs]
        return replace(solution, from_batch=float(max(apart))), BatchOutcome(
            optimum, problem, groups
        )

    def _batch_solution(
        self,
        graph: FactorGraph,
        end: BatchOutcome,
        *,
        model_is_right: bool,
        model_ranges: ModelRanges | None,
    ) -> GraphSolution:
        """
        Solution of a batch; a robust cost has no chi-square distribution, even without outliers.
        """
        gated = 0 if end.possible is None else int(np.count_nonzero(~end.possible))
        expected = (
            math.nan if end.problem.loss is not None else (graph.degrees_of_freedom - gated) / 2.0
        )
        progress = end.optimum.progress
        status = gate(
            progress, self.options, expected_cost=expected if model_is_right else math.nan
        )
        solution = make_solution(end.optimum.state.values(graph), progress, status, expected)
        solution = replace(solution, gated_links=gated, expansions=end.expansions)
        if (
            solution.usable
            and model_ranges is not None
            and model_ranges.unknowns is not None
            and model_ranges.unknowns.name
        ):
            solution = replace(solution, unknowns=_unknowns(model_ranges.unknowns, end))
        return solution


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "batch": Method(),
        **{name: Method(loss) for name, loss in LOSSES.items()},
        "incremental": Method(incremental=True),
        "gtsam": Method(gtsam="converged"),
    }
)
"""Methods to solve a graph whose ranges are distances, by name."""


def _unknowns(unknowns: RangeUnknowns, end: BatchOutcome) -> UnknownsEstimate:
    """Estimate of the unknowns that have names, in their units."""
    n = len(unknowns.name)
    optimum = end.optimum
    factors = end.problem.factors
    sigma = unknowns.sigma[:n]
    assert optimum.last is not None  # else it is not usable
    shared = np.arange(factors.n_variables, end.problem.structure.row.size)
    (inverse,) = optimum.last.factor.inverse([shared])
    covariance = sigma[:, None] * inverse[:n, :n] * sigma
    return UnknownsEstimate(
        unknowns.name, unknowns.unit, sigma, sigma * optimum.state.shared[:n], covariance
    )
