"""The sound speed at the transmitter for each range, as a straight world would have it."""

from pymantaray.config.estimators import RangeEstimatorSection
from pymantaray.estimation import TransmitterSpeed
from pymantaray.study.beliefs import Beliefs


def build(_section: RangeEstimatorSection, _beliefs: Beliefs, _realization: int) -> TransmitterSpeed:
    """Range model that needs to be told nothing."""
    return TransmitterSpeed()
