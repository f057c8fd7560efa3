"""Which of a ping's arrivals a receiver takes for the direct one, as probabilities from their levels."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics import Sonar, probability_of_excess
from pymantaray.errors import SensingError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
PickRule = Literal["first-detected", "strongest-detected"]
_SPREAD_DB = 6.0  # of an arrival's level where no sonar says another
_FAR_DB = 1e4  # stands for an infinite loss
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_TAIL = 8.0  # standard deviations beyond which a normal level does not go


@dataclass(frozen=True)
class Picker:
    r"""
    Rule by which a receiver picks one of the arrivals of a ping.

    Parameters
    ----------
    rule : {"first-detected", "strongest-detected"}
        The earliest of the arrivals that it detects, or the loudest of them.
    sonar : Sonar, optional
        What it detects, and how much levels spread about the predicted ones.
    below_strongest_db : float, optional
        Without a sonar, for ``first-detected``: an arrival predicted to be so much weaker than the link's strongest
        is detected half the time. [dB]

    Raises
    ------
    SensingError
        If the rule is unknown, or there is not exactly one threshold where the rule needs one.

    Notes
    -----
    The level of each arrival is normal in decibels about the predicted one with standard deviation
    :math:`\sigma`, independently of the others. With the mean excess :math:`e_k` over the threshold and :math:`p_k =
    \Phi(e_k / \sigma)`, arrival k in order of time is taken with probability

    .. math:: p_k \prod_{j < k} (1 - p_j)

    by ``first-detected`` and, of all orders,

    .. math:: \int_{-e_k / \sigma}^\infty \varphi(z) \prod_{j \ne k} \Phi\left(z + (e_k - e_j) / \sigma\right) dz

    by ``strongest-detected``. Both add up to :math:`1 - \prod_k (1 - p_k)`: with a sonar, nothing may be heard.
    Without one, as everywhere, something is: the threshold lies `below_strongest_db` below the predicted level of
    the strongest, :math:`\sigma` is 6 dB, and if nothing passes the receiver takes the predicted strongest;
    ``strongest-detected`` has no threshold then.
    """

    rule: PickRule
    sonar: Sonar | None = None
    below_strongest_db: float | None = None

    def __post_init__(self) -> None:
        """Check the rule and that it has its threshold."""
        if self.rule not in get_args(PickRule):
            raise SensingError(f"Picker: rule {self.rule!r}; allowed are {', '.join(get_args(PickRule))}")
        needed = self.rule == "first-detected" and self.sonar is None
        if needed != (self.below_strongest_db is not None):
            raise SensingError(
                f"Picker: below_strongest_db is {self.below_strongest_db}; first-detected without a sonar needs it,"
                " nothing else does"
            )

    def probabilities(self, loss_db: ArrayLike, link: ArrayLike, travel_time: ArrayLike) -> Array:
        """
        Probability that each arrival is the one that its receiver takes.

        Parameters
        ----------
        loss_db : array_like, shape (n_arrivals,)
            Loss; NaN counts as infinite. Without a sonar only differences within a link matter. [dB]
        link : array_like of int, shape (n_arrivals,)
            Arrivals of the same link compete.
        travel_time : array_like, shape (n_arrivals,)
            [s]

        Returns
        -------
        ndarray, shape (n_arrivals,)
        """
        given = np.asarray(link, dtype=np.int64)
        order = np.lexsort((np.asarray(travel_time, dtype=float), given))
        loss = np.nan_to_num(np.asarray(loss_db, dtype=float), nan=_FAR_DB, posinf=_FAR_DB, neginf=-_FAR_DB)[
            order
        ]
        ranks = by_rank(given[order])
        competes = np.unique(given, return_inverse=True)[1][order]  # links without gaps between them
        least = np.full(competes.max(initial=-1) + 1, np.inf)
        np.minimum.at(least, competes, loss)
        if self.sonar is not None:
            spread, excess = self.sonar.spread_db, self.sonar.figure_of_merit_db - loss
        else:
            spread, excess = _SPREAD_DB, (self.below_strongest_db or 0.0) + least[competes] - loss
        strongest = _earliest(ranks, competes, loss == least[competes])
        if self.rule == "first-detected":
            found, missed = _first(ranks, competes, probability_of_excess(excess, spread))
            if self.sonar is None:
                found[strongest] += missed[competes[strongest]]
        elif spread == 0.0:
            found = np.where((excess >= 0.0) & np.isin(np.arange(loss.size), strongest), 1.0, 0.0)
        else:
            lowest = None if self.sonar is None else -excess / spread
            found = _loudest(ranks, competes, excess / spread, lowest)
        result = np.empty(loss.size)
        result[order] = found
        return result


def by_rank(group: NDArray[np.int64]) -> list[Indices]:
    """
    Rows by their place within their group.

    Parameters
    ----------
    group : ndarray of int, shape (n_rows,)
        Group of each row; rows of a group stand together.

    Returns
    -------
    list of ndarray of int
        The first row of each group, the second of each that has so many, and so on.
    """
    _, start, count = np.unique(group, return_index=True, return_counts=True)
    return [start[count > rank] + rank for rank in range(int(count.max(initial=0)))]


def _earliest(ranks: list[Indices], link: Indices, marked: NDArray[np.bool_]) -> Indices:
    """First marked row of each link."""
    row = np.full(link.max(initial=-1) + 1, -1)
    for rows in ranks:
        new = rows[marked[rows] & (row[link[rows]] < 0)]
        row[link[new]] = new
    return row


def _first(ranks: list[Indices], link: Indices, detected: Array) -> tuple[Array, Array]:
    """Probability of each row to be the first detected, and of each link that none is."""
    found, missed = np.empty(detected.size), np.ones(link.max(initial=-1) + 1)
    for rows in ranks:
        found[rows] = detected[rows] * missed[link[rows]]
        missed[link[rows]] *= 1.0 - detected[rows]
    return found, missed


def _loudest(ranks: list[Indices], link: Indices, level: Array, lowest: Array | None) -> Array:
    """Probability of each row to be the loudest, above its lowest level; levels have standard deviation 1."""
    from scipy.special import ndtr

    low = np.full(level.size, -_TAIL) if lowest is None else np.clip(lowest, -_TAIL, _TAIL)
    half = 0.5 * (_TAIL - low)
    z = low[:, None] + half[:, None] * (_NODES + 1.0)
    integrand = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    for rows in ranks:
        other = np.full(link.max(initial=-1) + 1, -1)
        other[link[rows]] = rows
        rival = other[link]
        beaten = np.flatnonzero((rival >= 0) & (rival != np.arange(level.size)))
        integrand[beaten] *= ndtr(z[beaten] + (level[beaten] - level[rival[beaten]])[:, None])
    return np.asarray(half * (integrand @ _WEIGHTS))
