"""Normal equations of a graph in blocks of six: elimination order, factorization and inverse."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from pymantaray.estimation._kernels import cholesky
from pymantaray.estimation._kernels.residuals import Matrix

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
SIZE = 6
_NO_VECTOR = np.empty((0, SIZE))


class Blocks(NamedTuple):
    """Indices of the blocks of pairs of variables, and whether the block has the pair in reverse order."""

    block: Indices
    turned: NDArray[np.bool_]


class Structure:
    """
    Elimination order and nonzero blocks, from the pairs (n, 2) of variables that share a factor.

    Variable i has row ``row[i]``, those in ``last`` after all others; ``column`` lists the off-diagonal columns, from ``start`` of each row.
    """

    def __init__(self, size: int, pairs: Indices, last: Indices | None = None) -> None:
        a, b = pairs.T
        links = coo_array((np.full(a.size, -1.0), (a, b)), shape=(size, size)).tocsc()
        links = (links + links.T).tocsc()
        links.data[:] = -1.0
        links.setdiag(1.0 - links.sum(axis=0))
        # scipy offers minimum degree only within splu; the matrix is weakly dominant, so that rows are not exchanged
        self.row = np.asarray(
            splu(
                links.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            ).perm_c,
            dtype=np.intp,
        )
        if last is not None:
            late = np.zeros(size, dtype=np.bool_)
            late[last] = True
            self.row[np.lexsort((self.row, late))] = np.arange(size)
        low, high = np.sort(self.row[pairs], axis=1).T
        before = coo_array((np.ones(low.size), (high, low)), shape=(size, size)).tocsr()
        parent, count = np.full(size, -1), np.zeros(size, dtype=np.intp)
        walk = (before.indptr.astype(np.intp), before.indices.astype(np.intp), parent)
        none = np.empty(0, dtype=np.intp)
        cholesky.join_rows(*walk, np.empty(size, dtype=np.intp), count, none, none)
        self.start = np.concatenate([[0], np.cumsum(count)])
        self.column = np.empty(self.start[-1], dtype=np.intp)
        cholesky.join_rows(*walk, np.empty(size, dtype=np.intp), count, self.start, self.column)
        self._between: dict[bytes, tuple[Indices, Indices, Blocks]] = {}

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
        """Pairs of some mutually connected variables, as two arrays of indices, and their blocks; computed once."""
        key = variables.tobytes()
        if key not in self._between:
            a, b = np.triu_indices(len(variables), 1)
            self._between[key] = a, b, self.blocks(np.stack([variables[a], variables[b]], axis=1))
        return self._between[key]


class Factor:
    """Cholesky factor of normal equations."""

    def __init__(self, structure: Structure, diagonal: Array, above: Array) -> None:
        self._structure, self._diagonal, self._above = structure, diagonal, above

    def solve(self, vector: Array, *, overwrite: bool = False) -> Array:
        """
        Solution for a right-hand side, both in the order of rows, (n, 6); it can take the place of the right-hand side.

        Several right-hand sides, (n, 6, count), have the same digits as each alone, and take less time.
        """
        x, s = vector if overwrite else vector.copy(), self._structure
        factor = s.start, s.column, self._diagonal, self._above
        if x.ndim == 2:
            cholesky.substitute(*factor, x, True)
        else:
            cholesky.substitute_all(*factor, x)
        return x

    def finish(self, vector: Array) -> Array:
        """Solution for the right-hand side that `NormalEquations.factorize` has changed, in its place."""
        s = self._structure
        cholesky.substitute(s.start, s.column, self._diagonal, self._above, vector, False)
        return vector

    def inverse(self, groups: list[Indices]) -> list[Array]:
        """Dense blocks of the inverse, one for each group of mutually connected variables."""
        s = self._structure
        rows = np.zeros(s.row.size, dtype=np.bool_)
        for group in groups:
            rows[s.row[group]] = True
        diagonal, above = np.zeros_like(self._diagonal), np.zeros_like(self._above)
        work = np.empty((1, SIZE, SIZE))
        cholesky.invert(s.start, s.column, self._diagonal, self._above, rows, diagonal, above, work)
        return [self._joint(group, diagonal, above) for group in groups]

    def _joint(self, group: Indices, diagonal: Array, above: Array) -> Array:
        s, n = self._structure, len(group)
        out = np.empty((n, n, SIZE, SIZE))
        i = np.arange(n)
        out[i, i] = diagonal[s.row[group]]
        a, b, (block, turned) = s.between(group)
        between = above[block]
        between[turned] = np.swapaxes(between[turned], 1, 2)
        out[a, b], out[b, a] = between, np.swapaxes(between, 1, 2)
        return np.moveaxis(out, 2, 1).reshape(n * SIZE, n * SIZE)


class NormalEquations:
    """
    Matrix, gradient and cost of residuals linearized at one state; ``factorize`` overwrites the matrix.

    The matrix of order 1 is that of Gauss-Newton. Order 2 adds the largest part of the curvature of odometry, order 3 that of
    distances, and order 4 all curvature of odometry, for steps along arcs. ``scale`` is the diagonal before order 4 is added.
    """

    def __init__(self, structure: Structure, order: int = 1) -> None:
        self.structure, self.order = structure, order
        n = structure.row.size
        self.diagonal, self.above = np.zeros((n, SIZE, SIZE)), np.zeros((structure.column.size, SIZE, SIZE))
        self.gradient, self.cost, self._element = np.zeros((n, SIZE)), 0.0, np.empty((n, SIZE))
        self.scale: Array | None = None

    def cleared(self, order: int) -> "NormalEquations":
        """These equations, empty and of an order; a factor in their arrays is lost."""
        for array in (self.diagonal, self.above, self.gradient):
            array.fill(0.0)
        self.order, self.cost, self.scale = order, 0.0, None
        return self

    @property
    def matrix(self) -> Matrix:
        """Arrays that residual kernels add to."""
        return Matrix(self.structure.row, self.diagonal, self.above, self.gradient)

    def factorize(self, right: Array = _NO_VECTOR) -> Factor | None:
        """
        Compute the Cholesky factor in place of the matrix; None if some direction is not determined.

        It changes a right-hand side (n, 6), for `Factor.finish`.
        """
        s = self.structure
        self._element[:] = np.diagonal(self.diagonal, axis1=1, axis2=2)
        if cholesky.factorize(s.start, s.column, self.diagonal, self.above, self._element, right) >= 0:
            return None
        return Factor(s, self.diagonal, self.above)

    def step(self) -> tuple[Factor, Array] | None:
        """Factor as in `factorize`, and the step to the minimum of the linearized cost (n, 6), in the order of rows."""
        step = -self.gradient
        factor = self.factorize(step)
        return None if factor is None else (factor, factor.finish(step))

    def eliminate(self, last: Indices) -> tuple[Array, Array] | None:
        """
        Dense matrix and gradient that remain for the last variables of the structure, in the order given; overwrites the matrix.

        None if some direction of the others is not determined.
        """
        s, n = self.structure, len(last)
        first, end = s.row.size - n, s.start[s.row.size - n]
        self._element[:] = np.diagonal(self.diagonal, axis1=1, axis2=2)
        element = self._element[:first]
        if cholesky.factorize(s.start, s.column, self.diagonal, self.above, element, _NO_VECTOR) >= 0:
            return None
        left = np.zeros((n, n, SIZE, SIZE))
        own, row = np.arange(n), np.repeat(np.arange(n), np.diff(s.start[first:]))
        left[own, own] = self.diagonal[first:]
        left[row, s.column[end:] - first] = self.above[end:]
        left[s.column[end:] - first, row] = np.swapaxes(self.above[end:], 1, 2)
        self.diagonal[first:], self.above[end:] = np.eye(SIZE), 0.0
        rest = Factor(s, self.diagonal, self.above).solve(self.gradient)[first:]
        at = s.row[last] - first
        matrix = np.moveaxis(left[at[:, None], at], 2, 1).reshape(n * SIZE, n * SIZE)
        return matrix, rest[at].ravel()

    def damped(self, factor: float) -> "NormalEquations":
        """Copy with a multiple of the diagonal added (of the diagonal without curvature, if stored)."""
        copy = NormalEquations(self.structure)
        copy.diagonal, copy.above = self.diagonal.copy(), self.above.copy()
        copy.gradient, copy.cost = self.gradient, self.cost
        i = np.arange(SIZE)
        copy.diagonal[:, i, i] += factor * (self.diagonal[:, i, i] if self.scale is None else self.scale)
        return copy

    def add(self, variables: Indices, matrix: Array, gradient: Array) -> None:
        """Add a dense term of mutually connected variables."""
        s, n = self.structure, len(variables)
        blocks = np.swapaxes(matrix.reshape(n, SIZE, n, SIZE), 1, 2)
        rows, i = s.row[variables], np.arange(n)
        self.gradient[rows] += gradient.reshape(n, SIZE)
        self.diagonal[rows] += blocks[i, i]
        a, b, (block, turned) = s.between(variables)
        between = blocks[a, b]
        between[turned] = np.swapaxes(between[turned], 1, 2)
        self.above[block] += between

    def information(self) -> csc_array:
        """The matrix in the order of the variables."""
        s, n = self.structure, self.structure.row.size
        variable = np.argsort(s.row)
        row = np.repeat(variable, np.diff(s.start))
        upper = _matrix(row, variable[s.column], self.above, n)
        return csc_array(upper + upper.T + _matrix(variable, variable, self.diagonal, n))


def _matrix(row: Indices, column: Indices, blocks: Array, size: int) -> csc_array:
    """Sparse matrix of blocks at block rows and columns."""
    i, j = np.indices((SIZE, SIZE))
    at = SIZE * row[:, None, None] + i, SIZE * column[:, None, None] + j
    entries = blocks.ravel(), (at[0].ravel(), at[1].ravel())
    return csc_array(coo_array(entries, shape=(size * SIZE, size * SIZE)))
