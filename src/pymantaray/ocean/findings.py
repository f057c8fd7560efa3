"""What a check has found: what is wrong or doubtful, where, and what to do about it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

Severity = Literal["wrong", "doubtful"]


@dataclass(frozen=True)
class Finding:
    """
    One thing that is wrong or doubtful.

    Parameters
    ----------
    severity : {"wrong", "doubtful"}
        Wrong: the ocean cannot be used, or not for what is asked. Doubtful: it can; someone should look.
    what : str
        The property, in a few words.
    where : str
        Place and depth, variable or axis; empty if it is the ocean as a whole.
    found : str
        Value with unit.
    allowed : str
        Limit with unit; empty if there is none.
    remedy : str
        What to do; empty where what was found says so.
    """

    severity: Severity
    what: str
    where: str
    found: str
    allowed: str
    remedy: str

    def __str__(self) -> str:
        """One line."""
        place = f" ({self.where})" if self.where else ""
        limit = f"; allowed {self.allowed}" if self.allowed else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.severity}: {self.what}{place}: {self.found}{limit}{remedy}"


@dataclass(frozen=True)
class Findings:
    """
    Everything that a check has found.

    Parameters
    ----------
    every : tuple of Finding
        What is wrong first.
    """

    every: tuple[Finding, ...] = ()

    @property
    def wrong(self) -> tuple[Finding, ...]:
        """Those that make the ocean unusable."""
        return tuple(f for f in self.every if f.severity == "wrong")

    @property
    def doubtful(self) -> tuple[Finding, ...]:
        """Those that someone should look at."""
        return tuple(f for f in self.every if f.severity == "doubtful")

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong; something may be doubtful."""
        return not self.wrong

    def __iter__(self) -> Iterator[Finding]:
        return iter(self.every)

    def __len__(self) -> int:
        return len(self.every)

    def named(self, what: str) -> Finding | None:
        """
        First finding about a property.

        Parameters
        ----------
        what : str

        Returns
        -------
        Finding or None
            None if there is none.
        """
        return next((f for f in self.every if f.what == what), None)


def wrong(what: str, found: str, allowed: str, remedy: str, *, where: str = "") -> Finding:
    """
    Finding that makes the ocean unusable.

    Parameters
    ----------
    what, found, allowed, remedy, where : str
        See `Finding`.

    Returns
    -------
    Finding
    """
    return Finding("wrong", what, where, found, allowed, remedy)


def doubtful(what: str, found: str, allowed: str, remedy: str, *, where: str = "") -> Finding:
    """
    Finding that someone should look at.

    Parameters
    ----------
    what, found, allowed, remedy, where : str
        See `Finding`.

    Returns
    -------
    Finding
    """
    return Finding("doubtful", what, where, found, allowed, remedy)
