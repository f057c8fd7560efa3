"""One address asked for bytes: time limits, size limits, retries; every outcome is the bytes or one line."""

import email.utils
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, TypeVar

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.messages import EXTRA, check_address, one_line, place, server_message

if TYPE_CHECKING:
    import requests

T = TypeVar("T")
_RETRIED = frozenset({408, 425, 429, 500, 502, 503, 504})
_CHUNK = 65536  # bytes


class ServerError(OceanError):
    """What a server answered cannot be used; asking again cannot help."""


class _PassingError(ServerError):
    """What a server answered cannot be used, but the next answer may be better."""


class TimeLimitError(OceanError):
    """The time that was allowed for the whole fetch has passed."""


@dataclass(frozen=True)
class Limits:
    """How long to wait and how often to ask."""

    connect_s: float = 20.0
    """To open a connection. [s]"""
    idle_s: float = 90.0
    """Without a byte. [s]"""
    request_s: float = 300.0
    """For one answer. [s]"""
    total_s: float = 1800.0
    """For the whole fetch. [s]"""
    attempts: int = 4
    """For one answer, the first included."""
    backoff_s: float = 2.0
    """Before the second attempt; doubles with each. [s]"""
    longest_backoff_s: float = 60.0
    """Between two attempts, also where a server asks for longer. [s]"""

    def __post_init__(self) -> None:
        """Refuse limits that could not be kept."""
        for name in ("connect_s", "idle_s", "request_s", "total_s"):
            if not getattr(self, name) > 0.0:
                raise OceanError(f"fetch: {name} is {getattr(self, name)}; must be positive")
        if self.attempts < 1 or not self.backoff_s >= 0.0 or not self.longest_backoff_s >= 0.0:
            raise OceanError("fetch: attempts must be at least 1 and backoff_s at least 0")


