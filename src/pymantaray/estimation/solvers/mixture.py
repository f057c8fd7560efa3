"""
Ranges of a max-mixture: pick the most probable candidate of each range, solve the graph with the
picks, and repeat.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.ranges.candidates import CandidateArrivals, CandidateModel, of_picks
from pymantaray.estimation.ranges.expansion import Expansion, RangeWeights
from pymantaray.estimation.ranges.picks import (
    NONE,
    Chains,
    EpochMixture,
    RangeChoice,
    best_picks,
    choices,
    fits,
    graduated_fits,
    predicted,
    probabilities,
)
from pymantaray.estimation.ranges.range_models import ModelRanges, Prediction, RangeEndpoints, Rows
from pymantaray.estimation.solvers.normal_equations import SIZE
from pymantaray.estimation.solvers.optimize import LastStep, Optimum, optimize
from pymantaray.estimation.solvers.outer import BatchOutcome, OuterIterations, RangeArguments
from pymantaray.estimation.solvers.problems import ExpandedRanges, GraphState, Problem, ProblemCache
from pymantaray.estimation.solvers.solution import SolveOptions

_FORWARD_TOLERANCE = 1e-2  # m, rad; of a solve before the next ping is added


class PickedWeights(RangeWeights):
    """
    Covariances of the residuals of each epoch, with the variances of the travel times of the picks.
    """

    def add(self, added: Array) -> None:
        """Replace the variances of the travel times of all picks. [m²]"""
        total = self._variance + added
        self._full = [np.diag(total[rows]) for rows in self.rows]


class MixtureIterations(OuterIterations):
    r"""
    Minimize the cost of a graph whose ranges are max-mixtures of candidates.

    A range of which candidate k has the weight :math:`w_k`, the residual :math:`r_k` and the
    variance :math:`v_k` costs

    .. math:: \min_k \left( \frac{r_k^2}{2 v_k} + \frac12 \log v_k - \log w_k \right)

    over its candidates and the possibility that it belongs to none of them. With persistence the
    minimum is over the sequences of candidates of an ordered pair. Picks and positions are
    minimized in turns, so that the cost decreases. Ranges without a pick are gated.

    The start is found on line: ping by ping, from the optimum of the graph without ranges, each
    ping by graduated mixtures from the positions that the earlier pings predict. Then each ping is
    picked again from the positions that all other pings predict.
    """

    def __init__(
        self, cache: ProblemCache, graph: FactorGraph, model_ranges: ModelRanges, poses: Indices
    ) -> None:
        super().__init__(cache, graph, model_ranges, None, poses)
        model = model_ranges.model
        assert isinstance(model, CandidateModel)  # the caller checks
        if model_ranges.uncertainty is not None:
            raise EstimationError(
                "a mixture of candidates has its own variances; remove the uncertainty of travel"
                " times"
            )
        self._graph = graph
        self._model = model
        self._variance = np.array(graph["range"].variance)
        self._weights = self._picked_weights = PickedWeights(model_ranges, self._variance)
        landmarks = graph.vehicle_name.size + np.arange(graph.landmark_name.size)
        owner = np.concatenate([graph.pose_vehicle, landmarks]).astype(np.intp)
        self._chains = Chains.of(model_ranges.ranges, owner, model.mixture.persistence)

    def solve(self, initial: GraphValues, options: SolveOptions) -> BatchOutcome:
        """Solve from the on-line estimate, which starts from these values."""
        self._initial = GraphState.of(initial, self._model_ranges.n_unknowns)
        return super().solve(self._online(self._initial, options).values(self._graph), options)

    def _predict(self, links: RangeEndpoints, unknowns: Array) -> tuple[Prediction, Array]:
        """Predict the most probable sequence of candidates at the links."""
        candidates = self._candidates(links, self._rows, unknowns)
        each = choices(candidates.table, candidates.fit, self._variance, self._model.mixture)
        picks = best_picks(each, self._chains)
        self._picked_weights.add(candidates.added(picks))
        return of_picks(candidates.prediction, picks), candidates.by(picks)

    def _candidates(self, links: RangeEndpoints, rows: Rows, unknowns: Array) -> "_Candidates":
        """Candidates of some ranges at their links."""
        table = self._model.candidates(links)
        row = table.row
        n = table.row.size
        prediction = table.prediction
        by_unknowns = np.empty((n, 0))
        of_candidates = RangeEndpoints(*(column[row] for column in links))
        if self._model_ranges.unknowns is not None:
            prediction, by_unknowns = self._model_ranges.unknowns.applied(
                prediction, of_candidates, rows[row], unknowns
            )
        travel_time = self._model_ranges.ranges.travel_time[rows][row]
        residual = of_candidates.sound_speed * (prediction.travel_time - travel_time)
        smallest = self._variance[rows][row]
        variance = smallest + (of_candidates.sound_speed * table.sigma) ** 2
        fit = fits(residual, variance, smallest)
        expansion = Expansion(prediction, of_candidates, travel_time, unknowns, by_unknowns)
        return _Candidates(table, prediction, by_unknowns, variance, smallest, fit, expansion)

    def _initial_cost(
        self, _start: GraphState, ranges: ExpandedRanges, _arguments: RangeArguments
    ) -> float:
        """Cost of the given start with the final picks."""
        return self._factors.cost(self._initial) + ranges.cost(self._initial, None)

    def _online(self, state: GraphState, options: SolveOptions) -> GraphState:
        """
        State after all pings were added one by one and then picked again; the given one if the
        graph is singular without ranges.
        """
        n = self._model_ranges.ranges.time.size
        earlier_picks = _Picks(n, state.shared.size)
        known: list[tuple[RangeChoice, Array] | None] = [None] * n
        limits = replace(options, step_tolerance=max(_FORWARD_TOLERANCE, options.step_tolerance))
        end = self._solve_picks(earlier_picks, state, limits)
        epochs = self._picked_weights.rows
        for number, rows in enumerate([*epochs, *epochs]):
            if number >= len(epochs):  # again, from what all other pings predict
                earlier_picks.prediction.possible[rows] = False
                end = self._solve_picks(earlier_picks, end.state, limits)
            if end.last is None or not rows.size:
                return state
            self._pick_epoch(rows, end.state, end.last, earlier_picks, known)
            end = self._solve_picks(earlier_picks, end.state, limits)
        return (
            end.state
            if np.isfinite(end.progress.final_cost) and not end.progress.singular
            else state
        )

    def _solve_picks(
        self, earlier_picks: "_Picks", state: GraphState, options: SolveOptions
    ) -> Optimum:
        """Optimum of the graph with the picks of the pings so far."""
        timed = self._model_ranges.ranges
        expansion = earlier_picks.expansion(
            timed.links(earlier_picks.transmitter, earlier_picks.receiver), timed.travel_time
        )
        self._picked_weights.add(earlier_picks.added)
        ranges = ExpandedRanges(
            timed, self._weights.blocks(earlier_picks.prediction.possible), expansion, self._shared
        )
        return optimize(Problem(self._factors, ranges, self._structure), state, options)

    def _pick_epoch(
        self,
        rows: Rows,
        state: GraphState,
        last: LastStep,
        earlier_picks: "_Picks",
        known: list[tuple[RangeChoice, Array] | None],
    ) -> None:
        """
        Pick the candidates of the ranges of one epoch from the state that earlier epochs predict.
        """
        timed = self._model_ranges.ranges
        mixture = self._model.mixture
        ends, at = np.unique(
            np.concatenate([timed.transmitter[rows], timed.receiver[rows]]), return_inverse=True
        )
        position = state.position[ends]
        one = at[: rows.size]
        other = at[rows.size :]
        links = RangeEndpoints(
            timed.time[rows], position[one], position[other], timed.sound_speed[rows]
        )
        candidates = self._candidates(links, rows, state.shared)
        row = candidates.table.row
        before = self._priors(
            choices(candidates.table, candidates.fit, self._variance[rows], mixture), rows, known
        )
        epoch = EpochMixture(
            expansion=candidates.expansion,
            transmitter=one[row],
            receiver=other[row],
            position=position,
            unknowns=state.shared,
            covariance=self._covariance(last, ends, state.shared.size),
            row=row,
            variance=candidates.variance,
            smallest=candidates.smallest,
            weight=np.concatenate([np.empty(0), *(choice.prior[:-1] for choice in before)]),
            null=np.array([choice.prior[-1] * np.exp(-choice.fit[-1]) for choice in before]),
        )
        fit = graduated_fits(epoch, mixture.gate)
        picks = np.full(rows.size, NONE)
        for i, choice in enumerate(before):
            own = choice._replace(fit=np.append(fit[choice.candidate[:-1]], choice.fit[-1]))
            share = probabilities(own)
            known[int(rows[i])] = own, share
            picks[i] = own.candidate[share.argmax()]
        earlier_picks.add(rows, links, candidates, picks, state.shared)

    def _covariance(self, last: LastStep, ends: Indices, n_unknowns: int) -> Array:
        """
        Covariance of the positions of some variables and of the unknowns, before the next ping.
        """
        (joint,) = last.factor.inverse([np.concatenate([ends, self._shared])])
        positions = (SIZE * np.arange(ends.size)[:, None] + np.arange(3, SIZE)).ravel()
        at = np.concatenate([positions, SIZE * ends.size + np.arange(n_unknowns)])
        return np.asarray(joint[np.ix_(at, at)])

    def _priors(
        self, each: list[RangeChoice], rows: Rows, known: list[tuple[RangeChoice, Array] | None]
    ) -> list[RangeChoice]:
        """
        Choices of ranges with the probabilities that follow from the previous ranges of their
        ordered pairs.
        """
        out = []
        for choice, row in zip(each, rows.tolist(), strict=True):
            before = int(self._chains.previous[row])
            earlier = known[before] if before >= 0 else None
            out.append(
                choice
                if earlier is None
                else predicted(choice, *earlier, float(self._chains.stay[row]))
            )
        return out


class _Candidates(NamedTuple):
    """Candidates of some ranges, with their residuals at the estimate."""

    table: CandidateArrivals
    prediction: Prediction  # with the unknowns
    by_unknowns: Array  # (n, n_unknowns) [s]
    variance: Array  # of each residual [m²]
    smallest: Array  # variance of the range in an exact ocean [m²]
    fit: Array
    expansion: Expansion

    def added(self, picks: Rows) -> Array:
        """Variance that the ocean adds to each range. [m²]"""
        return np.asarray(np.append(self.variance - self.smallest, 0.0)[picks])

    def by(self, picks: Rows) -> Array:
        """Derivatives of the picked travel times by the unknowns, zero for none."""
        return np.concatenate([self.by_unknowns, np.zeros((1, self.by_unknowns.shape[1]))])[picks]


class _Picks:
    """
    Picks of the pings so far, expanded where they were made; their travel times are those for
    unknowns of zero.
    """

    def __init__(self, n: int, n_unknowns: int) -> None:
        self.prediction = Prediction(
            np.full(n, np.nan),
            np.full((n, 3), np.nan),
            np.full((n, 3), np.nan),
            np.zeros(n, dtype=bool),
            np.zeros(n, dtype=np.intp),
        )
        self.added = np.zeros(n)
        self.transmitter = np.zeros((n, 3))
        self.receiver = np.zeros((n, 3))
        self._by_unknowns = np.zeros((n, n_unknowns))

    def add(
        self,
        rows: Rows,
        links: RangeEndpoints,
        candidates: _Candidates,
        picks: Rows,
        unknowns: Array,
    ) -> None:
        """Add the picks of one epoch."""
        prediction = of_picks(candidates.prediction, picks)
        by = candidates.by(picks)
        prediction = prediction._replace(travel_time=prediction.travel_time - by @ unknowns)
        self.prediction.put(rows, prediction)
        self.added[rows] = candidates.added(picks)
        self.transmitter[rows] = links.transmitter
        self.receiver[rows] = links.receiver
        self._by_unknowns[rows] = by

    def expansion(self, links: RangeEndpoints, travel_time: Array) -> Expansion:
        """Residuals of the picks near the links at which they were made."""
        zero = np.zeros(self._by_unknowns.shape[1])
        return Expansion(self.prediction, links, travel_time, zero, self._by_unknowns)
