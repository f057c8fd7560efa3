"""
Marginal prior: Gaussian information of eliminated variables on those that shared factors with them.
"""

from dataclasses import dataclass, replace

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.estimation.graph.graph import FactorGraph
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.estimation.solvers.normal_equations import (
    POSITION,
    ROTATION,
    SIZE,
    Blocks,
    NormalEquations,
    Structure,
)
from pymantaray.estimation.solvers.problems import (
    Distances,
    FactorsExceptRanges,
    GraphState,
    Problem,
)
from pymantaray.geometry.se3 import hat, so3_log

_SMALL_ANGLE = 1e-2  # rad; below it a series replaces the closed form


@dataclass(frozen=True, eq=False)
class MarginalPrior:
    """
    Cost ``cost + gradient . d + d . matrix d / 2`` of the distance d of variables from a state, as
    rotation vectors and displacements.
    """

    variables: Indices
    rotation: Array
    position: Array
    matrix: Array
    gradient: Array
    cost: float

    def among(self, variables: Indices) -> "MarginalPrior":
        """The same with variables numbered by their index among sorted ones."""
        return replace(self, variables=np.searchsorted(variables, self.variables))

    def renumber(self, variables: Indices) -> "MarginalPrior":
        """The inverse of `among`."""
        return replace(self, variables=variables[self.variables])

    def cost_at(self, state: GraphState) -> float:
        """Cost at a state."""
        d = self._distance(state).ravel()
        return self.cost + float(self.gradient @ d) + 0.5 * float(d @ self.matrix @ d)

    def add(self, state: GraphState, out: NormalEquations) -> None:
        """Add cost, gradient and blocks."""
        d = self._distance(state)
        n = len(d)
        by = np.zeros((n, SIZE, n, SIZE))
        own = np.arange(n)
        by[own, ROTATION, own, ROTATION] = _by_rotation(d[:, ROTATION])
        by[own, POSITION, own, POSITION] = np.eye(3)
        jacobian = by.reshape(SIZE * n, SIZE * n)
        pull = self.gradient + self.matrix @ d.ravel()
        out.cost += self.cost_at(state)
        out.add(self.variables, jacobian.T @ self.matrix @ jacobian, jacobian.T @ pull)

    def _distance(self, state: GraphState) -> Array:
        rotation = np.swapaxes(self.rotation, 1, 2) @ state.rotation[self.variables]
        return np.concatenate(
            [so3_log(rotation), state.position[self.variables] - self.position], axis=1
        )


def _by_rotation(vector: Array) -> Array:
    """Derivatives of rotation vectors (n, 3) by a further rotation in the body's axes."""
    angle = np.linalg.norm(vector, axis=1)
    large = np.maximum(angle, _SMALL_ANGLE)
    closed = (1.0 - 0.5 * large / np.tan(0.5 * large)) / large**2
    bend = np.where(angle < _SMALL_ANGLE, 1.0 / 12.0 + angle**2 / 720.0, closed)
    cross = hat(vector)
    return np.asarray(np.eye(3) + 0.5 * cross + bend[:, None, None] * (cross @ cross))


class RangesAndPrior(Distances):
    """Ranges of a graph as distances, and a prior on some of its variables."""

    def __init__(self, graph: FactorGraph, prior: MarginalPrior | None) -> None:
        super().__init__(graph)
        self._prior = prior

    def cost(self, state: GraphState, loss: Loss | None) -> float:
        """Cost of the ranges and of the prior."""
        return super().cost(state, loss) + (
            0.0 if self._prior is None else self._prior.cost_at(state)
        )

    def add(
        self, state: GraphState, blocks: Blocks, loss: Loss | None, out: NormalEquations
    ) -> None:
        """Add cost, gradient and blocks."""
        super().add(state, blocks, loss, out)
        if self._prior is not None:
            self._prior.add(state, out)


def marginalize(
    graph: FactorGraph, prior: MarginalPrior | None, state: GraphState, remaining: Indices
) -> MarginalPrior | None:
    """
    Prior on the remaining variables of a graph and a prior, after elimination of all others at a
    state.

    None if the others are not determined.
    """
    factors = FactorsExceptRanges(graph)
    ranges = RangesAndPrior(graph, prior)
    pairs = [factors.pairs, ranges.pairs]
    if prior is not None:
        one, other = np.triu_indices(prior.variables.size, 1)
        pairs.append(np.stack([prior.variables[one], prior.variables[other]], axis=1))
    structure = Structure(graph.n_variables, np.concatenate(pairs).astype(np.intp), last=remaining)
    equations = Problem(factors, ranges, structure).linearize(state)
    rest = equations.eliminate(remaining)
    if rest is None:
        return None
    matrix, gradient = rest
    return MarginalPrior(
        remaining,
        state.rotation[remaining],
        state.position[remaining],
        matrix,
        gradient,
        equations.cost,
    )
