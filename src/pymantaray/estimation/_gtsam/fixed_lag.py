"""GTSAM's fixed-lag smoothers, batch and incremental, which keep the last estimate of marginalized variables."""

from time import process_time
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation._gtsam import incremental as isam2

Array = NDArray[np.float64]
_TOLERANCE = 1e-12  # of the cost, relative and absolute, at which the smoother's own steps end


class LaggedSmoother:
    """Current estimate of the latest variables; unusable after a failed update."""

    def __init__(self, lag: float, incremental: isam2.Options | None = None) -> None:
        if incremental is None:
            steps = gtsam.LevenbergMarquardtParams()
            steps.setRelativeErrorTol(_TOLERANCE)
            steps.setAbsoluteErrorTol(_TOLERANCE)
            self._smoother: Any = gtsam.BatchFixedLagSmoother(lag, steps)
        else:
            self._smoother = gtsam.IncrementalFixedLagSmoother(lag, isam2.parameters(incremental))
        self.seconds = 0.0
        """CPU time of the last update and of its estimate."""
        self.latest = gtsam.Values()
        """Estimate of every variable when it was last in the window."""

    def update(self, factors: Any, rows: NDArray[np.intp], new: Any, time: Any) -> bool:
        """Add factors and variables, with times by key, and update; True if it succeeded."""
        added = gtsam.NonlinearFactorGraph()
        for i in rows.tolist():
            added.add(factors.at(i))
        begin = process_time()
        try:
            self._smoother.update(added, new, time)
            estimate = self._smoother.calculateEstimate()
            self.seconds = process_time() - begin
            self.latest.insert_or_assign(estimate)
        except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
            return False
        return True

    def pose(self, key: int) -> Any:
        """Current estimate of one pose."""
        return self._smoother.calculateEstimatePose3(key)

    def covariance(self, keys: NDArray[np.intp]) -> Array | None:
        """Joint covariance of poses in their tangents, (6 n, 6 n); None unless all are in the window."""
        values = self._smoother.getLinearizationPoint()
        if not all(values.exists(key) for key in keys.tolist()):
            return None
        marginals = gtsam.Marginals(self._smoother.getFactors(), values)
        joint = marginals.jointMarginalCovariance(keys.tolist())
        return np.block([[joint.at(a, b) for b in keys.tolist()] for a in keys.tolist()])
