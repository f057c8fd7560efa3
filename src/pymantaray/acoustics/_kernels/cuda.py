"""
Solver of links on a CUDA device, with one thread per link and the kernels of the processor.
Experimental: never run on a device.

If a CUDA kernel calls a function that is decorated for the processor, Numba compiles it again for
the device. In the simulator (NUMBA_ENABLE_CUDASIM=1), all kernels are plain Python.
"""

import warnings
from math import prod
from typing import Any

import numpy as np
from numba import cuda, float64
from numba.core.errors import NumbaPerformanceWarning

from pymantaray.acoustics._kernels.layout import (
    N_FAN,
    N_FULL,
    N_SPACE,
    N_STATE,
    Domain,
    Results,
    Room,
    Settings,
    Work,
    least_shapes,
)
from pymantaray.acoustics._kernels.link import solve_links
from pymantaray.arrays import Array
from pymantaray.compile import cached_on_disk

_BLOCK = 64  # threads
# number of threads with 255 registers that the largest devices run at once; smaller devices queue
# them
_THREADS = 32_768
_SHARE = 0.7  # share of the device's free memory for workspaces


def _solve_wave(domain, bounces, settings, source, receiver, work, results):
    """
    Solve links; each workspace in ``work`` is an array (n_threads, ...) with one row per thread.
    """
    t = cuda.grid(1)
    if t >= work.path.shape[0]:
        return
    own = Work(
        cuda.local.array(N_STATE, float64),
        cuda.local.array((7, N_FULL), float64),
        cuda.local.array((7, N_FAN), float64),
        cuda.local.array((7, N_SPACE), float64),
        cuda.local.array(N_SPACE, float64),
        work.no_path[t],
        work.path[t],
        work.breaks[t],
        work.wall_breaks[t],
        work.cells[t],
        work.candidates[t],
        work.small[t],
        work.acc[t],
        work.store[t],
        work.cuts[t],
        work.extremes[t],
        work.ladder[t],
        work.nodes[t],
        work.rays[t],
        work.stack[t],
        work.halves[t],
        work.kinds[t],
        work.brackets[t],
        work.rows[t],
    )
    solve_links(
        domain,
        bounces,
        settings,
        source,
        receiver,
        (t, work.path.shape[0]),
        Room(own, None),
        results,
    )


solve_wave = cached_on_disk(cuda.jit, _solve_wave)


class CudaSolver:
    """
    Solver with the medium and workspaces on the current device, for links up to the longest of
    these links.
    """

    def __init__(
        self,
        domain: Domain,
        bounces: tuple[int, int] | None,
        settings: Settings,
        source: Array,
        receiver: Array,
    ) -> None:
        step = receiver[:, :2] - source[:, :2]
        sizes = least_shapes(domain, float(np.hypot(step[:, 0], step[:, 1]).max(initial=0.0)))
        self._threads = thread_count(len(source), sizes)
        self._domain = _on_device(domain)
        self._work = Work(*(cuda.device_array((self._threads, *shape)) for shape in sizes))
        self._bounces, self._settings = bounces or (0, 0), settings

    def solve(self, source: Array, receiver: Array, results: Results) -> None:
        """Solve links in one launch and fill the results as `solve_links` does."""
        ends = [cuda.to_device(np.ascontiguousarray(x)) for x in (source, receiver)]
        out = Results(*(cuda.device_array(x.shape, x.dtype) for x in results))
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", NumbaPerformanceWarning
            )  # few links cannot use the whole device
            solve_wave[-(-self._threads // _BLOCK), _BLOCK](
                self._domain, self._bounces, self._settings, *ends, self._work, out
            )
        for host, device in zip(results, out, strict=True):
            device.copy_to_host(host)


def _on_device(value: Any) -> Any:
    """Copy an array, or all arrays of a tuple, to the device."""
    if isinstance(value, np.ndarray):
        return cuda.to_device(value)
    if isinstance(value, tuple):
        return getattr(type(value), "_make", tuple)(map(_on_device, value))
    return value


def thread_count(n_links: int, sizes: Work) -> int:
    """
    Number of threads for some links, limited by the number that can run at once and by the free
    memory for workspaces.
    """
    needed = 8 * sum(prod(shape) for shape in sizes)
    fit = _SHARE * cuda.current_context().get_memory_info().free / needed
    return max(1, int(min(n_links, _THREADS, fit)))
