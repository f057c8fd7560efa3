"""
Compilation of numerical kernels: without reference counting, without the GIL, cached on disk.

Python calls entries. Entries call kernels, which are compiled as part of them. Both are plain
Python with ``NUMBA_DISABLE_JIT=1``.
"""

import fcntl
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numba
from numba import config, njit, types
from numba.extending import intrinsic

from pymantaray.messages import announce_compilation, one_line, warn_not_cached, warn_once
from pymantaray.user_files import read_bytes

PLAIN = bool(config.DISABLE_JIT)
_LOCK_WAIT = 30.0  # s; longer than another process needs, unless it is starved or stopped
_LOCK_POLL = 0.1  # s
_LOCK_FLAGS = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
_SHARED_SOURCES = tuple(
    Path(__file__).parents[1] / p
    for p in (
        "compile/kernel.py",
        "compile/linking.py",
        "records/status.py",
        "geometry/boundary_kernels.py",
    )
)

# The caller owns the arrays, and they outlive the call. Inner loops therefore need no reference
# counting, which costs two atomic operations per access and made a field evaluation six times
# slower.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}

# Numba links, optimizes and compiles each function separately, and again within each direct or
# indirect caller. For kernels that only kernels call, this takes more than half of the time. Here,
# kernels are linked, optimized and compiled as a whole within entries. This uses private parts of
# Numba, so only in versions that were tested. With other versions, each kernel is compiled
# separately, which takes several times as long. (In 0.61 and 0.62, code from the disk cache crashes
# the process.)
_TESTED_VERSIONS = (0, 63), (0, 68)


def _compilers() -> tuple[str, tuple[dict[str, Any], ...]]:
    """
    Options that link kernels into entries, for kernels, shared kernels and entries.

    They are empty if that is not possible, and the text says why.
    """
    low, high = (".".join(map(str, version)) for version in _TESTED_VERSIONS)
    plain: tuple[dict[str, Any], ...] = ({}, {}, {})
    version = tuple(int(n) for n in numba.__version__.split(".")[:2])
    if not _TESTED_VERSIONS[0] <= version <= _TESTED_VERSIONS[1]:
        return f"Numba {numba.__version__} was not tried, only {low} to {high}", plain
    try:
        from pymantaray.compile.linking import EntryCompiler, KernelCompiler, SharedCompiler
    except (ImportError, AttributeError) as error:
        return f"Numba {numba.__version__} lacks a part ({one_line(error, 80)})", plain
    return "", tuple({"pipeline_class": x} for x in (KernelCompiler, SharedCompiler, EntryCompiler))


_WHY_PLAIN, (_KERNEL, _SHARED, _ENTRY) = _compilers()


@cache
def _digest(folder: Path) -> str:
    """
    Digest of all sources that are compiled into the entries of a folder, and of the version of
    Numba.
    """
    text = [p.read_bytes() for p in (*_SHARED_SOURCES, *sorted(folder.glob("*.py")))]
    return hashlib.sha256(numba.__version__.encode() + b"".join(text)).hexdigest()[:12]


def cached_on_disk(
    decorate: Callable[..., Any], function: Callable[..., Any], **options: Any
) -> Any:
    """
    Compile a function and cache it on disk, or in memory if no folder is writable.

    Numba checks only the file of the function itself, not the files of the functions that it calls,
    so it could load stale code. Here, the names of its cache files contain a digest of all sources.
    Files with other digests, and damaged files, are removed. If several processes need code that is
    not cached, one compiles it and the others wait for at most half a minute.
    """
    name = function.__qualname__
    digest = _digest(Path(function.__code__.co_filename).parent)
    function.__qualname__ = f"{name}-{digest}"
    try:
        compiled = decorate(cache=True, **options)(function)
    except RuntimeError:  # no locator
        warn_not_cached(
            "the package's folder and the user's cache folder are not writable", _WHY_PLAIN
        )
        return decorate(**options)(function)
    finally:
        function.__qualname__ = name
    if not PLAIN:
        folder, stem = (
            Path(compiled.stats.cache_path),
            f"{Path(function.__code__.co_filename).stem}.{name}",
        )
        _discard_stale(folder, stem, digest)
        _add_checksums(compiled._cache._cache_file)
        _ignore_failed_saves(compiled._cache, folder, f"{stem}-{digest}")
        _discard_damaged(compiled._cache, folder, f"{stem}-{digest}")
        if decorate is njit:
            _compile_in_one_process(compiled, folder / f"{stem}-{digest}.lock")
    return compiled


def _add_checksums(files: Any) -> None:
    """
    Append a checksum to each file of a cache and check it before Numba reads the file: damaged
    machine code ends the process or gives wrong numbers.
    """
    open_for_write, load_index, load_data = (
        files._open_for_write,
        files._load_index,
        files._load_data,
    )

    @contextmanager
    def write_with_checksum(path: str) -> Iterator[IO[bytes]]:
        with open_for_write(path) as file:
            buffer = BytesIO()
            yield buffer
            content = buffer.getvalue()
            file.write(content + hashlib.sha256(content).digest())

    def check(path: str) -> None:
        if os.path.lexists(path):
            content = read_bytes(path, ValueError)
            size = hashlib.sha256().digest_size
            if hashlib.sha256(content[:-size]).digest() != content[-size:]:
                raise ValueError("wrong checksum")

    def load_checked_index() -> Any:
        check(files._index_path)
        return load_index()

    def load_checked_data(name: str) -> Any:
        check(files._data_path(name))
        return load_data(name)

    files._open_for_write = write_with_checksum
    files._load_index, files._load_data = load_checked_index, load_checked_data


