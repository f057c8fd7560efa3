"""
Picks of a mixture: the most probable candidate of each range and sequence of candidates of each
ordered pair, and picks of one ping from the predicted positions of its ends.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array, Mask
from pymantaray.estimation.ranges.candidates import CandidateArrivals, MixtureOptions
from pymantaray.estimation.ranges.expansion import Expansion
from pymantaray.estimation.ranges.range_models import Rows, TimedRanges
from pymantaray.geometry import stream

NONE = -1  # pick, and family, of a range that belongs to none of its candidates
_CONTROL_RATIO = 1.5  # ratio of the standard deviations of successive surrogates
_STEPS = 3  # re-weighted steps on each surrogate
_DRAWN_STARTS = 24  # descents from positions drawn from the prediction


def stay_probability(elapsed: float, persistence: float) -> float:
    """Probability that a receiver stays with its arrival for a time. [s]"""
    return float(np.exp(-elapsed / persistence))


class Chains(NamedTuple):
    """Successive ranges of each ordered pair."""

    previous: Rows  # row of the previous range of the same transmitter and receiver, -1 without one
    stay: Array  # probability that the receiver stays with its family of arrivals since then
    order: Rows  # rows in order of time

    @classmethod
    def of(cls, ranges: TimedRanges, owner: Rows, persistence: float) -> "Chains":
        """
        Chains of ranges between the owners of their variables; without persistence [s] no range has
        a previous one.
        """
        n = ranges.time.size
        previous = np.full(n, -1)
        stay = np.zeros(n)
        order = np.argsort(ranges.time, kind="stable")
        last: dict[tuple[int, ...], int] = {}
        pairs = np.stack([owner[ranges.transmitter], owner[ranges.receiver]], axis=1).tolist()
        for row in order.tolist() if persistence > 0.0 else ():
            pair = tuple(pairs[row])
            if pair in last:
                previous[row] = last[pair]
                stay[row] = stay_probability(
                    ranges.time[row] - ranges.time[last[pair]], persistence
                )
            last[pair] = row
        return cls(previous, stay, order)


def persist(same: ArrayLike, prior: Array, stay: ArrayLike) -> Array:
    """
    Probability of each arrival if the receiver stays with that of the range before with a
    probability, and otherwise picks as if for the first time.
    """
    return np.asarray(np.multiply(stay, same) + np.subtract(1.0, stay) * prior)


class RangeChoice(NamedTuple):
    """Alternatives of one range: each of its candidates and, last, none of them."""

    candidate: Rows
    # negative logarithm of the likelihood, relative to a residual of zero in an exact ocean
    fit: Array
    prior: Array  # probability before the range is measured
    family: Rows

    def follow(self, family: Rows, stay: float) -> Array:
        """
        Probability of each choice after each of some previous families, shape (n_previous, n).

        A receiver whose family has no arrival any more picks as if for the first time.
        """
        same = family[:, None] == self.family
        return np.asarray(
            np.where(same.any(axis=1)[:, None], persist(same, self.prior, stay), self.prior)
        )


def choices(
    candidates: CandidateArrivals, fit: Array, variance: Array, mixture: MixtureOptions
) -> list[RangeChoice]:
    """Choices of all ranges, whose variances are given [m²], from the fit of each candidate."""
    n = variance.size
    stop = np.searchsorted(candidates.row, np.arange(n), side="right").tolist()
    null = np.log(mixture.null_width / np.sqrt(2.0 * np.pi * variance)).tolist()
    weight = (1.0 - mixture.null_weight) * candidates.weight
    out = []
    for start, end, missed in zip([0, *stop[:-1]], stop, null, strict=True):
        alone = mixture.null_weight if end > start else 1.0
        out.append(
            RangeChoice(
                np.append(np.arange(start, end), NONE),
                np.append(fit[start:end], missed),
                np.append(weight[start:end], alone),
                np.append(candidates.family[start:end], NONE),
            )
        )
    return out


def fits(residual: Array, variance: Array, smallest: Array) -> Array:
    """
    Negative log-likelihood of residuals [m] with variances, relative to that of zero with the
    smallest variance. [m²]
    """
    return np.asarray(0.5 * residual**2 / variance + 0.5 * np.log(variance / smallest))


def best_picks(all_choices: list[RangeChoice], chains: Chains) -> Rows:
    """
    Most probable candidate of each range, NONE for none, as the most probable sequence of each
    chain (Viterbi).
    """
    costs: list[Array] = [np.empty(0)] * len(all_choices)
    came: list[Rows] = [np.empty(0, dtype=np.intp)] * len(all_choices)
    picked = np.full(len(all_choices), -1)  # number of the choice
    followed = np.zeros(len(all_choices), dtype=bool)
    for row in chains.order.tolist():
        choice = all_choices[row]
        before = int(chains.previous[row])
        if before < 0:
            costs[row] = choice.fit + _surprise(choice.prior)
            continue
        followed[before] = True
        step = _surprise(choice.follow(all_choices[before].family, float(chains.stay[row])))
        total = costs[before][:, None] + step
        came[row] = total.argmin(axis=0)
        costs[row] = choice.fit + total.min(axis=0)
    for row in chains.order[::-1].tolist():
        if not followed[row]:
            picked[row] = costs[row].argmin()
        if (before := int(chains.previous[row])) >= 0:
            picked[before] = came[row][picked[row]]
    return np.array(
        [c.candidate[k] for c, k in zip(all_choices, picked, strict=True)], dtype=np.intp
    )


def predicted(
    choice: RangeChoice, before: RangeChoice, probability: Array, stay: float
) -> RangeChoice:
    """Choice whose prior follows from the probabilities of the previous range's choices."""
    return choice._replace(prior=probability @ choice.follow(before.family, stay))


