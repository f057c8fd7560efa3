"""
Solve one realization under several conditions and by several estimators; collect all realizations.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import process_time
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.build import (
    build_graph,
    timed_ranges,
    with_ranges,
)
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.names import STANDARD, LinkChoice, MeasuredRanges
from pymantaray.estimation.ranges.candidates import CandidateModel
from pymantaray.estimation.ranges.on_sphere import OnSphere
from pymantaray.estimation.ranges.range_models import (
    ClockPrior,
    ModelRanges,
    RangeModel,
    RangeUnknowns,
    TravelTimeUncertainty,
    UnknownsEstimate,
)
from pymantaray.estimation.solve import GraphSolver
from pymantaray.estimation.solvers.covariance import (
    checked_conditions,
    dead_reckoning_covariances,
)
from pymantaray.estimation.solvers.descents import choose, same_cost
from pymantaray.estimation.solvers.solution import (
    GraphSolution,
    Method,
    SolveProgress,
    make_solution,
)
from pymantaray.estimation.solvers.starts import dead_reckon
from pymantaray.records import Estimates, Measurements, SolveStatus

_MAX_SCALE = 1e4  # largest factor on range sigmas
_COST_TOLERANCE = 2e-3  # of the cost, relative to the number of ranges; changes the sigma by 0.2 %
_MAX_FITS = 30  # solves for one fit
_MIN_SHARE = 1e-3  # smallest cost of ranges, relative to its expected value, that the secant uses


@dataclass(frozen=True, eq=False)
class Estimator:
    """
    One way to estimate from the measurements of a fleet.

    Parameters
    ----------
    ranges, links : str
        As in `build_graph`.
    model : RangeModel, optional
        Model that predicts travel times. A model with one speed for each link converts ranges to
        distances; other models need outer iterations. By default the measured ranges are distances.
    uncertainty : TravelTimeUncertainty, optional
        Adds to the variance of the ranges.
    correlated : bool
        Use the covariances between the links of an epoch, too.
    initial : tuple of ndarray, optional
        Starting values, as in `solve_conditions`; the default is dead reckoning.
    model_is_right : bool
        Check that the final cost is within its chi-square bounds.
    method : Method
        Solver and loss.
    clocks : ClockPrior, optional
        Estimate offset and skew of all clocks with the poses, as amplitudes are estimated if the
        model has modes.
    scale_sigma, bias_sigma : float, optional
        Prior standard deviations of a factor less 1 on all travel times [-] and of a bias of the
        ranges of each ordered pair [m], which are then estimated too.
    range_sigma : float or "fitted", optional
        Standard deviation of ranges to assume [m]. "fitted" uses the smallest one, not below that
        of the measurements, at which the cost equals its expected value.
    mean_of_directions : bool
        Replace both ranges of a pair by their mean.
    dead_reckoned : bool
        Use dead reckoning and solve no graph.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import ClockPrior, ConstantSpeed, Estimator, solve_conditions
    >>> speed, clocks = ConstantSpeed(1460.0), ClockPrior(offset_sigma=1e-3, skew_sigma=1e-9)
    >>> estimators = {
    ...     "1460 m/s": Estimator("refracted", model=speed),
    ...     "and clocks": Estimator("refracted", model=speed, clocks=clocks),
    ... }
    >>> solutions = solve_conditions(noisy, estimators)
    >>> [(name, solution.status.name) for name, solution in solutions.items()]
    [('1460 m/s', 'OK'), ('and clocks', 'OK')]
    """

    ranges: MeasuredRanges
    links: LinkChoice = "refracted"
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
    mean_of_directions: bool = False
    dead_reckoned: bool = False


CONDITIONS: Mapping[str, Estimator] = MappingProxyType(
    {
        name: Estimator(
            condition.ranges,
            condition.links,
            model_is_right=condition.ranges != "refracted" and not condition.dead_reckoned,
            dead_reckoned=condition.dead_reckoned,
        )
        for name, condition in STANDARD.items()
    }
)
"""Ranging conditions of a study, by name."""


def solve_conditions(
    measurements: Measurements,
    conditions: Sequence[str] | Mapping[str, Estimator],
    initial: tuple[Array, Array] | None = None,
    *,
    solver: GraphSolver | None = None,
    covariance_samples: Indices | None = None,
) -> dict[str, GraphSolution]:
    """
    Estimate a fleet's trajectories from one realization under each of several ranging conditions.

    Parameters
    ----------
    measurements : Measurements
        Noisy measurements of one realization.
    conditions : sequence of str, or mapping of str to Estimator
        Keys of `CONDITIONS`, of which ``odometry`` is dead reckoning and the others are batch
        solves; or estimators by the names of their conditions.
    initial : tuple of ndarray, optional
        Starting values, unless an estimator has its own: positions of shape (n_vehicles, n_times,
        3) [m] and quaternions (w, x, y, z) of shape (n_vehicles, n_times, 4). The paper starts at
        the truth; the default is dead reckoning. Landmarks start at their surveyed positions.
    solver : GraphSolver, optional
        Solver to reuse for all realizations of a process; it caches what they share.
    covariance_samples : ndarray of int, shape (n_epochs,), optional
        Samples at which to compute covariances. By default none are computed.

    Returns
    -------
    dict of str to Solution
        In the order of ``conditions``; arrays of shape ``(n_vehicles, n_times, ...)``.

    Raises
    ------
    EstimationError
        If a condition is unknown, or `build_graph` or `GraphSolver` refuses the input. A failed
        solve raises no error; its status says so.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import solve_conditions
    >>> solutions = solve_conditions(noisy, ["odometry", "straight"])
    >>> error = solutions["straight"].position - truth.position
    >>> solutions["straight"].status.name, float(np.abs(error).max().round(1))
    ('OK', 8.5)
    """
    if not isinstance(conditions, Mapping):
        unknown = [c for c in conditions if c not in CONDITIONS]
        if unknown:
            raise EstimationError(
                f"unknown condition {unknown[0]!r}; allowed are {', '.join(CONDITIONS)}"
            )
        conditions = {name: CONDITIONS[name] for name in conditions}
    solver = solver or GraphSolver()
    fleet = _Fleet(measurements, covariance_samples)
    solved: dict[str, GraphSolution] = {}
    for name, given in conditions.items():
        start = process_time()
        estimator = given if given.initial else replace(given, initial=initial)
        solution = (
            fleet.dead_reckoning_solution()
            if estimator.dead_reckoned
            else fleet.solve(estimator, solver)
        )
        solved[name] = replace(solution, seconds=process_time() - start)
    return solved


class _Fleet:
    """Measurements of one realization and the intermediate results that its estimators share."""

    def __init__(self, measurements: Measurements, samples: Indices | None) -> None:
        self._measurements = measurements
        self._samples = samples
        self._graph: FactorGraph | None = None
        self._without_ranges: GraphSolution | None = None
        self._first: dict[tuple[object, ...], tuple[Estimator, GraphSolution]] = {}

    @cached_property
    def _dead_reckoned(self) -> tuple[Array, Array]:
        return dead_reckon(self._measurements)

    def solve(self, estimator: Estimator, solver: GraphSolver) -> GraphSolution:
        measurements = _adjusted(self._measurements, estimator)
        if self._graph is None:
            self._graph = build_graph(measurements, estimator.ranges, estimator.links)
        start = self._values(*(estimator.initial or self._dead_reckoned))
        if estimator.range_sigma == "fitted":
            return self._with_fitted_sigma(estimator, measurements, start, solver)
        first = self._first_solved(estimator, measurements, start, solver)
        plain = estimator.ranges is not None and estimator.method == Method()
        # a mixture starts there in any case
        plain &= not isinstance(estimator.model, CandidateModel)
        again = plain and (estimator.initial is None or not first.usable)
        return self._lower(first, estimator, measurements, solver) if again else first

    def _with_fitted_sigma(
        self,
        estimator: Estimator,
        measurements: Measurements,
        start: GraphValues,
        solver: GraphSolver,
    ) -> GraphSolution:
        """
        Solution with the range sigma, of at least the measured one, at which the cost equals its
        expected value; that of the measurements if there is none.

        The part of the cost that is due to ranges is nearly a power of the factor on sigma, so the
        secant is that of logarithms.
        """
        n_ranges = max(int(np.isfinite(measurements.refracted_range).sum()), 1)

        def fits(solution: GraphSolution) -> bool:
            """True if the cost has its expected value."""
            off = solution.final_cost - solution.expected_cost
            return abs(off) <= _COST_TOLERANCE * n_ranges

        log_scale = 0.0
        before = None
        low = 0.0
        high = np.log(_MAX_SCALE)
        solution = self._first_solved(estimator, measurements, start, solver)
        for _ in range(_MAX_FITS):
            scale = float(np.exp(log_scale))
            if before is not None:
                larger = replace(measurements, range_sigma=scale * measurements.range_sigma)
                solution = self._solved(estimator, larger, solution.values, solver, fits)
            if not solution.usable:
                break
            excess = solution.final_cost - solution.expected_cost
            if fits(solution) or (excess <= 0.0 and before is None):
                sigma = scale * float(np.median(measurements.range_sigma))
                return replace(solution, unknowns=_with_range_sigma(sigma, solution.unknowns))
            low, high = (log_scale, high) if excess > 0.0 else (low, log_scale)
            # the cost that ranges should have is half their number
            share = float(np.log(max(1.0 + 2.0 * excess / n_ranges, _MIN_SHARE)))
            slope = -2.0 if before is None else (share - before[1]) / (log_scale - before[0])
            before = log_scale, share
            guess = log_scale - share / slope if slope < 0.0 else np.inf
            log_scale = guess if low < guess < high else 0.5 * (low + high)
        # the cost is above its expected value for any weight of the ranges
        return self._solved(estimator, measurements, start, solver)

    def _lower(
        self,
        first: GraphSolution,
        estimator: Estimator,
        measurements: Measurements,
        solver: GraphSolver,
    ) -> GraphSolution:
        """
        Solve again from the optimum of the graph without ranges, and choose between both by the
        rule of `descents`.

        That start uses fixes and depths, unlike dead reckoning, and no ranges that could keep it in
        a wrong basin. If the two minima differ, the status is SECOND_MINIMUM.
        """
        if self._without_ranges is None:
            self._without_ranges = self._solved(
                Estimator(None), measurements, self._values(*self._dead_reckoned), solver
            )
        ends = [first]
        if self._without_ranges.usable:
            ends.append(self._solved(estimator, measurements, self._without_ranges.values, solver))
        best = choose(
            ends,
            lambda end: end.append(self._solved(estimator, measurements, end.values, solver)),
        )
        minima = [end.cost for end in ends if end.usable]
        if len(minima) == 2 and not same_cost(*minima) and best.status == SolveStatus.OK:
            return replace(best, status=SolveStatus.SECOND_MINIMUM)
        return best

    def _first_solved(
        self,
        estimator: Estimator,
        measurements: Measurements,
        start: GraphValues,
        solver: GraphSolver,
    ) -> GraphSolution:
        """
        Solution from the estimator's start; the fit of a range sigma begins with that of the
        estimator without a fit.
        """
        sigma = None if estimator.range_sigma == "fitted" else estimator.range_sigma
        models = (estimator.model, estimator.uncertainty, *(estimator.initial or ()))
        key = (
            tuple(id(part) for part in models),
            (estimator.ranges, estimator.links, estimator.mean_of_directions),
            (estimator.clocks, estimator.scale_sigma, estimator.bias_sigma, sigma),
            (estimator.correlated, estimator.model_is_right, estimator.method),
        )
        if key not in self._first:  # the estimator keeps the objects that the key identifies
            self._first[key] = estimator, self._solved(estimator, measurements, start, solver)
        return self._first[key][1]

    def _solved(
        self,
        estimator: Estimator,
        measurements: Measurements,
        start: GraphValues,
        solver: GraphSolver,
        covariances_if: Callable[[GraphSolution], bool] | None = None,
    ) -> GraphSolution:
        assert self._graph is not None  # built for the first estimator
        graph, model_ranges = _with_model(
            with_ranges(self._graph, measurements, estimator.ranges, estimator.links),
            measurements,
            estimator,
            start,
        )
        poses = None
        if self._samples is not None:
            poses = (
                np.arange(measurements.depth.size)
                .reshape(measurements.depth.shape)[:, self._samples]
                .T
            )
        solution = solver.solve(
            graph,
            start,
            method=estimator.method,
            model_is_right=estimator.model_is_right,
            model_ranges=model_ranges,
            covariance_poses=poses,
            covariances_if=covariances_if,
        )
        return self._by_vehicle(solution)

    def dead_reckoning_solution(self) -> GraphSolution:
        values = self._values(*self._dead_reckoned)
        solution = self._by_vehicle(
            make_solution(values, SolveProgress(0, np.nan, np.nan), SolveStatus.OK)
        )
        if self._samples is None:
            return solution
        covariances = dead_reckoning_covariances(
            self._measurements, self._samples, self._dead_reckoned
        )
        return replace(solution, covariances=covariances)

    def _values(self, position: Array, quaternion: Array) -> GraphValues:
        positions, rotations = (np.asarray(table) for table in (position, quaternion))
        return GraphValues(
            positions.reshape(-1, 3), rotations.reshape(-1, 4), self._measurements.landmark_position
        )

    def _by_vehicle(self, solution: GraphSolution) -> GraphSolution:
        shape = self._measurements.depth.shape
        position = solution.position.reshape(*shape, 3)
        rotation = solution.quaternion.reshape(*shape, 4)
        return replace(solution, position=position, quaternion=rotation)


def collect_estimates(
    measurements: Measurements, solutions: Sequence[Mapping[str, GraphSolution]]
) -> Estimates:
    """
    Collect the solutions of all realizations in one record.

    Parameters
    ----------
    measurements : Measurements
        Measurements of any realization, for names and times.
    solutions : sequence of mapping of str to Solution
        Results of `solve_conditions`, one for each realization.

    Returns
    -------
    Estimates

    Raises
    ------
    EstimationError
        If there is no realization, or two of them have different conditions.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import collect_estimates, solve_conditions
    >>> estimates = collect_estimates(noisy, [solve_conditions(noisy, ["odometry", "straight"])])
    >>> estimates
    <Estimates: 2 conditions, 1 realization, 2 vehicles, 2 times, 0 landmarks>
    """
    conditions = checked_conditions(solutions)

    def table(attribute: str) -> NDArray[Any]:
        return np.array([[getattr(s[c], attribute) for s in solutions] for c in conditions])

    names = (
        "position quaternion landmark_position iterations initial_cost final_cost expected_cost"
        " gradient_norm"
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


def _adjusted(measurements: Measurements, estimator: Estimator) -> Measurements:
    """Apply an estimator's range sigma and mean of directions to measurements."""
    if estimator.mean_of_directions:
        measurements = _with_mean_of_directions(measurements)
    if isinstance(estimator.range_sigma, float):
        measurements = replace(
            measurements, range_sigma=np.full_like(measurements.range_sigma, estimator.range_sigma)
        )
    return measurements


