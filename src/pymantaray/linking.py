"""Compilers of Numba's by which kernels are linked, optimized as a whole and compiled in the entries that call them."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
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
    """Code of an entry and of all kernels that it calls, directly or not, optimized once as a whole."""

    _linking_libraries: list[Any]

    def finalize(self) -> None:
        """Take up the code of all kernels, optimize and compile it."""
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
        """Lower a kernel into a library of its own."""
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
