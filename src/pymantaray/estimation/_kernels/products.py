"""
Products of blocks of six by six, a row at a time in vectors of the machine.

Numba leaves loops of six to scalar arithmetic, which takes three times as long; digits are the
same, for each element is the same sum.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from pymantaray.compile import PLAIN

SIZE = 6
_NUMBER = ir.DoubleType()


def _product(
    combine: str,
    *,
    turned_first: bool = False,
    transpose_second: bool = False,
    size: int = SIZE,
    half_empty: bool = False,
) -> Any:
    """
    Function of blocks ``out[i], a[p], b[q]`` of arrays (n, size, size) that sets, adds or subtracts
    a product, either factor transposed or not.

    ``out[i]`` is neither of the factors. Half empty factors have zeros in the upper right quarter;
    the first one is transposed.
    """
    if PLAIN:
        return _plain_product(combine, turned_first=turned_first, transpose_second=transpose_second)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, a, b = (
            _elements(context, builder, signature, arguments, k, size * size) for k in (0, 2, 4)
        )
        rows = [_row(builder, b, k, transpose=transpose_second, size=size) for k in range(size)]
        for r in range(size):
            total = None
            for k, row in enumerate(rows):
                if half_empty and r >= size // 2 > k:
                    continue
                share = builder.load(
                    _at(builder, a, size * k + r if turned_first else size * r + k)
                )
                term = builder.fmul(_repeated(builder, share, size), row)
                total = term if total is None else builder.fadd(total, term)
            place = builder.bitcast(_at(builder, out, size * r), _vector(size).as_pointer())
            if combine != "set":
                join = builder.fadd if combine == "add" else builder.fsub
                total = join(builder.load(place, align=8), total)
            builder.store(total, place, align=8)
        return context.get_dummy_value()

    def product(_context: Any, out: Any, i: Any, a: Any, p: Any, b: Any, q: Any) -> Any:
        return types.none(out, i, a, p, b, q), generate

    return intrinsic(product)


def _product_with_vector(*, transpose: bool) -> Any:
    """
    Function of vectors and a block ``out[i], a[p], x[k]`` of arrays (n, 6), (n, 6, 6), (n, 6) that
    subtracts ``a[p] @ x[k]`` from ``out[i]``.

    Turned, the block is transposed. Terms are subtracted one after the other; ``out[i]`` is not
    ``x[k]``.
    """
    if PLAIN:
        return _plain_product_with_vector(transpose=transpose)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, a, x = (
            _elements(context, builder, signature, arguments, k, size)
            for k, size in ((0, SIZE), (2, SIZE * SIZE), (4, SIZE))
        )
        place = builder.bitcast(out, _vector(SIZE).as_pointer())
        total = builder.load(place, align=8)
        for k in range(SIZE):
            share = _repeated(builder, builder.load(_at(builder, x, k)))
            total = builder.fsub(
                total, builder.fmul(_row(builder, a, k, transpose=not transpose), share)
            )
        builder.store(total, place, align=8)
        return context.get_dummy_value()

    def product(_context: Any, out: Any, i: Any, a: Any, p: Any, x: Any, k: Any) -> Any:
        return types.none(out, i, a, p, x, k), generate

    return intrinsic(product)


def _solution() -> Any:
    """
    Function of blocks ``out[p], u[k]`` of arrays (n, 6, 6) that replaces ``out[p]`` by the solution
    of ``u[k].T @ x = out[p]``, u upper.
    """
    if PLAIN:
        return _plain_solve

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, u = (_elements(context, builder, signature, arguments, k) for k in (0, 2))
        one = ir.Constant(_NUMBER, 1.0)
        rows: list[Any] = []
        for r in range(SIZE):
            total = _row(builder, out, r, transpose=False)
            for i, row in enumerate(rows):
                share = _repeated(builder, builder.load(_at(builder, u, SIZE * i + r)))
                total = builder.fsub(total, builder.fmul(share, row))
            inverse = builder.fdiv(one, builder.load(_at(builder, u, (SIZE + 1) * r)))
            rows.append(builder.fmul(total, _repeated(builder, inverse)))
        for r, row in enumerate(rows):
            builder.store(
                row,
                builder.bitcast(_at(builder, out, SIZE * r), _vector(SIZE).as_pointer()),
                align=8,
            )
        return context.get_dummy_value()

    def solve(_context: Any, out: Any, p: Any, u: Any, k: Any) -> Any:
        return types.none(out, p, u, k), generate

    return intrinsic(solve)


def _prefetch() -> Any:
    """
    Function of a block ``a[p]`` of an array (n, 6, 6) that asks for it to be loaded in the cache.
    """
    if PLAIN:
        return lambda _a, _p: None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        block = _elements(context, builder, signature, arguments, 0)
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        prefetch = builder.module.declare_intrinsic(
            "llvm.prefetch", [byte], ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        )
        for line in range(0, SIZE * SIZE, 8):
            address = builder.bitcast(_at(builder, block, line), byte)
            builder.call(prefetch, [address, number(0), number(3), number(1)])
        return context.get_dummy_value()

    def fetch(_context: Any, a: Any, p: Any) -> Any:
        return types.none(a, p), generate

    return intrinsic(fetch)


def _elements(
    context: Any, builder: Any, signature: Any, arguments: Any, k: int, size: int = SIZE * SIZE
) -> Any:
    """Index of the first element of a block or vector of a contiguous array."""
    array = context.make_array(signature.args[k])(context, builder, arguments[k])
    block = arguments[k + 1]
    return builder.gep(array.data, [builder.mul(block, block.type(size))])


def _at(builder: Any, block: Any, element: int) -> Any:
    return builder.gep(block, [ir.IntType(64)(element)])


def _vector(size: int) -> Any:
    return ir.VectorType(_NUMBER, size)


def _row(builder: Any, block: Any, k: int, *, transpose: bool, size: int = SIZE) -> Any:
    """A row of a block, or a column."""
    vector = _vector(size)
    if not transpose:
        return builder.load(
            builder.bitcast(_at(builder, block, size * k), vector.as_pointer()), align=8
        )
    row = ir.Constant(vector, ir.Undefined)
    for c in range(size):
        element = builder.load(_at(builder, block, size * c + k))
        row = builder.insert_element(row, element, ir.IntType(32)(c))
    return row


def _repeated(builder: Any, number: Any, size: int = SIZE) -> Any:
    """A row of one number."""
    none = ir.Constant(_vector(size), ir.Undefined)
    one = builder.insert_element(none, number, ir.IntType(32)(0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), size), [0] * size)
    return builder.shuffle_vector(one, none, first)


def _plain_product(
    combine: str, *, turned_first: bool, transpose_second: bool
) -> Callable[..., None]:
    """The same in Python."""

    def product(out: Any, i: int, a: Any, p: int, b: Any, q: int) -> None:
        total = (a[p].T if turned_first else a[p]) @ (b[q].T if transpose_second else b[q])
        out[i] = (
            total if combine == "set" else out[i] + total if combine == "add" else out[i] - total
        )

    return product


def _plain_product_with_vector(*, transpose: bool) -> Callable[..., None]:
    """The same in Python."""

    def product(out: Any, i: int, a: Any, p: int, x: Any, k: int) -> None:
        out[i] -= (a[p].T if transpose else a[p]) @ x[k]

    return product


def _plain_solve(out: Any, p: int, u: Any, k: int) -> None:
    """The same in Python."""
    for r in range(SIZE):
        for i in range(r):
            out[p, r] -= u[k, i, r] * out[p, i]
        out[p, r] *= 1.0 / u[k, r, r]


set_product = _product("set")
subtract_product = _product("subtract")
set_product_of_three = _product("set", size=3)
set_transposed_product_of_three = _product("set", size=3, turned_first=True)
subtract_product_of_three = _product("subtract", size=3)
add_transposed_product = _product("add", turned_first=True)
add_transposed_product_half_empty = _product("add", turned_first=True, half_empty=True)
subtract_transposed_product = _product("subtract", turned_first=True)
subtract_product_transposed = _product("subtract", transpose_second=True)
subtract_from_vector = _product_with_vector(transpose=False)
subtract_transposed_from_vector = _product_with_vector(transpose=True)
solve_transposed = _solution()
prefetch = _prefetch()
