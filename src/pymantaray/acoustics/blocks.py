"""Work on many rows, a block at a time: in threads, in order, with little waiting, and soon stopped."""

import os
import time
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
MOST_ROWS = 64  # of a block
_SECONDS = 0.02  # of a block: long beside what Python does between two, short beside a person's patience
_AHEAD = 4  # blocks per thread that are waiting or unread, at most


def in_blocks(
    work: Callable[[int, int], T], n_rows: int, *, threads: int | None = None
) -> Generator[T, None, None]:
    """
    Do work on rows in blocks.

    Parameters
    ----------
    work : callable
        Takes the first row and the one after the last; runs in several threads at once and should release the
        GIL. What it gives for a row must not depend on the block.
    n_rows : int
        With none, one empty block is worked on.
    threads : int, optional
        Default: all processors.

    Yields
    ------
    object
        What ``work`` gave, in the order of the rows. Blocks are as long as recent ones suggest for 0.02 s, at most
        64 rows; the first is one row, so that kernels are compiled once, before the threads start.

    Notes
    -----
    When the consumer stops, or an interrupt arrives, blocks that wait are dropped and those at work finish.
    """
    pace = 0.0  # s a row

    def timed(start: int, stop: int) -> tuple[T, float]:
        begin = time.perf_counter()
        done = work(start, stop)
        return done, (time.perf_counter() - begin) / max(stop - start, 1)

    def after(start: int) -> int:
        return min(start + min(max(int(_SECONDS / max(pace, 1e-9)), 1), MOST_ROWS), n_rows)

    start = min(n_rows, 1)
    done, pace = timed(0, start)
    yield done
    workers = min(threads or os.cpu_count() or 1, n_rows - start)
    if workers <= 1:
        while start < n_rows:
            stop = after(start)
            done, pace = timed(start, stop)
            yield done
            start = stop
        return
    with ThreadPoolExecutor(workers) as pool:
        waiting: deque[Future[tuple[T, float]]] = deque()
        try:
            while start < n_rows or waiting:
                while start < n_rows and len(waiting) < _AHEAD * workers:
                    stop = after(start)
                    waiting.append(pool.submit(timed, start, stop))
                    start = stop
                done, pace = waiting.popleft().result()
                yield done
        finally:
            for future in waiting:
                future.cancel()
