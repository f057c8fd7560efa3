"""Trajectory errors and statistics of range errors; the only folder that compares estimates with the truth."""

from pymantaray.evaluation.bound import DegreesOfFreedom, bound_table, error_bound, graph_degrees_of_freedom
from pymantaray.evaluation.comparison import comparison_table
from pymantaray.evaluation.consistency import consistency_summary, consistency_table, coverage_table
from pymantaray.evaluation.ping_error import ping_error_table
from pymantaray.evaluation.ranging_error import (
    ALL_LINKS,
    RangeErrors,
    dropout_table,
    range_error_table,
    range_errors,
    range_split_table,
)
from pymantaray.evaluation.trajectory_error import (
    attitude_table,
    error_table,
    graph_errors,
    trajectory_errors,
)
from pymantaray.evaluation.unknowns import directions_table, unknowns_table

__all__ = [
    "ALL_LINKS",
    "DegreesOfFreedom",
    "RangeErrors",
    "attitude_table",
    "bound_table",
    "comparison_table",
    "consistency_summary",
    "consistency_table",
    "coverage_table",
    "directions_table",
    "dropout_table",
    "error_bound",
    "error_table",
    "graph_degrees_of_freedom",
    "graph_errors",
    "ping_error_table",
    "range_error_table",
    "range_errors",
    "range_split_table",
    "trajectory_errors",
    "unknowns_table",
]
