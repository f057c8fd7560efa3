"""The sound speed at the transmitter for each range, as a straight world would have it."""

from pymantaray.apps.study.beliefs import Beliefs
from pymantaray.config.estimators import TransmitterRangeModel
from pymantaray.estimation import TransmitterSpeed


def build(
    _section: TransmitterRangeModel, _beliefs: Beliefs, _realization: int
) -> TransmitterSpeed:
    """Range model that needs to be told nothing."""
    return TransmitterSpeed()
