"""
The door: sections and configurations become objects of the library here, and nowhere else.

Everything outside `config` takes these objects, not sections or configurations, except the few
functions that open the door: `run_study` and others of the public interface.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.config.door.accessor import OceanAccessor as OceanAccessor
    from pymantaray.config.door.study import Study as Study, build_study as build_study
    from pymantaray.config.door.water import (
        Source as Source,
        open_water as open_water,
        open_waters as open_waters,
        water_of as water_of,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
