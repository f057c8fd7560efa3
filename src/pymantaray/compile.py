"""
How numerical kernels are compiled: without reference counting, the GIL released, kept on disk.

Python calls entries; entries call kernels, which are compiled as part of them. In CUDA's simulator
(``NUMBA_ENABLE_CUDASIM=1``) and with ``NUMBA_DISABLE_JIT=1`` both are plain Python.
"""

import gc
import hashlib
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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

# Numba links, optimizes and compiles each function by itself, and again within each that calls it, directly or not: more
# than half of all time for kernels that only kernels call. Here their code is linked, optimized as a whole and compiled in
# entries only. That needs inner parts of Numba, so it is for the versions on which it was tried; with others each kernel is
# compiled by itself, in three times the time.
_TRIED = (0, 61), (0, 68)

# Passes of Numba's for what no kernel has: with blocks, closures, raised exceptions, lists, array expressions.
_SPARED = {
    "with_lifting",
    "inline_closure_likes",
    "Rewrite dynamic raises",
    "make_function_op_code_to_jit_function",
    "inline_inlinables",
    "find_literally",
    "literal_unroll",
    "LiteralPropagation",
    "inline_overloads",
    "nopython_rewrites",
    "nopython_supported_feature_validation",
    "dump_parfor_diagnostics",
}


def _compilers() -> tuple[dict[str, Any], dict[str, Any]]:
    """Options of kernels and of entries by which kernels are only linked into entries; none in an untried Numba."""
    if not _TRIED[0] <= tuple(int(n) for n in numba.__version__.split(".")[:2]) <= _TRIED[1]:
        return {}, {}
    try:
        from numba.core.codegen import JITCodeLibrary
        from numba.core.compiler import CompilerBase, DefaultPassBuilder
        from numba.core.compiler_machinery import register_pass
        from numba.core.typed_passes import NativeLowering
    except ImportError:
        return {}, {}

    class KernelLibrary(JITCodeLibrary):  # type: ignore[misc]
        """Code of one kernel, without that of those it calls, optimized by itself only."""

        def finalize(self) -> None:
            for function in self._final_module.functions:
                if not function.is_declaration and function.linkage.name == "external":
                    function.linkage = "linkonce_odr"
            self._shared_module = self._final_module
            self._finalized = True

    class EntryLibrary(JITCodeLibrary):  # type: ignore[misc]
        """Code of an entry and of all kernels that it calls, directly or not, optimized once as a whole."""

        _linking_libraries: list[Any]

        def finalize(self) -> None:
            waiting, all_libraries = list(self._linking_libraries), dict[Any, None]()
            while waiting:
                library = waiting.pop()
                if library not in all_libraries:
                    all_libraries[library] = None
                    waiting += library._linking_libraries if isinstance(library, KernelLibrary) else []
            self._linking_libraries = list(all_libraries)
            super().finalize()

        def _optimize_final_module(self) -> None:
            """Leave out Numba's first round, which prepares the pruning of reference counts: there are none."""
            passes = self._codegen._module_pass_manager()
            manager, *builder = passes if isinstance(passes, tuple) else (passes,)
            manager.run(self._final_module, *builder)

    @register_pass(mutates_CFG=True, analysis_only=False)
    class KernelLowering(NativeLowering):  # type: ignore[misc]
        """Numba's last pass without what serves calls from Python."""

        _name = "kernel_lowering"

        def run_pass(self, state: Any) -> bool:
            name = state.func_id.func_qualname
            state.library = KernelLibrary(state.targetctx.codegen(), name)
            state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = state.flags.no_compile = True
            changed: bool = super().run_pass(state)
            # The dispatcher wants a built-in function, one of its own for each kernel; this one raises KeyError with
            # these words.
            no_entry = ("{" + f"{name} is called by kernels only" + "}").format
            state.targetctx.insert_user_function(no_entry, state.cr.fndesc, [state.library])
            state["cr"] = state.cr._replace(cfunc=no_entry)
            return changed

    @register_pass(mutates_CFG=True, analysis_only=False)
    class EntryLowering(NativeLowering):  # type: ignore[misc]
        """Numba's last pass into a library that takes up kernels."""

        _name = "entry_lowering"

        def run_pass(self, state: Any) -> bool:
            state.library = EntryLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            changed: bool = super().run_pass(state)
            return changed

    class KernelCompiler(CompilerBase):  # type: ignore[misc]
        """Numba's compiler with another last pass, without passes for what kernels do not have."""

        lowering = KernelLowering

        def define_pipelines(self) -> list[Any]:
            manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
            manager.passes = [
                (self.lowering if own is NativeLowering else own, why)
                for own, why in manager.passes
                if own._name not in _SPARED
            ]
            manager.finalize()
            return [manager]

    class EntryCompiler(KernelCompiler):
        """The same for an entry, which compiles the kernels that it calls on its way."""

        lowering = EntryLowering

        def compile_extra(self, function: Any) -> Any:
            if not _say_not_kept.cache_info().currsize:
                _say_once("compiling kernels: some seconds, the first time only")
            with _each_operator_resolved_once():
                return super().compile_extra(function)

    return {"pipeline_class": KernelCompiler}, {"pipeline_class": EntryCompiler}


@contextmanager
def _each_operator_resolved_once() -> Iterator[None]:
    """Let Numba remember which of an operator's implementations takes which types, a fifth of all time; no collection of garbage."""
    from numba.core.types import functions

    operators: Any = functions.BaseFunction
    resolve, signatures = operators.get_call_type, dict[Any, Any]()

    def remembered(operator: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return resolve(operator, context, args, kws)
        if (operator, args) not in signatures:
            signatures[operator, args] = resolve(operator, context, args, kws)
        return signatures[operator, args]

    collecting = gc.isenabled()
    gc.disable()
    operators.get_call_type = remembered
    try:
        yield
    finally:
        operators.get_call_type = resolve
        if collecting:
            gc.enable()


_KERNEL, _ENTRY = _compilers()


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
    compiled = njit(**_KERNEL, **_OPTIONS, **options)(function)
    template = compiled.get_call_template

    def template_of_types(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        """Take a constant by its type, for which the kernel may have been compiled already."""
        return template(
            tuple(map(types.unliteral, args)), {name: types.unliteral(x) for name, x in kws.items()}
        )

    compiled.get_call_template = template_of_types
    return compiled


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
