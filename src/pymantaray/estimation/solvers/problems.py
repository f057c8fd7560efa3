"""
Costs to minimize: relative poses, sightings, measured positions, and ranges as distances or
expanded travel times.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.estimation._kernels import assembly, cholesky, residuals
from pymantaray.estimation.graph.graph import FactorGraph, Factors, GraphValues, Residual
from pymantaray.estimation.ranges.expansion import EpochBlock, Expansion, whiten
from pymantaray.estimation.ranges.range_models import Rows, TimedRanges, chord
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.estimation.solvers.normal_equations import (
    POSITION,
    ROTATION,
    SIZE,
    Blocks,
    NormalEquations,
    Structure,
)
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix

_OUT_OF_PLANE = np.array([0, 1, 5])  # rx, ry and z of a block
_PIECE = 1 << 16  # rows to convert at once
_MIN_WEIGHT = 1e-12  # smallest weight of a range under a loss; its rows lose all digits below


class GraphState(NamedTuple):
    """Values of all variables; a landmark is a pose without rotation."""

    rotation: Array  # (n_variables, 3, 3)
    position: Array  # (n_variables, 3) [m]
    shared: Array  # unknowns that all ranges share, in their prior standard deviations

    @classmethod
    def of(cls, values: GraphValues, n_shared: int = 0) -> "GraphState":
        """Convert a graph's values; shared unknowns are zero."""
        n = len(values.position)
        rotation = np.empty((n + len(values.landmark_position), 3, 3))
        _by_pieces(matrix_from_quaternion, values.quaternion, rotation[:n])
        rotation[n:] = np.eye(3)
        position = np.concatenate([values.position, values.landmark_position])
        return cls(rotation, np.ascontiguousarray(position), np.zeros(n_shared))

    def values(self, graph: FactorGraph) -> GraphValues:
        """Convert to values of a graph's variables."""
        n = graph.n_poses
        quaternion = _by_pieces(quaternion_from_matrix, self.rotation[:n], np.empty((n, 4)))
        return GraphValues(self.position[:n], quaternion, self.position[n:])

    def after_step(
        self,
        structure: Structure,
        step: Array,
        *,
        arc: bool = False,
        into: "GraphState | None" = None,
    ) -> "GraphState":
        """
        State after a step in the order of rows, (n, 6), along straight lines or arcs; it can
        overwrite another one.
        """
        rotation, position = (
            (np.empty_like(self.rotation), np.empty_like(self.position))
            if into is None
            else into[:2]
        )
        residuals.move(self.rotation, self.position, structure.row, step, arc, rotation, position)
        shared = step[structure.row[len(position) :]].ravel()[: self.shared.size]
        return GraphState(rotation, position, self.shared + shared)


class FactorBlocks(NamedTuple):
    """
    Blocks of pairs of poses, and of poses with the landmarks they sight, and the factors of each
    batch of rows.
    """

    relative: Blocks
    sightings: Blocks
    batches: assembly.Batches


