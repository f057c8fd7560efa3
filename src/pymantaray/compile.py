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
_SHARED_SOURCES = tuple(
    Path(__file__).parent / p
    for p in ("compile.py", "linking.py", "records/status.py", "geometry/boundary_kernels.py")
)

# Arrays come in from outside and outlive the call, so that counting references to them in inner loops
# (two atomic operations an access; it made a field evaluation six times slower) can be left out.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}

# Numba links, optimizes and compiles each function by itself, and again within each that calls it, directly or not: more
# than half of all time for kernels that only kernels call. Here their code is linked, optimized as a whole and compiled in
# entries only. That needs inner parts of Numba, so it is for the versions on which it was tried; with others each kernel is
# compiled by itself, in three times the time. (In 0.61 and 0.62 code that was kept on disk ends the process.)
_TRIED = (0, 63), (0, 68)


def _compilers() -> tuple[dict[str, Any], ...]:
    """Options of kernels, shared kernels and entries by which kernels are only linked into entries; none in an untried Numba."""
    if not _TRIED[0] <= tuple(int(n) for n in numba.__version__.split(".")[:2]) <= _TRIED[1]:
        return {}, {}, {}
    try:
        from pymantaray.linking import EntryCompiler, KernelCompiler, SharedCompiler
    except ImportError:
        return {}, {}, {}
    return tuple({"pipeline_class": x} for x in (KernelCompiler, SharedCompiler, EntryCompiler))


def announce_compilation() -> None:
    """Say that kernels are compiled, unless it has been said that each process does so."""
    if not _say_not_kept.cache_info().currsize:
        _say_once("compiling kernels: some seconds, the first time only")


_KERNEL, _SHARED, _ENTRY = _compilers()


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
        _say_not_kept("neither the package's folder nor the user's cache can be written to")
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
            _say_not_kept(str(error.strerror))

    kept.save_overload = try_to_save


@cache
def _say_once(line: str) -> None:
    logging.getLogger("pymantaray").warning(line)


@cache
def _say_not_kept(cause: str) -> None:
    _say_once(
        f"compiled kernels cannot be kept: {cause}; "
        "each process compiles them; set NUMBA_CACHE_DIR to a folder that can be written to"
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
    return function if PLAIN else kept_on_disk(njit, function, **_ENTRY, **_OPTIONS)


def kernel(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that entries and kernels call."""
    if PLAIN:
        return function
    if not _KERNEL:
        return kept_on_disk(njit, function, **_OPTIONS, **options)
    compiled = njit(**{**_KERNEL, **_OPTIONS, **options})(function)
    template = compiled.get_call_template

    def template_of_types(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        """Take a constant by its type, for which the kernel may have been compiled already."""
        return template(
            tuple(map(types.unliteral, args)), {name: types.unliteral(x) for name, x in kws.items()}
        )

    compiled.get_call_template = template_of_types
    return compiled


def shared(function: Callable[..., Any]) -> Any:
    """Compile a large kernel that several entries call, once for all of them."""
    return kernel(function, **_SHARED)


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
