"""Factor graphs, their file formats and their solution; knows measurements, never the ocean or the truth."""

from pymantaray.estimation.build import build_graph
from pymantaray.estimation.candidates import CandidateArrivals, CandidateModel, MixtureOptions
from pymantaray.estimation.certificate import Certificate, certify
from pymantaray.estimation.conditions import CONDITIONS, Estimator, collect_estimates, solve_conditions
from pymantaray.estimation.covariance import (
    collect_covariances,
    effective_degrees_of_freedom,
    fixed_epochs,
    rmse_standard_error,
)
from pymantaray.estimation.external import GraphResult, open_graph, solve_graph, to_gtsam
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.losses import LOSSES, Loss
from pymantaray.estimation.marginals import covariances_at
from pymantaray.estimation.pyfg import read_pyfg, write_pyfg
from pymantaray.estimation.range_models import (
    AdjustableModel,
    ClockPrior,
    ConstantSpeed,
    MeanSlowness,
    Prediction,
    RangeEndpoints,
    RangeModel,
    TransmitterSpeed,
    UnknownsEstimate,
)
from pymantaray.estimation.solution import GraphSolution, IncrementalOptions, Method, SolveOptions
from pymantaray.estimation.solve import GraphSolver
from pymantaray.estimation.starts import dead_reckon

__all__ = [
    "CONDITIONS",
    "LOSSES",
    "AdjustableModel",
    "CandidateArrivals",
    "CandidateModel",
    "Certificate",
    "ClockPrior",
    "ConstantSpeed",
    "Estimator",
    "FactorGraph",
    "GraphResult",
    "GraphSolution",
    "GraphSolver",
    "GraphValues",
    "IncrementalOptions",
    "Loss",
    "MeanSlowness",
    "Method",
    "MixtureOptions",
    "Prediction",
    "RangeEndpoints",
    "RangeModel",
    "SolveOptions",
    "TransmitterSpeed",
    "UnknownsEstimate",
    "build_graph",
    "certify",
    "collect_covariances",
    "collect_estimates",
    "covariances_at",
    "dead_reckon",
    "effective_degrees_of_freedom",
    "fixed_epochs",
    "open_graph",
    "read_pyfg",
    "rmse_standard_error",
    "solve_conditions",
    "solve_graph",
    "to_gtsam",
    "write_pyfg",
]
