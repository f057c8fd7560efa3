"""
Numba compilers that link kernels into the entries that call them, and optimize and compile each
entry as a whole.

A large kernel that several entries call is shared: it is compiled once, with all kernels that it
calls, under a name that is the same in every process. The disk cache stores an entry with the
machine code of its shared kernels.
"""

from functools import partial
from typing import Any, ClassVar

from llvmlite import binding as llvm, ir  # type: ignore[import-untyped]
from numba.core import cgutils, errors, ir as numba_ir, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.cpu import CPUContext
from numba.core.datamodel import ArgPacker, DataModelManager, default_manager
from numba.core.datamodel.models import ArrayModel, OpaqueModel
from numba.core.lowering import Lower
from numba.core.registry import cpu_target
from numba.core.typed_passes import NativeLowering
from numba.core.types.containers import BaseNamedTuple
from numba.core.typing import Context
from numba.extending import register_model

# Passes of Numba for features that no kernel uses: with blocks, closures, exceptions, lists, array
# expressions.
_SKIPPED_PASSES = {
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
    "ir_legalization",
    "nopython_supported_feature_validation",
    "dump_parfor_diagnostics",
}


class ArrayByDataAndShape(ArrayModel):  # type: ignore[misc]
    """
    A contiguous array of numbers that is passed by its data and shape, from which its other fields
    follow.
    """

    def get_argument_type(self) -> tuple[Any, ...]:
        """Types of the arguments."""
        data = self.get_model(self.get_field_position("data"))
        return data.get_value_type(), *(cgutils.intp_t,) * self._fe_type.ndim

    def as_argument(self, builder: Any, value: Any) -> tuple[Any, ...]:
        """Extract data and shape from an array."""
        shape = self.get(builder, value, "shape")
        return self.get(builder, value, "data"), *cgutils.unpack_tuple(builder, shape)

    def from_argument(self, builder: Any, value: Any) -> Any:
        """Build the array from its data and shape."""
        data, *shape = value
        itemsize = cgutils.intp_t(self._fe_type.dtype.bitwidth // 8)
        nitems, strides = shape[-1], [itemsize]
        for n in shape[-2::-1]:
            strides.insert(0, builder.mul(itemsize, nitems))
            nitems = builder.mul(n, nitems)
        parts = {"nitems": nitems, "itemsize": itemsize, "data": data}
        parts |= {
            "shape": cgutils.pack_array(builder, shape),
            "strides": cgutils.pack_array(builder, strides),
        }
        array = ir.Constant(self.get_value_type(), None)
        for name, part in parts.items():
            array = self.set(builder, array, part, name)
        return array


def _array_model(models: Any, kind: Any) -> Any:
    plain = kind.layout == "C" and isinstance(kind.dtype, types.Number)
    return (ArrayByDataAndShape if plain else ArrayModel)(models, kind)


class ModelsOfArguments:
    """
    Numba's models of types, with `ArrayByDataAndShape` for arrays in named tuples, which only
    kernels take.
    """

    in_tuples = DataModelManager().chain(default_manager)
    in_tuples.register(types.Array, _array_model)

    @classmethod
    def lookup(cls, kind: Any) -> Any:
        """Model of a type."""
        return (cls.in_tuples if isinstance(kind, BaseNamedTuple) else default_manager).lookup(kind)


class KernelContext(CPUContext):  # type: ignore[misc]
    """
    Numba's context of a processor, with `ModelsOfArguments`.

    Two to four numbers per array of a workspace are passed instead of seven to eleven; saves a
    tenth of the time.
    """

    packers: ClassVar[dict[Any, Any]] = {}

    def get_arg_packer(self, kinds: Any) -> Any:
        """Packer of arguments, one for the same types."""
        kinds = tuple(kinds)
        if kinds not in self.packers:
            self.packers[kinds] = ArgPacker(ModelsOfArguments, kinds)
        return self.packers[kinds]


class KnownFunction(types.Function):
    """
    An operator or a function that Numba provides, which knows its signatures.

    Numba tries all candidates again at each of its places.
    """

    def __init__(self, function: Any) -> None:
        super().__init__(function.templates)
        self.signatures = dict[Any, Any]()

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature of a call."""
        if kws:
            return super().get_call_type(context, args, kws)
        if args not in self.signatures:
            self.signatures[args] = super().get_call_type(context, args, kws)
        return self.signatures[args]


register_model(KnownFunction)(OpaqueModel)


class KernelTyping(Context):  # type: ignore[misc]
    """Numba's typing context with `KnownFunction`."""

    known: ClassVar[dict[Any, KnownFunction]] = {}

    def __init__(self, whole: Context) -> None:
        self.__dict__.update(whole.__dict__)  # the same registries

    def resolve_value_type(self, value: Any) -> Any:
        """Type of a constant or a global name."""
        return self._as_known(super().resolve_value_type(value))

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """Signature of a call of an operator or of a type that can be called."""
        operator = self._lookup_global(function)
        return super().resolve_function_type(self._as_known(operator) or function, args, kws)

    def _as_known(self, kind: Any) -> Any:
        if type(kind) is not types.Function:
            return kind
        if kind not in self.known:
            self.known[kind] = KnownFunction(kind)
        return self.known[kind]


class Library(JITCodeLibrary):  # type: ignore[misc]
    """Code that is optimized only as a whole, not function by function."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout


class KernelLibrary(Library):
    """Unoptimized code of one kernel, without the kernels that it calls."""

    def add_llvm_module(self, module: Any) -> None:
        """Take the kernel's only module as it is."""
        self._optimize_functions(module)
        self._final_module = module

    def finalize(self) -> None:
        """Give each entry its own copy."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        self._shared_module = self._final_module
        self._finalized = True


class EntryLibrary(Library):
    """
    Code of an entry and of all kernels that it calls directly or indirectly, optimized once as a
    whole.

    ``needs`` is the machine code of shared kernels by symbol; a kernel follows the kernels that it
    calls. ``compact`` is True if loops remain as they are.
    """

    _linking_libraries: list[Any]
    needs: dict[str, bytes]
    compact = False

    def finalize(self) -> None:
        """Load shared kernels, add the code of all other kernels, then optimize and compile."""
        waiting, all_libraries = list(self._linking_libraries), dict[Any, None]()
        while waiting:
            library = waiting.pop()
            if library not in all_libraries:
                all_libraries[library] = None
                waiting += [] if isinstance(library, EntryLibrary) else library._linking_libraries
        self._linking_libraries = [x for x in all_libraries if not isinstance(x, SharedLibrary)]
        self.needs = {
            k: v for x in all_libraries if isinstance(x, SharedLibrary) for k, v in x.needs.items()
        }
        self._reload_init = {partial(load_shared, tuple(self.needs.items()))}
        super().finalize()

    def _optimize_final_module(self) -> None:
        """
        Skip Numba's first round, which prepares the pruning of reference counts: kernels have none.
        """
        manager, builder = (
            _compact_passes(self._codegen) if self.compact else self._codegen._module_pass_manager()
        )
        manager.run(self._final_module, builder)


def _compact_passes(codegen: Any) -> tuple[Any, Any]:
    """LLVM's passes without copies of loops: neither unrolled nor vectorized."""
    tuning = llvm.create_pipeline_tuning_options(speed_level=1)
    tuning.loop_unrolling = tuning.loop_vectorization = tuning.slp_vectorization = False
    builder = llvm.create_pass_builder(codegen._tm, tuning)
    return builder.getModulePassManager(), builder


class SharedLibrary(EntryLibrary):
    """
    Code of a shared kernel and of all kernels that it calls, optimized once as a whole; one per
    name and process.
    """

    loaded: ClassVar[dict[str, "SharedLibrary"]] = {}
    symbol = ""

    def finalize(self) -> None:
        """
        Compile the kernel, unless an entry from the disk cache has loaded it; its own code is the
        last in ``needs``.
        """
        if self.symbol not in self.loaded:
            super().finalize()
            self.needs[self.symbol] = self._get_compiled_object()
            self.loaded[self.symbol] = self
        self.needs = self.loaded[self.symbol].needs
        self._finalized = True


def load_shared(needs: tuple[tuple[str, bytes], ...]) -> None:
    """
    Load the machine code of shared kernels once per process; a kernel follows the kernels that it
    calls.
    """
    for i, (symbol, code) in enumerate(needs):
        if symbol not in SharedLibrary.loaded:
            library = SharedLibrary(cpu_target.target_context.codegen(), symbol)
            library.needs = dict(needs[: i + 1])
            library.enable_object_caching()
            library._set_compiled_object(code)
            library._finalize_final_module()
            SharedLibrary.loaded[symbol] = library


class KernelLower(Lower):  # type: ignore[misc]
    """
    Numba's lowering without debug information and without deletion of variables, which own nothing
    here.
    """

    _disable_sroa_like_opt = False  # only for debug information

    def alloca(self, name: str, kind: Any) -> Any:
        """Allocate a variable."""
        return cgutils.alloca_once(self.builder, self.context.get_value_type(kind), name=name)

    def lower_block(self, block: Any) -> None:
        """Lower the instructions of a block; an error tells which one."""
        self.pre_block(block)
        for inst in block.body:
            self.loc = inst.loc
            try:
                self.lower_inst(inst)
            except errors.NumbaError as error:
                error.add_context(f'lowering "{inst}" at {inst.loc}')
                raise
        self.post_block(block)

    def lower_inst(self, inst: Any) -> None:
        """Lower an instruction; assignments without their text for debugging."""
        if isinstance(inst, numba_ir.Assign):
            name = inst.target.name
            self.storevar(self.lower_assign(self.typeof(name), inst), name)
        else:
            super().lower_inst(inst)

    def storevar(self, value: Any, name: str, argidx: Any = None) -> None:  # noqa: ARG002
        """Store a value into a variable, whose old value owns nothing."""
        self._alloca_var(name, self.typeof(name))
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self.builder.store(value, self.getvar(name))

    def delvar(self, name: str) -> None:
        """Do nothing: a variable owns nothing."""


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):  # type: ignore[misc]
    """Numba's last pass without wrappers for calls from Python."""

    _name = "kernel_lowering"
    lowering_class = KernelLower
    library: Any = KernelLibrary

    def run_pass(self, state: Any) -> bool:
        """Lower a kernel into a library of its own."""
        name = state.func_id.func_qualname
        state.library = self.library(state.targetctx.codegen(), name)
        state.library.compact = hasattr(state.func_id.func, "compact")
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = state.flags.no_compile = (
            True
        )
        changed: bool = super().run_pass(state)
        # The dispatcher requires a distinct built-in function for each kernel. This one raises
        # KeyError with this text.
        no_entry = ("{" + f"{name} is called by kernels only" + "}").format
        state.targetctx.insert_user_function(no_entry, state.cr.fndesc, [state.library])
        state["cr"] = state.cr._replace(cfunc=no_entry)
        return changed


