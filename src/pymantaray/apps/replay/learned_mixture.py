"""Mixture whose candidates are corrected by learned errors, beside arrivals that are followed."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.apps.replay.baselines import horizon_of, last_measured
from pymantaray.apps.replay.event_data import HOUR, Components
from pymantaray.apps.replay.followed import Followed, follow
from pymantaray.apps.replay.learning import (
    PARTS,
    Design,
    ErrorSizes,
    Learned,
    LearningData,
    learn_causally,
    learn_smoothly,
)
from pymantaray.apps.replay.mixture import (
    Mixture,
    earlier_width,
    first_detected,
    intervals,
    known_sigma,
    other_width,
)
from pymantaray.apps.replay.options import PredictionOptions
from pymantaray.arrays import Array, Indices
from pymantaray.estimation.filters.gauss_markov import CLUTTER

_ROUNDS = 50  # of the shares of passes
_MIN_EVENTS = 40  # with a similar time since the last one, for shares of their own


class LearnedMixture(NamedTuple):
    """Mixture with learned errors of water, positions and clocks, and with followed arrivals."""

    mixture: Mixture
    learned: Learned
    followed: pd.DataFrame
    """Arrivals that are followed, as `Followed.arrivals`, of all passes."""


class _Pass(NamedTuple):
    """Predictions of all events from some of the others."""

    learned: Learned
    candidates: Components
    followed: Followed

    @property
    def density(self) -> Array:
        """Probability density of the measured time of each event, 0 without a prediction."""
        return np.nan_to_num(np.exp(self.followed.log_likelihood), nan=0.0)


def learn_mixture(
    events: pd.DataFrame,
    candidates: pd.DataFrame,
    options: PredictionOptions,
    *,
    persistence: float,
    merit_db: float | None = None,
) -> LearnedMixture:
    """
    Predict each event by a mixture of candidates, corrected by learned errors, and of arrivals that
    are followed.

    Parameters
    ----------
    events, candidates, options, persistence, merit_db
        As in `predict_mixture`. The errors of positions and sound speed of the options are those
        with which learning begins.

    Returns
    -------
    LearnedMixture

    Notes
    -----
    The water, the positions and the clocks err by Gauss-Markov processes (`ErrorSizes`), which a
    Kalman filter estimates from event to event; `follow` adds persistence. With ``causal``, a
    prediction uses only earlier events; with ``smooth``, all but the event itself: it is a mixture
    of predictions from earlier events, from later ones, and from the fused state of both, whose
    shares are those with the largest likelihood of the events of even hours for odd hours and vice
    versa, by the time since the last event of the way. The probability of an interval is that which
    covered 95 % of the earlier events with a similar time since the last event of the way; with
    ``smooth``, of those of the other hours.
    """
    without = replace(options, position_sigma=0.0, sound_speed_sigma=0.0)
    known = known_sigma(events, candidates, without)
    prior = first_detected(candidates, merit_db)
    time = events["time_s"].to_numpy(dtype=float)
    horizon = horizon_of(last_measured(events)["elapsed_s"].to_numpy())

    def predict(seen: pd.DataFrame, earlier: Learned | None = None) -> _Pass:
        design = Design.of(seen, candidates)
        data = LearningData.of(seen, candidates, known, prior, design=design)
        sizes = ErrorSizes.prior_of(options)
        if earlier is None:
            learned = learn_causally(data, sizes, persistence)
        else:
            learned = learn_smoothly(data, sizes, persistence, earlier)
        at = candidates["event"].to_numpy(dtype=np.int64)
        components = Components(
            at,
            candidates["travel_time_s"].to_numpy() + learned.parts.sum(axis=1)[at],
            np.sqrt(known**2 + (learned.unexplained**2 + learned.sigma**2)[at]),
            learned.expected,
        )
        return _Pass(learned, components, follow(seen, components))

    forward = predict(events)
    if options.learn == "smooth":
        even = (np.floor(time / HOUR) % 2) == 0
        backward = predict(events.assign(time_s=-time))
        passes = [predict(events, forward.learned), forward, backward]
        density = np.stack([one.density for one in passes], axis=1)
        shares = _shares_of_others(density, even, horizon)
        return _combined(events, candidates, passes, shares, partial(other_width, even, horizon))
    width_of = partial(earlier_width, np.argsort(time, kind="stable"), horizon)
    return _combined(events, candidates, [forward], np.ones((len(events), 1)), width_of)


def _combined(
    events: pd.DataFrame,
    candidates: pd.DataFrame,
    passes: Sequence[_Pass],
    shares: Array,
    width_of: Callable[[Array], Array | float],
) -> LearnedMixture:
    """Mixture of the predictions of passes by their shares (n_events, n_passes)."""
    learned = passes[0].learned
    parts = _averaged([one.learned.parts for one in passes], shares)
    components, arrivals = [], []
    for one, share in zip(passes, shares.T, strict=True):
        components.append(one.followed.components.scaled(share))
        probability = one.followed.arrivals["probability"] * share[one.followed.arrivals["event"]]
        arrivals.append(one.followed.arrivals.assign(probability=probability))
    table = intervals(events, Components.joined(components), width_of, CLUTTER)
    density = _averaged([one.density for one in passes], shares)
    columns = {f"learned_{name}_s": parts[:, k] for k, name in enumerate(PARTS)}
    with np.errstate(divide="ignore"):
        log_likelihood = np.where(density > 0.0, np.log(density), np.nan)
    at = candidates["event"].to_numpy(dtype=np.int64)
    center = candidates["travel_time_s"].to_numpy() + parts.sum(axis=1)[at]
    second = [one.candidates.sigma**2 + (one.candidates.time - center) ** 2 for one in passes]
    by_candidate = [one.candidates.probability * one.followed.modelled[at] for one in passes]
    mixture = Mixture(
        table.assign(log_likelihood=log_likelihood, **columns),
        _averaged(by_candidate, shares[at]),
        np.sqrt(_averaged(second, shares[at])),
        float(learned.sizes.unexplained_s),
    )
    followed = pd.concat(arrivals).sort_values(["event", "travel_time_s"], ignore_index=True)
    return LearnedMixture(mixture, learned._replace(parts=parts), followed)


def _averaged(values: Sequence[Array], shares: Array) -> Array:
    """Mean of the values of passes by their shares (n, n_passes)."""
    total = 0.0
    for value, share in zip(values, shares.T, strict=True):
        total = total + (value.T * share).T
    return np.asarray(total)


def _shares_of_others(density: Array, even: NDArray[np.bool_], group: Indices) -> Array:
    """
    Share of each pass, from the densities (n_events, n_passes) of the events of a group in even
    hours for odd hours, and vice versa; 0 for a pass without a prediction of an event.
    """
    shares = np.empty_like(density)
    has = density > 0.0
    for mine in (even, ~even):
        others = ~mine & has.all(axis=1)
        for number in np.unique(group[mine]).tolist():
            same = others & (group == number)
            members = same if same.sum() >= _MIN_EVENTS else others
            shares[mine & (group == number)] = _most_likely_shares(density[members])
    shares = shares * has
    return np.asarray(shares / np.maximum(shares.sum(axis=1, keepdims=True), 1e-300))


def _most_likely_shares(density: Array) -> Array:
    """Shares of passes with the largest likelihood of some events; equal ones without events."""
    share = np.full(density.shape[1], 1.0 / density.shape[1])
    for _ in range(_ROUNDS if len(density) else 0):
        by_pass = density * share
        share = (by_pass / by_pass.sum(axis=1, keepdims=True)).mean(axis=0)
    return np.asarray(share)
