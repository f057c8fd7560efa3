"""
Products of blocks of six by six, a row at a time in vectors of the machine.

Numba leaves loops of six to scalar arithmetic, which takes three times as long; digits are the same, for each element is the same sum.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from pymantaray.compile import PLAIN

SIZE = 6
_NUMBER, _ROW = ir.DoubleType(), ir.VectorType(ir.DoubleType(), SIZE)


def _product(combine: str, *, turned_first: bool = False, turned_second: bool = False) -> Any:
    """
    Function of blocks ``out[i], a[p], b[q]`` of arrays (n, 6, 6) that sets, adds or subtracts a product, either factor transposed or not.

    ``out[i]`` is neither of the factors.
    """
    if PLAIN:
        return _plain_product(combine, turned_first=turned_first, turned_second=turned_second)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, a, b = (_elements(context, builder, signature, arguments, k) for k in (0, 2, 4))
        rows = [_row(builder, b, k, turned=turned_second) for k in range(SIZE)]
        for r in range(SIZE):
            total = None
            for k, row in enumerate(rows):
                share = builder.load(_at(builder, a, SIZE * k + r if turned_first else SIZE * r + k))
                term = builder.fmul(_repeated(builder, share), row)
                total = term if total is None else builder.fadd(total, term)
            place = builder.bitcast(_at(builder, out, SIZE * r), _ROW.as_pointer())
            if combine != "set":
                join = builder.fadd if combine == "add" else builder.fsub
                total = join(builder.load(place, align=8), total)
            builder.store(total, place, align=8)
        return context.get_dummy_value()

    def product(_context: Any, out: Any, i: Any, a: Any, p: Any, b: Any, q: Any) -> Any:
        return types.none(out, i, a, p, b, q), generate

    return intrinsic(product)


def _product_with_vector(*, turned: bool) -> Any:
    """
    Function of vectors and a block ``out[i], a[p], x[k]`` of arrays (n, 6), (n, 6, 6), (n, 6) that subtracts ``a[p] @ x[k]`` from ``out[i]``.

    Turned, the block is transposed. Terms are subtracted one after the other; ``out[i]`` is not ``x[k]``.
    """
    if PLAIN:
        return _plain_product_with_vector(turned=turned)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, a, x = (
            _elements(context, builder, signature, arguments, k, size)
            for k, size in ((0, SIZE), (2, SIZE * SIZE), (4, SIZE))
        )
        place = builder.bitcast(out, _ROW.as_pointer())
        total = builder.load(place, align=8)
        for k in range(SIZE):
            share = _repeated(builder, builder.load(_at(builder, x, k)))
            total = builder.fsub(total, builder.fmul(_row(builder, a, k, turned=not turned), share))
        builder.store(total, place, align=8)
        return context.get_dummy_value()

    def product(_context: Any, out: Any, i: Any, a: Any, p: Any, x: Any, k: Any) -> Any:
        return types.none(out, i, a, p, x, k), generate

    return intrinsic(product)


def _elements(
    context: Any, builder: Any, signature: Any, arguments: Any, k: int, size: int = SIZE * SIZE
) -> Any:
    """Index of the first element of a block or vector of a contiguous array."""
    array = context.make_array(signature.args[k])(context, builder, arguments[k])
    block = arguments[k + 1]
    return builder.gep(array.data, [builder.mul(block, block.type(size))])


def _at(builder: Any, block: Any, element: int) -> Any:
    return builder.gep(block, [ir.IntType(64)(element)])


def _row(builder: Any, block: Any, k: int, *, turned: bool) -> Any:
    """A row of a block, or a column."""
    if not turned:
        return builder.load(builder.bitcast(_at(builder, block, SIZE * k), _ROW.as_pointer()), align=8)
    row = ir.Constant(_ROW, ir.Undefined)
    for c in range(SIZE):
        element = builder.load(_at(builder, block, SIZE * c + k))
        row = builder.insert_element(row, element, ir.IntType(32)(c))
    return row


def _repeated(builder: Any, number: Any) -> Any:
    """A row of one number."""
    one = builder.insert_element(ir.Constant(_ROW, ir.Undefined), number, ir.IntType(32)(0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), SIZE), [0] * SIZE)
    return builder.shuffle_vector(one, ir.Constant(_ROW, ir.Undefined), first)


def _plain_product(combine: str, *, turned_first: bool, turned_second: bool) -> Callable[..., None]:
    """The same in Python."""

    def product(out: Any, i: int, a: Any, p: int, b: Any, q: int) -> None:
        total = (a[p].T if turned_first else a[p]) @ (b[q].T if turned_second else b[q])
        out[i] = total if combine == "set" else out[i] + total if combine == "add" else out[i] - total

    return product


def _plain_product_with_vector(*, turned: bool) -> Callable[..., None]:
    """The same in Python."""

    def product(out: Any, i: int, a: Any, p: int, x: Any, k: int) -> None:
        out[i] -= (a[p].T if turned else a[p]) @ x[k]

    return product


set_product = _product("set")
subtract_product = _product("subtract")
add_transposed_product = _product("add", turned_first=True)
subtract_transposed_product = _product("subtract", turned_first=True)
subtract_product_transposed = _product("subtract", turned_second=True)
subtract_from_vector = _product_with_vector(turned=False)
subtract_transposed_from_vector = _product_with_vector(turned=True)