def _ignore_failed_saves(disk_cache: Any, folder: Path, stem: str) -> None:
    """
    Continue with the code in memory if it cannot be saved, for example on a full disk; a stop
    leaves no half-written file.
    """
    save = disk_cache.save_overload

    def try_to_save(signature: Any, code: Any) -> None:
        try:
            save(signature, code)
        except Exception as error:  # noqa: BLE001  a damaged index that cannot be removed, too
            warn_not_cached(getattr(error, "strerror", None) or one_line(error, 60))
        except (KeyboardInterrupt, SystemExit):
            for file in folder.glob(f"{stem.replace('<', '').replace('>', '')}*.tmp.*"):
                file.unlink(missing_ok=True)
            raise

    disk_cache.save_overload = try_to_save


def _discard_damaged(disk_cache: Any, folder: Path, stem: str) -> None:
    """Remove files of a function that cannot be read, so that it is compiled again."""
    load = disk_cache.load_overload

    def try_to_load(signature: Any, context: Any) -> Any:
        try:
            return load(signature, context)
        except Exception as error:  # noqa: BLE001  damaged pickles raise many types
            warn_once(
                f"{folder}: compiled kernels are damaged ({one_line(repr(error), 60)}); compiling"
                " them again"
            )
            for file in folder.glob(f"{stem.replace('<', '').replace('>', '')}*.nb[ic]"):
                with suppress(OSError):
                    file.unlink()
            return None

    disk_cache.load_overload = try_to_load


def _compile_in_one_process(compiled: Any, path: Path) -> None:
    """
    Let a process that finds no code on disk wait for one that compiles it; the lock ends with its
    process.

    After half a minute, a waiting process compiles in memory.
    """
    load, compile_types, locks = compiled._cache.load_overload, compiled.compile, list[IO[bytes]]()
    save, in_memory = compiled._cache.save_overload, list[bool]()

    def load_or_wait(signature: Any, context: Any) -> Any:
        code = load(signature, context)
        if code is None and not locks and not in_memory:
            with suppress(OSError):  # the folder is not writable, or its disk has no locks
                locks.append(os.fdopen(os.open(path, _LOCK_FLAGS, 0o666), "rb+", buffering=0))
                if not _is_locked(locks[0]):
                    locks.pop().close()
                    in_memory.append(True)
            code = load(signature, context)
        if code is None:
            announce_compilation(_WHY_PLAIN)
        return code

    def save_unless_in_memory(signature: Any, code: Any) -> None:
        if not in_memory:
            save(signature, code)

    def compile_and_unlock(signature: Any) -> Any:
        try:
            return compile_types(signature)
        finally:
            while locks:
                with locks.pop() as lock, suppress(OSError):
                    # a process that was forked meanwhile has the file, too
                    fcntl.flock(lock, fcntl.LOCK_UN)

    compiled._cache.load_overload, compiled.compile = load_or_wait, compile_and_unlock
    compiled._cache.save_overload = save_unless_in_memory


def _is_locked(file: IO[bytes]) -> bool:
    """Lock a file; False if another process holds it for too long."""
    end = time.monotonic() + _LOCK_WAIT
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            announce_compilation(_WHY_PLAIN)
            if time.monotonic() > end:
                warn_once(
                    f"another process has been compiling kernels for {_LOCK_WAIT:.0f} s; compiling"
                    " them in memory"
                )
                return False
            time.sleep(_LOCK_POLL)
        else:
            return True


def _discard_stale(folder: Path, stem: str, digest: str) -> None:
    stem = stem.replace("<", "").replace(">", "")
    for file in (*folder.glob(f"{stem}-*.nb[ic]"), *folder.glob(f"{stem}-*.lock")):
        if digest not in file.name:
            try:
                file.unlink()
            except OSError:  # another process removed it, or the folder belongs to another user
                return


def entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls."""
    return function if PLAIN else cached_on_disk(njit, function, **_ENTRY, **_OPTIONS)


def kernel(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that entries and kernels call."""
    if PLAIN:
        return function
    if not _KERNEL:
        return cached_on_disk(njit, function, **_OPTIONS, **options)
    compiled = njit(**{**_KERNEL, **_OPTIONS, **options})(function)
    template = compiled.get_call_template

    def template_of_types(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        """Replace a constant by its type, for which the kernel may already be compiled."""
        return template(
            tuple(map(types.unliteral, args)), {name: types.unliteral(x) for name, x in kws.items()}
        )

    compiled.get_call_template = template_of_types
    return compiled


def shared(function: Callable[..., Any]) -> Any:
    """Compile a large kernel that several entries call, once for all of them."""
    return kernel(function, **_SHARED)


def compact(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Mark an entry or a shared kernel whose loops need not be fast: they are neither unrolled nor
    vectorized.

    LLVM then takes half of its time for it. It applies to all kernels that are compiled with it,
    but not to shared kernels that it calls. Results are the same, because LLVM does not change the
    order of sums.
    """
    function.compact = True  # type: ignore[attr-defined]
    return function


def inlined(function: Callable[..., Any]) -> Any:
    """
    Compile an innermost kernel inline: passing a section's arrays costs more time than its
    arithmetic.
    """
    return kernel(function, forceinline=True)


@intrinsic  # type: ignore[untyped-decorator]
def _noinline(_context: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), generate


def _nothing() -> None:
    """Do nothing: `out_of_line` in plain Python."""


# Prevents inlining of the calling function: copies of the tracer would be compiled at each call.
out_of_line = _nothing if PLAIN else _noinline
