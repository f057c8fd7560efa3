"""
Measurements of the vehicles: one module per sensor, acoustic ranges, and noise.

Noise levels import quickly; the modules of ranges are imported on first use.

Examples
--------
>>> import numpy as np
>>> from pymantaray import Medium, Trajectories
>>> from pymantaray.sensing import NoiseModel, PingSchedule, assemble, measure_ranges
>>> truth = Trajectories(
...     name=["A", "B"],
...     role=["station", "station"],
...     time=[0.0, 600.0],
...     position=[[[0.0, 0.0, 20.0]] * 2, [[2000.0, 0.0, 400.0]] * 2],
...     quaternion=[[[1.0, 0.0, 0.0, 0.0]] * 2] * 2,
...     status=[[0, 0], [0, 0]],
... )
>>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
>>> schedule = PingSchedule(interval=600.0)
>>> ranging = measure_ranges(truth, [], medium, schedule)
>>> measurements = assemble(truth, [], ranging, NoiseModel())
>>> print(ranging.truth.travel_time.round(4), measurements.refracted_range.round(1))
[1.393 1.393] [2023.7 2040.8]
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.sensing.detection import Detector as Detector, Hearing as Hearing
    from pymantaray.sensing.draws import RangingDraws as RangingDraws
    from pymantaray.sensing.landmarks import Landmark as Landmark
    from pymantaray.sensing.measure import assemble as assemble, perturb as perturb
    from pymantaray.sensing.noise import NoiseModel as NoiseModel
    from pymantaray.sensing.picking import (
        Candidates as Candidates,
        Picker as Picker,
        draw_picks as draw_picks,
        find_candidates as find_candidates,
    )
    from pymantaray.sensing.ranging import (
        Links as Links,
        Ranging as Ranging,
        link_positions as link_positions,
        measure_ranges as measure_ranges,
    )
    from pymantaray.sensing.receptions import Receptions as Receptions, SoundPath as SoundPath
    from pymantaray.sensing.schedule import (
        PingList as PingList,
        PingSchedule as PingSchedule,
        Schedule as Schedule,
        SlotSchedule as SlotSchedule,
    )
    from pymantaray.sensing.timing import (
        ClockModel as ClockModel,
        Clocks as Clocks,
        OneWay as OneWay,
        Timing as Timing,
        TwoWay as TwoWay,
    )
    from pymantaray.sensing.transmission import (
        ReceptionOptions as ReceptionOptions,
        Transmission as Transmission,
        find_receptions as find_receptions,
    )
    from pymantaray.sensing.water import Water as Water

__getattr__, __dir__, __all__ = lazy_exports(__name__)
