"""
Sparse Cholesky factors in blocks of six by six, row by row of the upper triangle.

Row k has a diagonal block and, from ``start[k]`` to ``start[k + 1]``, blocks of the rising columns ``column``. A row's
columns are all connected by its elimination, so that each pair of them has its block.
"""

import math

from pymantaray.compile import entry, inlined
from pymantaray.estimation._kernels.products import (
    subtract_from_vector,
    subtract_product,
    subtract_product_transposed,
    subtract_transposed_from_vector,
    subtract_transposed_product,
)

# Part of its diagonal element that is left to a pivot when rounding has taken its digits.
NO_DIGITS = 1e-12
# Least information: some direction may stray by 1,000 km, or as many radians, given all that are eliminated after it.
MIN_PIVOT = 1e-12


@entry
def join_rows(first, neighbour, parent, mark, count, start, column):  # type: ignore[no-untyped-def]
    """
    Count the blocks of each row, or write their columns if there is room for them.

    ``neighbour[first[i]:first[i + 1]]`` are the rows before i that it shares a factor with. Each climbs the tree of
    ``parent`` up to i: all on its way have a block of column i.
    """
    for i in range(mark.size):
        mark[i] = i
        count[i] = 0
        for p in range(first[i], first[i + 1]):
            j = neighbour[p]
            while mark[j] != i:
                if parent[j] < 0:
                    parent[j] = i
                if column.size:
                    column[start[j] + count[j]] = i
                count[j] += 1
                mark[j] = i
                j = parent[j]


@entry
def factorize(start, column, diagonal, above, element, x):  # type: ignore[no-untyped-def]
    """
    Turn a matrix into its upper factor; a row without digits left, -1 for none.

    ``element`` has the diagonal elements (m, 6) of the rows to eliminate; below them the Schur complement remains. A right-hand side x,
    (n, 6) or empty, goes down the transposed factor on the way, so that the blocks are read once.
    """
    for k in range(element.shape[0]):
        for r in range(6):
            pivot = diagonal[k, r, r]
            if not pivot > max(NO_DIGITS * element[k, r], MIN_PIVOT):
                return k
            root = math.sqrt(pivot)
            diagonal[k, r, r] = root
            for c in range(r + 1, 6):
                diagonal[k, r, c] /= root
            for i in range(r + 1, 6):
                for c in range(i, 6):
                    diagonal[k, i, c] -= diagonal[k, r, i] * diagonal[k, r, c]
        for p in range(start[k], start[k + 1]):
            for r in range(6):
                for i in range(r):
                    share = diagonal[k, i, r]
                    for c in range(6):
                        above[p, r, c] -= share * above[p, i, c]
                inverse = 1.0 / diagonal[k, r, r]
                for c in range(6):
                    above[p, r, c] *= inverse
        if x.size:
            _go_down(start, column, diagonal, above, x, k)
        for p in range(start[k], start[k + 1]):
            i = column[p]
            subtract_transposed_product(diagonal, i, above, p, above, p)
            at = start[i]
            for q in range(p + 1, start[k + 1]):
                while column[at] != column[q]:
                    at += 1
                subtract_transposed_product(above, at, above, p, above, q)
    return -1


@inlined
def _go_down(start, column, diagonal, above, x, k):  # type: ignore[no-untyped-def]
    """Row k of a right-hand side, and what it leaves of later rows."""
    for r in range(6):
        for i in range(r):
            x[k, r] -= diagonal[k, i, r] * x[k, i]
        x[k, r] /= diagonal[k, r, r]
    for p in range(start[k], start[k + 1]):
        subtract_transposed_from_vector(x, column[p], above, p, x, k)


@entry
def substitute(start, column, diagonal, above, x, down):  # type: ignore[no-untyped-def]
    """Solve for a right-hand side (n, 6) in place: down the transposed factor, unless it has been there, and up the factor."""
    n = diagonal.shape[0]
    if down:
        for k in range(n):
            _go_down(start, column, diagonal, above, x, k)
    for k in range(n - 1, -1, -1):
        for p in range(start[k], start[k + 1]):
            subtract_from_vector(x, k, above, p, x, column[p])
        for r in range(5, -1, -1):
            for c in range(r + 1, 6):
                x[k, r] -= diagonal[k, r, c] * x[k, c]
            x[k, r] /= diagonal[k, r, r]


