"""
Comparison of measured with predicted travel times: residuals, coverage and clocks.

Examples
--------
>>> import numpy as np
>>> import pandas as pd
>>> from pymantaray import Medium
>>> from pymantaray.apps.replay import read_events, replay_events
>>> names = ["source_north", "source_east", "source_depth"]
>>> names += ["receiver_north", "receiver_east", "receiver_depth", "travel_time"]
>>> there, back = [0, 0, 30, 1500, 0, 150, 1.0330], [1500, 0, 150, 0, 0, 30, 1.0290]
>>> table = pd.DataFrame([there, back] * 3, columns=names).assign(
...     time=60.0 * np.arange(6), source=["A", "B"] * 3, receiver=["B", "A"] * 3
... )
>>> table.to_csv("events.csv", index=False)
>>> events = read_events("events.csv")
>>> water = Medium.from_profile([0.0, 500.0], [1450.0, 1458.0], bottom_depth=500.0)
>>> replay = replay_events(events, water)
>>> replay.events["status"].value_counts().to_dict()
{'ok': 6}
"""

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
