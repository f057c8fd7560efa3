"""How kernels are compiled: no allocation, no reference counting, the GIL released, cached on disk.

Python calls entries; entries call kernels. Numba would optimize a kernel and compile it to machine code by itself, and again
within each that calls it, directly or not: more than half of all time. So a kernel's code is only kept, and
optimized as part of the entry that needs it.
"""

import contextlib
import hashlib
from pathlib import Path

from numba import config, njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering
from numba.extending import intrinsic


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


class _KeptLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel, with that of the kernels it calls, as it was written: neither optimized nor compiled."""

    def finalize(self):
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _KeepCode(NativeLowering):  # type: ignore[misc]
    """Numba's last pass without what serves calls from Python."""

    _name = "keep_code"

    def run_pass(self, state):
        name = state.func_id.func_qualname
        state.library = _KeptLibrary(state.targetctx.codegen(), name)
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = state.flags.no_compile = True
        changed = super().run_pass(state)
        # The dispatcher wants a built-in function, one of its own for each kernel; this one raises KeyError with these words.
        no_entry = ("{" + f"{name} is called by kernels only" + "}").format
        state.targetctx.insert_user_function(no_entry, state.cr.fndesc, [state.library])
        state["cr"] = state.cr._replace(cfunc=no_entry)
        return changed


class _KernelCompiler(CompilerBase):  # type: ignore[misc]
    """Numba's compiler with that pass in place of its own."""

    def define_pipelines(self):
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [(_KeepCode if own is NativeLowering else own, why) for own, why in manager.passes]
        manager.finalize()
        return [manager]


# Arrays come in from outside and outlive the call, so that counting references to them in inner loops
# (two atomic operations an access; it made a field evaluation six times slower) can be left out.
_options = {"nogil": True, "error_model": "numpy", "_nrt": False}
entry = njit(cache=True, **_options)
kernel = njit(pipeline_class=_KernelCompiler, **_options)

# The same for the innermost functions: passing a section's arrays costs more than their arithmetic.
inlined = njit(pipeline_class=_KernelCompiler, forceinline=True, **_options)


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
