"""Commands that check, show, plot and make oceans."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.ocean.figures import write_ocean_plots as write_ocean_plots

__getattr__, __dir__, __all__ = lazy_exports(__name__)
