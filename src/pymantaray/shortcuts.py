"""
Shorter ways through Numba while an entry is compiled. The compiled code is the same.

Numba formats each instruction and the types of each pass for messages that nobody reads, colours
the text of exceptions that it catches, and repeats searches and analyses. A replacement whose place
does not exist in a version of Numba is left out.
"""

import gc
import inspect
import itertools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

from llvmlite.ir import _utils  # type: ignore[import-untyped]
from llvmlite.ir.builder import IRBuilder  # type: ignore[import-untyped]
from numba.core import (
    base,
    byteflow,
    errors,
    event,
    interpreter,
    ir,
    lowering,
    postproc,
    ssa,
    transforms,
    typeinfer,
    utils,
)
from numba.core.base import BaseContext
from numba.core.compiler_machinery import PassManager
from numba.core.datamodel.packer import ArgPacker
from numba.core.types import functions
from numba.core.types.abstract import Type
from numba.core.types.functions import RecursiveCall
from numba.core.typing.context import BaseContext as TypingContext
from numba.np import arrayobj

from pymantaray import fewer_instructions
from pymantaray.release import types_without_variables

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
    """
    Numba's manager of compiler passes, without events, and without checks and a text of all types
    for each pass.
    """

    analyses: ClassVar[dict[Any, Any]] = {}

    def _runPass(self, _index: int, one: Any, state: Any) -> None:  # noqa: N802
        one.analysis = self._analysis
        for part in (one.run_initialization, one.run_pass, one.run_finalizer):
            part(state)

    def dependency_analysis(self) -> Any:
        """Find the passes that need results of others, once for the same passes."""
        passes = tuple(own for own, _ in self.passes)
        if passes not in self.analyses:
            self.analyses[passes] = super().dependency_analysis()
        return self.analyses[passes]


def _operators() -> Callable[..., Any]:
    """Numba's choice of an operator's implementation, stored by types."""
    resolve = functions.BaseFunction.get_call_type
    signatures = dict[Any, Any]()

    def get_call_type(operator: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return resolve(operator, context, args, kws)
        key = operator, args
        signature = signatures.get(key, signatures)
        if signature is signatures:
            signature = signatures[key] = resolve(operator, context, args, kws)
        return signature

    return get_call_type


def _attributes() -> Callable[..., Any]:
    """Numba's types of attributes, stored by the owner's type and the name."""
    resolve = TypingContext.resolve_getattr
    known = dict[Any, Any]()

    def resolve_getattr(context: Any, kind: Any, name: str) -> Any:
        key = kind, name
        found = known.get(key, known)
        if found is known:
            found = known[key] = resolve(context, kind, name)
        return found

    return resolve_getattr


def _constants() -> Callable[..., Any]:
    """Numba's types of global values, stored by object."""
    resolve = TypingContext.resolve_value_type
    known = dict[int, Any]()

    def resolve_value_type(context: Any, value: Any) -> Any:
        if id(value) not in known:
            known[id(value)] = (
                value,
                resolve(context, value),
            )  # with the value, which therefore keeps its id
        return known[id(value)][1]

    return resolve_value_type


def _implementations() -> Callable[..., Any]:
    """
    Numba's search of an implementation; it loads all registries again only for the first search
    without result.
    """
    search = BaseContext.get_function
    missing = set[Any]()

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


def _refresh() -> Callable[..., Any]:
    """
    Numba's search for new functions in its registries, only if there are more of them, or new
    modules.

    Numba copies a context for each function. All copies share their registries, which are kept by
    identity.
    """
    refresh = BaseContext.refresh
    seen = dict[int, tuple[Any, int]]()

    def refresh_if_new(context: Any) -> None:
        own = context._registries
        lists = (
            x
            for one in (*own, *context.typing_context._registries)
            for x in vars(one).values()
            if isinstance(x, list)
        )
        count = len(sys.modules) + sum(map(len, lists))
        if seen.get(id(own)) != (own, count):
            refresh(context)
            seen[id(own)] = own, count  # with the registries, which therefore keep their id

    return refresh_if_new


def _parameters() -> Callable[..., Any]:
    """Numba's test if a function has a parameter ``loc``, stored by the function's code."""
    has_loc = base._has_loc
    known = dict[Any, bool]()

    def remembered(function: Any) -> bool:
        code = getattr(inspect.unwrap(function), "__code__", None)
        if code is None:
            return bool(has_loc(function))
        if code not in known:
            known[code] = has_loc(function)
        return known[code]

    return remembered


def _lifetimes() -> Callable[..., Any]:
    """
    Numba's analysis of the lifetime of variables, only if it inserts the ends of lifetimes, which
    kernels do not need.
    """
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
    """
    Numba's step to the next instruction; in functions without exception handlers, without a search
    for them, past unused code.
    """
    search = byteflow.Flow._run_handle_exception

    def search_if_there(self: Any, runner: Any, state: Any) -> Any:
        code = self._bytecode
        if (
            getattr(code, "exception_entries", None) != ()
        ):  # handlers, or a Python without this table
            return search(self, runner, state)
        following = code[state._pc].next
        while following in code and code[following].opname == "CACHE":
            following = code[following].next
        state._pc = following
        return None

    return search_if_there


def _without_with() -> Callable[..., Any]:
    """
    Numba's removal of the variables of ``with`` blocks, only from functions that have such blocks.
    """
    remove = interpreter.peep_hole_delete_with_exit

    def remove_if_there(code: Any) -> Any:
        there = any(
            isinstance(one, ir.EnterWith) for block in code.blocks.values() for one in block.body
        )
        return remove(code) if there else code

    return remove_if_there


def _hash() -> Callable[..., Any]:
    """Numba's hash of a type, stored by object, because it needs those of all its parts."""
    known = dict[int, Any]()

    def stored(self: Any) -> int:
        found = known.get(id(self))
        if found is None:
            found = known[id(self)] = (
                self,
                hash(self.key),
            )  # with the type, which therefore keeps its id
        value: int = found[1]
        return value

    return stored


class _ErrorContext:
    """As Numba's new_error_context, which is a generator."""

    __slots__ = ("text", "values")

    def __init__(self, text: str, **values: Any) -> None:
        self.text = text
        self.values = values

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind: object, error: object, _traceback: object) -> None:
        if isinstance(error, errors.NumbaError):
            error.add_context(self.text.format(**self.values) if self.values else self.text)


