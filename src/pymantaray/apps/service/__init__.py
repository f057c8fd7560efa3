"""
Ranges ping by ping, in the loop of a simulator: in its own process, or by a server on loopback.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.service.ranging_service import (
        Ping as Ping,
        RangingService as RangingService,
    )
    from pymantaray.apps.service.server import make_server as make_server

__getattr__, __dir__, __all__ = lazy_exports(__name__)
