"""
Stop requests (Ctrl-C, SIGTERM) while compiled code runs, which does not return to Python to handle
them.

Python runs a signal handler between two of its own instructions, so a long call of compiled code
would leave no way to end the process but SIGKILL. A thread learns of the signal at once, and ends
the process if the handler has not run after a few seconds. Compiled code releases the GIL
(`compile`), so the thread can run.
"""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from pymantaray.records import stops

_PATIENCE = 3.0  # s
_STOPS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def answered_stops() -> Iterator[None]:
    """
    Handle stop requests in the block by exceptions, and end the process if they cannot be raised.
    """
    if (
        threading.current_thread() is not threading.main_thread()
    ):  # other threads cannot set signal handlers
        yield
        return
    read, write = os.pipe()
    os.set_blocking(write, False)
    before = {number: signal.signal(number, _raise) for number in _STOPS}
    earlier = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    stops.handled.clear()
    watch = threading.Thread(target=_watch, args=(read,), daemon=True)
    watch.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(earlier)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(write)  # ends the thread, which closes the other end


def end_after_stop(code: object) -> None:
    """
    After a stop request, end the process in a few seconds if threads of compiled code keep it from
    ending by itself.
    """
    if stops.handled.is_set() and isinstance(code, int):
        timer = threading.Timer(_PATIENCE, os._exit, (code,))
        timer.daemon = True
        timer.start()


def _ignore_signals_of_children() -> None:
    """Detach a forked process from the pipe of its parent."""
    if threading.current_thread() is threading.main_thread():
        signal.set_wakeup_fd(-1)


os.register_at_fork(after_in_child=_ignore_signals_of_children)


def _raise(number: int, _frame: FrameType | None) -> None:
    """Raise an exception for a stop request, so that unfinished files are removed."""
    stops.handled.set()
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)


def _watch(pipe: int) -> None:
    """
    End the process if a signal whose number arrives in a pipe is not handled; return at the end of
    the pipe.
    """
    with open(pipe, "rb", buffering=0) as numbers:
        while number := numbers.read(1):
            if (
                number[0] in _STOPS
                and not stops.handled.wait(_PATIENCE)
                and not stops.are_deferred()
            ):
                os._exit(128 + number[0])
