"""One realization under several ranging conditions and by several estimators, and all realizations as one record."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import process_time
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

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
    UnknownsEstimate,
)
from pymantaray.estimation.solution import Method, Progress, Solution, judged
from pymantaray.estimation.solve import GraphSolver
from pymantaray.estimation.starts import dead_reckon
from pymantaray.records import Estimates, Measurements, SolveStatus

Array = NDArray[np.float64]

_SAME_COST = 1e-6  # relative; what outer iterations leave open is less
_MOST_SCALE, _SCALE_TOLERANCE = 1e4, 1e-2  # of the ranges' standard deviations; of its logarithm


class _NoFitError(Exception):
    """A solve on the way is not usable."""


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
    scale_sigma, bias_sigma : float, optional
        Prior standard deviations of a factor less 1 on all travel times [-] and of a bias of the ranges of each ordered
        pair [m], which are then estimated too.
    range_sigma : float or "fitted", optional
        Standard deviation that is believed in place of the measurements' own [m]; "fitted" the one at which the cost is what
        is expected of it, and no smaller than theirs.
    averaged : bool
        Whether both directions of a pair have the mean of their ranges.
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
    scale_sigma: float | None = None
    bias_sigma: float | None = None
    range_sigma: float | Literal["fitted"] | None = None
    averaged: bool = False
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
    conditions: Sequence[str] | Mapping[str, Estimator],
    initial: tuple[Array, Array] | None = None,
    *,
    solver: GraphSolver | None = None,
    covariance_samples: NDArray[np.intp] | None = None,
) -> dict[str, Solution]:
    """
    Estimate a fleet's trajectories from one realization under each of several ranging conditions.

    Parameters
    ----------
    measurements : Measurements
        With noise.
    conditions : sequence of str, or mapping of str to Estimator
        Keys of `CONDITIONS`, of which ``odometry`` is dead reckoning and the others are batch solves; or estimators by
        the names of their conditions.
    initial : tuple of ndarray, optional
        Where the solver starts, unless an estimator says otherwise: positions of shape (n_vehicles, n_times, 3) [m] and
        quaternions (w, x, y, z) of shape (n_vehicles, n_times, 4). The paper starts at the truth; the default
        is dead reckoning. Landmarks start at their surveyed positions.
    solver : GraphSolver, optional
        Hand in the same one for all realizations of a process: it keeps what they share.
    covariance_samples : ndarray of int, shape (n_epochs,), optional
        Samples at which every solution gets its covariances. By default none has any.

    Returns
    -------
    dict of str to Solution
        In the order of ``conditions``; arrays of shape ``(n_vehicles, n_times, ...)``.

    Raises
    ------
    EstimationError
        If a condition is unknown, or for what `build_graph` and
        `GraphSolver` refuse. A solve that fails is no error but has a status.
    """
    if not isinstance(conditions, Mapping):
        unknown = [c for c in conditions if c not in CONDITIONS]
        if unknown:
            raise EstimationError(f"unknown condition {unknown[0]!r}; allowed are {', '.join(CONDITIONS)}")
        conditions = {name: CONDITIONS[name] for name in conditions}
    solver = solver or GraphSolver()
    fleet = _Fleet(measurements, covariance_samples)
    solved: dict[str, Solution] = {}
    for name, estimator in conditions.items():
        start = process_time()
        e = estimator if estimator.initial else replace(estimator, initial=initial)
        solution = fleet.reckoned_solution() if e.dead_reckoned else fleet.solve(e, solver)
        solved[name] = replace(solution, seconds=process_time() - start)
    return solved


class _Fleet:
    """Measurements of one realization, and what its estimators share."""

    def __init__(self, measurements: Measurements, samples: NDArray[np.intp] | None) -> None:
        self._o, self._samples = measurements, samples
        self._graph: FactorGraph | None = None
        self._without_ranges: Solution | None = None

    @cached_property
    def _reckoned(self) -> tuple[Array, Array]:
        return dead_reckon(self._o)

    def solve(self, e: Estimator, solver: GraphSolver) -> Solution:
        o = _believing(self._o, e)
        if self._graph is None:
            self._graph = build_graph(o, e.ranges, e.links)
        start = self._values(*(e.initial or self._reckoned))
        if e.range_sigma != "fitted":
            first = self._solved(e, o, start, solver)
            plain = e.ranges is not None and e.method == Method()
            again = plain and (e.initial is None or not first.usable)
            return self._lower(first, e, o, solver) if again else first
        scale = _fitted_scale(lambda k, at: self._solved(e, _scaled(o, k), at, solver), start)
        if scale is None:
            return self._solved(e, o, start, solver)
        solution = self._solved(e, _scaled(o, scale), start, solver)
        sigma, none = np.array([scale * float(np.median(o.range_sigma))]), np.full((1, 1), np.nan)
        return replace(solution, unknowns=UnknownsEstimate(("range sigma",), ("m",), none[0], sigma, none))

    def _lower(self, first: Solution, e: Estimator, o: Measurements, solver: GraphSolver) -> Solution:
        """
        The lower of a solution and of one that starts where the graph without ranges has its optimum; the status says so if they differ.

        That start has fixes and depths, which dead reckoning has not, and no ranges that could hold it in a wrong basin.
        """
        if self._without_ranges is None:
            self._without_ranges = self._solved(Estimator(None), o, self._values(*self._reckoned), solver)
        if not self._without_ranges.usable:
            return first
        second = self._solved(e, o, self._without_ranges.values, solver)
        if not (first.usable and second.usable):
            return second if second.usable else first
        lower = min(first, second, key=lambda solution: solution.final_cost)
        if abs(first.final_cost - second.final_cost) <= _SAME_COST * (1.0 + lower.final_cost):
            return first
        status = SolveStatus.SECOND_MINIMUM if lower.status == SolveStatus.OK else lower.status
        return replace(lower, status=status)

    def _solved(self, e: Estimator, o: Measurements, start: GraphValues, solver: GraphSolver) -> Solution:
        assert self._graph is not None  # built for the first estimator
        graph, believed = _believed(with_ranges(self._graph, o, e.ranges, e.links), o, e)
        poses = None
        if self._samples is not None:
            poses = np.arange(o.depth.size).reshape(o.depth.shape)[:, self._samples].T
        solution = solver.solve(
            graph,
            start,
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


def _believing(o: Measurements, e: Estimator) -> Measurements:
    """Measurements as an estimator takes them."""
    if e.averaged:
        o = _with_mean_of_directions(o)
    if isinstance(e.range_sigma, float):
        o = replace(o, range_sigma=np.full_like(o.range_sigma, e.range_sigma))
    return o


def _with_mean_of_directions(o: Measurements) -> Measurements:
    """Both ranges of a pair at one ping become their mean, which together are worth what it is: half the variance."""
    ends = np.sort(np.stack([o.range_transmitter, o.range_receiver], axis=1), axis=1)
    pair = np.unique(np.column_stack([o.range_sample, ends]), axis=0, return_inverse=True)[1]
    heard = np.isfinite(o.refracted_range)

    def mean(ranges: Array) -> Array:
        total = np.bincount(pair[heard], ranges[heard], pair.max(initial=-1) + 1)
        count = np.bincount(pair[heard], minlength=total.size)
        return np.where(heard, (total / np.maximum(count, 1))[pair], ranges)

    return replace(o, refracted_range=mean(o.refracted_range), straight_range=mean(o.straight_range))


def _scaled(o: Measurements, scale: float) -> Measurements:
    return replace(o, range_sigma=scale * o.range_sigma)


def _fitted_scale(solve: Callable[[float, GraphValues], Solution], start: GraphValues) -> float | None:
    """Factor on the standard deviations of ranges at which the cost of a solve is as expected, 1 at least; None if there is none."""
    latest = start

    def excess(log_scale: float) -> float:
        nonlocal latest
        solution = solve(float(np.exp(log_scale)), latest)
        if not solution.usable:
            raise _NoFitError
        latest = solution.values
        return float(np.log(solution.final_cost / solution.expected_cost))

    try:
        if excess(0.0) <= 0.0:
            return 1.0
        return float(np.exp(brentq(excess, 0.0, np.log(_MOST_SCALE), xtol=_SCALE_TOLERANCE)))
    except (_NoFitError, ValueError):  # not usable, or over its expectation however little ranges weigh
        return None


def _believed(graph: FactorGraph, o: Measurements, e: Estimator) -> tuple[FactorGraph, BelievedRanges | None]:
    """Graph of an estimator; one speed for each link makes its ranges distances, and nothing is left to believe."""
    if e.model is None:
        return graph, None
    timed = timed_ranges(o, e.ranges, e.links)
    unknown = any(prior is not None for prior in (e.clocks, e.scale_sigma, e.bias_sigma))
    plain = e.uncertainty is None and not unknown
    if isinstance(e.model, ConstantSpeed | TransmitterSpeed) and plain:
        ratio = e.model.speed(timed.sound_speed) / timed.sound_speed
        ranges = graph["range"]
        longer = ranges.with_columns(distance=ratio * ranges.column("distance"))
        scaled = replace(longer, covariance=ratio[:, None, None] ** 2 * ranges.covariance)
        return graph.with_factors(range=scaled), None
    unknowns = None
    if unknown or isinstance(e.model, AdjustableModel):
        unknowns = Unknowns(
            e.model,
            timed,
            graph.pose_vehicle,
            graph.vehicle_name.tolist(),
            clocks=e.clocks,
            scale_sigma=e.scale_sigma,
            bias_sigma=e.bias_sigma,
        )
    return graph, BelievedRanges(e.model, timed, e.uncertainty, e.correlated, unknowns)
