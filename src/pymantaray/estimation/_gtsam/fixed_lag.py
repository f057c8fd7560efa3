"""
GTSAM's incremental fixed-lag smoother, which keeps the last estimate of marginalized variables.
"""

from time import process_time
from typing import Any

import gtsam
import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.estimation._gtsam import incremental as isam2
from pymantaray.estimation._gtsam.factors import graph_factors, graph_values, values_of
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.solvers.solution import IncrementalOptions


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
        self._smoother: Any = gtsam.IncrementalFixedLagSmoother(lag, isam2.parameters(options))
        self._factors = graph_factors(graph)
        self._line = isam2.timeline(self._factors, moment, times)
        self._entering = isam2.Entering(graph, values_of(initial), times)
        self._latest = gtsam.Values()
        self.seconds = 0.0
        """CPU time of the last update and of its estimate."""

    def update(self, k: int, _groups: list[Indices]) -> bool:
        """Add what enters at an update, and update; True if it succeeded."""
        n = self._graph.n_poses
        now = float(self._times[k])
        variables = np.flatnonzero(self._line.variable_update == k)
        there = (
            np.flatnonzero(self._line.variable_update[n:] <= k) + n
        )  # landmarks are never marginalized
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
