"""
Arithmetic on sixteen numbers in vector registers of the processor (`Lanes`), for sixteen rays at a
time.

Comparisons return a mask for `choose` and `any_lane`. A product and a sum may be combined with a
single rounding. In plain Python there are only `load`, `store`, `rounded_product` and `packed`, on
arrays: `beside` uses them for the numbers of one ray.
"""

import operator

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.core.imputils import lower_builtin
from numba.core.typing import signature
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, models, register_model

from pymantaray.compile import PLAIN

WIDTH = 16  # two vectors of the widest processors: while one waits for a result, the other proceeds
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_QUAD, _OCTET = (ir.VectorType(ir.DoubleType(), n) for n in (4, 8))


class Lanes(types.Type):  # type: ignore[misc]
    """
    Numba type of sixteen numbers in vector registers; the name identifies it in kernels on disk.
    """


class Mask(types.Type):  # type: ignore[misc]
    """Numba type of sixteen logical values."""


def _kind(kind, element):
    """Type with values in a vector register."""

    def of_vectors(self, manager, own):
        models.PrimitiveModel.__init__(self, manager, own, ir.VectorType(element, WIDTH))

    register_model(kind)(
        type(f"{kind.__name__}Model", (models.PrimitiveModel,), {"__init__": of_vectors})
    )
    return kind(kind.__name__)


LANES, MASK = _kind(Lanes, ir.DoubleType()), _kind(Mask, ir.IntType(1))


def _splat(builder, value):
    """Vector with sixteen equal numbers."""
    if isinstance(value.type, ir.VectorType):
        return value
    empty = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, empty, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), None)
    )


_PAIRS = (LANES, LANES), (LANES, types.float64), (types.float64, LANES)


def _define(op, result, emit, pairs=_PAIRS):
    """Define an operator of two vectors, or of a vector and a number."""

    def lower(_context, builder, _signature, args):
        return emit(builder, *(_splat(builder, x) for x in args))

    cases = {"cases": [signature(result, *pair) for pair in pairs]}
    infer_global(op)(type(f"Lanes_{op.__name__}", (ConcreteTemplate,), cases))
    for pair in pairs:
        lower_builtin(op, *pair)(lower)


_define(operator.add, LANES, lambda builder, a, b: builder.fadd(a, b, flags=("contract",)))
_define(operator.sub, LANES, lambda builder, a, b: builder.fsub(a, b, flags=("contract",)))
_define(operator.mul, LANES, lambda builder, a, b: builder.fmul(a, b, flags=("contract",)))
_define(operator.truediv, LANES, lambda builder, a, b: builder.fdiv(a, b))
_define(operator.gt, MASK, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_define(operator.lt, MASK, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_define(operator.and_, MASK, lambda builder, a, b: builder.and_(a, b), ((MASK, MASK),))


def _or_plain(plain):
    """Decorator of an intrinsic that in plain Python is another function, of arrays."""
    return (lambda _intrinsic: plain) if PLAIN else intrinsic


def _plain_row(rows, i):
    return rows.reshape(-1)[WIDTH * i : WIDTH * (i + 1)]


def _plain_store(rows, i, value):
    _plain_row(rows, i)[:] = value


def _plain_packed(numbers):
    return np.pad(np.array(numbers), (0, WIDTH - len(numbers)))


@_or_plain(operator.mul)
def rounded_product(_context, _number, lanes):
    """Product of a number and sixteen numbers that is rounded before it is added to others."""

    def generate(_context, builder, _signature, args):
        return builder.fmul(_splat(builder, args[0]), args[1])

    return LANES(types.float64, lanes), generate


@_or_plain(_plain_packed)
def packed(_context, numbers):
    """Sixteen numbers: those of a tuple, then zeros."""

    def generate(_context, builder, signature, args):
        total = ir.Constant(_VECTOR, None)
        for i in range(len(signature.args[0])):
            value = builder.extract_value(args[0], i)
            total = builder.insert_element(total, value, ir.IntType(32)(i))
        return total

    return LANES(numbers), generate


def _unary(name):
    """LLVM intrinsic for sixteen numbers."""

    @intrinsic
    def function(_context, _x):
        def generate(_context, builder, _signature, args):
            kind = ir.FunctionType(_VECTOR, [_VECTOR])
            own = get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
            return builder.call(own, args)

        return LANES(LANES), generate

    return function


root, floor, absolute = (_unary(name) for name in ("sqrt", "floor", "fabs"))


@intrinsic
def any_lane(_context, _mask):
    """True if any element of a mask is true."""

    def generate(_context, builder, _signature, args):
        byte = ir.IntType(WIDTH)
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], byte), byte(0))

    return types.boolean(MASK), generate


