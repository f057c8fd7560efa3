"""Ranges over HTTP: a small WSGI application behind waitress, for simulators in other languages."""

import json
import logging
import resource
import socket
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from http import HTTPStatus
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

import pymantaray
from pymantaray.errors import MantaRayError, ServiceError
from pymantaray.jobs.processes import WorkerEndedError
from pymantaray.messages import one_line
from pymantaray.service.facts import facts as facts_of
from pymantaray.service.messages import ErrorAnswer, answer, read_request, schema
from pymantaray.service.ranging_service import RangingService

MOST_BYTES = 4 * 2**20  # of a request's body
_READ_BYTES = 4 * MOST_BYTES  # of a body that is read to its end before it is refused
_MOST_HEADERS = 16 * 2**10
_THREADS = 4
_MOST_CONNECTIONS = 200
_OTHER_FILES = 64  # that this process has open beside connections, at least
_TIMEOUT = 120  # seconds without a complete request after which a connection is closed
_LONGEST_LINE = 480
_PATHS = {"/": "GET", "/schema": "GET", "/ping": "POST"}
_log = logging.getLogger("pymantaray")

Environment = dict[str, Any]
Begin = Callable[[str, list[tuple[str, str]]], object]


def application(
    service: RangingService, *, loopback: bool = False
) -> Callable[[Environment, Begin], Iterable[bytes]]:
    """
    WSGI application of a service.

    ``GET /`` tells the version and the ocean, ``GET /schema`` what requests and answers look like, ``POST /ping`` is a
    ping. Whatever goes wrong is JSON, ``{"error": "one line"}``, with a status of 400 and above. Requests that a page of
    another site makes a browser send are refused; on loopback also those by a name that is not this machine's.
    """
    facts = json.dumps({"mantaray": pymantaray.__version__, **facts_of(service.water)}).encode()
    schemas = json.dumps(schema()).encode()

    def respond(environ: Environment) -> tuple[HTTPStatus, bytes]:
        stranger = _stranger(environ, loopback=loopback)
        if stranger:
            return HTTPStatus.FORBIDDEN, error_body(stranger)
        path, method = environ["PATH_INFO"] or "/", environ["REQUEST_METHOD"]
        if path not in _PATHS:
            there = ", ".join(f"{verb} {name}" for name, verb in _PATHS.items())
            return HTTPStatus.NOT_FOUND, error_body(f"no {path[:100]!r}; there are {there}")
        if method != _PATHS[path]:
            return HTTPStatus.METHOD_NOT_ALLOWED, error_body(
                f"{method[:20]} {path}; only {_PATHS[path]} is allowed"
            )
        if method == "GET":
            return HTTPStatus.OK, facts if path == "/" else schemas
        length = int(environ.get("CONTENT_LENGTH") or 0)
        if length > MOST_BYTES:
            line = f"the request has {length:,} bytes; {MOST_BYTES:,} are allowed: ask for fewer receivers at a time"
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE, error_body(line)
        try:
            ping = answer(service, read_request(environ["wsgi.input"].read(length)))
        except WorkerEndedError as error:
            _log.error("POST /ping: %s", error)
            return HTTPStatus.SERVICE_UNAVAILABLE, error_body(f"{error}; ask again")
        except MantaRayError as error:
            return HTTPStatus.BAD_REQUEST, error_body(str(error))
        return HTTPStatus.OK, ping.model_dump_json().encode()

    def call(environ: Environment, begin: Begin) -> Iterable[bytes]:
        try:
            status, body = respond(environ)
        except Exception:  # noqa: BLE001  the server goes on
            _log.exception("%s %s", environ.get("REQUEST_METHOD"), environ.get("PATH_INFO"))
            status, body = (
                HTTPStatus.INTERNAL_SERVER_ERROR,
                error_body("a fault of the server; its log has more"),
            )
        headers = [("Content-Type", "application/json"), ("Content-Length", str(len(body)))]
        if status == HTTPStatus.METHOD_NOT_ALLOWED:
            headers.append(("Allow", _PATHS[environ["PATH_INFO"] or "/"]))
        begin(f"{status.value} {status.phrase}", headers)
        return [body]

    return call


def error_body(line: str) -> bytes:
    """One short printable line that says why there is no answer."""
    return ErrorAnswer(error=one_line(line, _LONGEST_LINE)).model_dump_json().encode()


