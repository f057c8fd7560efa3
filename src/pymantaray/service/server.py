"""Ranges over HTTP: a small WSGI application behind waitress, for simulators in other languages."""

import json
import logging
import socket
from collections.abc import Callable, Iterable
from http import HTTPStatus
from typing import Any

import pymantaray
from pymantaray.errors import MantaRayError, ServiceError
from pymantaray.service.messages import ErrorAnswer, answer, read_request, schema
from pymantaray.service.ranging_service import RangingService

MOST_BYTES = 4 * 2**20  # of a request's body
_READ_BYTES = 4 * MOST_BYTES  # of a body that is read to its end before it is refused
_MOST_HEADERS = 16 * 2**10
_THREADS = 4
_PATHS = {"/": "GET", "/schema": "GET", "/ping": "POST"}
_log = logging.getLogger("pymantaray")

Environment = dict[str, Any]
Begin = Callable[[str, list[tuple[str, str]]], object]


def application(service: RangingService) -> Callable[[Environment, Begin], Iterable[bytes]]:
    """
    WSGI application of a service.

    ``GET /`` tells the version and the ocean, ``GET /schema`` what requests and answers look like, ``POST /ping`` is a
    ping. Whatever goes wrong is JSON, ``{"error": "one line"}``, with a status of 400 and above.
    """
    facts = json.dumps({"mantaray": pymantaray.__version__, **service.water.facts()}).encode()
    schemas = json.dumps(schema()).encode()

    def respond(environ: Environment) -> tuple[HTTPStatus, bytes]:
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
    """One line that says why there is no answer."""
    return ErrorAnswer(error=line).model_dump_json().encode()


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
        error_task_class = JsonErrorTask

    logging.getLogger("waitress.queue").setLevel(logging.ERROR)  # that a request waits is no news
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.create_server(address[:2], family=family)
    except (OSError, UnicodeError) as error:
        cause = getattr(error, "strerror", None) or error
        raise ServiceError(f"{host}, port {port}: nobody can listen there: {cause}; give another") from None
    server = create_server(
        application(service),
        sockets=[listening],
        threads=_THREADS,
        max_request_body_size=_READ_BYTES,
        max_request_header_size=_MOST_HEADERS,
        asyncore_use_poll=True,
        ident="mantaray",
    )
    server.channel_class = JsonChannel
    return server
