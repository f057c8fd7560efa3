"""Comparison of measured with predicted travel times: residuals, coverage and clocks."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.replay.compare import Replay as Replay, replay_events as replay_events
    from pymantaray.apps.replay.correction import correct_events as correct_events
    from pymantaray.apps.replay.events import Events as Events, read_events as read_events
    from pymantaray.apps.replay.options import PredictionOptions as PredictionOptions
    from pymantaray.apps.replay.page import write_replay as write_replay
    from pymantaray.apps.replay.positions import smooth_positions as smooth_positions
    from pymantaray.apps.replay.rules import (
        DEFAULT_RULE as DEFAULT_RULE,
        DetectionRule as DetectionRule,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
