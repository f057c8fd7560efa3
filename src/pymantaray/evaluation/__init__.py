"""
Trajectory errors and statistics of range errors; the only folder that compares estimates with the
truth.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.evaluation.bound import DegreesOfFreedom as DegreesOfFreedom
    from pymantaray.evaluation.bound import bound_table as bound_table
    from pymantaray.evaluation.bound import error_bound as error_bound
    from pymantaray.evaluation.bound import graph_degrees_of_freedom as graph_degrees_of_freedom
    from pymantaray.evaluation.comparison import comparison_table as comparison_table
    from pymantaray.evaluation.consistency import consistency_summary as consistency_summary
    from pymantaray.evaluation.consistency import consistency_table as consistency_table
    from pymantaray.evaluation.consistency import coverage_table as coverage_table
    from pymantaray.evaluation.explanation import LARGEST_RATIO as LARGEST_RATIO
    from pymantaray.evaluation.explanation import LEAST_RANGE as LEAST_RANGE
    from pymantaray.evaluation.explanation import LEAST_TIME as LEAST_TIME
    from pymantaray.evaluation.explanation import unexplained as unexplained
    from pymantaray.evaluation.ping_error import ping_error_table as ping_error_table
    from pymantaray.evaluation.ranging_error import ALL_LINKS as ALL_LINKS
    from pymantaray.evaluation.ranging_error import RangeErrors as RangeErrors
    from pymantaray.evaluation.ranging_error import dropout_table as dropout_table
    from pymantaray.evaluation.ranging_error import range_error_table as range_error_table
    from pymantaray.evaluation.ranging_error import range_errors as range_errors
    from pymantaray.evaluation.ranging_error import range_split_table as range_split_table
    from pymantaray.evaluation.trajectory_error import attitude_table as attitude_table
    from pymantaray.evaluation.trajectory_error import error_table as error_table
    from pymantaray.evaluation.trajectory_error import graph_errors as graph_errors
    from pymantaray.evaluation.trajectory_error import trajectory_errors as trajectory_errors
    from pymantaray.evaluation.unknowns import directions_table as directions_table
    from pymantaray.evaluation.unknowns import unknowns_table as unknowns_table

__getattr__, __dir__, __all__ = lazy_exports(__name__)
