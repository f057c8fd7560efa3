"""
GTSAM's iSAM2, fed with the factors of a graph in the order of their time, and its incremental
fixed-lag smoother.
"""

from time import perf_counter, process_time
from typing import Any, NamedTuple

import gtsam
import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.estimation._gtsam.factors import graph_factors, graph_values, poses_of, values_of
from pymantaray.estimation.graph.graph import FactorGraph, Factors, GraphValues
from pymantaray.estimation.solvers.solution import IncrementalOptions
from pymantaray.estimation.solvers.trilateration import trilaterate


class EntryUpdates(NamedTuple):
    """Update at which each factor and each variable enters; -1 for a variable without factors."""

    factor_update: Indices
    variable_update: Indices


def timeline(factors: Any, variable_time: Array, update_time: Array) -> EntryUpdates:
    """
    Find the update at which each factor and variable enters; a time of minus infinity means always
    available.
    """
    of_variable = np.searchsorted(update_time, variable_time)
    last = update_time.size
    first_use = np.full(variable_time.size, last)
    of_factor = np.empty(factors.size(), dtype=int)
    for i in range(factors.size()):
        keys = list(factors.at(i).keys())
        of_factor[i] = of_variable[keys].max()
        first_use[keys] = np.minimum(first_use[keys], of_factor[i])
    return EntryUpdates(of_factor, np.where(first_use == last, -1, first_use))


def parameters(options: IncrementalOptions) -> Any:
    """Parameters of iSAM2."""
    steps = gtsam.ISAM2GaussNewtonParams()
    steps.setWildfireThreshold(options.wildfire)
    out = gtsam.ISAM2Params()
    out.setOptimizationParams(steps)
    out.setRelinearizeThreshold(options.relinearize)
    out.relinearizeSkip = 1
    out.findUnusedFactorSlots = True
    out.setFactorization("CHOLESKY")
    return out


class IncrementalSmoother:
    """Current estimate; unusable after a failed update."""

    def __init__(self, options: IncrementalOptions) -> None:
        self._smoother = gtsam.ISAM2(parameters(options))
        self.seconds = np.nan
        """Duration of the last update."""

    def update(self, factors: Any, rows: Indices, new: Any) -> int | None:
        """Add factors and variables, and return how many were relinearized; None if singular."""
        graph = gtsam.NonlinearFactorGraph()
        for i in rows.tolist():
            graph.add(factors.at(i))
        begin = perf_counter()
        try:
            result = self._smoother.update(graph, new)
        except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
            return None
        self.seconds = perf_counter() - begin
        return int(result.getVariablesRelinearized())

    def pose(self, key: int) -> Any:
        """Current estimate of one pose."""
        return self._smoother.calculateEstimatePose3(key)

    def values(self) -> Any:
        """Current estimate of all variables."""
        return self._smoother.calculateEstimate()