@register_pass(mutates_CFG=True, analysis_only=False)
class SharedLowering(KernelLowering):
    """
    The last pass for shared kernels: one compiled library for all entries, under a name without
    Numba's counter.
    """

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
    """Numba's last pass into a library that includes kernels."""

    _name = "entry_lowering"
    lowering_class = KernelLower

    def run_pass(self, state: Any) -> bool:
        """Lower an entry into a library that is cached on disk."""
        state.library = EntryLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.compact = hasattr(state.func_id.func, "compact")
        state.library.enable_object_caching()
        state.flags.no_cfunc_wrapper = True
        changed: bool = super().run_pass(state)
        return changed


class KernelCompiler(CompilerBase):  # type: ignore[misc]
    """
    Numba's compiler with a different last pass, and without passes for features that kernels do not
    use.
    """

    lowering = KernelLowering

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.state.typingctx = self.state.targetctx.typing_context = KernelTyping(
            self.state.typingctx
        )
        self.state.targetctx.__class__ = KernelContext  # a copy that this compilation owns

    def define_pipelines(self) -> list[Any]:
        """Numba's passes in their order."""
        manager = PassManager(self.__class__.__name__)
        manager.passes = [
            (self.lowering if own is NativeLowering else own, why)
            for own, why in DefaultPassBuilder.define_nopython_pipeline(self.state).passes
            if own._name not in _SKIPPED_PASSES
        ]
        manager.finalize()
        return [manager]


class SharedCompiler(KernelCompiler):
    """Compiler of shared kernels."""

    lowering = SharedLowering


class EntryCompiler(KernelCompiler):
    """Compiler of entries, which also compiles the kernels that an entry calls."""

    lowering = EntryLowering
