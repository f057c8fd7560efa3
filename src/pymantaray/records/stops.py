"""Requests to stop (Ctrl-C, SIGTERM) that wait until a library has released its locks."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

handled = threading.Event()
"""Set once Python runs the handler of a stop request."""
requested: list[int] = []
"""Signals for which the handler raised an exception."""
unfinished: set[Path] = set()
"""Temporary files to remove if a stop request ends the process at once."""
_DEFERRED: list[int] = []


def are_deferred() -> bool:
    """True within a block that defers stop requests."""
    return bool(_DEFERRED)


@contextmanager
def deferred_stops() -> Iterator[None]:
    """
    Handle the first Ctrl-C or SIGTERM after the block; handle a second one at once.

    A handler that raises while xarray takes its lock of the HDF5 library leaves the lock taken, and
    the file's close waits forever. Other threads than the main thread handle no signals; there the
    block is an ordinary one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    stops = ((number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM))
    # handlers that are not callable do not raise
    handlers = {number: handler for number, handler in stops if callable(handler)}
    waiting: list[int] = []

    def wait(number: int, frame: FrameType | None) -> None:
        waiting.append(number)
        handled.set()
        if len(waiting) > 1:
            handlers[signal.Signals(number)](number, frame)

    for number in handlers:
        signal.signal(number, wait)
    _DEFERRED.append(1)
    try:
        yield
    finally:
        _DEFERRED.pop()
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if len(waiting) == 1:
            signal.raise_signal(waiting[0])