@intrinsic
def choose(_context, _mask, a, b):
    """Elements of a where a mask is true, otherwise of b."""

    def generate(_context, builder, _signature, args):
        return builder.select(args[0], _splat(builder, args[1]), _splat(builder, args[2]))

    return LANES(
        MASK, LANES if a == LANES else types.float64, LANES if b == LANES else types.float64
    ), generate


def _pointer(context, builder, kind, array, index):
    """Pointer to an element of a contiguous array."""
    return builder.gep(context.make_array(kind)(context, builder, array).data, [index])


@_or_plain(_plain_row)
def load(_context, rows, _i):
    """Load a row of an array (n, 16)."""

    def generate(context, builder, signature, args):
        at = builder.mul(args[1], args[1].type(WIDTH))
        pointer = _pointer(context, builder, signature.args[0], args[0], at)
        return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)

    return LANES(rows, types.int64), generate


@_or_plain(_plain_store)
def store(_context, rows, _i, value):
    """Store sixteen numbers in a row of an array (n, 16)."""

    def generate(context, builder, signature, args):
        at = builder.mul(args[1], args[1].type(WIDTH))
        pointer = _pointer(context, builder, signature.args[0], args[0], at)
        builder.store(
            _splat(builder, args[2]), builder.bitcast(pointer, _VECTOR.as_pointer()), align=8
        )
        return context.get_dummy_value()

    return types.none(rows, types.int64, LANES if value == LANES else types.float64), generate


def _shuffled(builder, a, b, order):
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(order)), list(order))
    return builder.shuffle_vector(a, b, mask)


def _transposed(context, builder, pairs):
    """
    Transpose sixteen vectors of four numbers, each two of them in one vector, to four vectors of
    sixteen.
    """
    halves = [_transposed_half(builder, pairs[i : i + 4]) for i in (0, 4)]
    columns = [_shuffled(builder, a, b, range(WIDTH)) for a, b in zip(*halves, strict=True)]
    return context.make_tuple(builder, types.UniTuple(LANES, 4), columns)


def _transposed_half(builder, pairs):
    """
    Transpose eight vectors of four numbers, each two of them in one vector, to four vectors of
    eight.
    """
    low, high = (0, 4, 8, 12, 1, 5, 9, 13), (2, 6, 10, 14, 3, 7, 11, 15)
    columns = []
    for part in (low, high):
        left, right = (_shuffled(builder, pairs[i], pairs[i + 1], part) for i in (0, 2))
        columns += [
            _shuffled(builder, left, right, (*range(k, k + 4), *range(k + 8, k + 12)))
            for k in (0, 4)
        ]
    return columns


def _indices(builder, lanes):
    """Integer parts of sixteen non-negative numbers, as sixteen integers."""
    long, short = ir.IntType(64), ir.IntType(32)
    whole = builder.fptosi(lanes, ir.VectorType(long, WIDTH))
    return [builder.extract_element(whole, short(i)) for i in range(WIDTH)]


