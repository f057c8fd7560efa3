"""Time limits and attempts of a download, and its errors."""

from dataclasses import dataclass

from pymantaray.errors import OceanError
from pymantaray.quantities.checks import check_fields


class ServerError(OceanError):
    """A server's response is unusable, and another attempt cannot help."""


class TransientServerError(ServerError):
    """A server's response is unusable, but another attempt may succeed."""

    def __init__(self, line: str, retry_after: float = 0.0) -> None:
        super().__init__(line)
        self.retry_after = retry_after


@dataclass(frozen=True)
class FetchLimits:
    """
    Time limits and number of attempts.

    Parameters
    ----------
    connect_s, idle_s : float
        Time limits for opening a connection, and between two bytes. [s]
    request_s : float
        Time limit of one request. [s]
    total_s : float
        Time limit of the download. [s]
    attempts : int
        Maximum number of attempts per request.
    backoff_s, longest_backoff_s : float
        Delay before the second attempt, which doubles with each attempt, and its maximum, also if a
        server asks for a longer delay. [s]
    """

    connect_s: float = 20.0
    idle_s: float = 90.0
    request_s: float = 300.0
    total_s: float = 1800.0
    attempts: int = 4
    backoff_s: float = 2.0
    longest_backoff_s: float = 60.0

    def __post_init__(self) -> None:
        """Check the limits."""
        waits = ("connect_s", "idle_s", "request_s", "total_s", "attempts")
        check_fields(OceanError, self, "", *waits, positive=True)
        check_fields(OceanError, self, "", "backoff_s", "longest_backoff_s")
