"""
Assembly of normal equations from relative poses and measured positions, batch by batch of rows.

The rows of a batch share blocks only with each other and with the last rows. A batch is emptied,
filled and, if wanted, eliminated while its blocks are in the cache; the memory's bandwidth limits
long missions.
"""

from collections import namedtuple

from pymantaray.compile import entry, inlined
from pymantaray.estimation._kernels.cholesky import eliminate_rows
from pymantaray.estimation._kernels.residuals import add_position, add_relative

ChainFactors = namedtuple("ChainFactors", "relative blocks positions")
ChainFactors.__doc__ = "Relative poses, the blocks of their pairs, and measured positions."
Batches = namedtuple("Batches", "row relative relative_start positions positions_start")
Batches.__doc__ = """Rows from ``row[b]`` to ``row[b + 1]`` of each batch, the last after them.

Factor ``relative[k]`` belongs to batch b for k from ``relative_start[b]`` to
``relative_start[b + 1]``."""
Costs = namedtuple("Costs", "relative positions")


@entry
def assemble(factors, batches, poses, matrix, upper, task, costs, work):  # type: ignore[no-untyped-def]
    """
    Compute the costs of all factors; of order 1 and above set the matrix and the gradient, as
    `add_relative` does.

    ``task`` is the order, and whether to eliminate batches. Their rows of ``upper.right`` are then
    the gradient's, negative; the last rows of ``right`` and ``element`` are changes by elimination
    alone. Return a row without digits left, or -1.
    """
    order, eliminate = task
    row, failed = batches.row, -1
    last = row.size - 2
    if order > 0:
        _empty_rows(matrix, upper, row[last], row[last + 1], eliminate)
    for b in range(last + 1):
        if order > 0 and b < last:
            _empty_rows(matrix, upper, row[b], row[b + 1], False)
        for k in range(batches.relative_start[b], batches.relative_start[b + 1]):
            i = batches.relative[k]
            costs.relative[i] = add_relative(
                factors.relative, factors.blocks, poses, matrix, order, i, work
            )
        for k in range(batches.positions_start[b], batches.positions_start[b + 1]):
            i = batches.positions[k]
            costs.positions[i] = add_position(factors.positions, poses.position, matrix, order, i)
        if eliminate and b < last and failed < 0:
            for k in range(row[b], row[b + 1]):
                for r in range(6):
                    upper.element[k, r] = upper.diagonal[k, r, r]
                    upper.right[k, r] = -matrix.gradient[k, r]
            failed = eliminate_rows(upper, row[b], row[b + 1], row[last])
    return failed


@inlined
def _empty_rows(matrix, upper, begin, end, eliminate):  # type: ignore[no-untyped-def]
    """
    Set blocks and gradient of rows to zero, and their right-hand side and elements if they only
    count changes.
    """
    for k in range(begin, end):
        for r in range(6):
            matrix.gradient[k, r] = 0.0
            for c in range(6):
                matrix.diagonal[k, r, c] = 0.0
            if eliminate:
                upper.right[k, r] = upper.element[k, r] = 0.0
    if begin < end:
        for p in range(upper.start[begin], upper.start[end]):
            for r in range(6):
                for c in range(6):
                    matrix.above[p, r, c] = 0.0