class FactorsExceptRanges:
    """
    All factors of a graph except its ranges: relative poses, sightings of landmarks, and measured
    positions.
    """

    def __init__(self, graph: FactorGraph) -> None:
        self._tables = _except_ranges(graph)
        self.n_poses = graph.n_poses
        self.n_variables = graph.n_variables
        self.planar = graph.planar
        self._groups = [
            graph.of_residual(r) for r in (Residual.POSE, Residual.SIGHTING, Residual.POSITION)
        ]
        poses = self._groups[0]
        self._relative = residuals.RelativePoses(*[*_stack(_relative, poses), _pose_roots(poses)])
        self._sightings = residuals.Sightings(*_stack(_sightings, self._groups[1]))
        self._positions = residuals.Positions(*_stack(_position, self._groups[2]))
        self._inner = self._relative.first >= 0  # relative to another pose, not to the world
        self._relative_pairs = np.stack(self._relative[:2], axis=1)[self._inner]
        self._sighting_pairs = np.stack(self._sightings[:2], axis=1)
        self.pairs = np.concatenate([self._relative_pairs, self._sighting_pairs])

    def unbatched(self, size: int, others: Sequence[Indices]) -> Indices:
        """
        Variables that are in other factors than relative poses and measured positions, among
        ``size``, or in no relative poses.
        """
        alone = np.ones(size, dtype=np.bool_)
        alone[self._relative_pairs] = False
        for variables in (self._sighting_pairs, *others):
            alone[variables] = True
        return np.flatnonzero(alone)

    def is_of(self, graph: FactorGraph) -> bool:
        """True if a graph has the same tables."""
        tables = _except_ranges(graph)
        shape = graph.n_poses, graph.n_variables, graph.planar
        return (self.n_poses, self.n_variables, self.planar) == shape and all(
            a is b or len(a) == len(b) == 0 for a, b in zip(self._tables, tables, strict=True)
        )

    def blocks(self, structure: Structure) -> FactorBlocks:
        """Blocks of pairs of variables; poses relative to the world have none."""
        n = self._inner.size
        inner = self._inner
        out = Blocks(np.zeros(n, dtype=np.intp), np.zeros(n, dtype=np.bool_))
        out.block[inner], out.reverse[inner] = structure.blocks(self._relative_pairs)
        row = structure.row
        relative = self._relative
        second = row[relative.second]
        eliminated = np.where(inner, np.minimum(row[relative.first], second), second)
        batches = _batches(structure.batch, eliminated, row[self._positions.variable])
        return FactorBlocks(out, structure.blocks(self._sighting_pairs), batches)

    def add(
        self, state: GraphState, blocks: FactorBlocks, out: NormalEquations, *, begin: bool
    ) -> None:
        """
        Set cost, gradient and blocks to those of these factors, from order 2 with the curvature of
        odometry.

        If wanted, begin the elimination.
        """
        order = 1 if out.order > 3 else min(out.order, 2)
        upper = out.begin() if begin else out.upper()
        costs, out.failed = self._evaluate(state, blocks, out.matrix, upper, (order, begin))
        out.cost += sum(float(cost.sum()) for cost in costs)

    def add_curvature(self, state: GraphState, blocks: FactorBlocks, out: NormalEquations) -> None:
        """Add the full curvature of relative poses."""
        poses = residuals.PoseArrays(state.rotation.copy(), state.position)
        lacking = np.empty((SIZE, 2 * SIZE))
        residuals.add_full_curvature(
            self._relative, blocks.relative, poses, out.matrix, lacking, _scratch()
        )

    def cost(self, state: GraphState) -> float:
        """Half the sum of squared residuals."""
        return sum(float(cost.sum()) for cost in self._costs(state))

    def worst(self, state: GraphState) -> tuple[list[int], float]:
        """Variables and cost of the factor with the largest cost."""
        costs = zip(self._costs(state), self._groups, strict=True)
        each = [
            (float(cost.max()), int(cost.argmax()), tables) for cost, tables in costs if cost.size
        ]
        if not each:
            return [], -1.0
        cost, row, tables = max(each, key=itemgetter(0))
        variables = [ends for table in tables for ends in table.variables.tolist()]
        return variables[row], cost

    def _costs(self, state: GraphState) -> tuple[Array, Array, Array]:
        """Cost of each relative pose, of each sighting, and of each measured position."""
        none = np.empty(0, dtype=np.intp)
        nothing = np.empty((0, SIZE, SIZE))
        vectors = np.empty((0, SIZE))
        matrix = residuals.Matrix(none, nothing, nothing, vectors)
        upper = cholesky.Upper(none, none, nothing, nothing, vectors, vectors)
        no_blocks = Blocks(none, none > 0)
        blocks = FactorBlocks(no_blocks, no_blocks, self._in_order)
        return self._evaluate(state, blocks, matrix, upper, (0, False))[0]

    @cached_property
    def _in_order(self) -> assembly.Batches:
        """All factors after all batches."""
        rows = (
            np.zeros(len(factors), dtype=np.intp)
            for factors in (self._inner, self._positions.variable)
        )
        return _batches(np.array([0, 0]), *rows)

    def _evaluate(
        self,
        state: GraphState,
        blocks: FactorBlocks,
        matrix: residuals.Matrix,
        upper: cholesky.Upper,
        task: tuple[int, bool],
    ) -> tuple[tuple[Array, Array, Array], bool]:
        """
        Costs as in `_costs`, and true if elimination failed; a task of order 1 or 2 sets the
        matrix, see `assembly.assemble`.
        """
        poses = residuals.PoseArrays(state.rotation, state.position)
        relative, sightings, positions = (
            np.empty(len(rows))
            for rows in (self._inner, self._sighting_pairs, self._positions.variable)
        )
        factors = assembly.ChainFactors(self._relative, blocks.relative, self._positions)
        costs = assembly.Costs(relative, positions)
        failed = assembly.assemble(
            factors, blocks.batches, poses, matrix, upper, task, costs, _scratch()
        )
        if sightings.size:  # compile the kernel only if needed
            residuals.add_sightings(
                self._sightings, blocks.sightings, poses, matrix, task[0], sightings, _scratch()
            )
        return (relative, sightings, positions), failed >= 0


