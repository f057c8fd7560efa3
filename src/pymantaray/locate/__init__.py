"""Estimation of node positions and their covariance from a survey of two-way and one-way travel times."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.locate.location import Location as Location
    from pymantaray.locate.location import locate as locate
    from pymantaray.locate.options import LocateOptions as LocateOptions
    from pymantaray.locate.options import PlanOptions as PlanOptions
    from pymantaray.locate.options import SpeedPrior as SpeedPrior
    from pymantaray.locate.plan import Pattern as Pattern
    from pymantaray.locate.plan import SurveyPlan as SurveyPlan
    from pymantaray.locate.plan import plan_survey as plan_survey
    from pymantaray.locate.read import read_survey as read_survey
    from pymantaray.locate.read_options import ReadOptions as ReadOptions
    from pymantaray.locate.survey import LeverArm as LeverArm
    from pymantaray.locate.survey import Node as Node
    from pymantaray.locate.survey import PlatformError as PlatformError
    from pymantaray.locate.survey import Survey as Survey
    from pymantaray.locate.survey import TravelDirection as TravelDirection

__getattr__, __dir__, __all__ = lazy_exports(__name__)
