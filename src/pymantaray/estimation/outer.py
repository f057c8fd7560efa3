"""Outer iterations: travel times of a range model, expanded about the estimate and expanded again where it moved."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.expansion import Expansion, RangeWeights
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.marginals import epoch_groups
from pymantaray.estimation.normal_equations import SIZE, Indices
from pymantaray.estimation.optimize import Optimum
from pymantaray.estimation.problems import ExpandedRanges, Problem, ProblemCache, State
from pymantaray.estimation.range_models import BelievedRanges, Prediction
from pymantaray.estimation.robust import optimize_robust
from pymantaray.estimation.solution import Progress, SolveOptions

Array = NDArray[np.float64]
_CORRECTION = 1e-3  # m; a range that a new prediction moves by less has settled
_FIRST_TOLERANCE = 0.1  # m; the first expansion is left early, for the next one is better
_MOST = 25  # expansions
_RETURNS = 2  # a link gated so many times stays gated
_PATIENT = 8  # expansions after which links that are still corrected are gated
_RESTLESS = 0.3  # of the largest correction, for smaller ones follow from it
_FEW = 0.05  # of the links, gated at a time


@dataclass(frozen=True, eq=False)
class Outcome:
    """End of a batch solve, with ranges as distances or of a model."""

    optimum: Optimum
    problem: Problem  # what has its optimum there
    groups: list[Indices]  # whose covariances are wanted
    possible: NDArray[np.bool_] | None = None  # whether each range was used; the others were gated
    expansions: int = 0


class OuterIterations:
    """
    Minimize the cost of a graph whose ranges are a model's.

    The model is asked at the estimate, the travel times are expanded there (`Expansion`), the graph is
    solved, and so on until a new prediction moves no range by more than 1 mm. A link that is not possible is
    gated until the next estimate, and for good after two times, so that the set of links settles; so are, after 8
    expansions, those that are corrected most: their first arrival is now of one family of rays, now of another.
    """

    def __init__(
        self,
        cache: ProblemCache,
        graph: FactorGraph,
        believed: BelievedRanges,
        loss: Loss | None,
        poses: Indices,
    ) -> None:
        _check_rows(graph, believed)
        if loss is not None and believed.correlated:
            raise EstimationError(
                "a robust loss on correlated ranges: each has a loss of its own; leave one of them out"
            )
        self._believed, self._loss = believed, loss
        r, n = believed.ranges, graph.n_variables
        self._shared = n + np.arange(-(-believed.n_unknowns // SIZE))
        self._factors = cache.factors(graph)
        self.groups = epoch_groups(poses, graph["range"].variables, graph.n_poses, self._shared)
        ends = np.stack([r.transmitter, r.receiver], axis=1)
        epochs = [np.unique(ends[r.epoch == e]) for e in range(int(r.epoch.max(initial=-1)) + 1)]
        cliques = [*self.groups, *(np.concatenate([e, self._shared]) for e in epochs)]
        self._structure = cache.structure(n + self._shared.size, self._factors.pairs, cliques)
        self._weights = RangeWeights(believed, graph["range"].variance)
        self._rows = np.arange(r.time.size)
        self._used, self._gated = np.ones(r.time.size, dtype=bool), np.zeros(r.time.size, dtype=int)
        self._expansion: Expansion | None = None
        self._first: tuple[Prediction, Array] | None = None

    def solve(self, initial: GraphValues, options: SolveOptions) -> Outcome:
        """Outcome from a start; if the expansions do not settle its last step is NaN, which no gate passes."""
        start, loss = State.of(initial, self._believed.n_unknowns), self._loss
        end, ranges, problem = Optimum(start, Progress(0, np.nan, np.nan)), None, None
        iterations, count, settled = 0, 0, False
        while True:
            place = self._ends(end.state)
            if self._expansion is not None and count > 1 and self._expansion.is_good_at(*place):
                settled = True
                break
            if count == _MOST:
                break
            expansion = self._ask(place, count)
            if expansion is None:
                settled = True
                break
            self._expansion = expansion
            blocks = self._weights.blocks(self._used)
            ranges = ExpandedRanges(self._believed.ranges, blocks, expansion, self._shared)
            if loss is not None and count:
                loss = replace(loss, graduated=False)  # only about the first expansion
            problem = Problem(self._factors, ranges, self._structure, loss)
            tolerance = options.step_tolerance if count else max(options.step_tolerance, _FIRST_TOLERANCE)
            end = optimize_robust(problem, end.state, replace(options, step_tolerance=tolerance))
            iterations, count = iterations + end.progress.iterations, count + 1
            if end.progress.singular or not np.isfinite(end.progress.final_cost):
                break
        assert problem is not None  # the model was asked once at least
        assert ranges is not None
        cost = self._initial_cost(start, ranges, place)
        progress = replace(end.progress, iterations=iterations, initial_cost=cost)
        if not settled:
            progress = replace(progress, last_step=np.nan)
        return Outcome(end._replace(progress=progress), problem, self.groups, self._used, count)

    def _ends(self, state: State) -> tuple[Array, Array, Array]:
        r = self._believed.ranges
        return state.place[r.transmitter], state.place[r.receiver], state.shared

    def _ask(self, place: tuple[Array, Array, Array], count: int) -> Expansion | None:
        """Ask the model, and gate: an expansion, or None if nothing has changed."""
        r = self._believed.ranges
        a, b, u = place
        links = r.links(a, b)
        prediction, by_unknowns = self._believed.predict(links, self._rows, u)
        self._gated += self._used & ~prediction.possible
        before, self._used = self._used, prediction.possible & (self._gated < _RETURNS)
        residual = r.sound_speed * (
            np.where(prediction.possible, prediction.travel_time, 0.0) - r.travel_time
        )
        if self._first is None:
            self._first = prediction, residual
        if self._expansion is not None:
            both = self._used & before
            off = np.where(both, np.abs(residual - self._expansion(a, b, u)[0]), 0.0)
            largest = float(off.max(initial=0.0))
            if count > 1 and np.array_equal(self._used, before) and largest <= _CORRECTION:
                return None
            if count >= _PATIENT and largest > _CORRECTION:
                restless = off >= _RESTLESS * largest
                if np.count_nonzero(restless) <= _FEW * np.count_nonzero(self._used):
                    self._gated[restless], self._used = _RETURNS, self._used & ~restless
        self._weights.at(links)
        return Expansion(prediction, links, r.travel_time, u, by_unknowns)

    def _initial_cost(self, start: State, ranges: ExpandedRanges, place: tuple[Array, Array, Array]) -> float:
        """Cost at the start of the links used in the end; those not possible at the start count as they end."""
        assert self._first is not None  # the model was asked once at least
        assert self._expansion is not None
        prediction, residual = self._first
        comparable = np.where(prediction.possible, residual, self._expansion(*place)[0])
        return self._factors.cost(start) + ranges.cost_of(comparable, self._loss)


def _check_rows(graph: FactorGraph, believed: BelievedRanges) -> None:
    ends = np.stack([believed.ranges.transmitter, believed.ranges.receiver], axis=1)
    rows = graph["range"].variables
    if not np.array_equal(np.sort(ends, axis=1), np.sort(rows, axis=1)):
        raise EstimationError(
            f"{len(ends)} timed ranges do not join the variables of the graph's {len(rows)} ranges; take"
            " both from the same measurements, ranges and links"
        )
