"""
Tables, figures and pages: of one study, of several studies, of a sweep, an atlas, a replay, a plan and located nodes; plots of an ocean and of rays.

matplotlib is imported on first use.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.atlas.figures import write_atlas_plots as write_atlas_plots
    from pymantaray.apps.atlas.page import write_atlas_page as write_atlas_page
    from pymantaray.apps.locate.page import write_location_page as write_location_page
    from pymantaray.apps.locate.page import write_plan_figure as write_plan_figure
    from pymantaray.apps.ocean.figures import write_ocean_plots as write_ocean_plots
    from pymantaray.apps.plan.page import write_plan_page as write_plan_page
    from pymantaray.apps.rays.figures import write_ray_plot as write_ray_plot
    from pymantaray.apps.replay.page import write_replay as write_replay
    from pymantaray.apps.study.comparison_page import write_comparison as write_comparison
    from pymantaray.apps.study.report import write_report as write_report
    from pymantaray.apps.sweep.page import write_sweep_page as write_sweep_page

__getattr__, __dir__, __all__ = lazy_exports(__name__)
