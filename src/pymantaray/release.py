"""
Release of what Numba and llvmlite made on the way to machine code.

Their objects refer to each other in cycles, so they stayed in memory until a garbage collection of
a million objects, at the end of the process at the latest. Without the cycles, they are freed at
once.
"""

from collections.abc import Callable
from typing import Any

from numba.core.typeinfer import TypeInferer


def release_module(module: Any) -> None:
    """Empty a module of LLVM's language whose text was read."""
    for function in module.functions:
        for block in function.blocks:
            block.instructions = []
            block.terminator = None
        function.blocks = []
        function.args = ()
        function.return_value = None
    module.globals.clear()


def release_code(state: Any) -> None:
    """
    Empty the scopes of a kernel's code after its last pass, and leave out the copy of the code for
    readers of its types.
    """
    for block in state.func_ir.blocks.values():
        block.scope.localvars._con.clear()
    state.type_annotation = ""
    state.cr.fndesc.typemap = state.cr.fndesc.calltypes = None


def types_without_variables() -> Callable[..., Any]:
    """Numba's end of type inference, which then forgets all that it needed."""
    unify = TypeInferer.unify

    def unify_and_forget(inference: Any, *args: Any, **options: Any) -> Any:
        types = unify(inference, *args, **options)
        vars(inference).clear()
        return types

    return unify_and_forget
