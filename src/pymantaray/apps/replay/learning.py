"""
Slow errors of water, positions and clocks, as Gauss-Markov processes that are learned from the
events: one-step-ahead predictions from earlier events, or predictions from all other events.
"""

from dataclasses import dataclass, fields, replace
from typing import NamedTuple, Self

import numpy as np
import pandas as pd

from pymantaray.apps.replay.draws import GRADIENT
from pymantaray.apps.replay.event_data import HOUR, ArrivalTracks, EventData
from pymantaray.apps.replay.options import PredictionOptions
from pymantaray.apps.replay.summary import pairs_of_depths
from pymantaray.arrays import Array, Indices
from pymantaray.estimation.filters.gauss_markov import (
    CLUTTER,
    CLUTTER_WIDTH,
    Alternatives,
    Estimate,
    GaussMarkovFilter,
    Processes,
    average_models,
    fuse,
)

_MEMORY = 24.0 * 3600.0  # s; of the arrivals of a pair
_FIRST_FIT = 8  # events before the first estimate of the sizes; each of the next doubles them
_MAX_FIT = 1000  # events of an estimate of the sizes, the latest
_STEPS = (2.7, 0.9, 0.45, 0.2)  # of the search, in logarithms
_SHARED = np.sqrt(0.5)  # half of the variance of the water is common to all pairs of depths
_SOUND_SPEED = 1450.0  # m/s, for sizes only
_DAY = 86400.0
PARTS = ("water", "position", "pair", "clock")
"""Parts of the learned correction of a travel time, in the order of `Design`."""


@dataclass(frozen=True)
class ErrorSizes:
    """
    Standard deviations and time scales of slow errors, and the error that nothing explains.

    Each field is positive; the defaults are where the search for the largest likelihood begins.
    """

    water: float = 4e-4
    """Constant relative error of the sound speed of a pair of depths."""
    water_varying: float = 4e-4
    water_hours: float = 6.0
    position_m: float = 0.7
    """Constant error of each horizontal coordinate of a node."""
    position_varying_m: float = 0.5
    position_hours: float = 8.0
    pair_m: float = 0.3
    """Varying error of a pair that neither water nor positions explain."""
    pair_hours: float = 3.0
    clock_s: float = 2e-4
    rate_s_per_day: float = 5e-5
    unexplained_s: float = 4e-4

    @classmethod
    def prior_of(cls, options: PredictionOptions) -> Self:
        """Return the defaults, or the errors of positions and sound speed of the options."""
        sizes = cls()
        if options.position_sigma > 0.0:
            sizes = replace(sizes, position_m=options.position_sigma)
        if options.sound_speed_sigma > 0.0:
            sizes = replace(sizes, water=options.sound_speed_sigma / _SOUND_SPEED)
        return sizes

    @property
    def logarithms(self) -> Array:
        """Natural logarithms of the fields."""
        return np.log([getattr(self, field.name) for field in fields(self)])

    @classmethod
    def from_logarithms(cls, values: Array) -> Self:
        """Return the sizes with some logarithms."""
        return cls(*np.exp(values).tolist())


LOG_SCALE = np.array([1.0, 1.0, 0.5, 1.0, 1.0, 0.5, 1.0, 0.5, 1.5, 1.5, 1.0])
"""Scales of the prior Cauchy distributions of the logarithms of `ErrorSizes`."""