def _batches(row: Indices, *eliminated: Indices) -> assembly.Batches:
    """
    Factors of each batch of rows, from the first row that each relative pose and each measured
    position adds to.
    """
    parts = []
    for first in eliminated:
        batch = np.minimum(np.searchsorted(row[1:], first, side="right"), row.size - 2)
        count = np.bincount(batch, minlength=row.size - 1)
        parts += [np.argsort(batch, kind="stable"), np.concatenate([[0], np.cumsum(count)])]
    return assembly.Batches(row, *parts)


def _except_ranges(graph: FactorGraph) -> list[Factors]:
    return graph.of_residual(*(r for r in Residual if r is not Residual.DISTANCE))


def _scratch() -> tuple[Array, Array, Array]:
    """Workspace for the blocks, matrices and vectors of one residual."""
    r = residuals
    return np.empty((r.BLOCKS, 6, 6)), np.empty((r.MATRICES, 3, 3)), np.empty((r.VECTORS, 6))


def _pieces(count: int) -> Iterator[slice]:
    """
    Slices of rows, at least one: temporary arrays of a long mission would take more time and memory
    than the result.
    """
    for first in range(0, max(count, 1), _PIECE):
        yield slice(first, min(first + _PIECE, count))


def _by_pieces(function: Callable[[Array], Array], rows: Array, out: Array) -> Array:
    """Compute each row of an array from the same row of another."""
    for piece in _pieces(len(rows)):
        out[piece] = function(rows[piece])
    return out


def _stack(columns: Callable[[Factors], tuple[Array, ...]], tables: list[Factors]) -> list[Any]:
    """Concatenate the columns of several tables."""
    out: list[Any] = []
    total = sum(map(len, tables))
    end = 0
    for table in tables:
        for piece in _pieces(len(table)):
            parts = columns(table if len(table) <= _PIECE else table[piece])
            out = out or [np.empty((total, *part.shape[1:]), part.dtype) for part in parts]
            begin = end
            end = end + len(parts[0])
            for whole, part in zip(out, parts, strict=True):
                whole[begin:end] = part
    return out


def _relative(table: Factors) -> tuple[Any, ...]:
    """First pose, -1 for the world, second pose, measured rotation and translation."""
    n = len(table)
    kind = table.kind
    first = table.variables[:, 0] if len(kind.ends) == 2 else np.full(n, -1)
    step = table.column("position") if "position" in kind.columns_at else np.zeros((n, 3))
    rotation = matrix_from_quaternion(table.column("quaternion"))
    return first.astype(np.intp), table.variables[:, -1].astype(np.intp), rotation, step


def _pose_roots(tables: list[Factors]) -> Array:
    """
    Roots of the information of relative poses (n, 6, 6) or, if all are diagonal, their diagonals
    (n, 6).
    """
    n = sum(map(len, tables))
    diagonal = all(_is_diagonal(table.covariance) for table in tables)
    out = np.zeros((n, SIZE) if diagonal else (n, SIZE, SIZE))
    end = 0
    for table in tables:
        start = end
        end = end + len(table)
        at = table.kind.measured
        for piece in _pieces(len(table)):
            rows = slice(start + piece.start, start + piece.stop)
            if diagonal:
                variance = table.variance[piece].reshape(-1, len(at))
                out[rows, at] = 1.0 / np.sqrt(variance)
            else:
                out[rows] = _embedded(_information_root(table.covariance[piece]), at, SIZE)
    return out


