"""Entry point of the command `mantaray`: Ctrl-C also ends it quietly while modules are imported."""

import os
import resource
import signal
import sys
import threading
import warnings

from pymantaray.collection import collect_rarely

_MIN_ADDRESS_SPACE_MIB = 1536  # with less, libraries raise errors or never return


def main() -> None:
    """Import the command line and run it."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < _MIN_ADDRESS_SPACE_MIB << 20:
        sys.stderr.write(
            f"error: not enough memory: the limit of this process is {limit / 2**20:.0f} MiB"
            " (ulimit -v); set it to 4096 MiB or more\n"
        )
        raise SystemExit(2)
    if sys.flags.optimize > 1:
        sys.stderr.write(
            "error: environment: PYTHONOPTIMIZE (or -OO) removes the docstrings that options are"
            " made of; set it to 1 or unset it\n"
        )
        raise SystemExit(2)
    collect_rarely()
    # figures are drawn into files; another value would end each import of Matplotlib, here and in
    # other processes
    os.environ.pop("MPLBACKEND", None)
    # warnings of numpy, in this process and in workers
    if not sys.warnoptions and "PYTHONWARNINGS" not in os.environ:
        warnings.simplefilter("ignore", RuntimeWarning)
        os.environ["PYTHONWARNINGS"] = "ignore::RuntimeWarning"
    # only the main thread may handle signals
    if threading.current_thread() is not threading.main_thread():
        from pymantaray.cli.main import main as run
    else:
        before = signal.signal(signal.SIGINT, lambda *_: os._exit(130))
        from pymantaray.cli.main import main as run

        signal.signal(signal.SIGINT, before)
    try:
        run()
    except SystemExit as end:
        from pymantaray.cli.stopping import end_after_stop

        end_after_stop(end.code)
        raise


if __name__ == "__main__":
    main()
