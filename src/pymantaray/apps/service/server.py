"""Ranges over HTTP: a small WSGI application behind waitress, for simulators in other languages."""

import json
import logging
import resource
import socket
from collections.abc import Callable, Iterable
from functools import partial
from http import HTTPStatus
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from pymantaray.apps.service.messages import answer_body, error_body, schema
from pymantaray.apps.service.ranging_service import RangingService, facts as facts_of
from pymantaray.errors import MantaRayError, ServiceError, optional_package
from pymantaray.jobs.processes import WorkerEndedError
from pymantaray.version import __version__

MAX_BYTES = 4 * 2**20  # of a request's body
_READ_BYTES = 4 * MAX_BYTES  # of a body that is read to its end before it is refused
_MAX_HEADERS = 16 * 2**10
_THREADS = 4
_MAX_CONNECTIONS = 200
_OWN_SOCKETS = 10  # of the library, which counts them as connections
_OTHER_FILES = 64  # open files of this process besides connections, at least
_PATHS = {"/": "GET", "/schema": "GET", "/ping": "POST"}
_log = logging.getLogger("pymantaray")

Environment = dict[str, Any]
Begin = Callable[[str, list[tuple[str, str]]], object]


def application(
    service: RangingService, *, loopback: bool = False
) -> Callable[[Environment, Begin], Iterable[bytes]]:
    """
    WSGI application of a service.

    ``GET /`` returns the version and facts of the ocean, ``GET /schema`` the JSON schemas, and
    ``POST /ping`` the outcome of a ping. Errors are JSON, ``{"error": "one line"}``, with a status
    of 400 and above. Requests that a browser sends for a page of another site are refused; on
    loopback also those by a name that is not this machine's.
    """
    facts = json.dumps({"mantaray": __version__, **facts_of(service.water)}).encode()
    schemas = json.dumps(schema()).encode()

    def respond(environ: Environment) -> tuple[HTTPStatus, bytes]:
        reason = _foreign(environ, loopback=loopback)
        if reason:
            return HTTPStatus.FORBIDDEN, error_body(reason)
        path = environ["PATH_INFO"] or "/"
        method = environ["REQUEST_METHOD"]
        if path not in _PATHS:
            there = ", ".join(f"{verb} {name}" for name, verb in _PATHS.items())
            return HTTPStatus.NOT_FOUND, error_body(f"no {path[:100]!r}; allowed are {there}")
        if method != _PATHS[path]:
            return HTTPStatus.METHOD_NOT_ALLOWED, error_body(
                f"{method[:20]} {path}; only {_PATHS[path]} is allowed"
            )
        if method == "GET":
            return HTTPStatus.OK, facts if path == "/" else schemas
        length = int(environ.get("CONTENT_LENGTH") or 0)
        if length > MAX_BYTES:
            line = (
                f"the request has {length:,} bytes; {MAX_BYTES:,} are allowed: ask for fewer"
                " receivers at a time"
            )
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE, error_body(line)
        try:
            body = service.call(answer_body, environ["wsgi.input"].read(length))
        except WorkerEndedError as error:
            _log.error("POST /ping: %s", error)
            return HTTPStatus.SERVICE_UNAVAILABLE, error_body(f"{error}; ask again")
        except MantaRayError as error:
            return HTTPStatus.BAD_REQUEST, error_body(str(error))
        return HTTPStatus.OK, body

    def call(environ: Environment, begin: Begin) -> Iterable[bytes]:
        try:
            status, body = respond(environ)
        except Exception:  # noqa: BLE001  the server goes on
            _log.exception("%s %s", environ.get("REQUEST_METHOD"), environ.get("PATH_INFO"))
            status = HTTPStatus.INTERNAL_SERVER_ERROR
            body = error_body("internal error of the server; see its log")
        headers = [("Content-Type", "application/json"), ("Content-Length", str(len(body)))]
        if status == HTTPStatus.METHOD_NOT_ALLOWED:
            headers.append(("Allow", _PATHS[environ["PATH_INFO"] or "/"]))
        begin(f"{status.value} {status.phrase}", headers)
        return [body]

    return call


def _foreign(environ: Environment, *, loopback: bool) -> str:
    """
    Reason to refuse a request that a browser sends for a page of another site, or to another name;
    empty without one.
    """
    host = environ.get("HTTP_HOST", "").strip().lower()
    if loopback and host and not _is_loopback(host):
        return (
            f"Host: {host[:100]!r}; a server that listens on loopback answers only to localhost,"
            " 127.0.0.1 and [::1]"
        )
    origin = environ.get("HTTP_ORIGIN", "").strip().lower()
    if origin and origin not in (f"http://{host}", f"https://{host}"):
        return f"Origin: {origin[:100]!r}; requests from pages of other sites are refused"
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
    Return a server that listens; its ``run`` serves until it is interrupted.

    Parameters
    ----------
    service : RangingService
    host : str
        Name or address to listen on.
    port : int
        0 selects a free one.

    Returns
    -------
    waitress.server.BaseWSGIServer
        Its address is ``effective_host`` and ``effective_port``.

    Raises
    ------
    ServiceError
        If waitress is not installed, or the address cannot be used.

    Examples
    --------
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.service import RangingService, make_server
    >>> medium = Medium.from_profile([0.0, 500.0], [1450.0, 1458.0], bottom_depth=500.0)
    >>> with RangingService(medium) as service:
    ...     server = make_server(service)
    ...     server.close()
    """
    with optional_package(ServiceError, "server", "waitress", "serve"):
        from waitress.server import create_server

        from pymantaray.apps.service.connections import TIMEOUT, JsonChannel, close_late
    # it reports every request that waits
    logging.getLogger("waitress.queue").setLevel(logging.ERROR)
    listening = _listening(host, port)
    loopback = ip_address(listening.getsockname()[0].partition("%")[0]).is_loopback
    connections = _max_connections()
    server = create_server(
        application(service, loopback=loopback),
        sockets=[listening],
        threads=_THREADS,
        max_request_body_size=_READ_BYTES,
        max_request_header_size=_MAX_HEADERS,
        asyncore_use_poll=True,
        connection_limit=connections
        + _OWN_SOCKETS,  # at the limit waitress waits for requests to end
        cleanup_interval=1,
        channel_timeout=TIMEOUT,
        ident="mantaray",
    )
    server.connections = connections
    server.channel_class = JsonChannel
    server.maintenance = partial(close_late, server)
    return server


def _listening(host: str, port: int) -> socket.socket:
    """Socket that listens at a name or address."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address[:2], family=family)
    except (OSError, UnicodeError) as error:
        cause = getattr(error, "strerror", None) or error
        raise ServiceError(
            f"{host}, port {port}: cannot listen there: {cause}; choose another host or port"
        ) from None


def _max_connections() -> int:
    """
    Maximum number of open connections, fewer if the system allows this process few open files.
    """
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files == resource.RLIM_INFINITY:
        return _MAX_CONNECTIONS
    return max(min(_MAX_CONNECTIONS, (files - _OTHER_FILES) // 2), 4)
