"""
Shorter ways through Numba while an entry is compiled. The compiled code is the same.

Numba formats each instruction and the types of each pass for messages that nobody reads, colours the text of exceptions that it catches,
and repeats searches and analyses. A replacement whose place does not exist in a version of Numba is left out.
"""

import gc
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite.ir import _utils  # type: ignore[import-untyped]
from llvmlite.ir.builder import IRBuilder  # type: ignore[import-untyped]
from numba.core import base, byteflow, errors, event, interpreter, ir, postproc, ssa, transforms
from numba.core.base import BaseContext
from numba.core.compiler_machinery import PassManager
from numba.core.types import functions
from numba.core.types.abstract import Type
from numba.core.types.containers import BaseTuple
from numba.core.typing.context import BaseContext as TypingContext
from numba.np import arrayobj

from pymantaray import fewer_instructions

_WITHOUT_VARIABLES = {
    ir.Loc,
    str,
    int,
    float,
    bool,
    type(None),
    type(len),
    ir.Const,
    ir.Arg,
    ir.Global,
    ir.FreeVar,
}


class QuickPassManager(PassManager):  # type: ignore[misc]
    """Numba's manager of compiler passes, without events, and without checks and a text of all types for each pass."""

    def _runPass(self, _index: int, one: Any, state: Any) -> None:  # noqa: N802
        one.analysis = self._analysis
        for part in (one.run_initialization, one.run_pass, one.run_finalizer):
            part(state)


