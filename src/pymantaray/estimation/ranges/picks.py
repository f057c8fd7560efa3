"""
Picks of a mixture: the most probable candidate of each range, and sequence of candidates of each
ordered pair.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.estimation.ranges.candidates import CandidateArrivals, MixtureOptions
from pymantaray.estimation.ranges.range_models import Rows, TimedRanges

NONE = -1  # pick, and family, of a range that belongs to none of its candidates


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
