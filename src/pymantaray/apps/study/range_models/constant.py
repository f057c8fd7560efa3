"""One sound speed for all ranges: one that is given, or that of a believed ocean."""

import numpy as np

from pymantaray.apps.study.assemble import fleet_plan
from pymantaray.apps.study.beliefs import Beliefs
from pymantaray.config.estimators import ConstantRangeModel
from pymantaray.estimation import ConstantSpeed, MeanSlowness, RangeEndpoints


def build(section: ConstantRangeModel, beliefs: Beliefs, realization: int) -> ConstantSpeed:
    """
    Range model with the configured sound speed, or the mean slowness of a belief down to the
    deepest place that is planned.
    """
    if section.sound_speed is not None:
        return ConstantSpeed(section.sound_speed)
    assert section.belief is not None  # checked by the section; for the type checker
    profile = MeanSlowness(*beliefs.believed(section.belief, realization).profile())
    deepest = max(float(points[:, 2].max()) for points in fleet_plan(beliefs.config).values())
    down = RangeEndpoints(
        np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0.0, deepest]]), np.ones(1)
    )
    return ConstantSpeed(deepest / float(profile.predict(down).travel_time[0]))
