"""
Removal of code that the types of a kernel's arguments make unreachable, before Numba infers types
and compiles what is called there.

Kinds are empty tuples and tuples of one number (`SMOOTH, LINEAR = (), (1,)`), so their comparison
follows from their types. Without this pass, Numba compiles both branches, with the same results.
"""

import operator
from types import ModuleType
from typing import Any

from numba.core import ir, types
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.consts import ConstantInference
from numba.core.ir_utils import get_definition, guard
from numba.core.types.containers import BaseNamedTuple, BaseTuple


@register_pass(mutates_CFG=False, analysis_only=False)
class DecideByType(FunctionPass):  # type: ignore[misc]
    """
    Replaces comparisons of kinds by their results, for which Numba's next pass removes branches.
    """

    _name = "decide_by_type"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Replace all comparisons that the types of the arguments decide."""
        code = state.func_ir
        changed = False
        for block in code.blocks.values():
            for one in block.find_insts(ir.Assign):
                equal = _equal(code, state.args, one.value)
                if equal is not None:
                    result = ir.Const(
                        equal == (one.value.fn in (operator.eq, operator.is_)), one.loc
                    )
                    definitions = code._definitions[one.target.name]
                    definitions[definitions.index(one.value)] = one.value = result
                    changed = True
        if changed:
            code._consts = ConstantInference(code)
        return changed


def _equal(code: Any, args: Any, value: Any) -> bool | None:
    """
    True or False if an instruction compares an argument with None, or two tuples of which one is
    empty; otherwise None.
    """
    if not isinstance(value, ir.Expr) or value.op != "binop":
        return None
    sides = value.lhs, value.rhs
    if value.fn in (operator.is_, operator.is_not):
        kind = _type(code, args, sides[0])
        constant = guard(get_definition, code, sides[1])
        if not isinstance(constant, ir.Const) or constant.value is not None:
            return None
        return kind is types.none if kind is types.none or isinstance(kind, BaseTuple) else None
    if value.fn in (operator.eq, operator.ne):
        lengths = [_length(code, args, side) for side in sides]
        return None if None in lengths or 0 not in lengths else lengths[0] == lengths[1]
    return None


def _length(code: Any, args: Any, variable: Any) -> int | None:
    """
    Number of elements of a tuple that is an argument, a part of one or a constant of a module;
    otherwise None.
    """
    definition = guard(get_definition, code, variable)
    if isinstance(definition, ir.Expr) and definition.op == "getattr":
        owner = guard(get_definition, code, definition.value)
        if isinstance(owner, ir.Global) and isinstance(owner.value, ModuleType):
            constant = getattr(owner.value, definition.attr, None)
            return len(constant) if type(constant) is tuple else None
    kind = _type(code, args, variable)
    return len(kind.types) if isinstance(kind, BaseTuple) else None


def _type(code: Any, args: Any, variable: Any) -> Any:
    """Type of an argument or of a part of one; otherwise None."""
    definition = guard(get_definition, code, variable)
    if isinstance(definition, ir.Arg):
        return args[definition.index]
    if not isinstance(definition, ir.Expr) or definition.op not in (
        "getattr",
        "static_getitem",
        "exhaust_iter",
    ):
        return None
    whole = _type(code, args, definition.value)
    if definition.op == "exhaust_iter":
        return whole
    if definition.op == "static_getitem" and isinstance(whole, BaseTuple):
        return whole.types[definition.index] if isinstance(definition.index, int) else None
    if isinstance(whole, BaseNamedTuple) and definition.attr in whole.fields:
        return whole.types[whole.fields.index(definition.attr)]
    return None