def _with_mean_of_directions(measurements: Measurements) -> Measurements:
    """
    Replace both ranges of a pair at one ping by their mean; two equal rows then carry half the
    variance.
    """
    ends = np.sort(
        np.stack([measurements.range_transmitter, measurements.range_receiver], axis=1), axis=1
    )
    pair = np.unique(
        np.column_stack([measurements.range_sample, ends]), axis=0, return_inverse=True
    )[1]
    heard = np.isfinite(measurements.refracted_range)

    def mean(ranges: Array) -> Array:
        total = np.bincount(pair[heard], ranges[heard], pair.max(initial=-1) + 1)
        count = np.bincount(pair[heard], minlength=total.size)
        return np.where(heard, (total / np.maximum(count, 1))[pair], ranges)

    return replace(
        measurements,
        refracted_range=mean(measurements.refracted_range),
        straight_range=mean(measurements.straight_range),
    )


def _with_range_sigma(sigma: float, others: UnknownsEstimate | None) -> UnknownsEstimate:
    """
    Estimates with a fitted range sigma [m] as the first, which has neither a prior nor a
    covariance.
    """
    nothing = np.empty(0)
    others = others or UnknownsEstimate((), (), nothing, nothing, np.empty((0, 0)))
    n = others.value.size
    covariance = np.full((n + 1, n + 1), np.nan)
    covariance[1:, 1:] = others.covariance
    return UnknownsEstimate(
        ("range sigma", *others.name),
        ("m", *others.unit),
        np.append(np.nan, others.prior_sigma),
        np.append(sigma, others.value),
        covariance,
    )