def _embedded(matrices: Array, at: list[int], size: int) -> Array:
    """Matrices of some rows in matrices of all rows, with zeros for those not measured."""
    out = np.zeros((len(matrices), size, size))
    out[:, np.array(at)[:, None], at] = matrices
    return out


def _sightings(table: Factors) -> tuple[Any, ...]:
    """Pose, landmark, its measured position, and the root of the information."""
    root = _embedded(_information_root(table.covariance), table.kind.measured, SIZE)
    pose, landmark = table.variables.astype(np.intp).T
    return pose, landmark, table.column("position"), root


def _position(table: Factors) -> tuple[Any, ...]:
    """Variable, measured position and its information; a depth has none in the horizontal."""
    n = len(table)
    if "position" in table.kind.columns_at:
        root = _embedded(_information_root(table.covariance), table.kind.measured, 3)
        return (
            table.subject.astype(np.intp),
            table.column("position"),
            np.swapaxes(root, 1, 2) @ root,
        )
    position = np.zeros((n, 3))
    information = np.zeros((n, 3, 3))
    position[:, 2] = table.column("depth")
    information[:, 2, 2] = 1.0 / table.variance
    return table.subject.astype(np.intp), position, information


def _information_root(covariance: Array) -> Array:
    """Lower triangular W for which W^T W is the inverse of each covariance."""
    n = covariance.shape[1]
    if _is_diagonal(covariance):
        return np.asarray(np.eye(n) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, None])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _is_diagonal(covariance: Array) -> bool:
    """True if there is nothing beside the diagonals, which have no zeros."""
    return bool(np.count_nonzero(covariance) <= len(covariance) * covariance.shape[1])


class Distances:
    """Ranges of a graph as distances."""

    def __init__(self, graph: FactorGraph) -> None:
        ranges = graph["range"]
        self.pairs = ranges.variables.astype(np.intp)
        self._distance = np.array(ranges.column("distance"))
        self._sigma = np.sqrt(ranges.variance)

    def whitened(self, state: GraphState) -> Array:
        """Residuals in their standard deviations."""
        return self._at(state)[0]

    def cost(self, state: GraphState, loss: Loss | None) -> float:
        """Half the sum of squares, or the sum of losses."""
        return _cost(self.whitened(state), loss)

    def add(
        self, state: GraphState, blocks: Blocks, loss: Loss | None, out: NormalEquations
    ) -> None:
        """
        Add cost, gradient and blocks, weighted under a loss, in order 3 with the curvature of
        distances.
        """
        white, slope = self._at(state)
        out.cost += _cost(white, loss)
        off = white * self._sigma
        bend = (
            off / np.maximum(self._distance + off, self._sigma)
            if out.order > 2
            else np.zeros_like(off)
        )
        information = self._sigma**-2
        if loss is not None:
            weight = loss.weight(white)
            white = np.sqrt(weight) * white
            slope = np.sqrt(weight)[:, None] * slope
            information = weight * information
        residuals.add_pairs(self.pairs, blocks, white, slope, bend, information, out.matrix)

    def linear_among(self, state: GraphState, variables: Indices) -> list["LinearTerm"]:
        """Terms of the ranges between some of the variables, one for each range."""
        rows = np.isin(self.pairs, variables).all(axis=1)
        white, slope = (part[rows] for part in self._at(state))
        jacobian = np.zeros((white.size, 1, 2 * SIZE))
        jacobian[:, 0, 3:6] = slope[:, :3]
        jacobian[:, 0, 9:12] = slope[:, 3:]
        return list(map(LinearTerm, self.pairs[rows], white[:, None], jacobian))

    def _at(self, state: GraphState) -> tuple[Array, Array]:
        distance, unit = chord(*state.position[self.pairs.T])
        slope = np.concatenate([-unit, unit], axis=1) / self._sigma[:, None]
        return (distance - self._distance) / self._sigma, slope


