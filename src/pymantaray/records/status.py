"""Outcomes of links, vehicles and solves, which are data, not errors."""

from enum import IntEnum
from typing import NamedTuple

TRUTH = "truth"
"""Name of the true poses in files, beside the names of conditions."""


class RayStatus(IntEnum):
    """Outcome of an acoustic link."""

    OK = 0  # an admitted arrival exists
    SHADOW = 1  # no ray within the allowed bounces reaches the receiver
    BLOCKED = 2  # the sea bed blocks the rays that would reach the receiver
    OUTSIDE = 3  # an end point is outside the water or the medium's domain
    WEAK = 4  # rays exist, but all are below the spreading cut-off
    STOPPED = 5  # one of the vehicles has stopped and is silent
    UNHEARD = 6  # an existing arrival was not detected, by chance (detection by the sonar equation)
    UNRESOLVED = 7  # no arrival was found, but the search is not complete from either end
    LEAKED = 8  # no ray arrives, but sound leaks past the nearest ray (a model, off by default)
    SCATTERED = 9  # no ray arrives, but scattered sound, louder than leaked (off by default)


ARRIVES = (RayStatus.OK, RayStatus.LEAKED, RayStatus.SCATTERED)
"""Outcomes of a link with an arrival."""


class RayStatusWords(NamedTuple):
    """Label of an outcome in figures and tables, and its meaning as a sentence."""

    label: str
    meaning: str


RAY_STATUS_WORDS = {
    RayStatus.SHADOW: RayStatusWords(
        "shadow", "No ray within the allowed bounces reaches the receiver."
    ),
    RayStatus.WEAK: RayStatusWords(
        "too weak",
        "Rays arrive, but all are weaker than the cut-off: 15 dB beyond spherical spreading by"
        " default.",
    ),
    RayStatus.BLOCKED: RayStatusWords(
        "blocked by the bottom", "The sea bed blocks the rays that would reach the receiver."
    ),
    RayStatus.OUTSIDE: RayStatusWords(
        "outside the domain", "An end of the link is outside the water or the domain."
    ),
    RayStatus.STOPPED: RayStatusWords(
        "vehicle stopped", "One of the vehicles has stopped and is silent."
    ),
    RayStatus.UNHEARD: RayStatusWords(
        "not detected", "A ray arrives, but the receiver does not detect it."
    ),
    RayStatus.UNRESOLVED: RayStatusWords(
        "search not complete", "No ray was found, but launch angles remained where one may be."
    ),
    RayStatus.LEAKED: RayStatusWords(
        "leaked, no ray", "No ray arrives, but sound leaks past the nearest ray."
    ),
    RayStatus.SCATTERED: RayStatusWords(
        "scattered, no ray", "No ray arrives, but scattered sound does."
    ),
}
"""Outcomes other than OK as text for figures, pages, their glossary and commands."""


class RayAxis(IntEnum):
    """Axis of integration of an eigenray and of its path."""

    HORIZONTAL = 0
    CHORD = 1  # the straight line of a steep link
    VERTICAL = 2  # leg by leg, for a reflected ray that is steep or turns back


class VehicleStatus(IntEnum):
    """Status of a vehicle; unless it is ACTIVE, the vehicle does not move and is silent."""

    ACTIVE = 0
    GROUNDED = 1  # reached the sea bed
    LEFT_DOMAIN = 2  # left the domain of the ocean
    ABSENT = 3  # before the first or after the last pose of an existing trajectory


class SolveStatus(IntEnum):
    """Verdict of the health gate on one solve of a factor graph."""

    OK = 0
    NO_ITERATION = 1  # the optimizer stopped at its starting point
    NOT_CONVERGED = 2  # the iteration limit was reached or the gradient is not small
    COST_ROSE = 3  # the final cost is above the initial one
    OVER_CHI_SQUARE = 4  # converged, but the cost is above the chi-square bounds of a correct model
    FAILED = 5  # the linear system could not be solved
    SECOND_MINIMUM = 6  # converged, but another start ends in another minimum; this is the lower
    UNDER_CHI_SQUARE = 7  # converged, but the cost is below the bounds of a correct model

    @property
    def usable(self) -> bool:
        """True if a solve with this status ended at an optimum."""
        return self is SolveStatus.OK or self in SOLVE_STATUS_WORDS


class StatusWords(NamedTuple):
    """Meaning of a status, and advice for the user."""

    meaning: str
    advice: str


SOLVE_STATUS_WORDS = {
    SolveStatus.OVER_CHI_SQUARE: StatusWords(
        "converged, but the cost is above its chi-square bounds: measurements disagree more than"
        " their noise allows",
        "compare the cost with that of another start, try a robust estimator, or give larger"
        " standard deviations",
    ),
    SolveStatus.UNDER_CHI_SQUARE: StatusWords(
        "converged, but the cost is below its chi-square bounds: measurements agree better than"
        " their noise allows",
        "give smaller standard deviations; if all are too large by one factor, the estimate stays"
        " the same and only its covariances are too large",
    ),
    SolveStatus.SECOND_MINIMUM: StatusWords(
        "converged, but two starts end in different minima; this is the lower",
        "compare both estimates; more ranges or a prior may decide",
    ),
}
"""Descriptions of usable solves that are not OK, for pages and commands."""
