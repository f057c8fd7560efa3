"""
Plan a deployment: positions, depths and ping intervals that give small position errors and few lost
links.
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
