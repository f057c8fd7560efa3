"""
Ranges ping by ping, in the loop of a simulator: in its own process, or by a server on loopback.
"""

from pymantaray.apps.service.ping import Ping
from pymantaray.apps.service.ranging_service import RangingService
from pymantaray.apps.service.server import make_server

__all__ = ["Ping", "RangingService", "make_server"]