def _stranger(environ: Environment, *, loopback: bool) -> str:
    """Why a request is none of this server's, empty if it is: a browser sends it for a page of another site, or to another name."""
    host = environ.get("HTTP_HOST", "").strip().lower()
    if loopback and host and not _is_loopback(host):
        return f"Host: {host[:100]!r}; a server that listens on this machine only answers to localhost, 127.0.0.1 and [::1]"
    origin = environ.get("HTTP_ORIGIN", "").strip().lower()
    if origin and origin not in (f"http://{host}", f"https://{host}"):
        return f"Origin: {origin[:100]!r}; requests of other sites' pages are refused"
    return ""


def _is_loopback(host: str) -> bool:
    """True if a host, with a port or without, is a name or address of loopback."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ip_address(name).is_loopback
    except ValueError:
        return False


def make_server(service: RangingService, host: str = "127.0.0.1", port: int = 0) -> Any:
    """
    Server that listens; its ``run`` serves until it is interrupted.

    Parameters
    ----------
    service : RangingService
    host : str
        Name or address to listen at.
    port : int
        0 takes one that is free.

    Returns
    -------
    waitress.server.BaseWSGIServer
        ``effective_host`` and ``effective_port`` say where it listens.

    Raises
    ------
    ServiceError
        If waitress is not installed, or nobody can listen there.
    """
    try:
        from waitress.channel import HTTPChannel
        from waitress.server import create_server
        from waitress.task import ErrorTask
    except ImportError:
        raise ServiceError("a server needs waitress: pip install 'pymantaray[serve]'") from None

    class JsonErrorTask(ErrorTask):  # type: ignore[misc]
        """What is no HTTP, or too large to be read, is refused in the same form as everything else."""

        def execute(self) -> None:
            refusal = self.request.error
            body = error_body(f"{refusal.reason}: {refusal.body}")
            self.status = f"{refusal.code} {refusal.reason}"
            self.response_headers.append(("Content-Type", "application/json"))
            self.set_close_on_finish()
            self.content_length = len(body)
            self.write(body)

    class JsonChannel(HTTPChannel):  # type: ignore[misc]
        """A connection that only whole requests keep open, so that a client cannot hold it by a byte now and then."""

        error_task_class = JsonErrorTask
        busy = False
        last_activity: float

        def __init__(self, server: Any, *arguments: Any, **options: Any) -> None:
            super().__init__(server, *arguments, **options)
            idle = [channel for channel in server.active_channels.values() if channel.idle]
            if len(server.active_channels) >= most and len(idle) > 1:
                min(idle, key=lambda channel: channel.last_activity).hang_up()

        @property
        def idle(self) -> bool:
            """True if no whole request waits or is worked at, and the connection is not being closed."""
            return not (self.requests or self.busy or self.will_close)

        def hang_up(self) -> None:
            """Have the loop close the connection in its next round, even if the client does not read its answer."""
            self.will_close = True
            with suppress(OSError):
                self.socket.shutdown(socket.SHUT_RDWR)

        def handle_read(self) -> None:
            before = self.last_activity
            super().handle_read()
            if self.idle:
                self.last_activity = before

        def service(self) -> None:
            self.busy = True  # beyond the end of its request, until the time of that is written down
            try:
                super().service()
            finally:
                self.last_activity = time.time()
                self.busy = False

    def close_late(now: float) -> None:
        """Close connections without a whole request for long, also those whose client does not read its answer."""
        for channel in list(server.active_channels.values()):
            if channel.idle and channel.last_activity < now - _TIMEOUT:
                channel.hang_up()

    logging.getLogger("waitress.queue").setLevel(logging.ERROR)  # that a request waits is no news
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.create_server(address[:2], family=family)
    except (OSError, UnicodeError) as error:
        cause = getattr(error, "strerror", None) or error
        raise ServiceError(f"{host}, port {port}: nobody can listen there: {cause}; give another") from None
    most = _most_connections()
    server = create_server(
        application(service, loopback=ip_address(listening.getsockname()[0].partition("%")[0]).is_loopback),
        sockets=[listening],
        threads=_THREADS,
        max_request_body_size=_READ_BYTES,
        max_request_header_size=_MOST_HEADERS,
        asyncore_use_poll=True,
        connection_limit=most
        + 10,  # the library counts its own sockets too; at the limit it waits for requests to end
        cleanup_interval=1,
        channel_timeout=_TIMEOUT,
        ident="mantaray",
    )
    server.channel_class = JsonChannel
    server.maintenance = close_late
    return server


def _most_connections() -> int:
    """Number of connections that are kept open, fewer where the system allows this process few open files."""
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files == resource.RLIM_INFINITY:
        return _MOST_CONNECTIONS
    return max(min(_MOST_CONNECTIONS, (files - _OTHER_FILES) // 2), 4)
