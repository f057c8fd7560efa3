"""What cannot be done is refused in one line; how every test says so."""

import resource
import signal
import sys
from contextlib import contextmanager

import pytest


def refused(error, message, call, *arguments, **options):
    """A call ends in an error of one line in which the pattern is found."""
    with pytest.raises(error, match=message) as caught:
        call(*arguments, **options)
    assert "\n" not in str(caught.value)


@contextmanager
def files_of_at_most(most):
    """
    A limit on the size of files [bytes], which the system reports as it does a full disk. No
    compiled module is written, of which Python would leave the first bytes for later processes.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    compiled, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = compiled
        signal.signal(signal.SIGXFSZ, ignored)
