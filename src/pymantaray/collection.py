"""Collection of garbage in processes of commands and their workers."""

import atexit
import gc

_NEW_OBJECTS = 100_000


def collect_rarely() -> None:
    """
    Look for garbage after every 100,000 new objects instead of 700 or 2,000, and not at the end.

    Modules and the compilation of kernels make millions of objects that stay; the end of the
    process frees them at once. Not for a process of a user's own program.
    """
    gc.set_threshold(_NEW_OBJECTS)
    atexit.register(gc.freeze)