class Design(NamedTuple):
    """Processes that contribute to the travel time of each event, and their factors."""

    names: pd.DataFrame
    """One row per process: its ``part``, ``name``, ``kind`` and ``unit``."""
    columns: Indices
    """(n_events, m)"""
    values: Array
    """Travel time per unit of the process (n_events, m). [s]"""
    part: Indices
    """Part of each of the m terms, an index of `PARTS`."""

    @classmethod
    def of(cls, events: pd.DataFrame, candidates: pd.DataFrame) -> Self:
        """
        Design of events.

        Parameters
        ----------
        events : pandas.DataFrame
            Events of a `Replay`.
        candidates : pandas.DataFrame
            As from `predict_draws`.
        """
        n = len(events)
        nodes = sorted(set(events["source"]) | set(events["receiver"]))
        pairs, pair = np.unique(events["pair"].to_numpy(dtype=str), return_inverse=True)
        depths, depth = pairs_of_depths(events)
        names: list[tuple[str, str, str, str]] = []
        columns: list[Indices] = []
        values: list[Array] = []
        part: list[int] = []

        def add(
            what: tuple[str, str, str], labels: list[str], terms: list[tuple[Indices, Array]]
        ) -> None:
            """Add one process per label, and its terms."""
            first = len(names)
            names.extend((what[0], label, what[1], what[2]) for label in labels)
            for index, factor in terms:
                columns.append(first + index)
                values.append(factor)
                part.append(PARTS.index(what[0]))

        # water: an error in proportion to the travel time
        travel_time = _mean_of(candidates, "travel_time_s", n)
        nothing = np.zeros(n, dtype=np.int64)
        for kind in ("water", "water_varying"):
            add(("water", kind, "1"), ["all"], [(nothing, -_SHARED * travel_time)])
            add(("water", kind, "1"), depths, [(depth, -_SHARED * travel_time)])
        # positions: errors along the bearing, opposite at both ends
        ends = [np.searchsorted(nodes, events[end]) for end in ("receiver", "source")]
        signs = (1.0, -1.0)
        along = _mean_of(candidates, GRADIENT[0], n)
        bearing = np.radians(events["bearing_deg"].to_numpy())
        is_other = (events["source"] != events["receiver"]).to_numpy(dtype=float)
        for kind in ("position", "position_varying"):
            for axis, cosine in (("north", np.cos(bearing)), ("east", np.sin(bearing))):
                labels = [f"{node} {axis}" for node in nodes]
                factor = is_other * along * cosine
                terms = [(end, sign * factor) for end, sign in zip(ends, signs, strict=True)]
                add(("position", kind, "m"), labels, terms)
        # pairs: a constant error of the distance
        add(("pair", "pair", "m"), list(pairs), [(pair, along)])
        # clocks: offset and rate
        days = (events["time_s"] - 0.5 * (events["time_s"].min() + events["time_s"].max())) / _DAY
        for kind, factor in (("clock", np.ones(n)), ("rate", days.to_numpy())):
            terms = [(end, sign * is_other * factor) for end, sign in zip(ends, signs, strict=True)]
            add(("clock", kind, "s" if kind == "clock" else "s/d"), nodes, terms)
        table = pd.DataFrame(names, columns=["part", "name", "kind", "unit"])
        return cls(table, np.stack(columns, 1), np.stack(values, 1), np.array(part))

    @property
    def water(self) -> tuple[list[str], Array]:
        """
        Pairs of depths, and the relative error of their sound speeds by the processes: a matrix
        with one row per pair of depths.
        """
        water = self.names[self.names["part"] == "water"]
        depths = [name for name in water["name"].unique() if name != "all"]
        weights = np.zeros((len(depths), len(self.names)))
        for row, depth in enumerate(depths):
            weights[row, water.index[water["name"].isin(["all", depth])]] = _SHARED
        return depths, weights

    def processes(self, sizes: ErrorSizes) -> Processes:
        """Processes with some sizes."""
        constant = np.inf
        of_kind = {
            "water": (sizes.water, constant),
            "water_varying": (sizes.water_varying, sizes.water_hours * HOUR),
            "position": (sizes.position_m, constant),
            "position_varying": (sizes.position_varying_m, sizes.position_hours * HOUR),
            "pair": (sizes.pair_m, sizes.pair_hours * HOUR),
            "clock": (sizes.clock_s, constant),
            "rate": (sizes.rate_s_per_day, constant),
        }
        sigma, time_scale = np.array([of_kind[kind] for kind in self.names["kind"]]).T
        return Processes(sigma, time_scale)


def _mean_of(candidates: pd.DataFrame, name: str, events: int) -> Array:
    """Mean of a column over the candidates of each event, 0 without any."""
    at = candidates["event"].to_numpy(dtype=np.int64)
    total = np.bincount(at, candidates[name].to_numpy(), minlength=events)
    return np.asarray(total / np.maximum(np.bincount(at, minlength=events), 1))


@dataclass(frozen=True, eq=False)
class LearningData(EventData):
    """Events with the slow errors that contribute to their travel times."""

    design: Design

    def alternatives(self, event: int, expected: Array, unexplained: float) -> Alternatives:
        """Explanations of the measured time of an event."""
        rows = self.rows(event)
        return Alternatives(
            self.measured[event] - self.candidate_time[rows],
            self.known_sigma[rows] ** 2 + unexplained**2,
            (1.0 - CLUTTER) * expected[rows],
            CLUTTER / CLUTTER_WIDTH,
        )


class Learned(NamedTuple):
    """Prediction of the slow errors of each event, without the event itself."""

    parts: Array
    """Part of the travel time of each event by each of `PARTS` (n_events, 4). [s]"""
    sigma: Array
    """Standard deviation of their sum. [s]"""
    expected: Array
    """Probability of each candidate before the measured time of its event is known."""
    log_likelihood: Array
    unexplained: Array
    """Of each event. [s]"""
    states: pd.DataFrame
    """Processes after the last event."""
    history: pd.DataFrame
    """Varying processes of the water at the end of each hour."""
    sizes: ErrorSizes
    no_error_after: float
    """Probability after the last event that water, positions and clocks are as stated."""


