"""
Outer iterations: expand the travel times of a range model about the estimate, solve, and repeat.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.ranges.expansion import Expansion, RangeWeights
from pymantaray.estimation.ranges.range_models import ModelRanges, Prediction, RangeEndpoints
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.estimation.solvers.marginals import epoch_groups
from pymantaray.estimation.solvers.normal_equations import SIZE
from pymantaray.estimation.solvers.optimize import Optimum
from pymantaray.estimation.solvers.problems import ExpandedRanges, GraphState, Problem, ProblemCache
from pymantaray.estimation.solvers.robust import optimize_robust
from pymantaray.estimation.solvers.solution import SolveOptions, SolveProgress

_SETTLED = 1e-3  # m; a range that a new prediction changes by less has converged
_FIRST_TOLERANCE = 0.1  # m; the first expansion is inaccurate, so its solve ends early
_MAX_EXPANSIONS = 25
_MAX_GATINGS = 2  # a link that was gated this often stays gated
_EXPANSIONS_BEFORE_GATING = 8  # after these, links whose corrections do not converge are gated
_GATED_FROM = 0.3  # share of the largest correction; smaller ones follow from it
_MAX_GATED_SHARE = 0.05  # share of the links that may be gated at a time


@dataclass(frozen=True, eq=False)
class BatchOutcome:
    """Result of a batch solve."""

    optimum: Optimum
    problem: Problem  # problem whose optimum it is
    groups: list[Indices]  # variables of the covariances to compute
    possible: Mask | None = None  # true for each used range; the others were gated
    expansions: int = 0


class RangeArguments(NamedTuple):
    """Arguments of an `Expansion`: positions of the ends of all ranges, and shared unknowns."""

    transmitter: Array
    receiver: Array
    unknowns: Array


class OuterIterations:
    """
    Minimize the cost of a graph with the ranges of a model.

    Predict travel times at the estimate, expand them (`Expansion`), solve the graph, and repeat
    until a new prediction changes no range by more than 1 mm. A link without an arrival is gated
    until the next estimate, and permanently after two times, so that the set of links converges.
    After 8 expansions the links with the largest corrections are gated, too: their first arrival
    alternates between families of rays.
    """

    def __init__(
        self,
        cache: ProblemCache,
        graph: FactorGraph,
        model_ranges: ModelRanges,
        loss: Loss | None,
        poses: Indices,
    ) -> None:
        ranges = model_ranges.ranges
        ends = np.stack([ranges.transmitter, ranges.receiver], axis=1)
        rows = graph["range"].variables
        if not np.array_equal(np.sort(ends, axis=1), np.sort(rows, axis=1)):
            raise EstimationError(
                f"{len(ends)} timed ranges do not join the variables of the graph's {len(rows)}"
                " ranges; take both from the same measurements, ranges and links"
            )
        if loss is not None and model_ranges.correlated:
            raise EstimationError(
                "a robust loss applies to single ranges, but these are correlated; remove the loss"
                " or the correlation"
            )
        self._model_ranges = model_ranges
        self._loss = loss
        n = graph.n_variables
        self._shared = n + np.arange(-(-model_ranges.n_unknowns // SIZE))
        self._factors = cache.factors(graph)
        self.groups = epoch_groups(poses, graph["range"].variables, graph.n_poses, self._shared)
        self._weights = RangeWeights(model_ranges, graph["range"].variance)
        epochs = [np.unique(ends[rows]) for rows in self._weights.rows]
        cliques = [*self.groups, *(np.concatenate([epoch, self._shared]) for epoch in epochs)]
        self._structure = cache.structure(
            self._factors, n + self._shared.size, np.empty((0, 2), dtype=np.intp), cliques
        )
        self._rows = np.arange(ranges.time.size)
        self._used = np.ones(ranges.time.size, dtype=bool)
        self._gated = np.zeros(ranges.time.size, dtype=int)
        self._expansion: Expansion | None = None
        self._first: tuple[Prediction, Array] | None = None

    def solve(self, initial: GraphValues, options: SolveOptions) -> BatchOutcome:
        """
        Solve from a start; if the expansions do not converge the last step is NaN, which no gate
        passes.
        """
        start = GraphState.of(initial, self._model_ranges.n_unknowns)
        loss = self._loss
        end = Optimum(start, SolveProgress(0, np.nan, np.nan))
        ranges = None
        problem = None
        iterations = 0
        count = 0
        settled = False
        while True:
            arguments = self._arguments(end.state)
            # a new prediction would change nothing
            if self._expansion is not None and count > 1 and self._expansion.is_good_at(*arguments):
                settled = True
                break
            if count == _MAX_EXPANSIONS:
                break
            expansion = self._predict_again(arguments, count)
            if expansion is None:
                settled = True
                break
            self._expansion = expansion
            blocks = self._weights.blocks(self._used)
            ranges = ExpandedRanges(self._model_ranges.ranges, blocks, expansion, self._shared)
            if loss is not None and count:
                loss = replace(loss, graduated=False)  # only for the first expansion
            problem = Problem(self._factors, ranges, self._structure, loss)
            tolerance = (
                options.step_tolerance if count else max(options.step_tolerance, _FIRST_TOLERANCE)
            )
            end = optimize_robust(problem, end.state, replace(options, step_tolerance=tolerance))
            iterations = iterations + end.progress.iterations
            count = count + 1
            if end.progress.singular or not np.isfinite(end.progress.final_cost):
                break
        assert problem is not None  # the model was evaluated at least once
        assert ranges is not None
        cost = self._initial_cost(start, ranges, arguments)
        progress = replace(end.progress, iterations=iterations, initial_cost=cost)
        if not settled:
            progress = replace(progress, last_step=np.nan)
        return BatchOutcome(
            end._replace(progress=progress), problem, self.groups, self._used, count
        )

    def _arguments(self, state: GraphState) -> RangeArguments:
        ranges = self._model_ranges.ranges
        return RangeArguments(
            state.position[ranges.transmitter], state.position[ranges.receiver], state.shared
        )

    def _predict_again(self, arguments: RangeArguments, count: int) -> Expansion | None:
        """Evaluate the model and gate links; None if nothing has changed."""
        ranges = self._model_ranges.ranges
        unknowns = arguments.unknowns
        links = ranges.links(arguments.transmitter, arguments.receiver)
        prediction, by_unknowns = self._predict(links, unknowns)
        self._gated += self._used & ~prediction.possible
        before = self._used
        self._used = prediction.possible & (self._gated < _MAX_GATINGS)
        residual = ranges.sound_speed * (
            np.where(prediction.possible, prediction.travel_time, 0.0) - ranges.travel_time
        )
        if self._first is None:
            self._first = prediction, residual
        if self._expansion is not None:
            both = self._used & before
            off = np.where(both, np.abs(residual - self._expansion(*arguments)[0]), 0.0)
            largest = float(off.max(initial=0.0))
            if count > 1 and np.array_equal(self._used, before) and largest <= _SETTLED:
                return None
            # the first arrivals of a few links alternate, so their corrections never settle
            if count >= _EXPANSIONS_BEFORE_GATING and largest > _SETTLED:
                unsettled = off >= _GATED_FROM * largest
                if np.count_nonzero(unsettled) <= _MAX_GATED_SHARE * np.count_nonzero(self._used):
                    self._gated[unsettled] = _MAX_GATINGS
                    self._used = self._used & ~unsettled
        self._weights.at(links)
        return Expansion(prediction, links, ranges.travel_time, unknowns, by_unknowns)

    def _predict(self, links: RangeEndpoints, unknowns: Array) -> tuple[Prediction, Array]:
        """Predict the travel times of all ranges and their derivatives by the unknowns."""
        return self._model_ranges.predict(links, self._rows, unknowns)

    def _initial_cost(
        self, start: GraphState, ranges: ExpandedRanges, arguments: RangeArguments
    ) -> float:
        """
        Initial cost of the links used at the end; links without an arrival at the start have their
        final residual.
        """
        assert self._first is not None  # the model was evaluated at least once
        assert self._expansion is not None
        prediction, residual = self._first
        comparable = np.where(prediction.possible, residual, self._expansion(*arguments)[0])
        return self._factors.cost(start) + ranges.cost_of(comparable, self._loss)
