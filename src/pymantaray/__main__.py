"""Start of the command `mantaray`: Ctrl-C ends it quietly also while modules are imported."""

import os
import signal
import threading


def main() -> None:
    """Import the command line and run it."""
    if threading.current_thread() is not threading.main_thread():  # no other may handle signals
        from pymantaray.cli.main import main as run
    else:
        before = signal.signal(signal.SIGINT, lambda *_: os._exit(130))
        from pymantaray.cli.main import main as run

        signal.signal(signal.SIGINT, before)
    run()


if __name__ == "__main__":
    main()
