"""Compilers of Numba's by which kernels are linked, optimized as a whole and compiled in the entries that call them.

Large kernels that several entries call are shared: compiled once with all that they call, and found by the entries under a name
that is the same in every process. An entry is kept on disk with the machine code of those that it calls.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, ClassVar

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import cpu_target
from numba.core.typed_passes import NativeLowering
from numba.core.types import functions

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


class KernelLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of one kernel, without that of those it calls, optimized by itself only."""

    def finalize(self) -> None:
        """Let each entry have a copy of its own."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        self._shared_module = self._final_module
        self._finalized = True


class EntryLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of an entry and of all kernels that it calls, directly or not, optimized once as a whole.

    needs is the machine code of shared kernels by symbol, of each after those that it calls.
    """

    _linking_libraries: list[Any]
    needs: dict[str, bytes]

    def finalize(self) -> None:
        """Take up the code of all kernels, optimize and compile it; that of shared ones is loaded before it."""
        waiting, all_libraries = list(self._linking_libraries), dict[Any, None]()
        while waiting:
            library = waiting.pop()
            if library not in all_libraries:
                all_libraries[library] = None
                waiting += [] if isinstance(library, EntryLibrary) else library._linking_libraries
        self._linking_libraries = [x for x in all_libraries if not isinstance(x, SharedLibrary)]
        self.needs = {k: v for x in all_libraries if isinstance(x, SharedLibrary) for k, v in x.needs.items()}
        self._reload_init = {partial(load_shared, tuple(self.needs.items()))}
        super().finalize()

    def _optimize_final_module(self) -> None:
        """Leave out Numba's first round, which prepares the pruning of reference counts: there are none."""
        passes = self._codegen._module_pass_manager()
        manager, *builder = passes if isinstance(passes, tuple) else (passes,)
        manager.run(self._final_module, *builder)


class SharedLibrary(EntryLibrary):
    """Code of a shared kernel and of all kernels that it calls, optimized once as a whole; one of a name in a process."""

    loaded: ClassVar[dict[str, "SharedLibrary"]] = {}
    symbol = ""

    def finalize(self) -> None:
        """Compile it, unless an entry that was kept on disk has brought it; its own code is the last that it needs."""
        if self.symbol not in self.loaded:
            super().finalize()
            self.needs[self.symbol] = self._get_compiled_object()
            self.loaded[self.symbol] = self
        self.needs = self.loaded[self.symbol].needs
        self._finalized = True


def load_shared(needs: tuple[tuple[str, bytes], ...]) -> None:
    """Load the machine code of shared kernels, once in a process, of each after those that it calls."""
    for i, (symbol, code) in enumerate(needs):
        if symbol not in SharedLibrary.loaded:
            library = SharedLibrary(cpu_target.target_context.codegen(), symbol)
            library.needs = dict(needs[: i + 1])
            library.enable_object_caching()
            library._set_compiled_object(code)
            library._finalize_final_module()
            SharedLibrary.loaded[symbol] = library


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):  # type: ignore[misc]
    """Numba's last pass without what serves calls from Python."""

    _name = "kernel_lowering"
    library: Any = KernelLibrary

    def run_pass(self, state: Any) -> bool:
        """Lower a kernel into a library of its own."""
        name = state.func_id.func_qualname
        state.library = self.library(state.targetctx.codegen(), name)
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = state.flags.no_compile = True
        changed: bool = super().run_pass(state)
        # The dispatcher wants a built-in function, one of its own for each kernel; this one raises KeyError with
        # these words.
        no_entry = ("{" + f"{name} is called by kernels only" + "}").format
        state.targetctx.insert_user_function(no_entry, state.cr.fndesc, [state.library])
        state["cr"] = state.cr._replace(cfunc=no_entry)
        return changed


@register_pass(mutates_CFG=True, analysis_only=False)
class SharedLowering(KernelLowering):
    """The same into a library that is compiled for all entries, under a name without Numba's counter."""

    _name = "shared_lowering"
    library = SharedLibrary

    def run_pass(self, state: Any) -> bool:
        """Lower a shared kernel."""
        state.func_id.unique_id = 0
        changed = super().run_pass(state)
        state.library.symbol = state.cr.fndesc.mangled_name
        state.library.enable_object_caching()
        return changed


@register_pass(mutates_CFG=True, analysis_only=False)
class EntryLowering(NativeLowering):  # type: ignore[misc]
    """Numba's last pass into a library that takes up kernels."""

    _name = "entry_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower an entry into a library that is kept on disk."""
        state.library = EntryLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        changed: bool = super().run_pass(state)
        return changed


class KernelCompiler(CompilerBase):  # type: ignore[misc]
    """Numba's compiler with another last pass, without passes for what kernels do not have."""

    lowering = KernelLowering

    def define_pipelines(self) -> list[Any]:
        """Numba's passes in their order."""
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [
            (self.lowering if own is NativeLowering else own, why)
            for own, why in manager.passes
            if own._name not in _SPARED
        ]
        manager.finalize()
        return [manager]


class SharedCompiler(KernelCompiler):
    """The same for a kernel that entries share."""

    lowering = SharedLowering


class EntryCompiler(KernelCompiler):
    """The same for an entry, which compiles the kernels that it calls on its way."""

    lowering = EntryLowering

    def compile_extra(self, function: Any) -> Any:
        """Compile a function, and say so."""
        from pymantaray.compile import announce_compilation

        announce_compilation()
        with _each_operator_resolved_once():
            return super().compile_extra(function)


@contextmanager
def _each_operator_resolved_once() -> Iterator[None]:
    """Let Numba remember which of an operator's implementations takes which types, a fifth of all time; no collection of garbage."""
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
