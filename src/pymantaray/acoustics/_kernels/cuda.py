"""Links on a CUDA device: one thread a link, the same kernels as on the processor. Experimental: never run on a device.

Numba compiles a function decorated for the processor again for the device when a CUDA kernel calls it. In the
simulator (NUMBA_ENABLE_CUDASIM=1) all kernels are plain Python.
"""

import warnings
from math import prod
from typing import Any

import numpy as np
from numba import cuda, float64
from numba.core.errors import NumbaPerformanceWarning
from numpy.typing import NDArray

from pymantaray.acoustics._kernels.layout import (
    N_FAN,
    N_FULL,
    N_STATE,
    Domain,
    Results,
    Settings,
    Work,
    least_shapes,
)
from pymantaray.acoustics._kernels.link import solve_links
from pymantaray.compile import cached_on_disk

Array = NDArray[np.float64]
_BLOCK = 64  # threads
_THREADS = 32_768  # at 255 registers each, what the largest devices run at once; smaller ones queue them
_SHARE = 0.7  # of the free memory of the device, for workspaces


def _solve_wave(domain, bounces, settings, source, receiver, work, results):
    """Solve links in as many threads as work, an array (n_threads, ...) for each workspace, has rows."""
    t = cuda.grid(1)
    if t >= work.path.shape[0]:
        return
    own = Work(
        cuda.local.array(N_STATE, float64),
        cuda.local.array((7, N_FULL), float64),
        cuda.local.array((7, N_FAN), float64),
        cuda.local.array(N_FULL, float64),
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
        work.nodes[t],
        work.fan[t],
        work.extremes[t],
        work.stack[t],
        work.halves[t],
        work.middles[t],
        work.brackets[t],
        work.rows[t],
        None,
    )
    solve_links(domain, bounces, settings, source, receiver, (t, work.path.shape[0]), own, results)


solve_wave = cached_on_disk(cuda.jit, _solve_wave)


class CudaSolver:
    """The medium and the workspaces on the current device, for links up to the longest of those given."""

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
        """Solve links in one launch; results are filled as `solve_links` does."""
        ends = [cuda.to_device(np.ascontiguousarray(x)) for x in (source, receiver)]
        out = Results(*(cuda.device_array(x.shape, x.dtype) for x in results))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NumbaPerformanceWarning)  # few links leave the device idle
            solve_wave[-(-self._threads // _BLOCK), _BLOCK](
                self._domain, self._bounces, self._settings, *ends, self._work, out
            )
        for host, device in zip(results, out, strict=True):
            device.copy_to_host(host)


def _on_device(value: Any) -> Any:
    """Copy arrays to the device, of a tuple each."""
    if isinstance(value, np.ndarray):
        return cuda.to_device(value)
    return type(value)(*map(_on_device, value)) if isinstance(value, tuple) else value


def thread_count(n_links: int, sizes: Work) -> int:
    """Threads for so many links: as many as run at once and have workspaces in the memory that is free."""
    needed = 8 * sum(prod(shape) for shape in sizes)
    fit = _SHARE * cuda.current_context().get_memory_info().free / needed
    return max(1, int(min(n_links, _THREADS, fit)))
