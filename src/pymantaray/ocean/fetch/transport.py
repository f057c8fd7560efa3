"""Requests through pydap with strict time limits; the outcome is data or a one-line error."""

import email.utils
import re
import socket
import threading
import time
import warnings
import weakref
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from typing import Any, Self, TypeVar
from urllib.parse import quote, urlsplit, urlunsplit

import requests
import urllib3
from requests.adapters import HTTPAdapter

from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.ocean.fetch.catalogue import split_address
from pymantaray.ocean.fetch.limits import FetchLimits, ServerError, TransientServerError

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # it imports webob, and that cgi
    from pydap.client import open_url
    from pydap.model import DatasetType

T = TypeVar("T")
_RETRIED = frozenset({408, 425, 429, 500, 502, 503, 504})
_CAUSES = {
    "IncompleteRead|incomplete|ended prematurely": "incomplete answer",
    "refused": "connection refused",
    "resolve|getaddrinfo|Name or service": "host not found",
}
"""Causes of failed connections by words in the errors of the libraries."""
_MAX_ANSWER = 64 << 20  # bytes


class Connection:
    """
    Connection to an OPeNDAP server for a sequence of requests with retries and a total time limit.

    Each attempt runs in its own thread. When its time has passed, the connection abandons the
    thread and closes its sockets. The client library limits only single reads from a socket, which
    a server can keep alive forever.
    """

    def __init__(self, root: str, limits: FetchLimits) -> None:
        self.root, account = split_address(root)
        self.limits = limits
        self.requests = 0
        self._end = time.monotonic() + limits.total_s
        self._adapter = _Adapter()
        self._session = _Session()
        self._session.headers["User-Agent"] = f"pymantaray/{version('pymantaray')}"
        self._session.auth = account
        self._session.adapters.clear()
        for scheme in ("https", urlsplit(self.root).scheme):  # no redirects from https to http
            self._session.mount(f"{scheme}://", self._adapter)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def open(self, url: str) -> DatasetType:
        """
        Open a pydap data set, which reads its arrays when they are indexed; call it inside `ask`.
        """
        # pydap would replace this session by its own, without account and limits; therefore it gets
        # a gateway
        return open_url(url, application=self._gateway, protocol="dap2")

    def _gateway(
        self, environ: dict[str, str], start_response: Callable[..., object]
    ) -> list[bytes]:
        parts = urlsplit(self.root)
        query = environ["QUERY_STRING"].replace("[", "%5B").replace("]", "%5D")
        url = urlunsplit((parts.scheme, parts.netloc, quote(environ["PATH_INFO"]), query, ""))
        start_response("200 OK", [("Content-Type", "text/plain; charset=utf-8")])
        return [self._get(url)]

    def _get(self, url: str) -> bytes:
        self.requests += 1
        waits = (self.limits.connect_s, self.limits.idle_s)
        try:
            with self._session.get(url, stream=True, timeout=waits) as answer:
                body = _whole(answer)
        except requests.ConnectTimeout:
            raise TransientServerError(f"no connection within {waits[0]:.3g} s") from None
        except (requests.Timeout, urllib3.exceptions.ReadTimeoutError):
            raise TransientServerError(f"no answer within {waits[1]:.3g} s") from None
        except requests.exceptions.TooManyRedirects:
            raise ServerError("too many redirects") from None
        except requests.exceptions.InvalidSchema:
            raise ServerError("redirect to an address without https is not allowed") from None
        except (requests.RequestException, urllib3.exceptions.HTTPError, OSError) as error:
            raise TransientServerError(_connection_line(error)) from None
        _check(answer, body)
        return body

    def ask(self, url: str, read: Callable[[], T]) -> T:
        """Call a function that reads from the server, with retries after transient errors."""
        where = f"{urlsplit(url).hostname}{urlsplit(url).path}"
        for attempt in range(self.limits.attempts):
            try:
                return self._within(min(self.limits.request_s, self._remaining()), read)
            except TransientServerError as error:
                reason = str(error)
                pause = max(self.limits.backoff_s * 2.0**attempt, error.retry_after)
            except ServerError as error:
                raise ServerError(f"{where}: {error}") from None
            if attempt + 1 < self.limits.attempts:
                time.sleep(min(pause, self.limits.longest_backoff_s, self._remaining()))
        raise ServerError(f"{where}: {reason} ({self.limits.attempts} attempts)")

    def _remaining(self) -> float:
        left = self._end - time.monotonic()
        if left <= 0.0:
            raise OceanError(
                f"fetch: the time limit of {self.limits.total_s:g} s has passed; try again later,"
                " or give a longer `total_s`"
            )
        return left

    def _within(self, seconds: float, read: Callable[[], T]) -> T:
        answers: list[T] = []
        errors: list[BaseException] = []

        def work() -> None:
            try:
                answers.append(read())
            except BaseException as error:  # noqa: BLE001  a parser raises any type on invalid data
                errors.append(error)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        try:
            thread.join(seconds)
        finally:
            late = thread.is_alive()
            if late:
                self._adapter.hang_up(thread)
        if late:
            self._remaining()
            raise TransientServerError(f"no complete answer within {seconds:.3g} s")
        if answers:
            return answers[0]
        error = errors[0]
        if isinstance(error, ServerError):
            raise error
        if isinstance(error, OceanError):
            raise TransientServerError(str(error))
        raise TransientServerError(f"unreadable answer ({one_line(error) or type(error).__name__})")


