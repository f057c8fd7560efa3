"""
Stop requests (Ctrl-C, SIGTERM) while compiled code runs, which does not return to Python to handle
them.

Python runs a signal handler between two of its own instructions, so a long call of compiled code
would leave no way to end the process but SIGKILL. A thread learns of the signal at once, and ends
the process if the handler has not run after a few seconds. Compiled code releases the GIL
(`compile`), so the thread can run.

Where Python discards exceptions, as in callbacks of LLVM while kernels are compiled, the handler
does not raise but asks for the same signal again.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from pymantaray.records import stops

_PATIENCE = 2.0  # s; together less than the 5 s after which `timeout -k 5` kills
_END_PATIENCE = 1.5  # s
_STOPS = (signal.SIGINT, signal.SIGTERM)
_RETRY = 0.02  # s
_DISCARDING = ("__del__", "_raw_object_cache_notify", "_raw_object_cache_getbuffer")
"""Functions from which Python or llvmlite discards exceptions."""


@contextmanager
def answered_stops() -> Iterator[None]:
    """
    Handle stop requests in the block by exceptions, and end the process if they cannot be raised.
    """
    # other threads cannot set signal handlers
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    read, write = os.pipe()
    os.set_blocking(write, False)
    before = {number: signal.signal(number, _raise) for number in _STOPS}
    earlier = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    stops.handled.clear()
    stops.requested.clear()
    hook = sys.unraisablehook
    sys.unraisablehook = _repeat_discarded
    threading.Thread(target=_watch, args=(read,), daemon=True).start()
    try:
        yield
    finally:
        sys.unraisablehook = hook
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
        timer = threading.Timer(_END_PATIENCE, os._exit, (code,))
        timer.daemon = True
        timer.start()


def _ignore_signals_of_children() -> None:
    """Detach a forked process from the pipe of its parent."""
    if threading.current_thread() is threading.main_thread():
        signal.set_wakeup_fd(-1)


os.register_at_fork(after_in_child=_ignore_signals_of_children)


def _raise(number: int, frame: FrameType | None) -> None:
    """
    Raise an exception for a stop request, so that unfinished files are removed; where it would be
    discarded, ask for the signal again.
    """
    while frame is not None:
        if frame.f_code.co_name in _DISCARDING:
            _send_again(number)
            return
        frame = frame.f_back
    stops.handled.set()
    stops.requested.append(number)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)


def _send_again(number: int) -> None:
    timer = threading.Timer(_RETRY, os.kill, (os.getpid(), number))
    timer.daemon = True
    timer.start()


def _repeat_discarded(discarded: Any) -> None:
    """Ask again for a stop whose exception Python discarded, and report other exceptions."""
    if issubclass(discarded.exc_type, KeyboardInterrupt):
        _send_again(signal.SIGINT)
    elif issubclass(discarded.exc_type, SystemExit) and stops.handled.is_set():
        _send_again(signal.SIGTERM)
    else:
        sys.__unraisablehook__(discarded)


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
                for path in list(stops.unfinished):
                    with suppress(OSError):
                        path.unlink()
                os._exit(128 + number[0])