@intrinsic
def take(_context, array, index):
    """Eight elements of an array."""

    def generate(context, builder, signature, args):
        kind, total = signature.args[0], ir.Constant(_VECTOR, ir.Undefined)
        for lane, i in enumerate(_indices(builder, args[1])):
            value = builder.load(_pointer(context, builder, kind, args[0], i))
            value = context.cast(builder, value, kind.dtype, types.float64)
            total = builder.insert_element(total, value, ir.IntType(32)(lane))
        return total

    return LANES(array, index), generate


def _some(vector, context, builder, kind, array, index):
    """Load as many successive elements of an array as a vector has."""
    pointer = _pointer(context, builder, kind, array, index)
    return builder.load(builder.bitcast(pointer, vector.as_pointer()), align=8)


@intrinsic
def gather(_context, data, position):
    """Load four successive numbers from each of sixteen positions in data."""

    def generate(context, builder, signature, args):
        kind = signature.args[0]
        quads = [
            _some(_QUAD, context, builder, kind, args[0], begin)
            for begin in _indices(builder, args[1])
        ]
        pairs = [
            _shuffled(builder, a, b, range(8)) for a, b in zip(quads[::2], quads[1::2], strict=True)
        ]
        return _transposed(context, builder, pairs)

    return types.UniTuple(LANES, 4)(data, position), generate


@intrinsic
def mix(_context, data, position, _stride, weights):
    """
    As `gather`, but eight numbers: the sum, with two weights, of those at a position and of those
    one stride further.
    """

    def generate(context, builder, signature, args):
        weights = [builder.extract_value(args[3], k) for k in range(2)]
        sums = []
        for lane, begin in enumerate(_indices(builder, args[1])):
            octets = []
            for k, octet_at in enumerate((begin, builder.add(begin, args[2]))):
                octet = _some(_OCTET, context, builder, signature.args[0], args[0], octet_at)
                weight = _shuffled(builder, weights[k], weights[k], 8 * (lane,))
                octets.append(builder.fmul(octet, weight, flags=("contract",) if k == 1 else ()))
            sums.append(builder.fadd(*octets, flags=("contract",)))
        columns = []
        for half in (range(4), range(4, 8)):
            orders = (*half, *(8 + k for k in half))
            pairs = [
                _shuffled(builder, a, b, orders) for a, b in zip(sums[::2], sums[1::2], strict=True)
            ]
            tuples = _transposed(context, builder, pairs)
            columns += [builder.extract_value(tuples, k) for k in range(4)]
        return context.make_tuple(builder, types.UniTuple(LANES, 8), columns)

    return types.UniTuple(LANES, 8)(data, position, types.int64, weights), generate


@intrinsic
def blend(_context, data, position, _stride, weights):
    """
    As `gather`, but weighted sums of these four numbers, the next four, and both of these one
    stride further.
    """

    def generate(context, builder, signature, args):
        weights = [builder.extract_value(args[3], k) for k in range(4)]
        sums = []
        for lane, begin in enumerate(_indices(builder, args[1])):
            octets = []
            for k, octet_at in enumerate((begin, builder.add(begin, args[2]))):
                octet = _some(_OCTET, context, builder, signature.args[0], args[0], octet_at)
                order = 4 * (lane,) + 4 * (WIDTH + lane,)
                weight = _shuffled(builder, weights[2 * k], weights[2 * k + 1], order)
                # only the second product may be combined with the sum: otherwise the compiler
                # chooses, in each lane anew
                octets.append(builder.fmul(octet, weight, flags=("contract",) if k == 1 else ()))
            sums.append(builder.fadd(*octets, flags=("contract",)))
        pairs = []
        for a, b in zip(
            sums[::2], sums[1::2], strict=True
        ):  # the sums of both halves, of two lanes
            halves = (
                _shuffled(builder, a, b, (*range(k, k + 4), *range(k + 8, k + 12))) for k in (0, 4)
            )
            pairs.append(builder.fadd(*halves))
        return _transposed(context, builder, pairs)

    return types.UniTuple(LANES, 4)(data, position, types.int64, weights), generate