class Entering:
    """
    Starting values of new variables: from a prior, from an edge to an existing pose, or from given
    values.
    """

    def __init__(self, graph: FactorGraph, start: Any, update_time: Array) -> None:
        self._start = start
        self._graph = graph
        self._update_time = update_time
        self._with_prior = {
            v for table in graph.of_ends(("landmark",)) for v in table.subject.tolist()
        }
        prior = graph["prior"]
        edge = graph["edge"]
        priors = poses_of(prior.column("quaternion"), prior.column("position"))
        self._prior = dict(reversed(list(zip(prior.subject.tolist(), priors, strict=True))))
        self._steps = poses_of(edge.column("quaternion"), edge.column("position"))
        self._edges: dict[int, list[tuple[int, int, bool]]] = {}
        for row, (a, b) in enumerate(edge.variables.tolist()):
            self._edges.setdefault(b, []).append((a, row, True))
            self._edges.setdefault(a, []).append((b, row, False))
        self._there: set[int] = set()

    def values(
        self, variables: Indices, smoother: "IncrementalSmoother | LaggedSmoother", update: int
    ) -> Any:
        """Starting values of the new variables of an update."""
        out = gtsam.Values()
        poses = variables[variables < self._graph.n_poses]
        for key in poses[np.argsort(self._graph.pose_time[poses], kind="stable")].tolist():
            out.insert(key, self._pose(key, out, smoother))
            self._there.add(key)
        for key in variables[variables >= self._graph.n_poses].tolist():
            out.insertPoint3(key, self._landmark(key, out, smoother, self._update_time[update]))
        return out

    def _landmark(
        self, key: int, new: Any, smoother: "IncrementalSmoother | LaggedSmoother", now: float
    ) -> Any:
        """
        Initial value of a landmark: its value with a prior, else the first sighting or
        trilateration from the earlier poses.
        """
        if key in self._with_prior:
            return self._start.atPoint3(key)
        graph = self._graph
        n = self._graph.n_poses

        def past(table: Factors) -> Factors:
            first, second = table.variables.T
            there = [pose < n and self._graph.pose_time[pose] <= now for pose in first.tolist()]
            return table[(second == key) & np.array(there, dtype=bool)]

        ranges = past(graph["range"])
        sightings = [past(table) for table in graph.of_ends(("pose", "landmark"))]
        if sighting := next((table for table in sightings if len(table)), None):
            pose = self._current(int(sighting.variables[0, 0]), new, smoother)
            return pose.transformFrom(sighting.column("position")[0])
        position = np.zeros((n, 3))
        for pose in np.unique(ranges.variables[:, 0]).tolist():
            position[pose] = self._current(pose, new, smoother).translation()
        level = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        values = GraphValues(position, level, np.zeros((graph.landmark_name.size, 3)))
        solutions = trilaterate(graph.with_factors(range=ranges), values, [key])
        return solutions[key][0] if key in solutions else self._start.atPoint3(key)

    @staticmethod
    def _current(key: int, new: Any, smoother: "IncrementalSmoother | LaggedSmoother") -> Any:
        """Current estimate of a pose, new or not."""
        return new.atPose3(key) if new.exists(key) else smoother.pose(key)

    def _pose(self, key: int, new: Any, smoother: "IncrementalSmoother | LaggedSmoother") -> Any:
        if key in self._prior:
            return self._prior[key]
        for other, row, forward in self._edges.get(key, ()):
            if other in self._there:
                step = self._steps[row]
                at = self._current(other, new, smoother)
                return at.compose(step if forward else step.inverse())
        return self._start.atPose3(key)


class LaggedSmoother:
    """
    Current estimate of the latest variables; unusable after a failed update. Parameters as those of
    `LagWindow`.
    """

    def __init__(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        moment: Array,
        times: Array,
        lag: float,
        options: IncrementalOptions,
    ) -> None:
        self._graph = graph
        self._moment = moment
        self._times = times
        self._smoother: Any = gtsam.IncrementalFixedLagSmoother(lag, parameters(options))
        self._factors = graph_factors(graph)
        self._line = timeline(self._factors, moment, times)
        self._entering = Entering(graph, values_of(initial), times)
        self._latest = gtsam.Values()
        self.seconds = 0.0
        """CPU time of the last update and of its estimate."""

    def update(self, k: int, _groups: list[Indices]) -> bool:
        """Add what enters at an update, and update; True if it succeeded."""
        n = self._graph.n_poses
        now = float(self._times[k])
        variables = np.flatnonzero(self._line.variable_update == k)
        # landmarks are never marginalized
        there = np.flatnonzero(self._line.variable_update[n:] <= k) + n
        time = {int(v): float(self._moment[v]) if v < n else now for v in (*variables, *there)}
        rows = np.flatnonzero(self._line.factor_update == k)
        return self._update(rows, self._entering.values(variables, self, k), time)

    def finish(self, updates: int) -> bool:
        """Relinearize in a number of updates without new factors; True if all succeeded."""
        none = np.empty(0, dtype=np.intp)
        return all(self._update(none, gtsam.Values(), {}) for _ in range(updates))

    def _update(self, rows: Indices, new: Any, time: dict[int, float]) -> bool:
        graph = gtsam.NonlinearFactorGraph()
        for i in rows.tolist():
            graph.add(self._factors.at(i))
        begin = process_time()
        try:
            self._smoother.update(graph, new, time)
            estimate = self._smoother.calculateEstimate()
            self.seconds = process_time() - begin
            self._latest.insert_or_assign(estimate)
        except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
            return False
        return True

    def values(self) -> GraphValues:
        """Estimate of every variable when it was last in the window."""
        return graph_values(self._latest, self._graph)

    def pose(self, key: int) -> Any:
        """Current estimate of one pose."""
        return self._smoother.calculateEstimatePose3(key)

    def covariance(self, poses: Indices) -> Array | None:
        """
        Joint covariance of poses in their tangents, (6 n, 6 n); None unless all are in the window.
        """
        values = self._smoother.getLinearizationPoint()
        if not all(values.exists(key) for key in poses.tolist()):
            return None
        marginals = gtsam.Marginals(self._smoother.getFactors(), values)
        joint = marginals.jointMarginalCovariance(poses.tolist())
        return np.block([[joint.at(a, b) for b in poses.tolist()] for a in poses.tolist()])