class LinearTerm(NamedTuple):
    """Whitened residuals (m,) and their derivatives (m, 6 k) with respect to k variables."""

    variables: Indices
    residual: Array
    jacobian: Array


class EpochTerms(NamedTuple):
    """Ranges of one epoch: rows of the tables, variables, and the root of the covariance."""

    rows: Rows
    variables: Indices  # ends, then shared unknowns
    transmitter: Rows  # index into the variables
    receiver: Rows
    root: Array  # lower triangular root of the covariance


class ExpandedRanges:
    """
    Ranges of a graph as travel times expanded about one state.

    Shared unknowns have a prior of zero mean and unit covariance. A loss needs diagonal covariances
    of the epochs.
    """

    def __init__(
        self,
        ranges: TimedRanges,
        blocks: Sequence[EpochBlock],
        expansion: Expansion,
        shared: Indices,
    ) -> None:
        self._ranges = ranges
        self._expansion = expansion
        self._shared = shared
        self._epochs = [(rows, covariance) for rows, covariance in blocks if rows.size]
        self._rows = np.concatenate(
            [np.empty(0, dtype=np.intp), *(rows for rows, _ in self._epochs)]
        )
        self._separate = not shared.size and all(
            np.count_nonzero(covariance) == len(covariance) for _, covariance in self._epochs
        )
        variances = (np.diagonal(covariance) for _, covariance in self._epochs)
        self._sigma = np.sqrt(np.concatenate([np.empty(0), *variances]))
        ends = np.stack([ranges.transmitter, ranges.receiver], axis=1)[self._rows]
        # joined ranges have the blocks of their epochs
        self.pairs = ends.astype(np.intp) if self._separate else np.empty((0, 2), dtype=np.intp)

    @cached_property
    def _terms(self) -> list[EpochTerms]:
        out = []
        ranges = self._ranges
        for rows, covariance in self._epochs:
            ends = np.concatenate([ranges.transmitter[rows], ranges.receiver[rows]])
            variables, at = np.unique(ends, return_inverse=True)
            variables = np.concatenate([variables, self._shared])
            root = np.asarray(np.linalg.cholesky(covariance), dtype=float)
            out.append(EpochTerms(rows, variables, at[: rows.size], at[rows.size :], root))
        return out

    def whitened(self, state: GraphState) -> Array:
        """Residuals in their standard deviations, epoch by epoch."""
        return np.concatenate([np.empty(0), *self._by_epoch(self._at(state)[0])])

    def cost(self, state: GraphState, loss: Loss | None) -> float:
        """Half the sum of squares, or the sum of losses, and the cost of shared unknowns."""
        return self.cost_of(self._at(state)[0], loss) + 0.5 * float(state.shared @ state.shared)

    def cost_of(self, residual: Array, loss: Loss | None) -> float:
        """Half the sum of squares, or the sum of losses, of residuals by row of the tables [m]."""
        if self._separate:
            return _cost(residual[self._rows] / self._sigma, loss)
        if loss is None:
            white = [whiten(epoch.root, residual[epoch.rows]) for epoch in self._terms]
        else:
            white = self._by_epoch(residual)
        return sum(_cost(w, loss) for w in white)

    def add(
        self, state: GraphState, blocks: Blocks, loss: Loss | None, out: NormalEquations
    ) -> None:
        """Add cost, gradient and blocks, weighted under a loss."""
        if self._separate:
            residual, *slopes = (part[self._rows] for part in self._at(state))
            white = residual / self._sigma
            slope = np.hstack(slopes) / self._sigma[:, None]
            out.cost += _cost(white, loss)
            if loss is not None:
                root = np.sqrt(loss.weight(white))
                white = root * white
                slope = root[:, None] * slope
            none = np.zeros_like(white)  # an expansion contains its curvature
            residuals.add_pairs(self.pairs, blocks, white, slope, none, none, out.matrix)
            return
        terms = self.linear(state, loss)
        if loss is None:
            out.cost += sum(_cost(term.residual, None) for term in terms) + 0.5 * float(
                state.shared @ state.shared
            )
        else:
            out.cost += self.cost(state, loss)
        for term in terms:
            jacobian = term.jacobian
            out.add(term.variables, jacobian.T @ jacobian, jacobian.T @ term.residual)
        if state.shared.size:
            rows = out.structure.row[state.position.shape[0] :]
            prior = np.zeros(rows.size * SIZE)
            prior[: state.shared.size] = state.shared
            out.gradient[rows] += prior.reshape(-1, SIZE)

    def linear_among(self, state: GraphState, variables: Indices) -> list[LinearTerm]:
        """Terms of the epochs that involve only some of the variables."""
        return [term for term in self.linear(state) if np.isin(term.variables, variables).all()]

    def linear(self, state: GraphState, loss: Loss | None = None) -> list[LinearTerm]:
        """One term for each epoch."""
        residual, by_transmitter, by_receiver = self._at(state)
        terms = self._terms
        if loss is not None:
            weights = (np.maximum(loss.weight(u), _MIN_WEIGHT) for u in self._by_epoch(residual))
            terms = [
                epoch._replace(root=epoch.root / np.sqrt(weight))
                for epoch, weight in zip(terms, weights, strict=True)
            ]
        return [self._linear(epoch, residual, by_transmitter, by_receiver) for epoch in terms]

    def _linear(
        self, terms: EpochTerms, residual: Array, by_transmitter: Array, by_receiver: Array
    ) -> LinearTerm:
        m = terms.rows.size
        row = np.arange(terms.rows.size)
        by = np.zeros((m, len(terms.variables), SIZE))
        by[row, terms.transmitter, POSITION] = by_transmitter[terms.rows]  # the ends differ
        by[row, terms.receiver, POSITION] = by_receiver[terms.rows]
        flat = by.reshape(m, -1)
        by_unknowns = self._expansion.by_unknowns[terms.rows]
        first = SIZE * (int(max(terms.transmitter.max(), terms.receiver.max())) + 1)
        flat[:, first : first + by_unknowns.shape[1]] = by_unknowns
        return LinearTerm(
            terms.variables, whiten(terms.root, residual[terms.rows]), whiten(terms.root, flat)
        )

    def _at(self, state: GraphState) -> tuple[Array, Array, Array]:
        ranges = self._ranges
        return self._expansion(
            state.position[ranges.transmitter], state.position[ranges.receiver], state.shared
        )

    def _by_epoch(self, residual: Array) -> list[Array]:
        return [residual[epoch.rows] / np.diagonal(epoch.root) for epoch in self._terms]


