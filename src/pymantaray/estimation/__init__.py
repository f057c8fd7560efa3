"""
Factor graphs, their file formats and their solution; knows measurements, never the ocean or the
truth.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.estimation.conditions import CONDITIONS as CONDITIONS
    from pymantaray.estimation.conditions import Estimator as Estimator
    from pymantaray.estimation.conditions import collect_estimates as collect_estimates
    from pymantaray.estimation.conditions import solve_conditions as solve_conditions
    from pymantaray.estimation.graph.build import build_graph as build_graph
    from pymantaray.estimation.graph.graph import FactorGraph as FactorGraph
    from pymantaray.estimation.graph.graph import GraphValues as GraphValues
    from pymantaray.estimation.graph.pyfg import read_pyfg as read_pyfg
    from pymantaray.estimation.graph.pyfg import write_pyfg as write_pyfg
    from pymantaray.estimation.ranges.candidates import CandidateArrivals as CandidateArrivals
    from pymantaray.estimation.ranges.candidates import CandidateModel as CandidateModel
    from pymantaray.estimation.ranges.candidates import MixtureOptions as MixtureOptions
    from pymantaray.estimation.ranges.range_models import ClockPrior as ClockPrior
    from pymantaray.estimation.ranges.range_models import ConstantSpeed as ConstantSpeed
    from pymantaray.estimation.ranges.range_models import MeanSlowness as MeanSlowness
    from pymantaray.estimation.ranges.range_models import Prediction as Prediction
    from pymantaray.estimation.ranges.range_models import RangeEndpoints as RangeEndpoints
    from pymantaray.estimation.ranges.range_models import RangeModel as RangeModel
    from pymantaray.estimation.ranges.range_models import TransmitterSpeed as TransmitterSpeed
    from pymantaray.estimation.ranges.range_models import UnknownsEstimate as UnknownsEstimate
    from pymantaray.estimation.solve import GraphSolver as GraphSolver
    from pymantaray.estimation.solvers.covariance import collect_covariances as collect_covariances
    from pymantaray.estimation.solvers.covariance import (
        effective_degrees_of_freedom as effective_degrees_of_freedom,
    )
    from pymantaray.estimation.solvers.covariance import fixed_epochs as fixed_epochs
    from pymantaray.estimation.solvers.covariance import rmse_standard_error as rmse_standard_error
    from pymantaray.estimation.solvers.losses import LOSSES as LOSSES
    from pymantaray.estimation.solvers.losses import Loss as Loss
    from pymantaray.estimation.solvers.marginals import covariances_at as covariances_at
    from pymantaray.estimation.solvers.solution import GraphSolution as GraphSolution
    from pymantaray.estimation.solvers.solution import IncrementalOptions as IncrementalOptions
    from pymantaray.estimation.solvers.solution import Method as Method
    from pymantaray.estimation.solvers.solution import SolveOptions as SolveOptions
    from pymantaray.estimation.solvers.starts import dead_reckon as dead_reckon

__getattr__, __dir__, __all__ = lazy_exports(__name__)
