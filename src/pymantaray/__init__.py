"""
MantaRay: effects of refraction in the ocean on acoustic ranges, and on the positions estimated from
them.

The names here are those that most work begins with; each is imported from its folder when it is
first used. All other public names are imported from the folder that has them: those of an
application from ``pymantaray.apps``, such as ``from pymantaray.apps.study import run_study``.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports
from pymantaray.version import __version__ as __version__

if TYPE_CHECKING:
    from pymantaray.acoustics import Medium as Medium, find_eigenrays as find_eigenrays
    from pymantaray.config import StudyConfig as StudyConfig, load_study as load_study
    from pymantaray.config.door.water import open_water as open_water, open_waters as open_waters
    from pymantaray.errors import MantaRayError as MantaRayError
    from pymantaray.exchange import read_trajectories as read_trajectories
    from pymantaray.geometry import LocalFrame as LocalFrame
    from pymantaray.ocean import open_ocean as open_ocean, to_local as to_local
    from pymantaray.records import (
        Arrivals as Arrivals,
        Estimates as Estimates,
        Measurements as Measurements,
        Trajectories as Trajectories,
    )
    from pymantaray.sensing.water import Water as Water

__getattr__, __dir__, __all__ = lazy_exports(__name__)