class Problem:
    """Cost of a graph whose ranges have a loss or, for None, squared residuals."""

    def __init__(
        self,
        factors: FactorsExceptRanges,
        ranges: Distances | ExpandedRanges,
        structure: Structure,
        loss: Loss | None = None,
    ) -> None:
        self.factors = factors
        self.ranges = ranges
        self.structure = structure
        self.loss = loss
        self._blocks = factors.blocks(structure)
        self._range_blocks = structure.blocks(ranges.pairs)

    @property
    def without_ranges(self) -> bool:
        """True for a graph without ranges, whose chains can rotate as a whole."""
        return isinstance(self.ranges, Distances) and not len(self.ranges.pairs)

    def under(self, loss: Loss | None) -> "Problem":
        """Copy with another loss on the ranges."""
        return Problem(self.factors, self.ranges, self.structure, loss)

    def cost(self, state: GraphState) -> float:
        """Cost at a state."""
        return self.factors.cost(state) + self.ranges.cost(state, self.loss)

    def linearize(
        self,
        state: GraphState,
        order: int = 1,
        into: NormalEquations | None = None,
        *,
        begin: bool = False,
    ) -> NormalEquations:
        """
        Normal equations at a state, with ranges weighted by the loss; they can overwrite earlier
        ones.

        ``begin`` allows to eliminate batches of rows already; then only `NormalEquations.step` can
        be called.
        """
        out = NormalEquations(self.structure, order) if into is None else into.clear(order)
        i = np.arange(SIZE)
        n = self.factors.n_poses
        m = self.factors.n_variables
        row = self.structure.row
        begin = begin and order <= 3 and not self.factors.planar and self.structure.batch.size > 2
        self.factors.add(state, self._blocks, out, begin=begin)
        # a landmark has no rotation
        out.diagonal[row[n:m, None], i[ROTATION], i[ROTATION]] += 1.0
        out.diagonal[row[m:, None], i, i] += 1.0  # prior of shared unknowns
        self.ranges.add(state, self._range_blocks, self.loss, out)
        if order > 3:
            out.scale = np.diagonal(out.diagonal, axis1=1, axis2=2).copy()
            self.factors.add_curvature(state, self._blocks, out)
            if self.without_ranges:
                _add_arcs(state, out, row[:n])
        if self.factors.planar:
            _hold_in_plane(out, row[:m])
        return out