def _propagate(network: Any, inference: Any) -> list[Any]:
    """
    As Numba's ConstraintNetwork.propagate, which collects warnings for each constraint, and repeats
    all calls in each round.

    A call whose signature is known is typed again only if the types of its arguments changed.
    """
    caught = []
    variables = inference.typevars
    with inference.warnings.catch_warnings():
        for constraint in network.constraints:
            inputs = None
            if isinstance(constraint, typeinfer.CallConstraint):
                inputs = _inputs(constraint, variables)
                if inputs == vars(constraint).get("inputs"):
                    continue
            try:
                constraint(inference)
            except errors.ForceLiteralArg as error:
                caught.append(error)
            except errors.TypingError as error:
                again = errors.TypingError(str(error), loc=constraint.loc, highlighting=False)
                caught.append(utils.chain_exception(again, error))
            else:
                if (
                    inputs
                    and not isinstance(inputs[-1], RecursiveCall)
                    and _is_final(constraint.signature)
                ):
                    constraint.inputs = inputs
    return caught


def _is_final(signature: Any) -> bool:
    """True if a call has a signature whose result needs no refinement."""
    return signature is not None and signature.return_type.is_precise()


def _inputs(constraint: Any, variables: Any) -> list[Any]:
    """Types of the function, of the arguments and of the result of a call."""
    names = [x.name for x in constraint.args]
    names += [x.name for _, x in constraint.kws]
    if constraint.vararg is not None:
        names.append(constraint.vararg.name)
    if not isinstance(constraint, typeinfer.IntrinsicCallConstraint):
        names.append(constraint.func)
    return [variables[x].type for x in names]


def _single_assignments(states: Any, block: Any, handler: Any) -> list[Any]:
    """As Numba's _run_ssa_block_pass, which is a generator and logs each instruction."""
    on_assign = handler.on_assign
    on_other = handler.on_other
    return [
        on_assign(states, x) if isinstance(x, ir.Assign) else on_other(states, x)
        for x in block.body
    ]


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
        counts = self._basenamemap
        first = name
        while name in used:
            counts[first] += 1
            name = f"{first}.{counts[first]}"
    used.add(name)
    return name


def _nothing(*_args: Any, **_kws: Any) -> None:
    """
    Do nothing: an event for which nobody listens, or names of arguments for readers of LLVM's
    language.
    """


def _replacements() -> list[tuple[Any, str, Any]]:
    """Owner, name and replacement of parts of Numba and llvmlite."""
    listeners = itertools.chain(*event._registered.values())
    silent = all(
        isinstance(x, event.TimingListener) for x in listeners
    )  # those of the entry's own compilation
    return [
        (functions.BaseFunction, "get_call_type", _operators()),
        (TypingContext, "resolve_value_type", _constants()),
        (TypingContext, "resolve_getattr", _attributes()),
        (typeinfer.ConstraintNetwork, "propagate", _propagate),
        (typeinfer.TypeInferer, "unify", types_without_variables()),
        *[(module, "new_error_context", _ErrorContext) for module in (typeinfer, lowering)],
        (BaseContext, "get_function", _implementations()),
        (base, "_has_loc", _parameters()),
        (type(errors.termcolor()), "errmsg", lambda _scheme, text: text),
        (postproc.PostProcessor, "run", _lifetimes()),
        (ir.Loc, "strformat", lambda place, *_: f'\nFile "{place.filename}", line {place.line}:'),
        (BaseContext, "refresh", _refresh()),
        (ir.Inst, "_rec_list_vars", _variables),
        (_utils.NameScope, "register", _unique_name),
        (IRBuilder, "extract_value", fewer_instructions.extract_value),
        (ArgPacker, "assign_names", _nothing),
        (arrayobj, "make_array", fewer_instructions.make_array),
        (byteflow.Flow, "_run_handle_exception", _without_try()),
        (interpreter, "peep_hole_delete_with_exit", _without_with()),
        (Type, "__hash__", _hash()),
        (ssa, "_run_ssa_block_pass", _single_assignments),
        *[(event, name, _nothing) for name in ("start_event", "end_event", "broadcast") if silent],
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