def _with_model(
    graph: FactorGraph, measurements: Measurements, estimator: Estimator, start: GraphValues
) -> tuple[FactorGraph, ModelRanges | None]:
    """
    Graph of an estimator and its range model.

    A model with one speed for each link only scales the distances, and so does the sphere in
    solvers that use distances.
    """
    if estimator.model is None:
        return graph, None
    timed = timed_ranges(measurements, estimator.ranges, estimator.links)
    unknown = any(
        prior is not None
        for prior in (estimator.clocks, estimator.scale_sigma, estimator.bias_sigma)
    )
    plain = estimator.uncertainty is None and not unknown
    speed = estimator.model.speed(timed.sound_speed)
    if speed is not None and plain:
        return _with_longer_ranges(graph, speed / timed.sound_speed), None
    if isinstance(estimator.model, OnSphere) and plain and estimator.method.uses_distances:
        position = np.concatenate([start.position, start.landmark_position])
        position[: graph.n_poses, 2] = measurements.depth.ravel()  # dead reckoning has worse depths
        links = timed.links(position[timed.transmitter], position[timed.receiver])
        return _with_longer_ranges(graph, estimator.model.frame_scale(links)), None
    unknowns = None
    if unknown or estimator.model.amplitude_sigma.size:
        unknowns = RangeUnknowns(
            estimator.model,
            timed,
            graph.pose_vehicle,
            graph.vehicle_name.tolist(),
            clocks=estimator.clocks,
            scale_sigma=estimator.scale_sigma,
            bias_sigma=estimator.bias_sigma,
        )
    return graph, ModelRanges(
        estimator.model, timed, estimator.uncertainty, estimator.correlated, unknowns
    )


def _with_longer_ranges(graph: FactorGraph, ratio: Array) -> FactorGraph:
    """Graph with distances and their standard deviations multiplied by a ratio."""
    ranges = graph["range"]
    longer = ranges.with_columns(distance=ratio * ranges.column("distance"))
    return graph.with_factors(
        range=replace(longer, covariance=ratio[:, None, None] ** 2 * ranges.covariance)
    )
