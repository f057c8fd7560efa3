"""Tables, figures and a page for the results of a study, and for several of them side by side; pages of a sweep, of an atlas and of located nodes; plots of an ocean, of rays and of an atlas.

matplotlib is imported when the first of them is asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pymantaray.report.atlas_page import write_atlas_page
    from pymantaray.report.atlas_plots import write_atlas_plots
    from pymantaray.report.compare import write_comparison
    from pymantaray.report.locate import write_location_page, write_plan_figure
    from pymantaray.report.ocean_plots import write_ocean_plots
    from pymantaray.report.ray_plots import write_ray_plot
    from pymantaray.report.replay import write_replay
    from pymantaray.report.sweep import write_sweep_page
    from pymantaray.report.write import write_report

__all__ = [
    "write_atlas_page",
    "write_atlas_plots",
    "write_comparison",
    "write_location_page",
    "write_ocean_plots",
    "write_plan_figure",
    "write_ray_plot",
    "write_replay",
    "write_report",
    "write_sweep_page",
]

_ROOMS = {
    "write_atlas_page": "atlas_page",
    "write_atlas_plots": "atlas_plots",
    "write_comparison": "compare",
    "write_location_page": "locate",
    "write_ocean_plots": "ocean_plots",
    "write_plan_figure": "locate",
    "write_ray_plot": "ray_plots",
    "write_replay": "replay",
    "write_report": "write",
    "write_sweep_page": "sweep",
}


def __getattr__(name: str) -> Any:
    """Import what needs matplotlib on first use."""
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_ROOMS[name]}"), name)
