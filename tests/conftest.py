"""Common to all tests."""

import signal


def pytest_configure():
    """Processes that tests start and interrupt inherit what a shell's background job ignores: Ctrl-C."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