def probabilities(choice: RangeChoice) -> Array:
    """Probability of each choice by its fit; if all are impossible, the range belongs to none."""
    cost = choice.fit + _surprise(choice.prior)
    if np.isinf(cost.min()):
        return np.asarray(np.where(choice.candidate == NONE, 1.0, 0.0))
    share = np.exp(cost.min() - cost)
    return np.asarray(share / share.sum())


def _surprise(probability: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.asarray(-np.log(probability))


class EpochMixture(NamedTuple):
    """
    Candidates of the ranges of one ping and the distribution of its ends and the unknowns before
    these ranges.
    """

    expansion: Expansion  # of the candidates
    transmitter: Rows  # end of each candidate
    receiver: Rows
    position: Array  # of the ends, (n_ends, 3) [m]
    unknowns: Array  # that all ranges share, in their prior standard deviations
    # of positions [m²] and unknowns, (3 n_ends + n_unknowns, 3 n_ends + n_unknowns)
    covariance: Array
    row: Rows  # range of each candidate
    variance: Array  # of each candidate's residual [m²]
    smallest: Array  # variance of each candidate's range in an exact ocean [m²]
    weight: Array  # probability of each candidate before the range is measured
    null: Array  # probability density of each range if it belongs to none, relative to `fits`


def graduated_fits(mixture: EpochMixture, gate: float) -> Array:
    """
    Fit of each candidate at the most probable positions of the ends; infinite for gated candidates.

    Each step weights the candidates of a range by their probabilities at the current positions and
    combines them with the prediction (expectation and maximization). The standard deviations of the
    ranges begin at the largest one of an innovation and decrease to their own, so that the first
    steps see one mode. Further descents begin at positions drawn from the prediction, with smaller
    standard deviations; the one of lowest cost is taken. Candidates whose innovation exceeds
    ``gate`` standard deviations are discarded.
    """
    root = np.linalg.cholesky(
        mixture.covariance + 1e-12 * np.trace(mixture.covariance) * np.eye(len(mixture.covariance))
    )
    residual, by_offset = _at(mixture, root, np.zeros(len(root)))
    innovation = np.sum(by_offset**2, axis=1) + mixture.variance
    allowed = residual**2 <= gate**2 * innovation
    if not allowed.any():
        return np.full(residual.size, np.inf)
    control = max(1.0, float(np.sqrt((innovation / mixture.variance)[allowed].max())))
    rng = stream(0, 0, "estimation", "picks of a ping")
    ends = [_descend(mixture, root, np.zeros(len(root)), control, allowed)]
    ends += [
        _descend(mixture, root, rng.standard_normal(len(root)), np.sqrt(control), allowed)
        for _ in range(_DRAWN_STARTS)
    ]
    residual = min(ends, key=lambda end: end[0])[1]
    return np.where(allowed, fits(residual, mixture.variance, mixture.smallest), np.inf)


def _descend(
    mixture: EpochMixture, root: Array, offset: Array, control: float, allowed: Mask
) -> tuple[float, Array]:
    """
    Cost and residuals of the candidates at the end of a graduated descent from an offset of the
    ends.
    """
    residual, by_offset = _at(mixture, root, offset)
    while True:
        for _ in range(_STEPS):
            share = _shares(mixture, residual, control**2, allowed)
            information = share / (control**2 * mixture.variance)
            target = by_offset @ offset - residual
            matrix = np.eye(len(root)) + by_offset.T @ (information[:, None] * by_offset)
            offset = np.asarray(np.linalg.solve(matrix, by_offset.T @ (information * target)))
            residual, by_offset = _at(mixture, root, offset)
        if control == 1.0:
            break
        control = max(1.0, control / _CONTROL_RATIO)
    fit = fits(residual, mixture.variance, mixture.smallest)
    density = np.where(allowed, mixture.weight * np.exp(-fit), 0.0)
    best = np.array(mixture.null)
    np.maximum.at(best, mixture.row, density)
    with np.errstate(divide="ignore"):
        return float(0.5 * offset @ offset - np.log(best).sum()), residual


def _at(mixture: EpochMixture, root: Array, offset: Array) -> tuple[Array, Array]:
    """
    Residuals of the candidates and their derivatives by the offset of the ends, in units of their
    covariance's root.
    """
    displacement = root @ offset
    m = 3 * len(mixture.position)
    position = mixture.position + displacement[:m].reshape(-1, 3)
    residual, by_transmitter, by_receiver = mixture.expansion(
        position[mixture.transmitter],
        position[mixture.receiver],
        mixture.unknowns + displacement[m:],
    )
    rows = root[:m].reshape(-1, 3, root.shape[1])
    by_offset = np.einsum("ni,nij->nj", by_transmitter, rows[mixture.transmitter])
    by_offset += np.einsum("ni,nij->nj", by_receiver, rows[mixture.receiver])
    return residual, by_offset + mixture.expansion.by_unknowns @ root[m:]


def _shares(mixture: EpochMixture, residual: Array, control: float, allowed: Mask) -> Array:
    """Probability of each candidate with all variances multiplied by a factor."""
    fit = fits(residual, control * mixture.variance, mixture.smallest)
    density = np.where(allowed, mixture.weight * np.exp(-fit), 0.0)
    total = np.bincount(mixture.row, density, mixture.null.size) + mixture.null
    return np.asarray(density / np.maximum(total, np.finfo(float).tiny)[mixture.row])