class _Session(requests.Session):
    """
    A session that does not forward passwords to redirects or read them from ``~/.netrc``, as the
    library does by default.
    """

    def rebuild_auth(
        self, prepared_request: requests.PreparedRequest, response: requests.Response
    ) -> None:
        if self.should_strip_auth(response.request.url or "", prepared_request.url or ""):
            prepared_request.headers.pop("Authorization", None)


class _Adapter(HTTPAdapter):
    """
    Adapter that records its sockets, to close them under a waiting thread, and threads whose time
    has passed.
    """

    def __init__(self) -> None:
        super().__init__(pool_maxsize=1)
        self._sockets: weakref.WeakSet[socket.socket] = weakref.WeakSet()
        self._late: weakref.WeakSet[threading.Thread] = weakref.WeakSet()
        self._lock = threading.Lock()

    def get_connection_with_tls_context(self, *args: Any, **kwargs: Any) -> Any:
        pool: Any = super().get_connection_with_tls_context(*args, **kwargs)
        if "ConnectionCls" not in vars(pool):
            pool.ConnectionCls = _remembering(pool.ConnectionCls, self.remember)
        return pool

    def remember(self, connected: socket.socket) -> None:
        """
        Record a socket of this thread; close it if the thread's time passed while it connected.
        """
        with self._lock:
            self._sockets.add(connected)
            if threading.current_thread() in self._late:
                _shut(connected)

    def hang_up(self, late: threading.Thread) -> None:
        """Close all sockets, and later those that a late thread connects."""
        with self._lock:
            self._late.add(late)
            for busy in self._sockets:
                _shut(busy)


def _shut(busy: socket.socket) -> None:
    with suppress(OSError):
        busy.shutdown(socket.SHUT_RDWR)


def _remembering(connection: Any, remember: Callable[[socket.socket], None]) -> Any:
    class Remembering(connection):  # type: ignore[misc]
        def connect(self) -> None:
            super().connect()
            remember(self.sock)

    return Remembering


def _whole(answer: requests.Response) -> bytes:
    body = bytearray()
    for piece in answer.iter_content(1 << 16):
        body += piece
        if len(body) > _MAX_ANSWER:
            raise TransientServerError(f"wrong size: more than {_MAX_ANSWER >> 20} MiB")
    return bytes(body)


def _check(answer: requests.Response, body: bytes) -> None:
    """
    Raise an error if a response is not OPeNDAP: an error status, an error text, or an incomplete
    description.
    """
    said = _message(body)
    if answer.status_code >= 400:
        line = f"server error {answer.status_code} {answer.reason or ''}".rstrip()
        line += f" ({said})" if said else ""
        if answer.status_code in _RETRIED:
            raise TransientServerError(line, _seconds(answer.headers.get("Retry-After", "")))
        raise ServerError(line)
    if body.lstrip().startswith(b"Error"):
        raise TransientServerError(f"server reports: {said}")
    description = body.partition(b"\nData:")[0]
    if not description.lstrip().lower().startswith((b"dataset", b"attributes")):
        raise TransientServerError("the answer is not data")
    if description.count(b"{") != description.count(b"}"):
        raise TransientServerError("incomplete answer")


def _message(body: bytes) -> str:
    """Text of an error page or an OPeNDAP error as one line without tags."""
    text = body[:4000].decode("utf-8", errors="replace")
    said = re.match(r'\s*Error[^"]*"([^"]*)', text)
    return one_line(said[1] if said else re.sub(r"<[^>]*>", "", text), 100)


def _seconds(header: str) -> float:
    """Retry-After from a number of seconds or a date; 0 for other text. [s]"""
    with suppress(ValueError):
        return float(header)
    with suppress(ValueError, TypeError, OverflowError):
        return email.utils.parsedate_to_datetime(header).timestamp() - time.time()
    return 0.0


def _connection_line(error: Exception) -> str:
    for words, line in _CAUSES.items():
        if re.search(words, str(error)):
            return line
    return f"connection failed ({one_line(getattr(error, 'reason', None) or error, 100)})"
