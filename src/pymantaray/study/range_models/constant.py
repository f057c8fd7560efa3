"""One sound speed for all ranges."""

from pymantaray.estimation import ConstantSpeed
from pymantaray.study.beliefs import Beliefs
from pymantaray.study.config_estimators import RangeEstimatorSection


def build(section: RangeEstimatorSection, _beliefs: Beliefs, _realization: int) -> ConstantSpeed:
    """Range model with the configured sound speed."""
    assert section.sound_speed is not None  # checked by the section; for the type checker
    return ConstantSpeed(section.sound_speed)
