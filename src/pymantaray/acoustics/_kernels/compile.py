"""How kernels are compiled: no allocation, no reference counting, the GIL released, cached on disk.

Python calls entries; entries call kernels, which are compiled as part of them.
"""

import contextlib
import hashlib
from pathlib import Path
from typing import Any

from numba import config, njit, types
from numba.extending import intrinsic

_of_kernels: dict[str, Any] = {"cache": True}  # any: njit's options
# A Numba whose inner parts have other names compiles each kernel by itself, in twice the time.
with contextlib.suppress(ImportError):
    from pymantaray.acoustics._kernels.keep_code import KernelCompiler

    _of_kernels = {"pipeline_class": KernelCompiler}


def _discard_stale_cache() -> None:
    """Empty the disk cache when any kernel's source has changed.

    Numba looks only at the file of the function itself, not at those of the functions it calls.
    """
    folder = Path(__file__).parent
    digest = hashlib.sha256(b"".join(p.read_bytes() for p in sorted(folder.glob("*.py")))).hexdigest()
    stamp = folder / "__pycache__" / "kernels.sha256"
    with contextlib.suppress(OSError):  # a read-only installation has no cache here
        if stamp.is_file() and stamp.read_text() == digest:
            return
        stamp.parent.mkdir(exist_ok=True)
        for index in stamp.parent.glob("*.nbi"):
            index.unlink(missing_ok=True)
        stamp.write_text(digest)


_discard_stale_cache()


# Arrays come in from outside and outlive the call, so that counting references to them in inner loops
# (two atomic operations an access; it made a field evaluation six times slower) can be left out.
_options = {"nogil": True, "error_model": "numpy", "_nrt": False}
entry = njit(cache=True, **_options)
kernel = njit(**_of_kernels, **_options)

# The same for the innermost functions: passing a section's arrays costs more than their arithmetic.
inlined = njit(forceinline=True, **_of_kernels, **_options)


@intrinsic
def out_of_line(_context):
    """Keep the calling function out of line.

    NVVM inlines every call that it may: the tracer's copies alone made the CUDA kernel three times as large.
    """

    def generate(context, builder, _signature, _arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), generate


def _plain(function):
    """Leave a kernel as it is: the CUDA simulator runs plain Python and cannot call compiled functions."""
    return function


def _nothing() -> None:
    """Stand for `out_of_line` there."""


if config.ENABLE_CUDASIM or config.DISABLE_JIT:
    entry, kernel, inlined, out_of_line = _plain, _plain, _plain, _nothing


@kernel
def sort_head(values, count):
    """Sort the first count values in place (insertion sort: short and nearly sorted input)."""
    for i in range(1, count):
        v = values[i]
        j = i - 1
        while j >= 0 and values[j] > v:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = v
