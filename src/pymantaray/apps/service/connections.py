"""
Connections of the server: JSON for malformed HTTP, and limits that a slow or silent client cannot
hold open.
"""

import socket
import time
from contextlib import suppress
from typing import Any

from waitress.channel import ClientDisconnected, HTTPChannel
from waitress.task import ErrorTask

from pymantaray.apps.service.messages import error_body

TIMEOUT = 120  # seconds without a complete request until a connection is closed


class JsonErrorTask(ErrorTask):  # type: ignore[misc]
    """Answer of malformed or oversized requests, in the same form as other errors."""

    def service(self) -> None:
        """
        Answer; a client that has left needs no answer. Waitress would log the path, which a
        malformed request may lack.
        """
        try:
            super().service()
        except ClientDisconnected:
            self.close_on_finish = True

    def execute(self) -> None:
        """Write the error as JSON and close the connection."""
        error = self.request.error
        body = error_body(f"{error.reason}: {error.body}")
        self.status = f"{error.code} {error.reason}"
        self.response_headers.append(("Content-Type", "application/json"))
        self.set_close_on_finish()
        self.content_length = len(body)
        self.write(body)


class JsonChannel(HTTPChannel):  # type: ignore[misc]
    """Connection that only complete requests keep open; single bytes do not count."""

    error_task_class = JsonErrorTask
    busy = False
    last_activity: float

    def __init__(self, server: Any, *arguments: Any, **options: Any) -> None:
        super().__init__(server, *arguments, **options)
        self.last_request = self.last_activity
        idle = [channel for channel in server.active_channels.values() if channel.idle]
        if len(server.active_channels) >= server.connections and len(idle) > 1:
            min(idle, key=lambda channel: channel.last_request).hang_up()

    @property
    def idle(self) -> bool:
        """
        True if no complete request waits or is in work, and the connection is not being closed.
        """
        return not (self.requests or self.busy or self.will_close)

    def hang_up(self) -> None:
        """
        Close the connection in the next round of the loop, even if the client does not read its
        answer.
        """
        self.will_close = True
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)

    def handle_read(self) -> None:
        """Read without counting an incomplete request as activity."""
        before = self.last_activity
        super().handle_read()
        if self.idle:
            self.last_activity = before

    def service(self) -> None:
        """
        Serve a request; the connection is busy until the time of its end is recorded.

        The time of the request is recorded before the client can have its answer, so that the order
        of connections is that of their requests.
        """
        self.busy = True
        self.last_request = time.time()
        try:
            super().service()
        finally:
            self.last_activity = time.time()
            self.busy = False


def close_late(server: Any, now: float) -> None:
    """
    Close connections of a server without a complete request for `TIMEOUT`, even if the client does
    not read its answer.
    """
    for channel in list(server.active_channels.values()):
        if channel.idle and channel.last_activity < now - TIMEOUT:
            channel.hang_up()
