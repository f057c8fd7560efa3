"""A compiler for kernels that keeps their code for the entries that call them.

Numba optimizes each function and compiles it to machine code by itself, and again within each that calls it, directly
or not: more than half of all time for kernels that only kernels call. This uses parts of Numba that are not its public interface.
"""

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering


class _KeptLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel and of those it calls, neither optimized as a whole nor compiled."""

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


class KernelCompiler(CompilerBase):  # type: ignore[misc]
    """Numba's compiler with that pass in place of its own."""

    def define_pipelines(self):
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [(_KeepCode if own is NativeLowering else own, why) for own, why in manager.passes]
        manager.finalize()
        return [manager]
