"""Estimation of node positions and their covariance from a survey of travel times."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.locate.displacement import (
        Campaign as Campaign,
        Displacement as Displacement,
        displacement_between as displacement_between,
        read_campaign as read_campaign,
    )
    from pymantaray.apps.locate.location import Location as Location, locate as locate
    from pymantaray.apps.locate.options import (
        LocateOptions as LocateOptions,
        PlanOptions as PlanOptions,
        SpeedPrior as SpeedPrior,
    )
    from pymantaray.apps.locate.page import (
        write_location_page as write_location_page,
        write_plan_figure as write_plan_figure,
    )
    from pymantaray.apps.locate.ping_pattern import Pattern as Pattern
    from pymantaray.apps.locate.plan import SurveyPlan as SurveyPlan, plan_survey as plan_survey
    from pymantaray.apps.locate.read import read_survey as read_survey
    from pymantaray.apps.locate.read_options import ReadOptions as ReadOptions
    from pymantaray.apps.locate.survey import (
        LeverArm as LeverArm,
        Node as Node,
        PlatformError as PlatformError,
        Survey as Survey,
        TravelDirection as TravelDirection,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