@entry
def substitute_all(start, column, diagonal, above, x):  # type: ignore[no-untyped-def]
    """
    Solve for several right-hand sides (n, 6, count) at once, with the digits of `substitute`.

    Sixteen take the time of four: a block of the factor is read once for all, and vectors of the machine hold several of them.
    """
    n, count = diagonal.shape[0], x.shape[2]
    for k in range(n):
        for r in range(6):
            for i in range(r):
                for s in range(count):
                    x[k, r, s] -= diagonal[k, i, r] * x[k, i, s]
            for s in range(count):
                x[k, r, s] /= diagonal[k, r, r]
        for p in range(start[k], start[k + 1]):
            for c in range(6):
                _subtract_sum(x, column[p], c, above[p, :, c], k)
    for k in range(n - 1, -1, -1):
        for p in range(start[k], start[k + 1]):
            for r in range(6):
                _subtract_sum(x, k, r, above[p, r], column[p])
        for r in range(5, -1, -1):
            for c in range(r + 1, 6):
                for s in range(count):
                    x[k, r, s] -= diagonal[k, r, c] * x[k, c, s]
            for s in range(count):
                x[k, r, s] /= diagonal[k, r, r]


@inlined
def _subtract_sum(x, i, r, share, k):  # type: ignore[no-untyped-def]
    """Subtract six numbers times the rows of ``x[k]`` from ``x[i, r]``, one after another; i is not k."""
    a, b, c, d, e, f = share[0], share[1], share[2], share[3], share[4], share[5]
    for s in range(x.shape[2]):
        x[i, r, s] = (
            x[i, r, s]
            - a * x[k, 0, s]
            - b * x[k, 1, s]
            - c * x[k, 2, s]
            - d * x[k, 3, s]
            - e * x[k, 4, s]
            - f * x[k, 5, s]
        )


@entry
def invert(start, column, diagonal, above, rows, inverse_diagonal, inverse_above, work):  # type: ignore[no-untyped-def]
    """
    Blocks of the inverse in those rows that are marked and in all that their elimination joined them to, which are marked then.

    By Takahashi's recursion from the last row: with U_kk X = I, ``Z_kj = -X sum_i U_ki Z_ij`` and
    ``Z_kk = X (X^T - sum_i U_ki Z_ik)``. Inverse blocks have to come in as zero.
    """
    for k in range(rows.size):
        if rows[k]:
            for p in range(start[k], start[k + 1]):
                rows[column[p]] = True
    for k in range(rows.size - 1, -1, -1):
        if not rows[k]:
            continue
        begin, end = start[k], start[k + 1]
        for p in range(begin, end):
            i = column[p]
            subtract_product(inverse_above, p, above, p, inverse_diagonal, i)
            at = start[i]
            for q in range(p + 1, end):
                while column[at] != column[q]:
                    at += 1
                subtract_product(inverse_above, q, above, p, inverse_above, at)
                subtract_product_transposed(inverse_above, p, above, q, inverse_above, at)
        for p in range(begin, end):
            _solve_upper(diagonal, k, inverse_above, p)
        for r in range(6):  # X^T, from U^T
            for c in range(6):
                total = 1.0 if r == c else 0.0
                for i in range(r):
                    total -= diagonal[k, i, r] * work[0, i, c]
                work[0, r, c] = total / diagonal[k, r, r]
        for p in range(begin, end):
            subtract_product_transposed(work, 0, above, p, inverse_above, p)
        _solve_upper(diagonal, k, work, 0)
        for r in range(6):
            for c in range(6):
                inverse_diagonal[k, r, c] = 0.5 * (work[0, r, c] + work[0, c, r])


@inlined
def _solve_upper(diagonal, k, out, p):  # type: ignore[no-untyped-def]
    for r in range(5, -1, -1):
        for c in range(6):
            total = out[p, r, c]
            for i in range(r + 1, 6):
                total -= diagonal[k, r, i] * out[p, i, c]
            out[p, r, c] = total / diagonal[k, r, r]
