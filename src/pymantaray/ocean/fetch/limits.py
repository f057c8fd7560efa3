"""How long a fetch waits and how often it asks, and what it says when that was in vain."""

from dataclasses import dataclass

from pymantaray.errors import OceanError
from pymantaray.geometry.checks import check_fields


class ServerError(OceanError):
    """What a server answered cannot be used; asking again cannot help."""


class PassingError(ServerError):
    """What a server answered cannot be used, but the next answer may be better."""

    def __init__(self, line: str, retry_after: float = 0.0) -> None:
        super().__init__(line)
        self.retry_after = retry_after


@dataclass(frozen=True)
class Limits:
    """
    How long to wait and how often to ask.

    Parameters
    ----------
    connect_s, idle_s : float
        To open a connection, and without a byte. [s]
    request_s, total_s : float
        For what is asked for at once, and for the whole fetch. [s]
    attempts : int
        For what is asked for at once, the first included.
    backoff_s, longest_backoff_s : float
        Before the second attempt, doubling with each, and at most, also where a server asks for longer. [s]
    """

    connect_s: float = 20.0
    idle_s: float = 90.0
    request_s: float = 300.0
    total_s: float = 1800.0
    attempts: int = 4
    backoff_s: float = 2.0
    longest_backoff_s: float = 60.0

    def __post_init__(self) -> None:
        """Refuse limits that could not be kept."""
        waits = ("connect_s", "idle_s", "request_s", "total_s", "attempts")
        check_fields(OceanError, self, "", *waits, positive=True)
        check_fields(OceanError, self, "", "backoff_s", "longest_backoff_s")
