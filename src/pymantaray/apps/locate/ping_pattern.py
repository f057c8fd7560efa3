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

    Examples
    --------
    >>> from pymantaray.apps.locate import Pattern
    >>> Pattern("rose", radius=1500.0, pings=100).shape
    'rose'
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
        if self.shape in ("circle", "rose"):
            angle = 2.0 * np.pi * fraction
            petal = np.cos(0.5 * _PETALS * angle)
            size = self.radius * (petal if self.shape == "rose" else np.ones(self.pings))
            return np.column_stack([size * np.cos(angle), size * np.sin(angle)])
        # straight lines, each sailed once in alternating directions
        count = {"line": 1, "cross": 2}.get(self.shape, _LINES)
        line = np.minimum((fraction * count).astype(int), count - 1)
        along = 2.0 * (fraction * count - line) - 1.0
        along = np.where(line % 2 == 0, along, -along)
        across = np.zeros(self.pings)
        if self.shape == "lines":
            across = 2.0 * line / (count - 1) - 1.0
        north, east = along, across
        if self.shape == "cross":
            north, east = np.where(line == 0, [along, across], [across, along])
        return np.asarray(self.radius * np.column_stack([north, east]))
