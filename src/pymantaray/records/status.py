"""Outcomes that are data, not errors: of a link, of a vehicle and of a solve."""

from enum import IntEnum
from typing import NamedTuple


class RayStatus(IntEnum):
    """What became of one acoustic link."""

    OK = 0  # an admitted arrival exists
    SHADOW = 1  # no ray within the allowed bounces reaches the receiver
    BLOCKED = 2  # the rays that would reach it meet the sea bed on their way
    OUTSIDE = 3  # an end point is outside the water or the medium's domain
    WEAK = 4  # rays exist, all of them below the spreading cut-off
    STOPPED = 5  # one of the vehicles has stopped and is silent
    UNHEARD = 6  # an arrival exists, but by chance it was not heard (detection by the sonar equation)
    UNRESOLVED = 7  # the search was cut short, there being too many rays to look at, before one was found
    LEAKED = 8  # no ray, but sound that leaks past the nearest one arrives (a model, off by default)
    SCATTERED = 9  # no ray, but scattered sound arrives, louder than what leaks (a model, off by default)


ARRIVES = (RayStatus.OK, RayStatus.LEAKED, RayStatus.SCATTERED)
"""Outcomes of a link on which something arrives."""

RAY_STATUS_WORDS = {
    RayStatus.SHADOW: "shadow",
    RayStatus.WEAK: "too weak",
    RayStatus.BLOCKED: "blocked by the bottom",
    RayStatus.OUTSIDE: "outside the domain",
    RayStatus.STOPPED: "vehicle stopped",
    RayStatus.UNHEARD: "not heard",
    RayStatus.UNRESOLVED: "search cut short",
    RayStatus.LEAKED: "leaked, no ray",
    RayStatus.SCATTERED: "scattered, no ray",
}
"""Outcomes but OK, as figures, pages and commands call them."""


class RayAxis(IntEnum):
    """Along what an eigenray was followed; its path is traced in the same way."""

    HORIZONTAL = 0
    CHORD = 1  # the straight line of a steep link
    VERTICAL = 2  # leg by leg, a reflected ray that is steep or turns back


class VehicleStatus(IntEnum):
    """What became of a vehicle; anything but ACTIVE means that it stays where it is, silent."""

    ACTIVE = 0
    GROUNDED = 1  # met the sea bed
    LEFT_DOMAIN = 2  # left the ocean that was given
    ABSENT = 3  # before the first or after the last pose of a trajectory that was given


class SolveStatus(IntEnum):
    """Verdict of the health gate on one solve of a factor graph."""

    OK = 0
    NO_ITERATION = 1  # the optimizer gave up at once and returned its starting point
    NOT_CONVERGED = 2  # the iteration limit was met or the gradient is not small
    COST_ROSE = 3  # the final cost is above the initial one
    OVER_CHI_SQUARE = 4  # converged, but the cost is above its chi-square bounds where the model is right
    FAILED = 5  # the linear system could not be solved
    SECOND_MINIMUM = 6  # converged, but another start ends in another minimum; this is the lower of both
    UNDER_CHI_SQUARE = 7  # converged, but the cost is below its chi-square bounds where the model is right

    @property
    def usable(self) -> bool:
        """Whether a solve of this status ended at an optimum."""
        return self is SolveStatus.OK or self in SOLVE_STATUS_WORDS


class StatusWords(NamedTuple):
    """Meaning of a status, and what a user can do about it."""

    meaning: str
    advice: str


SOLVE_STATUS_WORDS = {
    SolveStatus.OVER_CHI_SQUARE: StatusWords(
        "converged, but the cost is above its chi-square bounds: measurements disagree more than their noise allows",
        "compare the cost with that of another start, try a robust estimator, or give larger standard deviations",
    ),
    SolveStatus.UNDER_CHI_SQUARE: StatusWords(
        "converged, but the cost is below its chi-square bounds: measurements agree better than their noise allows",
        "give smaller standard deviations; if all are too large by one factor, the estimate stays the same and only its"
        " covariances are too large",
    ),
    SolveStatus.SECOND_MINIMUM: StatusWords(
        "converged, but two starts end in different minima; this is the lower",
        "compare both estimates; more ranges or a prior may decide",
    ),
}
"""Usable solves that are not OK, as pages and commands describe them."""
