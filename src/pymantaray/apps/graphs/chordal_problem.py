r"""
Chordal problem of a graph, whose cost is quadratic in rotations, positions and unit vectors.

It is the problem of SE-Sync [1]_ and CORA [2]_. Its cost is half the sum of

- :math:`\kappa\,|R_j - R_i R_{ij}|_F^2` with :math:`\kappa = 1 / (2 \sigma_R^2)` for relative
  rotations and attitudes,
- :math:`\tau\,|t_j - t_i - R_i t_{ij}|^2` with :math:`\tau = 1 / \sigma_t^2` for relative
  positions, sightings, fixes and priors,
- :math:`|t_j - t_i - d\,u|^2 / \sigma_d^2` for ranges d, with an unknown unit vector u each,

where each :math:`\sigma^2` is the mean variance of the axes. Priors are edges from a node of the
world. Row blocks
:math:`R_i^\top`, :math:`t_i^\top` and :math:`u^\top` form a matrix X, and the cost is
:math:`\frac12 \mathrm{tr}(X^\top Q X)`. The constraints are :math:`R_i^\top R_i = I` and :math:`|u|
= 1`. At a critical point the multipliers are the symmetric block diagonal
:math:`\Lambda` of :math:`Q X X^\top`, and :math:`S = Q - \Lambda` has :math:`S X = 0`. For every
feasible Y

.. math:: f(Y) = f(X) + \tfrac12 \mathrm{tr}(Y^\top S Y).

X has d columns in d dimensions. With more columns, the problem is a relaxation: every point of the
problem, padded with zeros, is one of the relaxation with the same cost.

References
----------
.. [1] Rosen, Carlone, Bandeira and Leonard, SE-Sync, https://github.com/david-m-rosen/SE-Sync
.. [2] Papalia, Fishberg, O'Neill, How, Rosen and Leonard, "Certifiably Correct
   Range-Aided SLAM", https://arxiv.org/abs/2302.11614
"""

from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues, Residual
from pymantaray.estimation.ranges.range_models import chord
from pymantaray.estimation.solvers.normal_equations import symmetric_factor
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix


def not_quadratic(graph: FactorGraph) -> list[str]:
    """
    Plurals of the kinds of factors in a graph that this problem cannot hold: those of a part of a
    position or rotation.
    """
    return [t.kind.plural for t in graph.tables.values() if t.kind.is_partial and len(t)]


class _Differences(NamedTuple):
    """
    Relative measurements between nodes, -1 for the world: rotation, position and their weights.
    """

    first: Indices
    second: Indices
    rotation: Array | None
    position: Array | None
    kappa: Array
    tau: Array


