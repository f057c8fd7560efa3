"""One realization under several ranging conditions and by several estimators, and all realizations as one record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.build import Links, Ranges, build_graph, timed_ranges, with_ranges
from pymantaray.estimation.covariance import reckoned_covariances
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.range_models import (
    AdjustableModel,
    BelievedRanges,
    ClockPrior,
    ConstantSpeed,
    RangeModel,
    TransmitterSpeed,
    TravelTimeUncertainty,
    Unknowns,
)
from pymantaray.estimation.solution import Method, Progress, Solution, judged
from pymantaray.estimation.solve import GraphSolver
from pymantaray.estimation.starts import dead_reckon
from pymantaray.records import Estimates, Measurements, SolveStatus

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimator:
    """
    One way to estimate from the measurements of a fleet.

    Parameters
    ----------
    ranges, links : str
        As in `build_graph`.
    model : RangeModel, optional
        What is believed of a range. One speed for a link makes a distance of it; other models take outer
        iterations. By default ranges are the distances that they are measured as.
    uncertainty : TravelTimeUncertainty, optional
        Adds to the variance of the ranges.
    correlated : bool
        Whether its covariances count too, between the links of an epoch.
    initial : tuple of ndarray, optional
        Where the solver starts, as in `solve_conditions`; the default is dead reckoning.
    model_is_right : bool
        Whether the final cost has to lie within its chi-square bounds.
    method : Method
        How the graph is solved.
    clocks : ClockPrior, optional
        Offset and skew of all clocks are then estimated with the poses, as amplitudes are if the model is an
        `AdjustableModel`.
    dead_reckoned : bool
        Whether no graph is solved at all.
    """

    ranges: Ranges
    links: Links = "refracted"
    model: RangeModel | None = None
    uncertainty: TravelTimeUncertainty | None = None
    correlated: bool = False
    initial: tuple[Array, Array] | None = None
    model_is_right: bool = False
    method: Method = field(default_factory=Method)
    clocks: ClockPrior | None = None
    dead_reckoned: bool = False


CONDITIONS: Mapping[str, Estimator] = MappingProxyType(
    {
        "odometry": Estimator(None, dead_reckoned=True),
        "no-ranges": Estimator(None, model_is_right=True),
        "straight": Estimator("straight", model_is_right=True),
        "refracted": Estimator("refracted"),
        "straight-all": Estimator("straight", links="all", model_is_right=True),
    }
)
"""Ranging conditions of a study, by name."""


def solve_conditions(
    measurements: Measurements,
    conditions: Sequence[str],
    initial: tuple[Array, Array] | None = None,
    *,
    estimators: Mapping[str, Estimator] | None = None,
    solver: GraphSolver | None = None,
    covariance_samples: NDArray[np.intp] | None = None,
) -> dict[str, Solution]:
    """
    Estimate a fleet's trajectories from one realization under each of several ranging conditions.

    Parameters
    ----------
    measurements : Measurements
        With noise.
    conditions : sequence of str
        Keys of `CONDITIONS`. ``odometry`` is dead reckoning, the others are batch solves.
    initial : tuple of ndarray, optional
        Where the solver starts under the conditions: positions of shape (n_agents, n_times, 3) [m] and
        quaternions (w, x, y, z) of shape (n_agents, n_times, 4). The paper starts at the truth; the default
        is dead reckoning. Landmarks start at their surveyed positions.
    estimators : mapping of str to Estimator, optional
        Solved after the conditions, from the same measurements; their names must be no conditions.
    solver : GraphSolver, optional
        Hand in the same one for all realizations of a process: it keeps what they share.
    covariance_samples : ndarray of int, shape (n_epochs,), optional
        Samples at which every solution gets its covariances. By default none has any.

    Returns
    -------
    dict of str to Solution
        In the order of ``conditions``, then of ``estimators``; arrays of shape ``(n_agents, n_times, ...)``.

    Raises
    ------
    EstimationError
        If a condition is unknown, an estimator has the name of one, or for what `build_graph` and
        `GraphSolver` refuse. A solve that fails is no error but has a status.
    """
    unknown = [c for c in conditions if c not in CONDITIONS]
    if unknown:
        raise EstimationError(f"unknown condition {unknown[0]!r}; allowed are {', '.join(CONDITIONS)}")
    more = dict(estimators or {})
    clash = [name for name in more if name in CONDITIONS]
    if clash:
        raise EstimationError(f"estimator {clash[0]!r} has the name of a condition; give it another")
    solver = solver or GraphSolver()
    fleet = _Fleet(measurements, covariance_samples)
    solved: dict[str, Solution] = {}
    for name, e in [*((c, replace(CONDITIONS[c], initial=initial)) for c in conditions), *more.items()]:
        solved[name] = fleet.reckoned_solution() if e.dead_reckoned else fleet.solve(e, solver)
    return solved


class _Fleet:
    """Measurements of one realization, and what its estimators share."""

    def __init__(self, measurements: Measurements, samples: NDArray[np.intp] | None) -> None:
        self._o, self._samples = measurements, samples
        self._graph: FactorGraph | None = None

    @cached_property
    def _reckoned(self) -> tuple[Array, Array]:
        return dead_reckon(self._o)

    def solve(self, e: Estimator, solver: GraphSolver) -> Solution:
        o, poses = self._o, None
        if self._graph is None:
            self._graph = build_graph(o, e.ranges, e.links)
        graph, believed = _believed(with_ranges(self._graph, o, e.ranges, e.links), o, e)
        if self._samples is not None:
            poses = np.arange(o.depth.size).reshape(o.depth.shape)[:, self._samples].T
        solution = solver.solve(
            graph,
            self._values(*(e.initial or self._reckoned)),
            method=e.method,
            model_is_right=e.model_is_right,
            believed=believed,
            covariance_poses=poses,
        )
        return self._by_vehicle(solution)

    def reckoned_solution(self) -> Solution:
        values = self._values(*self._reckoned)
        solution = self._by_vehicle(judged(values, Progress(0, np.nan, np.nan), SolveStatus.OK))
        if self._samples is None:
            return solution
        return replace(solution, covariances=reckoned_covariances(self._o, self._samples))

    def _values(self, position: Array, quaternion: Array) -> GraphValues:
        place, turn = (np.asarray(table) for table in (position, quaternion))
        return GraphValues(place.reshape(-1, 3), turn.reshape(-1, 4), self._o.landmark_position)

    def _by_vehicle(self, solution: Solution) -> Solution:
        shape = self._o.depth.shape
        place, turn = solution.position.reshape(*shape, 3), solution.quaternion.reshape(*shape, 4)
        return replace(solution, position=place, quaternion=turn)


def collect_estimates(measurements: Measurements, solutions: Sequence[Mapping[str, Solution]]) -> Estimates:
    """
    Put the solutions of all realizations into one record.

    Parameters
    ----------
    measurements : Measurements
        Of any realization: gives names and times.
    solutions : sequence of mapping of str to Solution
        What `solve_conditions` returned, one for each realization.

    Raises
    ------
    EstimationError
        If there is no realization, or two of them have different conditions.
    """
    if not solutions:
        raise EstimationError("no realization to collect; at least one is needed")
    conditions = list(solutions[0])
    odd = next((i for i, s in enumerate(solutions) if list(s) != conditions), None)
    if odd is not None:
        raise EstimationError(
            f"realization {odd} has conditions {list(solutions[odd])}, realization 0 {conditions}"
        )

    def table(attribute: str) -> NDArray[Any]:
        return np.array([[getattr(s[c], attribute) for s in solutions] for c in conditions])

    names = (
        "position quaternion landmark_position iterations initial_cost final_cost expected_cost gradient_norm"
    )
    return Estimates(
        condition=np.array(conditions),
        realization=np.arange(len(solutions)),
        name=measurements.name,
        time=measurements.time,
        start=measurements.start,
        landmark_name=measurements.landmark_name,
        solve_status=table("status"),
        gated_links=table("gated_links"),
        **{name: table(name) for name in names.split()},
    )


def _believed(graph: FactorGraph, o: Measurements, e: Estimator) -> tuple[FactorGraph, BelievedRanges | None]:
    """Graph of an estimator; one speed for each link makes its ranges distances, and nothing is left to believe."""
    if e.model is None:
        return graph, None
    timed = timed_ranges(o, e.ranges, e.links)
    plain = e.uncertainty is None and e.clocks is None
    if isinstance(e.model, ConstantSpeed | TransmitterSpeed) and plain:
        ratio = e.model.speed(timed.sound_speed) / timed.sound_speed
        ranges = graph["range"]
        longer = ranges.with_columns(distance=ratio * ranges.column("distance"))
        scaled = replace(longer, covariance=ratio[:, None, None] ** 2 * ranges.covariance)
        return graph.with_factors(range=scaled), None
    unknowns = None
    if e.clocks is not None or isinstance(e.model, AdjustableModel):
        unknowns = Unknowns(e.model, timed, graph.pose_agent, graph.agent_name.tolist(), clocks=e.clocks)
    return graph, BelievedRanges(e.model, timed, e.uncertainty, e.correlated, unknowns)
