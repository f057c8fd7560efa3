"""Which of a link's arrivals a receiver is taken to have detected: one rule, fixed before the residuals are looked at."""

from dataclasses import dataclass
from typing import Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Rule, choose_arrivals, link_loss_db
from pymantaray.acoustics.selection import NEAR_DB
from pymantaray.acoustics.sonar import Sonar
from pymantaray.errors import ReplayError
from pymantaray.records import Arrivals

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Kind = Literal["first", "strongest", "within", "threshold"]
DEFAULT_RULE = "within:6"
"""The first arrival within 6 dB of the link's strongest."""


@dataclass(frozen=True)
class DetectionRule:
    """
    Rule by which the detected arrival is predicted.

    ``first``: the earliest. ``strongest``: that of least loss. ``within``: the earliest of those at most ``within_db`` weaker
    than the strongest. ``threshold``: the earliest that the sonar equation has above its threshold.

    Examples
    --------
    >>> DetectionRule.parse("within:6")
    DetectionRule(kind='within', within_db=6.0)
    """

    kind: Kind
    within_db: float | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """Rule from its word, with the decibels behind a colon."""
        kind, _, number = text.partition(":")
        try:
            within = float(number) if number else None
        except ValueError:
            within = np.nan
        if kind not in get_args(Kind) or (kind == "within") != (within is not None and within >= 0.0):
            raise ReplayError(
                f"rule {text!r}; allowed are first, strongest, threshold and within:DB with decibels from 0, as within:6"
            )
        return cls(kind, within)  # type: ignore[arg-type]

    def __str__(self) -> str:
        """Give the word that `parse` reads."""
        return self.kind if self.within_db is None else f"{self.kind}:{self.within_db:g}"


class Heard(NamedTuple):
    """What receivers have to choose from."""

    arrivals: Arrivals
    """Down to `NEAR_DB` beyond the cut-off."""
    loss_db: Array
    """Of each arrival."""
    cutoff_db: float
    """Beyond spherical spreading; infinite for none."""
    sonar: Sonar | None

    def candidates(
        self, rule: DetectionRule, *, cutoff: float = 0.0, limit: float = 0.0
    ) -> NDArray[np.bool_]:
        """Arrivals that pass the cut-off and the rule's own limit, each by so much more than it says. [dB]"""
        a = self.arrivals
        passes = ~(a.spreading_db > self.cutoff_db + cutoff)
        if rule.kind == "within" and rule.within_db is not None:
            least = link_loss_db(np.where(passes, self.loss_db, np.inf), a.link, a.status.size)
            passes &= self.loss_db <= least[a.link] + rule.within_db + limit
        if rule.kind == "threshold" and self.sonar is not None:
            passes &= self.loss_db <= self.sonar.figure_of_merit_db + limit
        return passes

    def pick(self, rule: DetectionRule, candidates: NDArray[np.bool_]) -> Rows:
        """Row of the arrival that each link takes of its candidates, -1 for none."""
        by: Rule = "strongest" if rule.kind == "strongest" else "first"
        link, row = choose_arrivals(self.arrivals, by, loss_db=self.loss_db, heard=candidates)
        picks = np.full(self.arrivals.status.size, -1)
        picks[link] = row
        return picks

    def next(self, rule: DetectionRule, candidates: NDArray[np.bool_], picks: Rows) -> Rows:
        """Row of the candidate that each link would take if the one it takes were not there, -1 for none."""
        others = candidates.copy()
        others[picks[picks >= 0]] = False
        return self.pick(rule, others)

    def near_limit(self, rule: DetectionRule, picks: Rows) -> NDArray[np.bool_]:
        """Whether another cut-off or limit of the rule, `NEAR_DB` higher or lower, would change each link's pick."""
        changed = np.zeros(picks.size, dtype=bool)
        for shift in (-NEAR_DB, NEAR_DB):
            for which in ("cutoff", "limit"):
                changed |= self.pick(rule, self.candidates(rule, **{which: shift})) != picks
        return changed
