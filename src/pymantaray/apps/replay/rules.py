"""
Rules that predict the arrival that a receiver detected.

Fix the rule before you look at residuals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import link_loss_db
from pymantaray.acoustics.levels.sonar import Sonar
from pymantaray.acoustics.selection import NEAR_DB, first_rows
from pymantaray.arrays import Array
from pymantaray.errors import ReplayError
from pymantaray.sensing import Receptions

if TYPE_CHECKING:
    import pandas as pd

Rows = NDArray[np.int64]
Kind = Literal["first", "strongest", "within", "threshold", "persist"]
RULES: Mapping[Kind, tuple[str, str]] = MappingProxyType(
    {
        "first": ("first", "The earliest arrival."),
        "strongest": ("strongest", "The arrival of least loss."),
        "within": ("within:DB", "The earliest of those at most DB weaker than the strongest."),
        "threshold": ("threshold", "The earliest above the threshold of the sonar equation."),
        "persist": (
            "persist:MINUTES",
            (
                "The arrival of the previous reception of the same source and receiver while it"
                " remains plausible, with a time constant of MINUTES."
            ),
        ),
    }
)
"""Text and meaning of each rule."""
DEFAULT_RULE = "within:6"
"""The first arrival within 6 dB of the link's strongest."""
DEFAULT_PERSISTENCE = 10.0
"""Time constant of the rule ``persist``. [min]"""


@dataclass(frozen=True)
class DetectionRule:
    """
    Rule that predicts the detected arrival, one of `RULES`.

    Examples
    --------
    >>> DetectionRule.parse("within:6")
    DetectionRule(kind='within', within_db=6.0, persist_min=0.0)
    """

    kind: Kind
    within_db: float | None = None
    persist_min: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Self:
        """
        Read a rule from its text.

        Parameters
        ----------
        text : str
            As in `RULES`, with a number for DB or MINUTES.

        Returns
        -------
        DetectionRule

        Raises
        ------
        ReplayError
            If the text is not a rule; the message lists the rules.
        """
        kind, _, number = text.partition(":")
        try:
            within = float(number) if number else None
        except ValueError:
            within = np.nan
        if kind == "persist" and (within is None or 0.0 < within < np.inf):
            return cls(kind, None, DEFAULT_PERSISTENCE if within is None else within)  # type: ignore[arg-type]
        if (
            kind not in RULES
            or kind == "persist"
            or (kind == "within") != (within is not None and within >= 0.0)
        ):
            forms = ", ".join(form for form, _ in RULES.values())
            raise ReplayError(
                f"rule {text!r}; allowed are {forms}, such as within:6, with DB of 0 or more and"
                " MINUTES above 0"
            )
        return cls(kind, within)  # type: ignore[arg-type]

    def __str__(self) -> str:
        """Return the word that `parse` reads."""
        if self.kind == "persist":
            return f"persist:{self.persist_min:g}"
        return self.kind if self.within_db is None else f"{self.kind}:{self.within_db:g}"


class Choice(NamedTuple):
    """
    Receptions among which receivers choose.

    Sound without a ray passes every limit, because it has no competitor.
    """

    receptions: Receptions
    """From source to receiver, down to `NEAR_DB` beyond the cut-off."""
    events: int
    """Number of events; the link of a reception is its event."""
    loss_db: Array
    """Of each reception."""
    cutoff_db: float
    """Beyond spherical spreading; infinite for none."""
    sonar: Sonar | None

    def within_cutoff(self, margin: float = 0.0) -> NDArray[np.bool_]:
        """Eigenrays within the cut-off, which is higher by a margin. [dB]"""
        rows = self.receptions
        return np.asarray((rows.arrival >= 0) & ~(rows.spreading_db > self.cutoff_db + margin))

    def candidates(
        self, rule: DetectionRule, *, cutoff: float = 0.0, limit: float = 0.0
    ) -> NDArray[np.bool_]:
        """Receptions that pass the cut-off and the rule's limit, each higher by a margin. [dB]"""
        passes = self.within_cutoff(cutoff)
        link = self.receptions.link
        if rule.kind == "within" and rule.within_db is not None:
            least = link_loss_db(np.where(passes, self.loss_db, np.inf), link, self.events)
            passes &= self.loss_db <= least[link] + rule.within_db + limit
        if rule.kind == "threshold" and self.sonar is not None:
            passes &= self.loss_db <= self.sonar.figure_of_merit_db + limit
        return np.asarray(passes | (self.receptions.arrival < 0))

    def pick(self, rule: DetectionRule, candidates: NDArray[np.bool_]) -> Rows:
        """Row of the candidate that each event takes, -1 for none."""
        keys = [self.receptions.travel_time]
        if rule.kind == "strongest":
            keys.insert(0, self.loss_db)
        return first_picks(self.receptions.link, keys, candidates, self.events)

    def next(self, rule: DetectionRule, candidates: NDArray[np.bool_], picks: Rows) -> Rows:
        """Row of the candidate that each event would take without its pick, -1 for none."""
        others = candidates.copy()
        others[picks[picks >= 0]] = False
        return self.pick(rule, others)

    def near_limit(self, rule: DetectionRule, picks: Rows) -> NDArray[np.bool_]:
        """True for events whose pick changes if a limit is `NEAR_DB` higher or lower."""
        is_near = np.zeros(picks.size, dtype=bool)
        for margin in (-NEAR_DB, NEAR_DB):
            for which in ("cutoff", "limit"):
                is_near |= self.pick(rule, self.candidates(rule, **{which: margin})) != picks
        return is_near


def first_picks(
    link: Rows, keys: Sequence[Array], is_allowed: NDArray[np.bool_], links: int
) -> Rows:
    """First allowed row of each link in the order of the keys, -1 for a link without one."""
    picks = np.full(links, -1)
    first = first_rows(link, keys, is_allowed)
    picks[first.link] = first.row
    return picks


def predicted_columns(
    candidates: "pd.DataFrame",
    first: Rows,
    after: Rows,
    sonar: Sonar | None,
    *,
    rays: Rows | None = None,
) -> dict[str, Array | float]:
    """
    Columns of the picked rows of candidates and of their successors; NaN for rows of -1.

    ``rays`` are the picks whose numbers of reflections are known.
    """

    def of(name: str, rows: Rows) -> Array:
        return np.append(candidates[name].to_numpy(dtype=float), np.nan)[rows]

    rays = first if rays is None else rays
    level = of("loss_db", first)
    return {
        "predicted_s": of("travel_time_s", first),
        "surface_bounces": of("surface_bounces", rays),
        "bottom_bounces": of("bottom_bounces", rays),
        "loss_db": level,
        "level_db": np.nan if sonar is None else sonar.source_level_db - level,
        "next_s": of("travel_time_s", after) - of("travel_time_s", first),
        "next_db": level - of("loss_db", after),
    }
