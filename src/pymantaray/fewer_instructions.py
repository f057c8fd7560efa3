"""
Fewer instructions in the code that Numba generates for LLVM, which would remove the others again.

Numba stores variables and arrays in memory and loads them again. Here, they are values where
possible, fields of tuples and arrays too. Instructions without a user are removed before the code
becomes text. LLVM optimizes what remains to the same results.
"""

from collections import Counter
from functools import cache
from typing import Any

from llvmlite.ir import instructions as kinds  # type: ignore[import-untyped]
from numba.core import cgutils, ir, types
from numba.core.analysis import compute_cfg_from_blocks
from numba.np import arrayobj

_WITHOUT_EFFECT = (
    kinds.InsertValue,
    kinds.ExtractValue,
    kinds.GEPInstr,
    kinds.CastInstr,
    kinds.LoadInstr,
)
_numba_make_array = arrayobj.make_array


def variables_without_memory(blocks: dict[int, Any]) -> set[str]:
    """Variables with a single assignment that precedes all their uses."""
    assignments = Counter[str]()
    first = dict[str, int]()
    uses = set[tuple[str, int]]()
    for offset, block in blocks.items():
        here = set[str]()
        for inst in block.body:
            assigned = inst.target.name if isinstance(inst, ir.Assign) else None
            source = inst.value if assigned else inst
            read = [source] if isinstance(source, ir.Var) else []
            if isinstance(source, ir.Inst):
                read = source.list_vars()
            uses.update((x.name, offset) for x in read if x.name not in here)
            if assigned:
                assignments[assigned] += 1
                first[assigned] = offset
                here.add(assigned)
    single = {name for name, count in assignments.items() if count == 1}
    order = {offset: i for i, offset in enumerate(blocks)}
    dominators = compute_cfg_from_blocks(blocks).dominators()
    late = {
        name
        for name, offset in uses
        if name in single
        and (order[first[name]] >= order[offset] or first[name] not in dominators[offset])
    }
    return single - late


def extract_value(builder: Any, aggregate: Any, index: Any, name: str = "") -> Any:
    """
    As llvmlite's IRBuilder.extract_value; a value that was inserted into the aggregate before is
    returned itself.
    """
    indices = list(index) if isinstance(index, tuple | list) else [index]
    while isinstance(aggregate, kinds.InsertValue):
        inserted = list(aggregate.indices)
        n = min(len(inserted), len(indices))
        if inserted[:n] != indices[:n]:
            aggregate = aggregate.aggregate
        elif len(inserted) > len(indices):
            break  # only a part of the field was inserted here
        else:
            aggregate = aggregate.value
            indices = indices[n:]
            if not indices:
                return aggregate
    extracted = kinds.ExtractValue(builder.block, aggregate, indices, name=name)
    builder._insert(extracted)
    return extracted


def remove_unused(module: Any) -> None:
    """Remove instructions whose result has no user."""
    for function in module.functions:
        everything = [x for block in function.blocks for x in block.instructions]
        uses = Counter(id(x) for one in everything for x in _operands(one))
        waiting = [x for x in everything if not uses[id(x)] and isinstance(x, _WITHOUT_EFFECT)]
        unused = set[int]()
        while waiting:
            one = waiting.pop()
            unused.add(id(one))
            for operand in one.operands:
                uses[id(operand)] -= 1
                if not uses[id(operand)] and isinstance(operand, _WITHOUT_EFFECT):
                    waiting.append(operand)
        for block in function.blocks if unused else ():
            block.instructions = [x for x in block.instructions if id(x) not in unused]


def _operands(one: Any) -> Any:
    """Values that an instruction uses."""
    return (
        [value for value, _ in one.incomings] if isinstance(one, kinds.PhiInstr) else one.operands
    )


@cache
def make_array(kind: Any) -> Any:
    """
    As Numba's make_array, but an array that exists as a value is stored in memory only when its
    address is needed.
    """
    plain = _numba_make_array(kind)

    class Array(plain):  # type: ignore[misc,valid-type]
        """An array's fields."""

        def __init__(self, context: Any, builder: Any, value: Any = None, ref: Any = None) -> None:
            at_start = (
                builder.block is builder.function.entry_basic_block
            )  # before the memory of variables
            if value is None or at_start or type(kind) is not types.Array:
                super().__init__(context, builder, value, ref)
                return
            self._context = context
            self._builder = builder
            self._array = value
            self._datamodel = context.data_model_manager[self._fe_type]
            self._be_type = self._get_be_type(self._datamodel)
            before = builder.block.instructions[: builder._anchor]
            self._block = builder.block
            self._previous = before[-1] if before else None

        def __getattr__(self, name: str) -> Any:
            if name not in ("_value", "_outer_ref"):
                return super().__getattr__(name)
            self._store()
            return self.__dict__[name]

        def __getitem__(self, index: int) -> Any:
            if "_value" in self.__dict__:
                return super().__getitem__(index)
            return self._builder.extract_value(self._array, index)

        @property
        def shape(self) -> Any:
            """Numbers of elements."""
            if "_value" in self.__dict__:
                return plain.shape.fget(self)
            return self[self._datamodel.get_field_position("shape")]

        def _getvalue(self) -> Any:
            return super()._getvalue() if "_value" in self.__dict__ else self._array

        def _store(self) -> None:
            """Store the array in memory where this object was made, which precedes all its uses."""
            builder = self._builder
            block = builder.block
            following = builder.block.instructions[builder._anchor :][:1]
            memory = cgutils.alloca_once(builder, self._be_type)
            if self._previous is None:
                builder.position_at_start(self._block)
            else:
                builder.position_after(self._previous)
            builder.store(self._array, memory)
            self._outer_ref = self._value = memory
            if following:
                builder.position_before(following[0])
            else:
                builder.position_at_end(block)

    return Array
