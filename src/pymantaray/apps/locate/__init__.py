"""
Estimation of node positions and their covariance from a survey of travel times.

Examples
--------
>>> import numpy as np
>>> from pymantaray import Medium, find_eigenrays
>>> from pymantaray.apps.locate import LocateOptions, Node, Survey, locate
>>> water = Medium.from_profile([0.0, 1500.0], [1500.0, 1510.0], bottom_depth=1500.0)
>>> bearing = np.linspace(0.0, 12.0, 60)
>>> ship = np.stack([900.0 * np.cos(bearing), 900.0 * np.sin(bearing), 0.0 * bearing], axis=-1)
>>> rays = find_eigenrays(water, ship, np.tile([30.0, -20.0, 1300.0], (60, 1)))
>>> noise = 1e-4 * np.random.default_rng(1).standard_normal(60)
>>> survey = Survey(
...     nodes=(Node("M1", (0.0, 0.0, 1300.0)),),
...     node=np.zeros(60, dtype=int),
...     time=60.0 * np.arange(60),
...     travel_time=2.0 * rays.travel_time + noise,
...     transmit_position=ship,
...     receive_position=ship,
... )
>>> location = locate(survey, water, LocateOptions(earth="flat"))
>>> print(location.positions.round(1))
[[  30.  -20. 1300.]]
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.locate.displacement import (
        Campaign as Campaign,
        Displacement as Displacement,
        displacement_between as displacement_between,
        read_campaign as read_campaign,
    )
    from pymantaray.apps.locate.location import Location as Location, locate as locate
    from pymantaray.apps.locate.options import (
        LocateOptions as LocateOptions,
        PlanOptions as PlanOptions,
        SpeedPrior as SpeedPrior,
    )
    from pymantaray.apps.locate.page import (
        write_location_page as write_location_page,
        write_plan_figure as write_plan_figure,
    )
    from pymantaray.apps.locate.ping_pattern import Pattern as Pattern
    from pymantaray.apps.locate.plan import SurveyPlan as SurveyPlan, plan_survey as plan_survey
    from pymantaray.apps.locate.read import read_survey as read_survey
    from pymantaray.apps.locate.read_options import ReadOptions as ReadOptions
    from pymantaray.apps.locate.survey import (
        LeverArm as LeverArm,
        Node as Node,
        PlatformError as PlatformError,
        Survey as Survey,
        TravelDirection as TravelDirection,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