def _add_arcs(state: GraphState, out: NormalEquations, rows: Indices) -> None:
    """Add the curvature due to motion along arcs: half of ``g . (R w) x d``, symmetrically."""
    pull = np.cross(out.gradient[rows][:, None, POSITION], np.eye(3)[None])  # [g], transposed
    mixed = 0.5 * np.swapaxes(state.rotation[: rows.size], 1, 2) @ pull
    rotation = np.arange(3)
    translation = np.arange(3, 6)
    out.diagonal[rows[:, None, None], rotation[:, None], translation] += mixed
    out.diagonal[rows[:, None, None], translation[:, None], rotation] += np.swapaxes(mixed, 1, 2)


def _hold_in_plane(out: NormalEquations, rows: Indices) -> None:
    """Fix the coordinates out of the plane; by symmetry only rounding moves them."""
    out.diagonal[rows[:, None], _OUT_OF_PLANE, :] = 0.0
    out.diagonal[rows[:, None], :, _OUT_OF_PLANE] = 0.0
    out.diagonal[rows[:, None], _OUT_OF_PLANE, _OUT_OF_PLANE] = 1.0
    for k in _OUT_OF_PLANE.tolist():  # much faster than all three at once
        out.above[:, k, :] = 0.0
        out.above[:, :, k] = 0.0
    out.gradient[rows[:, None], _OUT_OF_PLANE] = 0.0


class ProblemCache:
    """Factors and structures of problems, reused for equal inputs."""

    def __init__(self) -> None:
        self._factors: FactorsExceptRanges | None = None
        self._structures: dict[tuple[int, bytes, bytes], Structure] = {}

    def factors(self, graph: FactorGraph) -> FactorsExceptRanges:
        """All factors of a graph except its ranges."""
        if self._factors is None or not self._factors.is_of(graph):
            self._factors = FactorsExceptRanges(graph)
        return self._factors

    def structure(
        self, factors: FactorsExceptRanges, size: int, pairs: Indices, groups: Sequence[Indices]
    ) -> Structure:
        """Structure of variables that are connected by factors, by other pairs or within groups."""
        within = [np.stack(np.triu_indices(len(group), 1), axis=1) for group in groups]
        every = [
            factors.pairs,
            pairs,
            *(group[inner] for group, inner in zip(groups, within, strict=True)),
        ]
        joined = np.concatenate(every).astype(np.intp)
        unbatched = factors.unbatched(size, [pairs, *groups])
        key = size, joined.tobytes(), unbatched.tobytes()
        if key not in self._structures:
            self._structures[key] = Structure(size, joined, unbatched=unbatched)
        return self._structures[key]


def distance_problem(
    graph: FactorGraph,
    loss: Loss | None = None,
    *,
    cache: ProblemCache | None = None,
    groups: Sequence[Indices] = (),
) -> Problem:
    """
    Problem of a graph whose ranges are distances; the variables of each group are also connected.
    """
    cache = cache or ProblemCache()
    factors = cache.factors(graph)
    ranges = Distances(graph)
    return Problem(
        factors, ranges, cache.structure(factors, graph.n_variables, ranges.pairs, groups), loss
    )


def _cost(white: Array, loss: Loss | None) -> float:
    return 0.5 * float(white @ white) if loss is None else float(loss.cost(white).sum())
