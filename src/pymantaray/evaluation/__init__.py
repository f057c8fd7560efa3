"""
Trajectory errors and statistics of range errors; the only folder that compares estimates with the
truth.

Examples
--------
Continues the example of `pymantaray.estimation`:

>>> import numpy as np
>>> from pymantaray.estimation import collect_covariances, collect_estimates, solve_conditions
>>> samples = np.array([1])
>>> solutions = [
...     solve_conditions(
...         perturb(measurements, root_seed=1, realization=k),
...         ["odometry", "straight", "refracted"],
...         covariance_samples=samples,
...     )
...     for k in range(3)
... ]
>>> estimates = collect_estimates(measurements, solutions)
>>> parts = [{name: s.covariances for name, s in solution.items()} for solution in solutions]
>>> covariances = collect_covariances(measurements, samples, parts)
>>> estimates
<Estimates: 3 conditions, 3 realizations, 2 vehicles, 2 times, 0 landmarks>
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.evaluation.bound import (
        DegreesOfFreedom as DegreesOfFreedom,
        bound_table as bound_table,
        error_bound as error_bound,
        graph_degrees_of_freedom as graph_degrees_of_freedom,
    )
    from pymantaray.evaluation.comparison import comparison_table as comparison_table
    from pymantaray.evaluation.consistency import (
        consistency_summary as consistency_summary,
        consistency_table as consistency_table,
        coverage_table as coverage_table,
    )
    from pymantaray.evaluation.explanation import (
        LARGEST_RATIO as LARGEST_RATIO,
        LEAST_RANGE as LEAST_RANGE,
        LEAST_TIME as LEAST_TIME,
        unexplained as unexplained,
    )
    from pymantaray.evaluation.ping_error import ping_error_table as ping_error_table
    from pymantaray.evaluation.ranging_error import (
        ALL_LINKS as ALL_LINKS,
        RangeErrors as RangeErrors,
        dropout_table as dropout_table,
        range_error_table as range_error_table,
        range_errors as range_errors,
        range_split_table as range_split_table,
    )
    from pymantaray.evaluation.trajectory_error import (
        attitude_table as attitude_table,
        error_table as error_table,
        graph_errors as graph_errors,
        trajectory_errors as trajectory_errors,
    )
    from pymantaray.evaluation.unknowns import (
        directions_table as directions_table,
        unknowns_table as unknowns_table,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
