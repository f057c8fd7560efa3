"""Run the two-point kernel on many links, block by block, in threads."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError

if TYPE_CHECKING:
    from pymantaray.acoustics._kernels.layout import Domain, Results, Room, Settings

T = TypeVar("T")
MAX_ARRIVALS = 64  # stored per link
# direct links that are one block, because the kernel traces rays of several links together
_FEW_LINKS = 16
_MAX_BLOCK_ROWS = 512  # rows of a block, at most
# s; duration of a block: long compared with Python's work between two blocks, and short enough to
# stop quickly
_BLOCK_SECONDS = 0.05
# direct links of a block, unless they take longer [s]: the kernel traces rays of several links
# together, and at the end of a block lanes are idle. The second number is for many links: with four
# blocks or more, all threads end at about the same time
_TOGETHER, _LONGEST = (32, 128), 1.0
_BLOCKS_AHEAD = 4  # blocks per thread that wait or are unread, at most
_OWN = threading.local()  # arrays of `_workspace`


def as_positions(name: str, values: ArrayLike) -> Array:
    """
    Return positions as an array (n_links, 3) of finite floats; the name appears in messages. [m]
    """
    # kernels are compiled for C order
    points = np.atleast_2d(np.array(values, dtype=float, order="C"))
    if points.ndim != 2 or points.shape[1] != 3:
        raise AcousticsError(
            f"{name} has shape {points.shape}; it must be (n_links, 3): north, east, down in metres"
        )
    if not np.all(np.isfinite(points)):
        raise AcousticsError(
            f"{name}: {np.count_nonzero(~np.isfinite(points))} coordinates are not finite"
        )
    return points


def _empty_results(n_links: int) -> Results:
    """Allocate the arrays that the kernels fill for n_links links."""
    from pymantaray.acoustics._kernels.layout import N_ARRIVAL, N_INFO, Results

    rows = np.empty((n_links, MAX_ARRIVALS, N_ARRIVAL))
    status = np.zeros(n_links, dtype=np.int8)
    return Results(rows, np.zeros(n_links, dtype=np.int64), status, np.empty((n_links, N_INFO)))


def _compact(room: Results, n: int) -> Results:
    """Copy the results of the first n links."""
    counts = room.counts[:n].copy()
    used = np.arange(MAX_ARRIVALS) < counts[:, None]
    return type(room)(room.rows[:n][used], counts, room.status[:n].copy(), room.info[:n].copy())


def solve_on_processor(
    domain: Domain,
    bounces: tuple[int, int] | None,
    settings: Settings,
    source: Array,
    receiver: Array,
    *,
    threads: int | None = None,
) -> Generator[Results, None, None]:
    """Solve links in threads, block by block; memory does not grow with the number of blocks."""
    from pymantaray.acoustics._kernels.link import solve_links

    def solve(start: int, stop: int) -> Results:
        (results, room), n = _workspace(domain.depth.size), stop - start
        part = type(results)(*(x[:n] for x in results))
        if n:  # no compilation without a link
            ends = source[start:stop], receiver[start:stop]
            solve_links(domain, bounces, settings, *ends, (0, 1), room, part)
        return _compact(results, n)

    direct = bounces is None
    return in_blocks(
        solve,
        len(source),
        threads=threads,
        first=len(source) if direct and len(source) <= _FEW_LINKS else 1,
        together=_TOGETHER if direct else (1, 1),
    )


def _workspace(n_depth: int) -> tuple[Results, Room]:
    """
    Results of a block and workspace of this thread, from its last block if the number of levels is
    the same; new arrays cause page faults.
    """
    if getattr(_OWN, "n_depth", None) != n_depth:
        from pymantaray.acoustics._kernels.layout import solver_room

        _OWN.n_depth, _OWN.arrays = n_depth, (_empty_results(_MAX_BLOCK_ROWS), solver_room(n_depth))
    arrays: tuple[Results, Room] = _OWN.arrays
    return arrays


def in_blocks(
    work: Callable[[int, int], T],
    n_rows: int,
    *,
    threads: int | None = None,
    first: int = 1,
    together: tuple[int, int] = (1, 1),
) -> Generator[T, None, None]:
    """
    Yield the results of work(start, stop) for blocks of rows, in order, from several threads.

    A block has at most 512 rows and takes about 0.05 s, as estimated from recent blocks. It has as
    many rows ``together`` as the first number if each thread has a block, and as the second one if
    each has four, unless these take more than a second. The first block has ``first`` rows and is
    finished before the threads start, so kernels are compiled once. Without rows there is one empty
    block. The result of a row must not depend on the block. When the consumer stops or an interrupt
    arrives, waiting blocks are dropped and running ones finish.
    """
    pace = 0.0  # s per row
    most = threads or os.cpu_count() or 1
    share = -(-n_rows // most)
    least = max(min(together[0], share), min(together[1], share // 4))

    def timed(start: int, stop: int) -> tuple[T, float]:
        begin = time.perf_counter()
        done = work(start, stop)
        return done, (time.perf_counter() - begin) / max(stop - start, 1)

    def after(start: int) -> int:
        short, long = (int(seconds / max(pace, 1e-9)) for seconds in (_BLOCK_SECONDS, _LONGEST))
        rows = max(short, min(least, long), 1)
        return min(start + min(rows, _MAX_BLOCK_ROWS), n_rows)

    start = min(n_rows, first)
    done, pace = timed(0, start)
    yield done
    if start == n_rows:
        return
    workers = min(most, n_rows - start)
    # starting threads would take longer
    if workers <= 1 or pace * (n_rows - start) < _BLOCK_SECONDS:
        while start < n_rows:
            stop = after(start)
            done, pace = timed(start, stop)
            yield done
            start = stop
        return
    pool = ThreadPoolExecutor(workers)
    waiting: deque[Future[tuple[T, float]]] = deque()
    joined = True
    try:
        while start < n_rows or waiting:
            while start < n_rows and len(waiting) < _BLOCKS_AHEAD * workers:
                stop = after(start)
                waiting.append(pool.submit(timed, start, stop))
                start = stop
            done, pace = waiting.popleft().result()
            yield done
    except (KeyboardInterrupt, SystemExit):  # a block may be one long link
        joined = False
        raise
    finally:
        pool.shutdown(wait=joined, cancel_futures=True)
