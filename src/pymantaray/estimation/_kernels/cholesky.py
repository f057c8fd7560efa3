"""
Sparse Cholesky factors in blocks of six by six, row by row of the upper triangle.

Row k has a diagonal block and, from ``start[k]`` to ``start[k + 1]``, blocks of the rising columns
``column``. A row's columns are all connected by its elimination, so that each pair of them has its
block.
"""

import math
from collections import namedtuple

from pymantaray.compile import entry, inlined, shared
from pymantaray.estimation._kernels.products import (
    prefetch,
    solve_transposed,
    subtract_from_vector,
    subtract_product,
    subtract_product_transposed,
    subtract_transposed_from_vector,
    subtract_transposed_product,
)

# Part of its diagonal element that is left to a pivot when rounding has taken its digits.
NO_DIGITS = 1e-12
# Least information: some direction may stray by 1,000 km, or as many radians, given all that are
# eliminated after it.
MIN_PIVOT = 1e-12
# rows whose blocks are fetched before they are needed: up the factor, the machine does not foresee
# it
AHEAD = 8
BATCH_ROWS = 256  # their blocks take about 250 kB and stay in a core's cache


@entry
def join_rows(first, neighbour, parent, mark, count, start, column):  # type: ignore[no-untyped-def]
    """
    Count the blocks of each row, or write their columns if there is room for them.

    ``neighbour[first[i]:first[i + 1]]`` are the rows before i that it shares a factor with. Each
    climbs the tree of ``parent`` up to i: all on its way have a block of column i.
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
def eliminate_chains(pairs, fixed, neighbour, wait_round, waiting, row, fill_in):  # type: ignore[no-untyped-def]
    """
    Order the variables with at most two neighbours first, as minimum degree does; return how many
    there are, and the number of pairs of others that they connect.

    ``pairs`` (m, 2) of variables share a factor. Loose ends of chains are first, one variable of
    each per round. Then each round eliminates variables that are not neighbours, and connects the
    two neighbours of each. Variables are not ordered if they are ``fixed`` or have more neighbours;
    ``fixed`` is then true. ``fill_in`` becomes the pairs of these that elimination connects.
    ``neighbour`` (n, 2), with -1, ``wait_round``, with zeros, and ``waiting`` are scratch.
    """
    _put_neighbours(pairs, fixed, neighbour)
    count, done, fill_ins = 0, 0, 0
    now = 0  # number of the round
    for i in range(fixed.size):
        if not fixed[i] and min(neighbour[i, 0], neighbour[i, 1]) < 0:
            waiting[count] = i
            count += 1
    # Loose ends have one neighbour: their elimination connects nothing, so they are first. The
    # neighbour may become a loose end of the next round.
    while count > 0:
        now += 1
        later = 0
        for k in range(count):
            i = waiting[k]
            row[i] = done
            wait_round[i] = -1
            done += 1
            a = max(neighbour[i, 0], neighbour[i, 1])
            if a >= 0 and not fixed[a]:
                if min(neighbour[a, 0], neighbour[a, 1]) >= 0:
                    waiting[later] = a
                    later += 1
                _connect(neighbour, a, i, -1)
        count = later
    # What is left are chains between branches, and rings. Of two neighbours one waits for the next
    # round, so that a round eliminates every second variable: the tree has logarithmic height.
    count = 0
    for i in range(fixed.size):
        if not fixed[i] and wait_round[i] == 0:
            waiting[count] = i
            count += 1
    while count > 0:
        now += 1
        later = 0
        for k in range(count):
            i = waiting[k]
            if wait_round[i] == now:  # a neighbour has been eliminated in this round
                waiting[later] = i
                later += 1
                continue
            row[i] = done
            done += 1
            a, b = neighbour[i, 0], neighbour[i, 1]
            if a >= 0 and not fixed[a]:
                _connect(neighbour, a, i, b)
                wait_round[a] = now
            if b >= 0 and not fixed[b]:
                _connect(neighbour, b, i, a)
                wait_round[b] = now
            if a >= 0 and b >= 0 and fixed[a] and fixed[b]:  # fill-in between two branches
                fill_in[fill_ins, 0] = a
                fill_in[fill_ins, 1] = b
                fill_ins += 1
        count = later
    return done, fill_ins


@inlined
def _put_neighbours(pairs, fixed, neighbour):  # type: ignore[no-untyped-def]
    """
    Put the neighbours of each variable into ``neighbour``; one with a third branches, and is fixed,
    so that minimum degree orders it.
    """
    for p in range(pairs.shape[0]):
        for end in range(2):
            a, b = pairs[p, end], pairs[p, 1 - end]
            if a == b or neighbour[a, 0] == b or neighbour[a, 1] == b:
                continue
            if neighbour[a, 0] < 0:
                neighbour[a, 0] = b
            elif neighbour[a, 1] < 0:
                neighbour[a, 1] = b
            else:
                fixed[a] = True


@inlined
def _connect(neighbour, a, old, new):  # type: ignore[no-untyped-def]
    """Replace a neighbour of a variable by another one, -1 for none."""
    own = 0 if neighbour[a, 0] == old else 1
    neighbour[a, own] = -1 if neighbour[a, 1 - own] == new else new


Upper = namedtuple("Upper", "start column diagonal above element right")
Upper.__doc__ = """A matrix and its right-hand side on their way to a factor.

