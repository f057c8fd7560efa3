"""Start of the command `mantaray`: Ctrl-C ends it quietly also while modules are imported."""

import os
import resource
import signal
import sys
import threading

_LEAST_MIB = 1536  # of address space; with less, libraries end in tracebacks or spin without end


def main() -> None:
    """Import the command line and run it."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < _LEAST_MIB << 20:
        sys.stderr.write(
            f"error: not enough memory: this process may have {limit / 2**20:.0f} MiB (ulimit -v); allow 4096 or more\n"
        )
        raise SystemExit(2)
    if threading.current_thread() is not threading.main_thread():  # no other may handle signals
        from pymantaray.cli.main import main as run
    else:
        before = signal.signal(signal.SIGINT, lambda *_: os._exit(130))
        from pymantaray.cli.main import main as run

        signal.signal(signal.SIGINT, before)
    run()


if __name__ == "__main__":
    main()
