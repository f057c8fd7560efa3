"""Positions of nodes from a survey of real pings: two-way and one-way times in, positions with their covariance out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pymantaray.locate.location import Location, locate
    from pymantaray.locate.plan import Pattern, Plan, PlanOptions, plan_survey
    from pymantaray.locate.read import read_survey
    from pymantaray.locate.read_options import ReadOptions
    from pymantaray.locate.solve import LocateOptions
    from pymantaray.locate.sound_speed import SpeedPrior
    from pymantaray.locate.survey import Direction, LeverArm, Node, PlatformError, Survey

__all__ = [
    "Direction",
    "LeverArm",
    "LocateOptions",
    "Location",
    "Node",
    "Pattern",
    "Plan",
    "PlanOptions",
    "PlatformError",
    "ReadOptions",
    "SpeedPrior",
    "Survey",
    "locate",
    "plan_survey",
    "read_survey",
]

_HOME = {
    "location": ("Location", "locate"),
    "plan": ("Pattern", "Plan", "PlanOptions", "plan_survey"),
    "read": ("read_survey",),
    "read_options": ("ReadOptions",),
    "solve": ("LocateOptions",),
    "sound_speed": ("SpeedPrior",),
    "survey": ("Direction", "LeverArm", "Node", "PlatformError", "Survey"),
}
_LATER = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import what is heavy on first use."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
