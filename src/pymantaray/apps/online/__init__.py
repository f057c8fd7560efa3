"""Estimator for use on board, which is fed as measurements arrive."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.online.drifting_water import DriftingWater as DriftingWater
    from pymantaray.apps.online.drifting_water import SoundSpeedBias as SoundSpeedBias
    from pymantaray.apps.online.timeline import Outcome as Outcome
    from pymantaray.apps.online.vehicle import Beacon as Beacon
    from pymantaray.apps.online.vehicle import OnlineEstimator as OnlineEstimator
    from pymantaray.apps.online.vehicle import PoseEstimate as PoseEstimate
    from pymantaray.apps.online.vehicle import StartPose as StartPose

__getattr__, __dir__, __all__ = lazy_exports(__name__)