class ChordalProblem:
    """
    Matrix form of a graph: rows of the world's rotation, of rotation and position of each pose, of
    landmarks and of unit vectors.

    ``root`` is a sparse matrix with cost ``|root X|^2 / 2``. Methods accept an X with d or more
    columns.
    """

    def __init__(self, graph: FactorGraph) -> None:
        if lost := not_quadratic(graph):
            raise EstimationError(
                f"a chordal problem cannot hold {', '.join(lost)}; leave them out"
            )
        self.graph = graph
        self.d = 2 if graph.planar else 3
        d = self.d
        n = graph.n_poses
        node = np.arange(graph.n_variables)
        self.rotation_row = d + (d + 1) * np.arange(n)
        self.position_row = np.where(node < n, d + (d + 1) * node + d, d + (d + 1) * n + node - n)
        self.unit_row = d + (d + 1) * n + (graph.n_variables - n) + np.arange(len(graph["range"]))
        self.size = int(d + (d + 1) * n + (graph.n_variables - n) + len(graph["range"]))
        self.constrained = np.ones(self.size, dtype=bool)
        self.constrained[self.position_row] = False
        self.root = self._root()
        self.quadratic = csc_array(self.root.T @ self.root)

    def matrix(self, values: GraphValues) -> Array:
        """Rows X of values, with unit vectors along the ranges."""
        d = self.d
        x = np.zeros((self.size, self.d))
        x[:d] = np.eye(d)
        rotation = matrix_from_quaternion(values.quaternion)[:, :d, :d]
        x[self.rotation_row[:, None] + np.arange(d)] = np.swapaxes(rotation, 1, 2)
        place = np.concatenate([values.position, values.landmark_position])[:, :d]
        x[self.position_row] = place
        first, second = self.graph["range"].variables.T
        unit = chord(place[first], place[second])[1]
        unit[~unit.any(axis=1), 0] = 1.0
        x[self.unit_row] = unit
        return x

    def values(self, x: Array, like: GraphValues) -> GraphValues:
        """Values of rows X with d columns; planar values have depth 0."""
        n = self.graph.n_poses
        d = self.d
        rotation = np.tile(np.eye(3), (n, 1, 1))
        rotation[:, :d, :d] = np.swapaxes(x[self.rotation_row[:, None] + np.arange(d)], 1, 2)
        place = np.zeros((self.graph.n_variables, 3))
        place[:, :d] = self.positions(x)
        return replace(
            like,
            position=place[:n],
            quaternion=quaternion_from_matrix(rotation),
            landmark_position=place[n:],
        )

    def feasible(self, x: Array) -> Array:
        """
        X with each rotation block at the nearest orthonormal rows, unit vectors of length 1 and the
        best positions for these.
        """
        out = x.copy()
        d = self.d
        start = np.concatenate([[0], self.rotation_row])[:, None] + np.arange(d)
        left, _, right = np.linalg.svd(out[start], full_matrices=False)
        out[start] = left @ right
        length = np.linalg.norm(out[self.unit_row], axis=1)[:, None]
        out[self.unit_row] /= np.where(length > 0.0, length, 1.0)
        rest = self.quadratic[self.position_row][:, self.constrained] @ out[self.constrained]
        out[self.position_row] = -self._positions_factor.solve(rest)
        return out

    @cached_property
    def _positions_factor(self) -> Any:
        """Sparse factor of the rows and columns of the positions."""
        return symmetric_factor(csc_array(self.quadratic[self.position_row][:, self.position_row]))

    def positions(self, x: Array) -> Array:
        """Positions of all variables."""
        return np.asarray(x[self.position_row])

    def cost(self, x: Array) -> float:
        """Half the sum of squared residuals."""
        return 0.5 * float(np.sum((self.root @ x) ** 2))

    def certificate_matrix(self, x: Array) -> csc_array:
        """S = Q - Lambda at a critical point."""
        d = self.d
        product = self.quadratic @ x
        start = np.concatenate([[0], self.rotation_row])[:, None] + np.arange(d)
        block = product[start] @ np.swapaxes(x[start], 1, 2)
        block = 0.5 * (block + np.swapaxes(block, 1, 2))
        row = np.broadcast_to(start[:, :, None], block.shape).ravel()
        column = np.broadcast_to(start[:, None, :], block.shape).ravel()
        unit = np.sum(product[self.unit_row] * x[self.unit_row], axis=1)
        entries = np.concatenate([block.ravel(), unit])
        rows = np.concatenate([row, self.unit_row])
        columns = np.concatenate([column, self.unit_row])
        multipliers = csc_array((entries, (rows, columns)), shape=(self.size, self.size))
        return csc_array(self.quadratic - multipliers)

    def _root(self) -> csr_array:
        parts = [self._rows_of(difference) for difference in self._differences()] + [
            self._range_rows()
        ]
        entry = []
        row = []
        column = []
        count = 0
        for values, rows, columns, height in parts:
            entry.append(values)
            row.append(rows + count)
            column.append(columns)
            count += height
        index = np.concatenate(row), np.concatenate(column)
        return csr_array((np.concatenate(entry), index), shape=(count, self.size))

    def _differences(self) -> list[_Differences]:
        """All factors but ranges as relative measurements, priors from the world."""
        out = []
        turns = [2] if self.d == 2 else [0, 1, 2]
        for table in self.graph.of_residual(Residual.POSE, Residual.SIGHTING, Residual.POSITION):
            if table.kind.is_partial:
                continue
            ends = table.variables.astype(np.intp)
            first = ends[:, 0] if ends.shape[1] == 2 else np.full(len(table), -1)
            columns = table.kind.columns_at
            variance = np.diagonal(table.covariance, axis1=1, axis2=2)
            turn = "quaternion" in columns
            rotation = (
                matrix_from_quaternion(table.column("quaternion"))[:, : self.d, : self.d]
                if turn
                else None
            )
            position = table.column("position")[:, : self.d] if "position" in columns else None
            kappa = 0.5 / variance[:, turns].mean(axis=1) if turn else np.empty(0)
            along = variance[:, -3:][:, : self.d]  # rows of a rotation come first
            tau = 1.0 / along.mean(axis=1) if position is not None else np.empty(0)
            out.append(_Differences(first, ends[:, -1], rotation, position, kappa, tau))
        return out

    def _rows_of(self, m: _Differences) -> tuple[Array, Indices, Indices, int]:
        """Entries, rows, columns and number of rows of some relative measurements."""
        d = self.d
        n = m.first.size
        k = np.arange(n)
        axis = np.arange(d)
        start = np.where(m.first < 0, 0, d + (d + 1) * m.first)  # of the rotation of the first node
        entry = []
        row = []
        column = []
        height = 0
        if m.rotation is not None:
            weight = np.sqrt(m.kappa)
            rows = d * k[:, None] + axis
            entry += [
                np.repeat(weight, d),
                -(weight[:, None, None] * np.swapaxes(m.rotation, 1, 2)).ravel(),
            ]
            row += [rows.ravel(), np.repeat(rows.ravel(), d)]
            column.append((d + (d + 1) * m.second[:, None] + axis).ravel())
            column.append(np.repeat(start[:, None] + axis, d, axis=0).ravel())
            height = d * n
        if m.position is not None:
            weight = np.sqrt(m.tau)
            rows = height + k
            inner = m.first >= 0
            entry += [weight, -weight[inner], -(weight[:, None] * m.position).ravel()]
            row += [rows, rows[inner], np.repeat(rows, d)]
            column += [self.position_row[m.second], self.position_row[m.first[inner]]]
            column.append((start[:, None] + axis).ravel())
            height += n
        return np.concatenate(entry), np.concatenate(row), np.concatenate(column), height

    def _range_rows(self) -> tuple[Array, Indices, Indices, int]:
        ranges = self.graph["range"]
        first, second = self.position_row[ranges.variables.astype(np.intp).T]
        weight = 1.0 / np.sqrt(ranges.variance)
        k = np.arange(len(ranges))
        entry = np.concatenate([weight, -weight, -weight * ranges.column("distance")])
        return entry, np.tile(k, 3), np.concatenate([second, first, self.unit_row]), k.size
