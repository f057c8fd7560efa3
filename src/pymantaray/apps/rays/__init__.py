"""Eigenrays, travel times and paths between positions in a table."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.rays.figures import write_ray_plot as write_ray_plot

__getattr__, __dir__, __all__ = lazy_exports(__name__)
