"""Patterns of a platform's pings around a node's drop point."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import LocateError

Shape = Literal["circle", "cross", "line", "rose", "lines"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
_PETALS = 4  # per rose
_LINES = 5  # parallel lines
_MAX_PINGS = 100_000


@dataclass(frozen=True)
class Pattern:
    """
    Pattern of a platform's pings around the node's drop point.

    Parameters
    ----------
    shape : {"circle", "cross", "line", "rose", "lines"}
        One full circle, two lines at right angles, one line, four petals through the middle, or
        five parallel lines.
    radius : float
        Extent of the pattern from its middle. [m]
    pings : int
        Number of pings.
    """

    shape: Shape
    radius: float
    pings: int

    def __post_init__(self) -> None:
        """Check."""
        if self.shape not in SHAPES:
            raise LocateError(f"pattern is {self.shape!r}; allowed: {', '.join(SHAPES)}")
        if not (self.radius > 0.0 and np.isfinite(self.radius)):
            raise LocateError(f"pattern: radius is {self.radius:g} m; it must be positive")
        if not 3 <= self.pings <= _MAX_PINGS:
            raise LocateError(f"pattern: pings is {self.pings}; it must be 3 to {_MAX_PINGS:,}")

    @property
    def turns(self) -> int:
        """Number of turns between lines."""
        return {"cross": 1, "lines": _LINES - 1}.get(self.shape, 0)

    def points(self) -> Array:
        """North and east of the pings (n, 2) in order of time. [m]"""
        fraction = (np.arange(self.pings) + 0.5) / self.pings
        if self.shape == "circle":
            angle = 2.0 * np.pi * fraction
            unit = np.column_stack([np.cos(angle), np.sin(angle)])
        elif self.shape == "rose":
            angle = 2.0 * np.pi * fraction
            size = np.cos(0.5 * _PETALS * angle)
            unit = size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        elif self.shape == "line":
            unit = np.column_stack([2.0 * fraction - 1.0, 0.0 * fraction])
        elif self.shape == "cross":
            unit = _along_lines(fraction, 2, is_cross=True)
        else:
            unit = _along_lines(fraction, _LINES, is_cross=False)
        return np.asarray(self.radius * unit)


def _along_lines(fraction: Array, count: int, *, is_cross: bool) -> Array:
    """Points on two crossing lines or on parallel lines, sailed once in alternating directions."""
    which = np.minimum((fraction * count).astype(int), count - 1)
    along = 2.0 * (fraction * count - which) - 1.0
    along = np.where(which % 2 == 0, along, -along)
    if is_cross:
        first = np.column_stack([along, 0.0 * fraction])
        second = np.column_stack([0.0 * fraction, along])
        return np.where((which == 0)[:, None], first, second)
    return np.column_stack([along, 2.0 * which / (count - 1) - 1.0])
