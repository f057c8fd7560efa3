"""
How numerical kernels are compiled: without reference counting, the GIL released, kept on disk.

Python calls entries; entries call kernels, which are compiled as part of them. In CUDA's simulator
(``NUMBA_ENABLE_CUDASIM=1``) and with ``NUMBA_DISABLE_JIT=1`` both are plain Python.
"""

import hashlib
import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import config, njit, types
from numba.extending import intrinsic

PLAIN = bool(config.ENABLE_CUDASIM or config.DISABLE_JIT)
_SHARED_SOURCES = (Path(__file__), Path(__file__).parent / "records" / "status.py")

# Arrays come in from outside and outlive the call, so that counting references to them in inner loops
# (two atomic operations an access; it made a field evaluation six times slower) can be left out.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}

# Numba optimizes each function and compiles it to machine code by itself, and again within each that calls it,
# directly or not: more than half of all time for kernels that only kernels call. `_linked_only` leaves that out by
# inner parts of Numba, so it is for the versions on which it was tried; with others each kernel is compiled
# by itself, in twice the time.
_TRIED = (0, 61), (0, 68)


def _linked_only() -> dict[str, Any]:
    """Options by which the code of a kernel is only linked into that of its callers; none in an untried Numba."""
    if not _TRIED[0] <= tuple(int(n) for n in numba.__version__.split(".")[:2]) <= _TRIED[1]:
        return {}
    try:
        from numba.core.codegen import JITCodeLibrary
        from numba.core.compiler import CompilerBase, DefaultPassBuilder
        from numba.core.compiler_machinery import register_pass
        from numba.core.typed_passes import NativeLowering
    except ImportError:
        return {}

    class LinkedLibrary(JITCodeLibrary):  # type: ignore[misc]
        """Code of a kernel and of those it calls, neither optimized as a whole nor compiled."""

        def finalize(self) -> None:
            for library in dict.fromkeys(self._linking_libraries):
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
            self._finalized = True

    @register_pass(mutates_CFG=True, analysis_only=False)
    class LinkedLowering(NativeLowering):  # type: ignore[misc]
        """Numba's last pass without what serves calls from Python."""

        _name = "linked_lowering"

        def run_pass(self, state: Any) -> bool:
            name = state.func_id.func_qualname
            state.library = LinkedLibrary(state.targetctx.codegen(), name)
            state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = state.flags.no_compile = True
            changed: bool = super().run_pass(state)
            # The dispatcher wants a built-in function, one of its own for each kernel; this one raises KeyError with
            # these words.
            no_entry = ("{" + f"{name} is called by kernels only" + "}").format
            state.targetctx.insert_user_function(no_entry, state.cr.fndesc, [state.library])
            state["cr"] = state.cr._replace(cfunc=no_entry)
            return changed

    class KernelCompiler(CompilerBase):  # type: ignore[misc]
        """Numba's compiler with that pass in place of its own."""

        def define_pipelines(self) -> list[Any]:
            manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
            manager.passes = [
                (LinkedLowering if own is NativeLowering else own, why) for own, why in manager.passes
            ]
            manager.finalize()
            return [manager]

    return {"pipeline_class": KernelCompiler}


_LINKED_ONLY = _linked_only()


@cache
def _digest(folder: Path) -> str:
    """Digest of all sources that are compiled into the entries of a folder, and of the Numba that does it."""
    text = [p.read_bytes() for p in (*_SHARED_SOURCES, *sorted(folder.glob("*.py")))]
    return hashlib.sha256(numba.__version__.encode() + b"".join(text)).hexdigest()[:12]


def kept_on_disk(decorate: Callable[..., Any], function: Callable[..., Any], **options: Any) -> Any:
    """
    Compile a function that is cached on disk by Numba, in memory where no folder can be written to.

    Numba looks only at the file of the function itself, not at those of the functions it calls, so stale code could be
    picked up. Here the names of its files hold a digest of all sources; those with other digests are removed.
    """
    name = function.__qualname__
    digest = _digest(Path(function.__code__.co_filename).parent)
    function.__qualname__ = f"{name}-{digest}"
    try:
        compiled = decorate(cache=True, **options)(function)
    except RuntimeError:  # no locator
        _warn_once("neither the package's folder nor the user's cache can be written to")
        return decorate(**options)(function)
    finally:
        function.__qualname__ = name
    if not PLAIN:
        _discard_stale(
            Path(compiled.stats.cache_path), f"{Path(function.__code__.co_filename).stem}.{name}", digest
        )
        _save_if_there_is_room(compiled._cache)
    return compiled


def _save_if_there_is_room(kept: Any) -> None:
    """Let a function whose code cannot be saved, as on a full disk, go on in memory."""
    save = kept.save_overload

    def try_to_save(signature: Any, code: Any) -> None:
        try:
            save(signature, code)
        except OSError as error:
            _warn_once(str(error.strerror))

    kept.save_overload = try_to_save


@cache
def _warn_once(cause: str) -> None:
    logging.getLogger("pymantaray").warning(
        f"compiled kernels cannot be kept: {cause}; "
        "each process compiles them (half a minute); set NUMBA_CACHE_DIR to a folder that can be written to"
    )


def _discard_stale(folder: Path, stem: str, digest: str) -> None:
    stem = stem.replace("<", "").replace(">", "")
    for file in folder.glob(f"{stem}-*.nb[ic]"):
        if digest not in file.name:
            try:
                file.unlink()
            except OSError:  # another process was first, or the folder belongs to another user
                return


def entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls."""
    return function if PLAIN else kept_on_disk(njit, function, **_OPTIONS)


def kernel(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that entries and kernels call."""
    if PLAIN:
        return function
    if _LINKED_ONLY:
        return njit(**_LINKED_ONLY, **_OPTIONS, **options)(function)
    return kept_on_disk(njit, function, **_OPTIONS, **options)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile an innermost kernel: passing a section's arrays costs more than their arithmetic."""
    return kernel(function, forceinline=True)


@intrinsic  # type: ignore[untyped-decorator]
def _noinline(_context: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), generate


def _nothing() -> None:
    """Stand for `out_of_line` in plain Python."""


# Keeps the calling function out of line: NVVM inlines every call that it may, and the tracer's copies alone made the CUDA
# kernel three times as large.
out_of_line = _nothing if PLAIN else _noinline
