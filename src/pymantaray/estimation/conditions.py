"""One realization under several ranging conditions, and all realizations as one record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.assemble import (
    CONDITIONS,
    Condition,
    Links,
    Ranges,
    build_graph,
    timed_ranges,
    with_ranges,
)
from pymantaray.estimation.covariance import reckoned_covariances
from pymantaray.estimation.dead_reckoning import dead_reckon
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.range_models import (
    ConstantSpeed,
    RangeModel,
    TransmitterSpeed,
    TravelTimeUncertainty,
)
from pymantaray.estimation.range_weights import BelievedRanges
from pymantaray.estimation.solution import Solution, Variant
from pymantaray.estimation.solve import GraphSolver
from pymantaray.estimation.unknowns import AdjustableModel, ClockPrior, Unknowns
from pymantaray.records import Estimates, Measurements, SolveStatus

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimator:
    """
    One more way to estimate from the same measurements, beside the conditions.

    Parameters
    ----------
    ranges, links : str
        As in `build_graph`.
    model : RangeModel
        What is believed of a range. One speed for a link makes a distance of it; other models take outer iterations.
    uncertainty : TravelTimeUncertainty, optional
        Adds to the variance of the ranges.
    correlated : bool
        Whether its covariances count too, between the links of an epoch.
    initial : tuple of ndarray, optional
        Where the solver starts, as in `solve_conditions`; the default is dead reckoning.
    model_is_right : bool
        Whether the final cost has to lie within its chi-square bounds.
    loss : Loss, optional
        Of the ranges, in place of least squares.
    incremental : bool
        Whether the factors are replayed in the order of time.
    clocks : ClockPrior, optional
        Offset and skew of all clocks are then estimated with the poses, as amplitudes are if the model is an
        `AdjustableModel`.
    """

    ranges: Ranges
    links: Links
    model: RangeModel
    uncertainty: TravelTimeUncertainty | None = None
    correlated: bool = False
    initial: tuple[Array, Array] | None = None
    model_is_right: bool = False
    loss: Loss | None = None
    incremental: bool = False
    clocks: ClockPrior | None = None


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
        Where the solver starts: positions of shape (n_agents, n_times, 3) [m] and quaternions (w, x, y, z)
        of shape (n_agents, n_times, 4). The paper starts at the truth; the default is dead reckoning.
        Landmarks start at their surveyed positions.
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
        If a condition is unknown, an estimator has the name of one, or for what `build_graph` and `GraphSolver` refuse. A solve that fails
        is no error but has a status.
    """
    unknown = [c for c in conditions if c not in CONDITIONS]
    if unknown:
        raise EstimationError(f"unknown condition {unknown[0]!r}; allowed are {', '.join(CONDITIONS)}")
    more = dict(estimators or {})
    taken = [name for name in more if name in CONDITIONS]
    if taken:
        raise EstimationError(f"estimator {taken[0]!r} has the name of a condition; give it another")
    o = measurements
    solved: dict[str, Solution] = {}
    variants = _variants(o, conditions, more)
    if variants:
        reckoned = (
            dead_reckon(o) if initial is None or any(e.initial is None for e in more.values()) else None
        )
        for name, e in more.items():
            start = reckoned if e.initial is None else e.initial
            variants[name] = variants[name]._replace(initial=_values(o, start or dead_reckon(o)))
        first = _values(o, initial or reckoned or dead_reckon(o))
        poses = None
        if covariance_samples is not None:
            poses = np.arange(o.depth.size).reshape(o.depth.shape)[:, covariance_samples].T
        solved = (solver or GraphSolver()).solve_variants(variants, first, covariance_poses=poses)
    out = {}
    for name in [*conditions, *more]:
        if name in solved:
            flat = solved[name]
            out[name] = replace(
                flat,
                position=flat.position.reshape(*o.depth.shape, 3),
                quaternion=flat.quaternion.reshape(*o.depth.shape, 4),
            )
        else:
            out[name] = _reckoned(o, covariance_samples)
    return out


def collect_estimates(measurements: Measurements, solutions: Sequence[Mapping[str, Solution]]) -> Estimates:
    """
    Put the solutions of all realizations into one record.

    Parameters
    ----------
    measurements : Measurements
        Of any realization: gives names and times.
    solutions : sequence of mapping of str to Solution
        What `solve_conditions` returned, one for each realization, all with the same conditions.

    Returns
    -------
    Estimates

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

    return Estimates(
        condition=np.array(conditions),
        realization=np.arange(len(solutions)),
        name=measurements.name,
        time=measurements.time,
        landmark_name=measurements.landmark_name,
        position=table("position"),
        quaternion=table("quaternion"),
        landmark_position=table("landmark_position"),
        solve_status=table("status"),
        iterations=table("iterations"),
        initial_cost=table("initial_cost"),
        final_cost=table("final_cost"),
        expected_cost=table("expected_cost"),
        gradient_norm=table("gradient_norm"),
        gated_links=table("gated_links"),
    )


def _variants(
    o: Measurements, conditions: Sequence[str], estimators: Mapping[str, Estimator]
) -> dict[str, Variant]:
    wanted: list[tuple[str, Condition | Estimator]] = [
        (name, CONDITIONS[name]) for name in conditions if not CONDITIONS[name].dead_reckoned
    ]
    variants: dict[str, Variant] = {}
    base = None
    for name, c in [*wanted, *estimators.items()]:
        if base is None:
            base = graph = build_graph(o, c.ranges, c.links)
        else:
            graph = with_ranges(base, o, c.ranges, c.links)
            check_graph(graph)
        believed = None
        if isinstance(c, Estimator):
            graph, believed = _believed(graph, o, c)
        variants[name] = Variant(graph, c.model_is_right, believed)
        if isinstance(c, Estimator):
            variants[name] = variants[name]._replace(loss=c.loss, incremental=c.incremental)
    return variants


def _believed(graph: FactorGraph, o: Measurements, e: Estimator) -> tuple[FactorGraph, BelievedRanges | None]:
    """Graph of an estimator; one speed for each link makes its ranges distances, and nothing is left to believe."""
    timed = timed_ranges(o, e.ranges, e.links)
    plain = e.uncertainty is None and e.clocks is None
    if isinstance(e.model, ConstantSpeed | TransmitterSpeed) and plain:
        ratio = e.model.speed(timed.sound_speed) / timed.sound_speed
        scaled = replace(
            graph,
            range_distance=ratio * graph.range_distance,
            range_variance=ratio**2 * graph.range_variance,
        )
        return scaled, None
    unknowns = None
    if e.clocks is not None or isinstance(e.model, AdjustableModel):
        unknowns = Unknowns(e.model, timed, graph.pose_agent, graph.agent_name.tolist(), clocks=e.clocks)
    return graph, BelievedRanges(e.model, timed, e.uncertainty, e.correlated, unknowns)


def _values(o: Measurements, start: tuple[Array, Array]) -> GraphValues:
    return GraphValues(
        position=np.asarray(start[0]).reshape(-1, 3),
        quaternion=np.asarray(start[1]).reshape(-1, 4),
        landmark_position=o.landmark_position,
    )


def _reckoned(o: Measurements, samples: NDArray[np.intp] | None) -> Solution:
    position, quaternion = dead_reckon(o)
    return Solution(
        position=position,
        quaternion=quaternion,
        landmark_position=o.landmark_position,
        status=SolveStatus.OK,
        iterations=0,
        initial_cost=np.nan,
        final_cost=np.nan,
        expected_cost=np.nan,
        gradient_norm=np.nan,
        covariances=None if samples is None else reckoned_covariances(o, samples),
    )