``element`` has the diagonal elements (n, 6) before elimination. ``right``, (n, 6) or empty, goes
down the transposed factor on the way, so that blocks are read once."""


@entry
def gather_rows(parent, row, fixed, size, root, new_row, end):  # type: ignore[no-untyped-def]
    """
    Number rows anew, so that blocks of neighbouring variables are near each other; return the
    number of batches.

    A batch holds subtrees, of at most BATCH_ROWS rows in all, in the order of their first
    variables. Its rows keep their order, in which successive rows rarely depend on each other. Rows
    above the subtrees come last, as do variables for which ``fixed`` is true. ``new_row`` becomes
    the new number of each row, and ``end[b]`` the end of each batch; ``size`` and ``root`` are
    scratch.
    """
    n, batches, room, total = row.size, 0, 0, 0
    for k in range(n):
        size[k] = 1
    for i in range(n):
        if fixed[i]:
            size[row[i]] += BATCH_ROWS
    for k in range(n):
        if parent[k] >= 0:
            size[parent[k]] += size[k]
    for k in range(n - 1, -1, -1):  # root of each row's subtree; -1 above all subtrees
        if size[k] > BATCH_ROWS:
            root[k] = -1
        elif parent[k] >= 0 and root[parent[k]] >= 0:
            root[k] = root[parent[k]]
        else:
            root[k] = k
    for i in range(n):  # a root's size becomes -1 - b in batch b
        top = root[row[i]]
        if top >= 0 and size[top] > 0:
            if size[top] > room:
                end[batches], room = 0, BATCH_ROWS
                batches += 1
            room -= size[top]
            end[batches - 1] += size[top]
            size[top] = -batches
    for b in range(batches):
        rows = end[b]
        end[b] = total
        total += rows
    for k in range(n):
        if root[k] < 0:
            new_row[k] = total
            total += 1
        else:
            b = -1 - size[root[k]]
            new_row[k] = end[b]
            end[b] += 1
    return batches


@entry
def factorize(upper, begin, end):  # type: ignore[no-untyped-def]
    """
    Eliminate rows from begin to end: they become those of the upper factor, and below them the
    Schur complement remains.

    Return a row without digits left, or -1.
    """
    return eliminate_rows(upper, begin, end, upper.diagonal.shape[0])


@shared
def eliminate_rows(upper, begin, end, watched):  # type: ignore[no-untyped-def]
    """
    Eliminate rows as `factorize` does; ``element`` of the watched rows, the last ones, counts what
    elimination takes from their diagonals.
    """
    start, column, diagonal, above, element, x = (
        upper.start,
        upper.column,
        upper.diagonal,
        upper.above,
        upper.element,
        upper.right,
    )
    for k in range(begin, end):
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
            solve_transposed(above, p, diagonal, k)
        if x.size:
            _go_down(start, column, diagonal, above, x, k)
        for p in range(start[k], start[k + 1]):
            i = column[p]
            subtract_transposed_product(diagonal, i, above, p, above, p)
            if i >= watched:
                for r in range(6):
                    for c in range(6):
                        element[i, c] += above[p, r, c] * above[p, r, c]
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
    """
    Solve for a right-hand side (n, 6) in place: down the transposed factor, unless it has been
    there, and up the factor.
    """
    n = diagonal.shape[0]
    if down:
        for k in range(n):
            _go_down(start, column, diagonal, above, x, k)
    for k in range(n - 1, -1, -1):
        if k >= AHEAD:
            for p in range(start[k - AHEAD], start[k - AHEAD + 1]):
                prefetch(above, p)
            prefetch(diagonal, k - AHEAD)
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

    Sixteen take the time of four: a block of the factor is read once for all, and vectors of the
    machine hold several of them.
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
    """
    Subtract six numbers times the rows of ``x[k]`` from ``x[i, r]``, one after another; i is not k.
    """
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
    Blocks of the inverse in those rows that are marked and in all that their elimination joined
    them to, which are marked then.

    By Takahashi's recursion from the last row: with U_kk X = I, ``Z_kj = -X sum_i U_ki Z_ij`` and
    ``Z_kk = X (X^T - sum_i U_ki Z_ik)``. Blocks of other rows stay as they are.
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
            for r in range(6):
                for c in range(6):
                    inverse_above[p, r, c] = 0.0
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
