"""Batch solves by GTSAM's Levenberg-Marquardt optimizer."""

from typing import Any

import gtsam


def optimize(factors: Any, start: Any, *, converged: bool) -> tuple[Any, int]:
    """
    Minimize a graph's cost; return the values and the number of iterations.

    With the default parameters GTSAM stops once the cost falls by less than 1e-5 of itself.
    ``converged`` continues until no damping lowers the cost.
    """
    parameters = gtsam.LevenbergMarquardtParams()
    if converged:
        parameters.setRelativeErrorTol(0.0)
        parameters.setAbsoluteErrorTol(0.0)
    optimizer = gtsam.LevenbergMarquardtOptimizer(factors, start, parameters)
    return optimizer.optimize(), optimizer.iterations()