def learn_causally(data: LearningData, prior: ErrorSizes, persistence: float) -> Learned:
    """
    Predict every event from earlier events only.

    Sizes of the errors are those with the largest posterior density, given one-step-ahead
    predictions of earlier events. They are estimated after eight events, and again whenever the
    number of events has doubled. Predictions are averaged with those of a model without slow
    errors, weighted by the likelihoods of both for the earlier events (Bayesian model averaging).
    """
    n = data.time.size
    tracks = ArrivalTracks(persistence, _MEMORY)
    parts = np.zeros((n, len(PARTS)))
    spread = np.zeros(n)
    unexplained = np.full(n, prior.unexplained_s)
    log_likelihood = np.full(n, np.nan)
    expected = data.prior.copy()
    sizes = prior
    history = []
    ends_hour = data.ends_hour
    state = GaussMarkovFilter(data.design.processes(sizes), 0.0)
    no_error = 0.5  # probability that water, positions and clocks are as stated
    next_fit = _FIRST_FIT
    for k, event in enumerate(data.order.tolist()):
        # sizes of the errors from earlier events
        if k == next_fit:
            earlier = data.order[max(k - _MAX_FIT, 0) : k]
            sizes = fit_sizes(data, expected, earlier, prior, sizes)
            state = _run(data, expected, data.order[:k], sizes).state
            next_fit *= 2
        # prediction of the event
        state.advance(data.time[event])
        columns, values = data.design.columns[event], data.design.values[event]
        parts[event], spread[event] = _averaged_parts(data.design, event, state.estimate, no_error)
        unexplained[event] = sizes.unexplained_s
        candidates = data.candidates_of(event)
        expected[data.rows(event)] = tracks.expect(data.ways[event], candidates)
        alternatives = data.alternatives(event, expected, sizes.unexplained_s)
        # update by its measured time, as far as a candidate explains it
        outcome = state.update(columns, values, alternatives)
        log_likelihood[event], no_error = average_models(
            outcome.log_likelihood, _log_likelihood(alternatives, 0.0, 0.0), no_error
        )
        if outcome.probability.sum() > 0.5:  # else nothing explains it, and tracks go on
            tracks.learn(data.ways[event], candidates, outcome.probability)
        if ends_hour[event]:
            history.append(_water(data.design, data.time[event], state))
    return Learned(
        parts,
        spread,
        expected,
        log_likelihood,
        unexplained,
        _states(data.design, state),
        pd.concat(history, ignore_index=True) if history else pd.DataFrame(),
        sizes,
        no_error,
    )


def learn_smoothly(
    data: LearningData, prior: ErrorSizes, persistence: float, causal: Learned
) -> Learned:
    """
    Predict every event from all other events, from predictions by earlier events only.

    A filter runs forwards and another one backwards; the estimate at an event is that of the first
    before it and of the second after it. Sizes are estimated from one-step-ahead predictions.
    """
    # sizes of the errors, and the filter that runs forwards
    last = data.order[-_MAX_FIT:]
    sizes = fit_sizes(data, causal.expected, last, prior, causal.sizes)
    no_error = causal.no_error_after
    processes = data.design.processes(sizes)
    forward = _run(data, causal.expected, data.order, sizes, keep=True)
    # the filter that runs backwards
    backward_tracks = ArrivalTracks(persistence, _MEMORY)
    backward_expected = data.prior.copy()
    state = GaussMarkovFilter(processes, data.time[data.order[-1]] if data.order.size else 0.0)
    parts = np.zeros_like(causal.parts)
    spread = np.zeros(data.time.size)
    expected = causal.expected.copy()
    log_likelihood = causal.log_likelihood.copy()
    history = []
    ends_hour = data.ends_hour
    for event, before in zip(data.order[::-1].tolist(), forward.before[::-1], strict=True):
        rows = data.rows(event)
        state.advance(data.time[event])
        columns, values = data.design.columns[event], data.design.values[event]
        # prediction by both filters
        both = fuse(before, state.estimate, processes)
        parts[event], spread[event] = _averaged_parts(data.design, event, both, no_error)
        candidates = data.candidates_of(event)
        backward_expected[rows] = backward_tracks.expect(data.ways[event], candidates)
        expected[rows] = 0.5 * (causal.expected[rows] + backward_expected[rows])
        alternatives = data.alternatives(event, expected, sizes.unexplained_s)
        log_likelihood[event] = _log_likelihood(
            alternatives, parts[event].sum(), spread[event] ** 2
        )
        # update of the second filter
        outcome = state.update(
            columns, values, data.alternatives(event, backward_expected, sizes.unexplained_s)
        )
        if outcome.probability.sum() > 0.5:
            backward_tracks.learn(data.ways[event], candidates, outcome.probability)
        if ends_hour[event]:
            history.append(_water(data.design, data.time[event], both))
    return causal._replace(
        parts=parts,
        sigma=spread,
        expected=expected,
        log_likelihood=log_likelihood,
        unexplained=np.full(data.time.size, sizes.unexplained_s),
        states=_states(data.design, forward.state),
        history=pd.concat(history[::-1], ignore_index=True),
        sizes=sizes,
    )


