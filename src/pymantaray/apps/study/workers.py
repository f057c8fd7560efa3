"""Number of processes that solve the realizations of a study."""

import os

_REALIZATIONS_PER_WORKER = 3


def worker_count(realizations: int, asked: int | None = None) -> int:
    """
    Number of processes for some realizations, at least one; by default at most one per core and one
    for every three realizations, because a process takes as long to start as it takes to solve a
    few short ones.
    """
    by_default = min(os.cpu_count() or 1, -(-realizations // _REALIZATIONS_PER_WORKER))
    return max(1, min(by_default if asked is None else asked, realizations))
