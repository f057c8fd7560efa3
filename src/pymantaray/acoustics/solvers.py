"""Where links are solved: on the processor in threads, or on a CUDA device; both a block at a time."""

import threading
from collections.abc import Generator
from importlib.util import find_spec
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.blocks import MOST_ROWS, in_blocks
from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
Device = Literal["auto", "cpu", "cuda"]
Settings = tuple[tuple[int, int] | None, float, float, bool]  # most bounces, cut-off, tolerance, canonical

MAX_ARRIVALS = 64  # kept per link
MANY_LINKS = 50_000  # from which "auto" takes a CUDA device
_WAVE = 65_536  # links per launch on a device; their rows take 0.4 GB


class Solved(NamedTuple):
    """Outcome of a run of links: rows of arrivals, how many each link has, and what belongs to the link."""

    rows: Array
    counts: NDArray[np.int64]
    status: NDArray[np.int8]
    info: Array


class _Room:
    """Arrays that the kernels fill for a number of links."""

    def __init__(self, n_links: int) -> None:
        from pymantaray.acoustics._kernels.link import N_INFO
        from pymantaray.acoustics._kernels.rows import N_COLUMNS

        self.rows = np.empty((n_links, MAX_ARRIVALS, N_COLUMNS))
        self.counts = np.zeros(n_links, dtype=np.int64)
        self.status = np.zeros(n_links, dtype=np.int8)
        self.info = np.empty((n_links, N_INFO))

    def compact(self, n: int) -> Solved:
        """Copy what the first n links have."""
        counts = self.counts[:n].copy()
        used = np.arange(MAX_ARRIVALS) < counts[:, None]
        return Solved(self.rows[:n][used], counts, self.status[:n].copy(), self.info[:n].copy())


def solve_on_processor(
    medium: Medium, source: Array, receiver: Array, settings: Settings, *, threads: int | None = None
) -> Generator[Solved, None, None]:
    """
    Solve links in threads.

    Parameters
    ----------
    medium : Medium
    source, receiver : ndarray, shape (n_links, 3)
        [m]
    settings : tuple
        Most bounces at the surface and at the bottom or None, spreading cut-off [dB], tolerance [m], and whether each link is
        solved from its deeper end.
    threads : int, optional
        Default: all processors.

    Yields
    ------
    Solved
        A block of links, in order; memory does not grow with the number of blocks.
    """
    from pymantaray.acoustics._kernels.link import solve_links
    from pymantaray.acoustics._kernels.workspace import workspace

    packed, bed = medium.packed(), medium.bed()
    own = threading.local()  # arrays made anew for each block would cost page faults

    def solve(start: int, stop: int) -> Solved:
        if not hasattr(own, "room"):
            own.room, own.work = _Room(MOST_ROWS), workspace(medium.depth.size)
        room, n = own.room, stop - start
        solve_links(
            packed,
            bed,
            source[start:stop],
            receiver[start:stop],
            *settings,
            0,
            1,
            own.work,
            room.rows[:n],
            room.counts[:n],
            room.status[:n],
            room.info[:n],
        )
        solved: Solved = room.compact(n)
        return solved

    return in_blocks(solve, len(source), threads=threads)


def solve_on_cuda(
    medium: Medium, source: Array, receiver: Array, settings: Settings
) -> Generator[Solved, None, None]:
    """
    Solve links on the current CUDA device.

    Parameters
    ----------
    medium, source, receiver, settings
        As `solve_on_processor`.

    Yields
    ------
    Solved
    """
    from pymantaray.acoustics._kernels.solve_cuda import CudaSolver

    solver = CudaSolver(medium.packed(), medium.bed(), source, receiver, settings)
    for start in range(0, max(len(source), 1), _WAVE):
        part = slice(start, start + _WAVE)
        room = _Room(len(source[part]))
        solver.solve(source[part], receiver[part], room.rows, room.counts, room.status, room.info)
        yield room.compact(len(room.counts))


def on_cuda(device: str, n_links: int) -> bool:
    """
    Whether links are to be solved on a CUDA device.

    Parameters
    ----------
    device : {"auto", "cpu", "cuda"}
    n_links : int
        "auto" takes a device, where there is one, for many links.

    Returns
    -------
    bool

    Raises
    ------
    AcousticsError
        If the name is another, or "cuda" is asked for and there is no device.
    """
    if device not in ("auto", "cpu", "cuda"):
        raise AcousticsError(f"device: {device!r}; allowed are 'auto', 'cpu' and 'cuda'")
    if device == "cpu" or (device == "auto" and n_links < MANY_LINKS):
        return False
    from numba import config

    found = False
    if config.ENABLE_CUDASIM or find_spec("numba_cuda"):  # the target inside older Numba lacks too much
        from numba import cuda

        found = bool(cuda.is_available())
    if device == "cuda" and not found:
        raise AcousticsError(
            "device: 'cuda', but no CUDA device was found; it needs an NVIDIA driver and pip install pymantaray[cuda]"
        )
    return found