class Transport:
    """
    Gets addresses one after another over one connection, within a total time limit.

    pydap's own client is not used for this: its time limit holds for each read from the socket only, its
    session repeats requests inside one call, and where https fails it falls back to http.

    Parameters
    ----------
    limits : Limits, optional

    Raises
    ------
    OceanError
        If the packages of the extra are not installed.
    """

    def __init__(self, limits: Limits | None = None) -> None:
        try:
            import requests
        except ImportError:
            raise OceanError(f"fetch: {EXTRA}") from None
        self.limits = limits or Limits()
        self.requests = 0
        self._session = requests.Session()
        self._session.headers["User-Agent"] = f"pymantaray/{version('pymantaray')}"
        self._end = time.monotonic() + self.limits.total_s

    def close(self) -> None:
        """Close the connection."""
        self._session.close()

    def remaining(self) -> float:
        """
        Time left for the whole fetch.

        Returns
        -------
        float
            [s]

        Raises
        ------
        TimeLimitError
            If there is none.
        """
        left = self._end - time.monotonic()
        if left <= 0.0:
            raise TimeLimitError(
                f"fetch: the time limit of {self.limits.total_s:g} s has passed; what arrived is kept,"
                " run the same command again or give more time"
            )
        return left

    def get(self, url: str, largest: int, parse: Callable[[bytes], T]) -> tuple[bytes, T]:
        """
        Get the answer of an address, and what it means.

        Parameters
        ----------
        url : str
            http or https.
        largest : int
            Bytes after which an answer is given up.
        parse : callable
            Gives the meaning; any exception of it counts as a broken answer, which is asked for again.

        Returns
        -------
        body : bytes
        parsed : object

        Raises
        ------
        ServerError
            If the server refuses, or no attempt gave an answer that can be used.
        TimeLimitError
            If the total time limit passes.
        """
        check_address(url)
        reason = ""
        for attempt in range(self.limits.attempts):
            try:
                body = self._once(url, largest)
                return body, _parsed(body, parse)
            except _PassingError as error:
                reason = str(error)
                self._wait(attempt, error)
        raise ServerError(f"{place(url)}: {reason} ({self.limits.attempts} attempts)")

    def _wait(self, attempt: int, error: _PassingError) -> None:
        if attempt + 1 == self.limits.attempts:
            return
        asked = float(getattr(error, "retry_after", 0.0))
        pause = max(self.limits.backoff_s * 2.0**attempt, asked)
        time.sleep(min(pause, self.limits.longest_backoff_s, self.remaining()))
        self.remaining()

    def _once(self, url: str, largest: int) -> bytes:
        import requests
        import urllib3

        left = self.remaining()
        end = time.monotonic() + min(self.limits.request_s, left)
        waits = (min(self.limits.connect_s, left), min(self.limits.idle_s, self.limits.request_s, left))
        self.requests += 1
        try:
            with self._session.get(url, stream=True, timeout=waits) as answer:
                _check_status(
                    url, answer, self._read(answer, 65536, end) if answer.status_code >= 400 else b""
                )
                return self._read(answer, largest, end)
        except requests.ConnectTimeout:
            raise _PassingError(f"no connection within {waits[0]:.3g} s") from None
        except (requests.Timeout, urllib3.exceptions.ReadTimeoutError):
            raise _PassingError(f"no answer within {waits[1]:.3g} s") from None
        except requests.exceptions.TooManyRedirects:
            raise ServerError(f"{place(url)}: redirects without end") from None
        except (requests.RequestException, urllib3.exceptions.HTTPError, OSError) as error:
            raise _PassingError(_connection_line(error)) from None

    def _read(self, answer: "requests.Response", largest: int, end: float) -> bytes:
        parts, size = [], 0
        # read1 returns after one read of the socket, so that a server that drips is stopped by the clock
        while part := answer.raw.read1(_CHUNK, decode_content=True):
            parts.append(part)
            size += len(part)
            if size > largest:
                raise _PassingError(f"wrong size: more than the {largest} bytes that were to be expected")
            if time.monotonic() > end:
                self.remaining()
                raise _PassingError(f"answer not complete within {self.limits.request_s:g} s")
        return b"".join(parts)


def _parsed(body: bytes, parse: Callable[[bytes], T]) -> T:
    try:
        return parse(body)
    except ServerError:
        raise
    except OceanError as error:
        raise _PassingError(str(error)) from None
    except Exception as error:  # noqa: BLE001  a parser given garbage raises whatever it stumbles over
        raise _PassingError(f"answer cannot be read ({one_line(error) or type(error).__name__})") from None


def _check_status(url: str, answer: "requests.Response", body: bytes) -> None:
    code = answer.status_code
    if url.startswith("https:") and not answer.url.startswith("https:"):
        raise ServerError(f"{place(url)}: redirected from https to an unprotected address; refused")
    if code < 400:
        return
    said = server_message(body)
    line = f"server error {code} {answer.reason or ''}".rstrip() + (f" ({said})" if said else "")
    if code in _RETRIED:
        passing: Any = _PassingError(line)
        passing.retry_after = _seconds(answer.headers.get("Retry-After", ""))
        raise passing
    raise ServerError(f"{place(url)}: {line}")


def _seconds(header: str) -> float:
    """Retry-After as a number of seconds or a date. [s]"""
    try:
        return max(0.0, float(header))
    except ValueError:
        parsed = email.utils.parsedate_tz(header)
        return 0.0 if parsed is None else max(0.0, email.utils.mktime_tz(parsed) - time.time())


def _connection_line(error: Exception) -> str:
    text = str(error)
    if "IncompleteRead" in text or "incomplete" in text.lower():
        return "answer cut short"
    if "refused" in text:
        return "connection refused"
    if any(s in text for s in ("resolve", "getaddrinfo", "Name or service")):
        return "host not found"
    return f"connection failed ({one_line(getattr(error, 'reason', None) or error, 100)})"
