"""
Factor graphs, their file formats and their solution; knows measurements, never the ocean or the
truth.

Examples
--------
Continues the example of `pymantaray.sensing`:

>>> from pymantaray.estimation import GraphValues, build_graph, dead_reckon
>>> from pymantaray.sensing import perturb
>>> noisy = perturb(measurements, root_seed=1, realization=0)
>>> graph = build_graph(noisy, "straight")
>>> position, quaternion = dead_reckon(noisy)
>>> start = GraphValues(
...     position.reshape(-1, 3), quaternion.reshape(-1, 4), noisy.landmark_position
... )
>>> graph
<FactorGraph: 2 vehicles, 0 landmarks, 4 poses>
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.estimation.conditions import (
        CONDITIONS as CONDITIONS,
        Estimator as Estimator,
        collect_estimates as collect_estimates,
        solve_conditions as solve_conditions,
    )
    from pymantaray.estimation.graph.build import build_graph as build_graph
    from pymantaray.estimation.graph.graph import (
        FactorGraph as FactorGraph,
        GraphValues as GraphValues,
    )
    from pymantaray.estimation.graph.pyfg import read_pyfg as read_pyfg, write_pyfg as write_pyfg
    from pymantaray.estimation.ranges.candidates import (
        CandidateArrivals as CandidateArrivals,
        CandidateModel as CandidateModel,
        MixtureOptions as MixtureOptions,
    )
    from pymantaray.estimation.ranges.range_models import (
        ClockPrior as ClockPrior,
        ConstantSpeed as ConstantSpeed,
        MeanSlowness as MeanSlowness,
        Prediction as Prediction,
        RangeEndpoints as RangeEndpoints,
        RangeModel as RangeModel,
        TransmitterSpeed as TransmitterSpeed,
        UnknownsEstimate as UnknownsEstimate,
    )
    from pymantaray.estimation.solve import GraphSolver as GraphSolver
    from pymantaray.estimation.solvers.covariance import (
        collect_covariances as collect_covariances,
        effective_degrees_of_freedom as effective_degrees_of_freedom,
        fixed_epochs as fixed_epochs,
        rmse_standard_error as rmse_standard_error,
    )
    from pymantaray.estimation.solvers.losses import LOSSES as LOSSES, Loss as Loss
    from pymantaray.estimation.solvers.marginals import covariances_at as covariances_at
    from pymantaray.estimation.solvers.solution import (
        GraphSolution as GraphSolution,
        IncrementalOptions as IncrementalOptions,
        Method as Method,
        SolveOptions as SolveOptions,
    )
    from pymantaray.estimation.solvers.starts import dead_reckon as dead_reckon

__getattr__, __dir__, __all__ = lazy_exports(__name__)