def fit_sizes(
    data: LearningData, expected: Array, rows: Indices, prior: ErrorSizes, start: ErrorSizes
) -> ErrorSizes:
    """
    Sizes with the largest posterior density from one-step-ahead predictions of some events.

    The probabilities of candidates stay fixed. The prior of the logarithm of a size is a Cauchy
    distribution, because an error may be absent. One size changes at a time, by steps that become
    smaller: upwards as long as the density increases, for errors of many times the usual ones, and
    downwards by one step, because a few events may show none by chance.
    """

    def score(logarithms: Array) -> float:
        sizes = ErrorSizes.from_logarithms(logarithms)
        off = (logarithms - prior.logarithms) / LOG_SCALE
        return _run(data, expected, rows, sizes).log_likelihood - float(np.log1p(off**2).sum())

    best = start.logarithms
    highest = score(best)
    for step in _STEPS:
        for moved in step * np.eye(best.size):
            before = highest
            while (value := score(best + moved)) > highest:
                best, highest = best + moved, value
            if highest == before and (value := score(best - moved)) > highest:
                best, highest = best - moved, value
    return ErrorSizes.from_logarithms(best)


def _averaged_parts(
    design: Design, event: int, estimate: Estimate, no_error: float
) -> tuple[Array, float]:
    """Parts of the travel time of an event, averaged with zero, and the sigma of their sum."""
    columns, values = design.columns[event], design.values[event]
    terms = np.bincount(design.part, values * estimate.mean[columns], minlength=len(PARTS))
    variance = float(values @ estimate.covariance[np.ix_(columns, columns)] @ values)
    total = max(variance, 0.0) + no_error * terms.sum() ** 2
    return np.asarray((1.0 - no_error) * terms), float(np.sqrt((1.0 - no_error) * total))


class _Run(NamedTuple):
    """Filter that has seen some events."""

    state: GaussMarkovFilter
    log_likelihood: float
    before: list[Estimate]
    """Estimate before each event, if they are kept."""


def _run(
    data: LearningData, expected: Array, rows: Indices, sizes: ErrorSizes, *, keep: bool = False
) -> _Run:
    """Filter some events in turn with some sizes; the probabilities of candidates are fixed."""
    begin = data.time[rows[0]] if rows.size else 0.0
    state = GaussMarkovFilter(data.design.processes(sizes), begin)
    total = 0.0
    before = []
    for event in rows.tolist():
        state.advance(data.time[event])
        if keep:
            before.append(state.estimate)
        alternatives = data.alternatives(event, expected, sizes.unexplained_s)
        columns, values = data.design.columns[event], data.design.values[event]
        total += state.update(columns, values, alternatives).log_likelihood
    return _Run(state, total, before)


def _log_likelihood(alternatives: Alternatives, mean: float, variance: float) -> float:
    """Log likelihood of a measurement with a predicted mean and variance of the slow errors."""
    total = alternatives.variance + variance
    fits = np.exp(-0.5 * (alternatives.residual - mean) ** 2 / total)
    density = alternatives.probability * fits / np.sqrt(2.0 * np.pi * total)
    return float(np.log(density.sum() + alternatives.density))


def _states(design: Design, state: GaussMarkovFilter) -> pd.DataFrame:
    """Value and standard deviation of each process."""
    sigma = np.sqrt(np.maximum(np.diag(state.covariance), 0.0))
    return design.names.assign(value=state.mean, sigma=sigma, prior_sigma=state.processes.sigma)


def _water(design: Design, time: float, state: GaussMarkovFilter | Estimate) -> pd.DataFrame:
    """Relative error of the sound speed of each pair of depths at a time, and its sigma."""
    names, weights = design.water
    variance = np.einsum("ij,jk,ik->i", weights, state.covariance, weights)
    return pd.DataFrame(
        {
            "time_h": time / HOUR,
            "depths": names,
            "relative_error": weights @ state.mean,
            "sigma": np.sqrt(np.maximum(variance, 0.0)),
        }
    )
