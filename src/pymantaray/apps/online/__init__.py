"""Estimator for use on board, which is fed as measurements arrive."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.online.drifting_water import (
        DriftingWater as DriftingWater,
        SoundSpeedBias as SoundSpeedBias,
    )
    from pymantaray.apps.online.slow_errors import LearnedWays as LearnedWays, WayError as WayError
    from pymantaray.apps.online.timeline import Outcome as Outcome
    from pymantaray.apps.online.vehicle import (
        Beacon as Beacon,
        OnlineEstimator as OnlineEstimator,
        PoseEstimate as PoseEstimate,
        StartPose as StartPose,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
