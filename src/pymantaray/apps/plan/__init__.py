"""
Plan a deployment: positions, depths and ping intervals that give small position errors and few lost
links.

Examples
--------
>>> from pymantaray import load_study
>>> from pymantaray.apps.plan import DeploymentPlan, PlanSection, search_designs
>>> receiver = {"name": "T", "north": 0.0, "east": 0.0, "depth": 1.0}
>>> hours = {"mission.duration_h": 1.0, "mission.ping_interval_h": 0.5}
>>> section = PlanSection(free={"landmarks.T.depth": [1.0, 100.0]}, lost_of="T")
>>> plan = DeploymentPlan(load_study("quick", landmarks=[receiver], **hours), section)
>>> results = search_designs(plan, workers=1)
>>> results.frame[["landmarks.T.depth", "lost_percent"]]
   landmarks.T.depth  lost_percent
0                1.0     13.636364
1              100.0     45.454545
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.plan.definition import (
        DeploymentPlan as DeploymentPlan,
        PlanSection as PlanSection,
        load_plan as load_plan,
    )
    from pymantaray.apps.plan.page import write_plan_page as write_plan_page
    from pymantaray.apps.plan.results import PlanResults as PlanResults
    from pymantaray.apps.plan.search import search_designs as search_designs

__getattr__, __dir__, __all__ = lazy_exports(__name__)