def _operators() -> Callable[..., Any]:
    """Numba's choice of an operator's implementation, stored by types."""
    resolve, signatures = functions.BaseFunction.get_call_type, dict[Any, Any]()

    def get_call_type(operator: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return resolve(operator, context, args, kws)
        if (operator, args) not in signatures:
            signatures[operator, args] = resolve(operator, context, args, kws)
        return signatures[operator, args]

    return get_call_type


def _constants() -> Callable[..., Any]:
    """Numba's types of global values, stored by object."""
    resolve, known = TypingContext.resolve_value_type, dict[int, Any]()

    def resolve_value_type(context: Any, value: Any) -> Any:
        if id(value) not in known:
            known[id(value)] = value, resolve(context, value)  # with the value, which therefore keeps its id
        return known[id(value)][1]

    return resolve_value_type


def _implementations() -> Callable[..., Any]:
    """Numba's search of an implementation; it loads all registries again only for the first search without result."""
    search, missing = BaseContext.get_function, set[Any]()

    def get_function(context: Any, function: Any, signature: Any, **options: Any) -> Any:
        if not isinstance(function, str):
            return search(context, function, signature, **options)
        if (function, signature) in missing:
            raise NotImplementedError(function)
        try:
            return search(context, function, signature, **options)
        except NotImplementedError:
            missing.add((function, signature))
            raise

    return get_function


def _parameters() -> Callable[..., Any]:
    """Numba's test if a function has a parameter ``loc``, stored by the function's code."""
    has_loc, known = base._has_loc, dict[Any, bool]()

    def remembered(function: Any) -> bool:
        code = getattr(inspect.unwrap(function), "__code__", None)
        if code is None:
            return bool(has_loc(function))
        if code not in known:
            known[code] = has_loc(function)
        return known[code]

    return remembered


def _lifetimes() -> Callable[..., Any]:
    """Numba's analysis of the lifetime of variables, only if it inserts the ends of lifetimes, which kernels do not need."""
    run = postproc.PostProcessor.run

    def run_if_needed(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        code = self.func_ir
        if emit_dels or code.is_generator:
            run(self, emit_dels, extend_lifetimes)
            return
        code.blocks = transforms.canonicalize_cfg(code.blocks)
        code.variable_lifetime = postproc.VariableLifetime(code.blocks)
        code.generator_info = None

    return run_if_needed


def _without_try() -> Callable[..., Any]:
    """Numba's search for the exception handler of an instruction, only in functions that have handlers."""
    search = byteflow.Flow._run_handle_exception

    def search_if_there(self: Any, runner: Any, state: Any) -> Any:
        if (
            getattr(self._bytecode, "exception_entries", None) != ()
        ):  # handlers, or a Python without this table
            return search(self, runner, state)
        return state.advance_pc()

    return search_if_there


def _without_with() -> Callable[..., Any]:
    """Numba's removal of the variables of ``with`` blocks, only from functions that have such blocks."""
    remove = interpreter.peep_hole_delete_with_exit

    def remove_if_there(code: Any) -> Any:
        there = any(isinstance(one, ir.EnterWith) for block in code.blocks.values() for one in block.body)
        return remove(code) if there else code

    return remove_if_there


def _hash() -> Callable[..., Any]:
    """Numba's hash of a type; that of a tuple's type is stored by object, because it needs those of all its parts."""
    known = dict[int, Any]()

    def stored(self: Any) -> int:
        if not isinstance(self, BaseTuple):
            return hash(self.key)
        if id(self) not in known:
            known[id(self)] = self, hash(self.key)  # with the type, which therefore keeps its id
        value: int = known[id(self)][1]
        return value

    return stored


def _single_assignments(states: Any, block: Any, handler: Any) -> list[Any]:
    """As Numba's _run_ssa_block_pass, which is a generator and logs each instruction."""
    on_assign, on_other = handler.on_assign, handler.on_other
    return [on_assign(states, x) if isinstance(x, ir.Assign) else on_other(states, x) for x in block.body]


def _variables(self: Any, value: Any) -> list[Any]:
    """As Numba's Inst._rec_list_vars, in fewer calls."""
    if isinstance(value, dict):
        value = value.values()
    elif not isinstance(value, list | tuple):
        value = (value,)
    variables: list[Any] = []
    for one in value:
        if type(one) in _WITHOUT_VARIABLES:
            continue
        if isinstance(one, ir.Var):
            variables.append(one)
        elif isinstance(one, ir.Inst):
            variables += one.list_vars()
        elif isinstance(one, list | tuple | dict):
            variables += _variables(self, one)
    return variables


def _unique_name(self: Any, name: str, deduplicate: bool = False) -> str:
    """As llvmlite's NameScope.register, in one call."""
    used = self._useset
    if name in used:
        if not deduplicate:
            raise _utils.DuplicatedNameError(name)
        counts, first = self._basenamemap, name
        while name in used:
            counts[first] += 1
            name = f"{first}.{counts[first]}"
    used.add(name)
    return name


def _no_event(*_args: Any, **_kws: Any) -> None:
    """Do nothing: the start or the end of an event for which nobody listens."""


def _replacements() -> list[tuple[Any, str, Any]]:
    """Owner, name and replacement of parts of Numba and llvmlite."""
    silent = not any(event._registered.values())
    return [
        (functions.BaseFunction, "get_call_type", _operators()),
        (TypingContext, "resolve_value_type", _constants()),
        (BaseContext, "get_function", _implementations()),
        (base, "_has_loc", _parameters()),
        (type(errors.termcolor()), "errmsg", lambda _scheme, text: text),
        (postproc.PostProcessor, "run", _lifetimes()),
        (ir.Inst, "_rec_list_vars", _variables),
        (_utils.NameScope, "register", _unique_name),
        (IRBuilder, "extract_value", fewer_instructions.extract_value),
        (arrayobj, "make_array", fewer_instructions.make_array),
        (byteflow.Flow, "_run_handle_exception", _without_try()),
        (interpreter, "peep_hole_delete_with_exit", _without_with()),
        (Type, "__hash__", _hash()),
        (ssa, "_run_ssa_block_pass", _single_assignments),
        *[(event, name, _no_event) for name in ("start_event", "end_event", "broadcast") if silent],
    ]


@contextmanager
def shortcuts() -> Iterator[None]:
    """Replace parts of Numba, and postpone garbage collection."""
    originals = []
    collecting = gc.isenabled()
    gc.disable()
    try:
        for owner, name, new in _replacements():
            if name in vars(owner):
                originals.append((owner, name, vars(owner)[name]))
                setattr(owner, name, new)
        yield
    finally:
        for owner, name, old in reversed(originals):
            setattr(owner, name, old)
        if collecting:
            _postpone_collection()
            gc.enable()


def _postpone_collection() -> None:
    """Move all objects to the oldest generation, which is collected rarely."""
    if not gc.get_freeze_count():
        gc.freeze()
        gc.unfreeze()
