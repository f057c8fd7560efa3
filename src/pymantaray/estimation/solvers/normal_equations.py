"""Normal equations of a graph in blocks of six: elimination order, factorization and inverse."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import bsr_array, coo_array, csc_array
from scipy.sparse.linalg import SuperLU, splu

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.estimation._kernels import cholesky
from pymantaray.estimation._kernels.residuals import Matrix

SIZE = 6  # of a block: rotation in the body's axes, position in the world's axes
ROTATION = slice(0, 3)
POSITION = slice(3, SIZE)
_NO_VECTOR = np.empty((0, SIZE))
_NO_BLOCKS = np.empty((0, SIZE, SIZE))
_LARGEST_SPARE = 1 << 26  # bytes


def symmetric_factor(matrix: csc_array) -> SuperLU:
    """Factor a symmetric matrix; raises `RuntimeError` if it is exactly singular."""
    return splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


class Blocks(NamedTuple):
    """
    Indices of the blocks of pairs of variables, and true if a block has its pair in reverse order.
    """

    block: Indices
    reverse: Mask


class Structure:
    """
    Elimination order and nonzero blocks, from the pairs (n, 2) of variables that share a factor.

    Variable i has row ``row[i]``, those in ``last`` after all others; ``column`` lists the
    off-diagonal columns, from ``start`` of each row. ``batch`` has the first row of each batch, of
    the rows after all batches, and the number of rows. Rows of a batch share blocks only with each
    other and with the rows after all batches, among which are those of the variables in
    ``unbatched``; None makes no batches.
    """

    def __init__(
        self,
        size: int,
        pairs: Indices,
        last: Indices | None = None,
        *,
        unbatched: Indices | None = None,
    ) -> None:
        late = np.zeros(size, dtype=np.bool_)
        if last is not None:
            late[last] = True
        self.row = _order(size, pairs, late.copy())
        if last is not None:
            self.row[np.lexsort((self.row, late))] = np.arange(size)
        self.batch = np.array([0, size])
        if unbatched is not None and size > cholesky.BATCH_ROWS:
            self._make_batches(pairs, unbatched)
        walk, count = self._tree(pairs)
        self.start = np.concatenate([[0], np.cumsum(count)])
        self.column = np.empty(self.start[-1], dtype=np.intp)
        cholesky.join_rows(*walk, np.empty(size, dtype=np.intp), count, self.start, self.column)
        self._between: dict[bytes, tuple[Indices, Indices, Blocks]] = {}
        self._spare: list[tuple[Array, Array]] = []

    def take_blocks(self) -> tuple[Array, Array]:
        """Blocks on and above the diagonal, with any numbers in them."""
        if self._spare:
            return self._spare.pop()
        return np.empty((self.row.size, SIZE, SIZE)), np.empty((self.column.size, SIZE, SIZE))

    def return_blocks(self, diagonal: Array, above: Array) -> None:
        """
        Keep blocks that are not needed any more for the next equations, unless they are large: new
        memory takes time.
        """
        if diagonal.nbytes + above.nbytes <= _LARGEST_SPARE:
            self._spare.append((diagonal, above))

    def _tree(self, pairs: Indices) -> tuple[tuple[Indices, Indices, Indices], Indices]:
        """
        Earlier neighbours of each row (their ends and numbers) and its parent in the elimination
        tree, and its number of blocks.
        """
        size = self.row.size
        low, high = np.sort(self.row[pairs], axis=1).T
        before = coo_array((np.ones(low.size), (high, low)), shape=(size, size)).tocsr()
        parent = np.full(size, -1)
        count = np.zeros(size, dtype=np.intp)
        walk = (before.indptr.astype(np.intp), before.indices.astype(np.intp), parent)
        none = np.empty(0, dtype=np.intp)
        cholesky.join_rows(*walk, np.empty(size, dtype=np.intp), count, none, none)
        return walk, count

    def _make_batches(self, pairs: Indices, unbatched: Indices) -> None:
        """Number the rows by batches; their blocks stay the same."""
        size = self.row.size
        fixed = np.zeros(size, dtype=np.bool_)
        fixed[unbatched] = True
        scratch, root, new_row, end = np.empty((4, size), dtype=np.intp)
        (_, _, parent), _ = self._tree(pairs)
        batches = cholesky.gather_rows(parent, self.row, fixed, scratch, root, new_row, end)
        self.batch = np.concatenate([[0], end[:batches], [size]])
        self.row = new_row[self.row]

    @cached_property
    def _keys(self) -> Indices:
        rows = np.repeat(np.arange(self.row.size), np.diff(self.start))
        return rows * self.row.size + self.column

    def blocks(self, pairs: Indices) -> Blocks:
        """Blocks of connected pairs (n, 2) of variables."""
        first, second = self.row[pairs.reshape(-1, 2)].T
        keys = np.minimum(first, second) * self.row.size + np.maximum(first, second)
        return Blocks(np.searchsorted(self._keys, keys), first > second)

    def between(self, variables: Indices) -> tuple[Indices, Indices, Blocks]:
        """
        Pairs of some mutually connected variables, as two arrays of indices, and their blocks;
        computed once.
        """
        key = variables.tobytes()
        if key not in self._between:
            a, b = np.triu_indices(len(variables), 1)
            self._between[key] = a, b, self.blocks(np.stack([variables[a], variables[b]], axis=1))
        return self._between[key]


def _order(size: int, pairs: Indices, fixed: Mask) -> Indices:
    """
    Row of each variable by minimum degree; it changes ``fixed``, variables that are not in the
    first part of the order.
    """
    row = np.empty(size, dtype=np.intp)
    fill_in = np.empty((size, 2), dtype=np.intp)
    neighbour = np.full((size, 2), -1)
    wait_round = np.zeros(size, dtype=np.intp)
    waiting = np.empty(size, dtype=np.intp)
    count, fill_ins = cholesky.eliminate_chains(
        pairs, fixed, neighbour, wait_round, waiting, row, fill_in
    )
    if count < size:
        number = np.cumsum(fixed) - 1
        rest = np.concatenate([pairs[fixed[pairs].all(axis=1)], fill_in[:fill_ins]])
        row[fixed] = count + _minimum_degree(size - count, number[rest])
    return row


def _minimum_degree(size: int, pairs: Indices) -> Indices:
    """
    Row of each variable by multiple minimum degree; SciPy offers it only within a factorization.
    """
    a, b = pairs.T
    links = coo_array((np.full(a.size, -1.0), (a, b)), shape=(size, size)).tocsc()
    links = (links + links.T).tocsc()
    links.data[:] = -1.0
    links.setdiag(1.0 - links.sum(axis=0))  # weakly dominant, so that rows are not exchanged
    return np.asarray(symmetric_factor(links.tocsc()).perm_c, dtype=np.intp)


class Factor:
    """Cholesky factor of normal equations."""

    def __init__(self, structure: Structure, diagonal: Array, above: Array) -> None:
        self._structure = structure
        self._diagonal = diagonal
        self._above = above

    def solve(self, vector: Array, *, overwrite: bool = False) -> Array:
        """
        Solution for a right-hand side, both in the order of rows, (n, 6); it can take the place of
        the right-hand side.

        Several right-hand sides, (n, 6, count), have the same digits as each alone, and take less
        time.
        """
        x = vector if overwrite else vector.copy()
        structure = self._structure
        factor = structure.start, structure.column, self._diagonal, self._above
        if x.ndim == 2:
            cholesky.substitute(*factor, x, True)
        else:
            cholesky.substitute_all(*factor, x)
        return x

    def release(self) -> None:
        """Let later equations use the arrays; the factor cannot be used any more."""
        self._structure.return_blocks(self._diagonal, self._above)
        self._diagonal = self._above = _NO_BLOCKS

    def inverse(self, groups: list[Indices]) -> list[Array]:
        """Dense blocks of the inverse, one for each group of mutually connected variables."""
        structure = self._structure
        rows = np.zeros(structure.row.size, dtype=np.bool_)
        for group in groups:
            rows[structure.row[group]] = True
        diagonal, above = self._inverse_blocks(rows)
        return [self._joint(group, diagonal, above) for group in groups]

    def inverse_of_pairs(self, pairs: Indices) -> tuple[Array, Array]:
        """
        Blocks of the inverse of all variables, (n_variables, 6, 6), and between connected pairs (n,
        2) of them, (n, 6, 6).
        """
        structure = self._structure
        diagonal, above = self._inverse_blocks(np.ones(structure.row.size, dtype=np.bool_))
        block, reverse = structure.blocks(pairs)
        between = above[block]
        between[reverse] = np.swapaxes(between[reverse], 1, 2)
        return diagonal[structure.row], between

    def _inverse_blocks(self, rows: Mask) -> tuple[Array, Array]:
        """Blocks of the inverse in some rows, on and above the diagonal."""
        structure = self._structure
        diagonal = np.empty_like(self._diagonal)
        above = np.empty_like(self._above)
        work = np.empty((1, SIZE, SIZE))
        cholesky.invert(
            structure.start,
            structure.column,
            self._diagonal,
            self._above,
            rows,
            diagonal,
            above,
            work,
        )
        return diagonal, above

    def _joint(self, group: Indices, diagonal: Array, above: Array) -> Array:
        structure = self._structure
        n = len(group)
        out = np.empty((n, n, SIZE, SIZE))
        i = np.arange(n)
        out[i, i] = diagonal[structure.row[group]]
        a, b, (block, reverse) = structure.between(group)
        between = above[block]
        between[reverse] = np.swapaxes(between[reverse], 1, 2)
        out[a, b] = between
        out[b, a] = np.swapaxes(between, 1, 2)
        return np.moveaxis(out, 2, 1).reshape(n * SIZE, n * SIZE)


class NormalEquations:
    """
    Matrix, gradient and cost of residuals linearized at one state; ``step`` overwrites the matrix,
    which has to be set first.

    The matrix of order 1 is that of Gauss-Newton. Order 2 adds the largest part of the curvature of
    odometry, order 3 that of distances, and order 4 all curvature of odometry, for steps along
    arcs. ``scale`` is the diagonal before order 4 is added. If ``begun``, the batches of the
    structure are eliminated already, and only `step` can be called.
    """

    def __init__(self, structure: Structure, order: int = 1) -> None:
        self.structure = structure
        self.order = order
        n = structure.row.size
        self.diagonal, self.above = structure.take_blocks()
        self.gradient = np.empty((n, SIZE))
        self.cost = 0.0
        self._element = np.empty((n, SIZE))
        self._right = _NO_VECTOR
        self.scale: Array | None = None
        self.begun = False
        self.failed = False

    def clear(self, order: int) -> "NormalEquations":
        """
        These equations without a cost and with an order; the matrix has to be set anew, and a
        factor in its arrays is lost.
        """
        self.order = order
        self.cost = 0.0
        self.scale = None
        self.begun = False
        self.failed = False
        return self

    @property
    def matrix(self) -> Matrix:
        """Arrays that residual kernels add to."""
        return Matrix(self.structure.row, self.diagonal, self.above, self.gradient)

    def upper(self, right: Array = _NO_VECTOR) -> cholesky.Upper:
        """Arrays to factorize, with a right-hand side or none."""
        structure = self.structure
        return cholesky.Upper(
            structure.start, structure.column, self.diagonal, self.above, self._element, right
        )

    def begin(self) -> cholesky.Upper:
        """Arrays to eliminate batches in, for a step."""
        self.begun = True
        if self._right.size == 0:
            self._right = np.empty_like(self.gradient)
        return self.upper(self._right)

    def step(self) -> tuple[Factor, Array] | None:
        """
        Cholesky factor in place of the matrix, and the step to the minimum of the linearized cost
        (n, 6), in the order of rows; None if some direction is not determined.

        The next step of equations in the same arrays may overwrite it.
        """
        if not self.begun:
            step = -self.gradient
            first = 0
            self._element[:] = np.diagonal(self.diagonal, axis1=1, axis2=2)
        else:
            step = self._right
            first = int(self.structure.batch[-2])
            step[first:] -= self.gradient[first:]
            self._element[first:] += np.diagonal(self.diagonal[first:], axis1=1, axis2=2)
        structure = self.structure
        if self.failed or cholesky.factorize(self.upper(step), first, structure.row.size) >= 0:
            return None
        # the right-hand side has gone down with the factorization
        arrays = structure.start, structure.column, self.diagonal, self.above
        cholesky.substitute(*arrays, step, False)
        return Factor(structure, self.diagonal, self.above), step

    def eliminate(self, last: Indices) -> tuple[Array, Array] | None:
        """
        Dense matrix and gradient that remain for the last variables of the structure, in the order
        given; overwrites the matrix.

        None if some direction of the others is not determined.
        """
        structure = self.structure
        n = len(last)
        first = structure.row.size - n
        end = structure.start[structure.row.size - n]
        self._element[:] = np.diagonal(self.diagonal, axis1=1, axis2=2)
        if cholesky.factorize(self.upper(), 0, first) >= 0:
            return None
        remaining = np.zeros((n, n, SIZE, SIZE))
        own = np.arange(n)
        row = np.repeat(np.arange(n), np.diff(structure.start[first:]))
        remaining[own, own] = self.diagonal[first:]
        remaining[row, structure.column[end:] - first] = self.above[end:]
        remaining[structure.column[end:] - first, row] = np.swapaxes(self.above[end:], 1, 2)
        self.diagonal[first:] = np.eye(SIZE)
        self.above[end:] = 0.0
        rest = Factor(structure, self.diagonal, self.above).solve(self.gradient)[first:]
        at = structure.row[last] - first
        matrix = np.moveaxis(remaining[at[:, None], at], 2, 1).reshape(n * SIZE, n * SIZE)
        return matrix, rest[at].ravel()

    def with_damping(self, factor: float) -> "NormalEquations":
        """
        Copy with a multiple of the diagonal added (of the diagonal without curvature, if stored).
        """
        copy = NormalEquations(self.structure)
        copy.diagonal[:] = self.diagonal
        copy.above[:] = self.above
        copy.gradient = self.gradient
        copy.cost = self.cost
        i = np.arange(SIZE)
        copy.diagonal[:, i, i] += factor * (
            self.diagonal[:, i, i] if self.scale is None else self.scale
        )
        return copy

    def add(self, variables: Indices, matrix: Array, gradient: Array) -> None:
        """Add a dense term of mutually connected variables."""
        structure = self.structure
        n = len(variables)
        blocks = np.swapaxes(matrix.reshape(n, SIZE, n, SIZE), 1, 2)
        rows = structure.row[variables]
        i = np.arange(n)
        self.gradient[rows] += gradient.reshape(n, SIZE)
        self.diagonal[rows] += blocks[i, i]
        a, b, (block, reverse) = structure.between(variables)
        between = blocks[a, b]
        between[reverse] = np.swapaxes(between[reverse], 1, 2)
        self.above[block] += between

    def information(self) -> csc_array:
        """The matrix in the order of the variables."""
        structure = self.structure
        n = structure.row.size
        size = (SIZE * n, SIZE * n)
        own = np.arange(n + 1)
        upper = bsr_array((self.above, structure.column, structure.start), shape=size)
        diagonal = bsr_array((self.diagonal, own[:n], own), shape=size)
        at = (SIZE * structure.row[:, None] + np.arange(SIZE)).ravel()
        return csc_array((upper + upper.T + diagonal).tocsc()[at][:, at])
