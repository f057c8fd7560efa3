"""
Batch fixed-lag smoothing: the poses of a window are optimized at each update, then the oldest are
marginalized.
"""

from dataclasses import dataclass, replace
from time import process_time
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.estimation.graph.graph import KINDS, FactorGraph, Factors, GraphValues
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.estimation.solvers.normal_equations import (
    POSITION,
    ROTATION,
    SIZE,
    Blocks,
    NormalEquations,
    Structure,
)
from pymantaray.estimation.solvers.optimize import LastStep, optimize
from pymantaray.estimation.solvers.problems import (
    Distances,
    FactorsExceptRanges,
    GraphState,
    Problem,
    ProblemCache,
)
from pymantaray.estimation.solvers.solution import SolveOptions
from pymantaray.estimation.solvers.starts import dead_reckon_graph
from pymantaray.estimation.solvers.trilateration import range_only_landmarks, trilaterate
from pymantaray.geometry.se3 import hat, matrix_from_quaternion, quaternion_from_matrix, so3_log

Rows = dict[str, Indices]
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


class _Window(NamedTuple):
    """Part of a graph: its variables, as numbered in the whole graph, and their optimum."""

    variables: Indices
    graph: FactorGraph
    last: LastStep


class LagWindow:
    """
    Current estimate of the variables of a window, and the last one of those that have left it;
    unusable after a failed update.

    Parameters
    ----------
    graph : FactorGraph
    initial : GraphValues
        Starting values of variables that neither a prior nor a factor with an earlier variable
        gives.
    moment : ndarray
        Time from which each variable is determined. [s]
    times : ndarray
        Times of the updates. [s]
    lag : float
        Poses older than this leave the window. [s]
    options : SolveOptions
        Limits of the solve of a window.
    """

    def __init__(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        moment: Array,
        times: Array,
        lag: float,
        options: SolveOptions,
    ) -> None:
        self._graph = graph
        self._moment = moment
        self._times = times
        self._lag = lag
        self._options = options
        state = GraphState.of(initial)
        self._rotation = state.rotation.copy()
        self._position = state.position.copy()
        of_variable = np.searchsorted(times, moment)
        self._enters = {
            name: of_variable[graph[name].variables].max(axis=1) for name in graph.factors
        }
        first = np.full(moment.size, times.size)
        for name, update in self._enters.items():
            for end in graph[name].variables.T:
                np.minimum.at(first, end, update)
        self._first = first  # update at which each variable enters
        self._inside = np.zeros(moment.size, dtype=np.bool_)
        self._left = np.zeros(moment.size, dtype=np.bool_)
        self._rows: Rows = {name: np.empty(0, dtype=np.intp) for name in graph.factors}
        self._prior: MarginalPrior | None = None
        self._window: _Window | None = None
        self.seconds = 0.0
        """CPU time of the last update."""

    def update(self, k: int, groups: list[Indices]) -> bool:
        """
        Add what enters at an update, optimize the window, and marginalize; True if it succeeded.
        The poses of each group are connected.
        """
        begin = process_time()
        new = np.flatnonzero(self._first == k)
        self._inside[new] = True
        for name, enters in self._enters.items():
            rows = np.flatnonzero(enters == k)
            known = ~self._left[self._graph[name].variables[rows]].any(axis=1)
            self._rows[name] = np.concatenate([self._rows[name], rows[known]])
        variables = np.flatnonzero(self._inside)
        graph = self._part(variables, self._rows)
        self._start(graph, variables, np.isin(variables, new))
        here = [np.searchsorted(variables, group) for group in groups if self._inside[group].all()]
        prior = None if self._prior is None else self._prior.among(variables)
        factors = FactorsExceptRanges(graph)
        ranges = RangesAndPrior(graph, prior)
        connected = here if prior is None else [*here, prior.variables]
        structure = ProblemCache().structure(factors, graph.n_variables, ranges.pairs, connected)
        problem = Problem(factors, ranges, structure)
        last = optimize(problem, self._state(variables), self._options).last
        done = last is not None and self._leave(k, variables, last)
        if last is not None:
            self._window = _Window(variables, graph, last)
        self.seconds = process_time() - begin
        return done

    def finish(self, _updates: int) -> bool:
        """Nothing: each update ends at an optimum."""
        return True

    def values(self) -> GraphValues:
        """Estimate of every variable when it was last in the window."""
        n = self._graph.n_poses
        return GraphValues(
            self._position[:n], quaternion_from_matrix(self._rotation[:n]), self._position[n:]
        )

    def covariance(self, poses: Indices) -> Array | None:
        """
        Joint covariance of the poses of a group in their tangents, (6 n, 6 n); None unless all were
        in the last window.
        """
        if self._window is None or not np.isin(poses, self._window.variables).all():
            return None
        state = self._window.last.state
        group = np.searchsorted(self._window.variables, poses)
        (joint,) = self._window.last.factor.inverse([group])
        rotation = np.zeros((group.size, SIZE, group.size, SIZE))
        own = np.arange(group.size)
        rotation[own, ROTATION, own, ROTATION] = np.eye(3)
        rotation[own, POSITION, own, POSITION] = state.rotation[group]
        to_world = rotation.reshape(joint.shape)
        return np.asarray(to_world.T @ joint @ to_world)

    def _state(self, variables: Indices) -> GraphState:
        return GraphState(self._rotation[variables], self._position[variables], np.zeros(0))

    def _part(self, variables: Indices, rows: Rows) -> FactorGraph:
        """Graph of some variables, in their order, and of some rows of the factors between them."""
        graph = self._graph
        n = self._graph.n_poses
        number = np.full(graph.n_variables, -1, dtype=np.int32)
        number[variables] = np.arange(variables.size)
        poses = variables[variables < n]
        landmarks = variables[variables >= n] - n
        bare = FactorGraph(
            vehicle_name=graph.vehicle_name,
            landmark_name=graph.landmark_name[landmarks],
            pose_vehicle=graph.pose_vehicle[poses],
            pose_number=graph.pose_number[poses],
            pose_time=graph.pose_time[poses],
            planar=graph.planar,
        )
        tables = {}
        for name, of_name in rows.items():
            table = graph[name]
            ends = number[table.variables[of_name]]
            tables[name] = Factors(
                table.kind, ends, table.measurement[of_name], table.covariance[of_name]
            )
        return bare.with_factors(**tables)

    def _start(self, graph: FactorGraph, variables: Indices, new: Mask) -> None:
        """
        Starting values of the new variables of a window: from a prior, from factors with earlier
        variables, or as given.
        """
        if not new.any():
            return
        n = graph.n_poses
        state = self._state(variables)
        quaternion = quaternion_from_matrix(state.rotation[:n])
        values = GraphValues(state.position[:n], quaternion, state.position[n:])
        old = np.flatnonzero(~new[:n])
        prior = graph["prior"]
        real = prior[new[prior.subject]]
        known = KINDS["prior"].table(
            np.concatenate([old, real.subject]),
            [
                np.concatenate([values.position[old], real.column("position")]),
                np.concatenate([quaternion[old], real.column("quaternion")]),
            ],
            np.tile(np.eye(SIZE), (old.size + len(real), 1, 1)),
        )
        reckoned = dead_reckon_graph(graph.with_factors(prior=known), values).values
        fresh = variables[new]
        rotation = matrix_from_quaternion(reckoned.quaternion)
        position = np.concatenate([reckoned.position, reckoned.landmark_position])
        self._rotation[fresh[fresh < self._graph.n_poses]] = rotation[new[:n]]
        self._position[fresh] = position[new]
        ranged = [v for v in range_only_landmarks(graph).tolist() if new[v]]
        if ranged:
            for landmark, solutions in trilaterate(graph, reckoned, ranged).items():
                self._position[variables[landmark]] = solutions[0]

    def _leave(self, k: int, variables: Indices, last: LastStep) -> bool:
        """
        Keep the estimates of an update and marginalize all poses older than the lag; False if they
        are not determined.
        """
        n = self._graph.n_poses
        old = (variables < n) & (self._moment[variables] < self._times[k] - self._lag)
        # what leaves has had its last estimate at the update before
        remaining = variables[~old]
        self._rotation[remaining] = last.state.rotation[~old]
        self._position[remaining] = last.state.position[~old]
        if not old.any():
            return True
        gone = np.zeros_like(self._left)
        gone[variables[old]] = True
        touching = {
            name: gone[self._graph[name].variables[rows]].any(axis=1)
            for name, rows in self._rows.items()
        }
        absorbed = {name: self._rows[name][rows] for name, rows in touching.items()}
        self._rows = {name: self._rows[name][~rows] for name, rows in touching.items()}
        ends = [self._graph[name].variables[rows].ravel() for name, rows in absorbed.items()]
        earlier = () if self._prior is None else self._prior.variables
        involved = np.unique(np.concatenate([*ends, variables[old], earlier])).astype(np.intp)
        at = np.searchsorted(variables, involved)
        state = GraphState(last.state.rotation[at], last.state.position[at], np.zeros(0))
        graph = self._part(involved, absorbed)
        before = None if self._prior is None else self._prior.among(involved)
        after = marginalize(graph, before, state, np.flatnonzero(~gone[involved]))
        if after is None:
            return False
        self._prior = replace(after, variables=involved[after.variables])
        self._inside &= ~gone
        self._left |= gone
        return True
