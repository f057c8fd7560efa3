"""Straight rays through the horizontal mean of a believed ocean."""

from pymantaray.apps.study.beliefs import Beliefs
from pymantaray.config.estimators import MeanSlownessRangeModel
from pymantaray.estimation import MeanSlowness


def build(section: MeanSlownessRangeModel, beliefs: Beliefs, realization: int) -> MeanSlowness:
    """Range model of the belief's mean profile."""
    return MeanSlowness(*beliefs.believed(section.belief, realization).profile())
