"""Ranges of existing trajectories."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.ranges.ranging import measure as measure

__getattr__, __dir__, __all__ = lazy_exports(__name__)
