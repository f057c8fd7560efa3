"""
The rule that chooses among descents from several starts: by cost, and the descent of the best start
is finished.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

import numpy as np

SAME_COST = 1e-6  # relative; smaller differences of the cost are of one minimum
_MAX_CONTINUED = 8  # further descents from the end of the lowest one, if it has not converged


class Descent(Protocol):
    """End of a descent."""

    @property
    def cost(self) -> float:
        """Cost at the end, also of a descent that did not converge; infinite if it failed."""

    @property
    def converged(self) -> bool:
        """True at a minimum."""


D = TypeVar("D", bound=Descent)


def lowest(descents: Sequence[D]) -> D:
    """
    Descent of the lowest cost whatever its status; among equal costs a converged one, then the
    first.
    """
    least = min(descent.cost for descent in descents)
    equal = [one for one in descents if one.cost <= least or same_cost(one.cost, least)]
    return next((one for one in equal if one.converged), equal[0])


def finish(descent: D, further: Callable[[D], D]) -> D:
    """Continue a descent from its end until it converges or its cost does not fall."""
    for _ in range(_MAX_CONTINUED):
        if descent.converged or descent.cost == np.inf:
            break
        longer = further(descent)
        if not longer.cost <= descent.cost:
            break
        descent = longer
    return descent


def choose(descents: Sequence[D], further: Callable[[D], D]) -> D:
    """Lowest of several descents, finished."""
    return finish(lowest(descents), further)


def same_cost(one: float, other: float) -> bool:
    """True if two costs differ by less than rounding and the tolerance of the solver."""
    return abs(one - other) <= SAME_COST * (1.0 + min(one, other))
