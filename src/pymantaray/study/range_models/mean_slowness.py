"""Straight rays through the horizontal mean of a believed ocean."""

from pymantaray.config.estimators import RangeEstimatorSection
from pymantaray.estimation import MeanSlowness
from pymantaray.study.beliefs import Beliefs


def build(section: RangeEstimatorSection, beliefs: Beliefs, realization: int) -> MeanSlowness:
    """Range model of the belief's mean profile."""
    assert section.belief is not None  # checked by the section; for the type checker
    return MeanSlowness(*beliefs.believed(section.belief, realization).profile())
