"""Outer iterations: travel times of a range model, expanded about the estimate and expanded again where it moved."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.assemble import TimedRanges
from pymantaray.estimation.expansion import Expansion, chord
from pymantaray.estimation.gate import Progress, SolveOptions
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.range_models import Prediction, RangeLinks
from pymantaray.estimation.range_weights import BelievedRanges, RangeWeights, cost_of_ranges

Array = NDArray[np.float64]
_CORRECTION = 1e-3  # m; a range that a new prediction moves by less has settled
_FIRST_TOLERANCE = 0.1  # m; the first expansion is left early, for the next one is better
_MOST = 25  # expansions
_RETURNS = 2  # a link gated so many times stays gated
_PATIENT = 8  # expansions after which links that are still corrected are gated
_RESTLESS, _FEW = (
    0.3,
    0.05,
)  # of the largest correction, for smaller ones follow from it; and of the links at a time


@dataclass(frozen=True, eq=False)
class Outcome:
    """End of the outer iterations."""

    values: Any
    progress: Progress
    possible: NDArray[np.bool_]
    """Whether each range was used; the others were gated."""
    expansions: int
    factors: Any
    """What has its optimum at the values, the ranges last; for covariances."""
    shared: int | None = None
    """Key of the unknowns that ranges share."""


def iterate(
    builder: Any,
    common: Any,
    graph: FactorGraph,
    believed: BelievedRanges,
    initial: GraphValues,
    options: SolveOptions,
    *,
    loss: Loss | None = None,
) -> Outcome:
    """
    Minimize the cost of a graph whose ranges are a model's.

    Parameters
    ----------
    builder : FactorBuilder
    common : gtsam.NonlinearFactorGraph
        All factors of the graph but its ranges.
    graph : FactorGraph
    believed : BelievedRanges
    initial : GraphValues
    options : SolveOptions

    Returns
    -------
    Outcome
        If the expansions do not settle the last step of its progress is NaN, which no gate passes.

    Raises
    ------
    EstimationError
        If the measured ranges are not those of the graph.

    Notes
    -----
    The model is asked at the estimate, the travel times are expanded there (`Expansion`), the graph is solved, and
    so on until a new prediction moves no range by more than 1 mm. A link that is not possible at an estimate is
    gated until the next one; one that was gated twice stays gated, so that the set of links settles. So are, after 8 expansions,
    those that are corrected most: their first arrival is now of one family of rays, now of another.
    Variances that depend on the rays are computed again where an end has moved by more than 100 m.
    """
    from pymantaray.estimation._gtsam.graduated import minimize_expanded
    from pymantaray.estimation._gtsam.robust import RobustExpandedRanges
    from pymantaray.estimation._gtsam.vector_factor import ExpandedRanges, epoch_terms, positions

    r, n = believed.ranges, graph.n_poses
    _check_rows(graph, r)
    if loss is not None and believed.correlated:
        raise EstimationError(
            "a robust loss on correlated ranges: each has a loss of its own; leave one of them out"
        )
    values, ordering, shared = _start(builder, common, graph, believed, initial)
    start, every = values, np.arange(r.time.size)
    keys, at = np.unique(np.concatenate([r.transmitter, r.receiver]), return_inverse=True)
    weights = RangeWeights(believed, graph.range_variance)
    used, gated = np.ones(r.time.size, dtype=bool), np.zeros(r.time.size, dtype=int)
    expansion: Expansion | None = None
    first: tuple[Prediction, Array] | None = None
    progress = Progress(iterations=0, initial_cost=np.nan, final_cost=np.nan)
    iterations, settled, tight, count = 0, False, False, 0
    while True:
        place = positions(values, keys, n)
        a, b, u = place[at[: r.time.size]], place[at[r.time.size :]], unknowns_at(values, shared)
        if expansion is not None and tight and expansion.is_good_at(a, b, u):
            settled = True
            break
        if count == _MOST:
            break
        links = RangeLinks(r.time, a, b, r.sound_speed)
        found, by_unknowns = believed.predict(links, every, u)
        gated += used & ~found.possible
        before, used = used, found.possible & (gated < _RETURNS)
        residual = r.sound_speed * (np.where(found.possible, found.travel_time, 0.0) - r.travel_time)
        if first is None:
            first = found, residual
        if expansion is not None:
            off = np.where(used & before, np.abs(residual - expansion(a, b, u)[0]), 0.0)
            largest = float(off.max(initial=0.0))
            if tight and np.array_equal(used, before) and largest <= _CORRECTION:
                settled = True
                break
            if count >= _PATIENT and largest > _CORRECTION:
                restless = off >= _RESTLESS * largest
                if np.count_nonzero(restless) <= _FEW * np.count_nonzero(used):
                    gated[restless], used = _RETURNS, used & ~restless
        expansion = Expansion(found, links, r.travel_time, u, by_unknowns)
        terms = epoch_terms(r, weights.blocks(links, used))
        stock = _stock(builder, common, graph, used, chord(a, b)[0] - residual, loss)
        parts = (common, stock, terms, n, expansion, (r.transmitter, r.receiver), shared)
        tolerance = options.step_tolerance if count else max(options.step_tolerance, _FIRST_TOLERANCE)
        rough = replace(options, step_tolerance=tolerance)
        values, progress = minimize_expanded(parts, loss, values, ordering, rough, first=count == 0)
        iterations, count, tight = (
            iterations + progress.iterations,
            count + 1,
            count > 0,
        )
        if progress.singular or not np.isfinite(progress.final_cost):
            break
    assert first is not None  # the loop ran once at least
    assert expansion is not None
    # the starting cost of the links used in the end; those not possible at the start count as they end
    end, _, _ = expansion(a, b, u)
    comparable = np.where(first[0].possible, first[1], end)
    initial_cost = float(common.error(start)) + cost_of_ranges(weights.kept(used), comparable, loss)
    progress = replace(progress, iterations=iterations, initial_cost=initial_cost)
    if not settled:
        progress = replace(progress, last_step=np.nan)
    factors = ExpandedRanges(*parts) if loss is None else RobustExpandedRanges(loss, *parts)
    return Outcome(values, progress, used, count, factors, shared)


def solve_vector_factors(
    builder: Any,
    common: Any,
    graph: FactorGraph,
    believed: BelievedRanges,
    initial: GraphValues,
    options: SolveOptions,
) -> Outcome:
    """
    Minimize the same cost with nonlinear factors that ask the model at every evaluation.

    Slower than `iterate` many times over, and independent of its expansions: its check.

    Parameters
    ----------
    builder, common, graph, believed, initial, options
        As in `iterate`. Variances that depend on the rays are those of the start.

    Returns
    -------
    Outcome
    """
    from pymantaray.estimation._gtsam.optimize import optimize
    from pymantaray.estimation._gtsam.vector_factor import (
        epoch_terms,
        positions,
        vector_factors,
    )

    r, n = believed.ranges, graph.n_poses
    _check_rows(graph, r)
    values, ordering, shared = _start(builder, common, graph, believed, initial)

    def links_at(values: Any) -> RangeLinks:
        a, b = (positions(values, ends, n) for ends in (r.transmitter, r.receiver))
        return RangeLinks(r.time, a, b, r.sound_speed)

    every = np.ones(r.time.size, dtype=bool)
    terms = epoch_terms(r, RangeWeights(believed, graph.range_variance).blocks(links_at(values), every))
    factors = vector_factors(believed, terms, n, shared)
    factors.push_back(common)
    values, progress = optimize(factors, values, ordering, options)
    found, _ = believed.predict(links_at(values), np.arange(r.time.size), unknowns_at(values, shared))
    return Outcome(values, progress, found.possible, 1, factors, shared)


def unknowns_at(values: Any, shared: int | None) -> Array:
    """
    Value of the unknowns that ranges share.

    Parameters
    ----------
    values : gtsam.Values
    shared : int or None
        Their key; None if there are none.

    Returns
    -------
    ndarray, shape (n_unknowns,)
        In their standard deviations. [-]
    """
    return np.empty(0) if shared is None else np.array(values.atVector(shared), dtype=float)


def _start(
    builder: Any, common: Any, graph: FactorGraph, believed: BelievedRanges, initial: GraphValues
) -> tuple[Any, Any, int | None]:
    """Starting values, ordering, and the key of the unknowns, which start at zero and are eliminated last."""
    values = builder.values(initial)
    ordering = builder.ordering(graph, builder.with_ranges(common, graph))
    if believed.unknowns is None:
        return values, ordering, None
    from pymantaray.estimation._gtsam.factors import with_shared

    shared = graph.n_poses + int(graph.landmark_name.size)
    return *with_shared(values, ordering, shared, believed.n_unknowns), shared


def _stock(
    builder: Any,
    common: Any,
    graph: FactorGraph,
    used: NDArray[np.bool_],
    distance: Array,
    loss: Loss | None,
) -> Callable[[], Any]:
    """Graph of stock factors, made only if damped steps are needed."""
    from pymantaray.estimation._gtsam.robust import robust_factors

    return lambda: robust_factors(builder, common, _with_distances(graph, used, distance), loss)


def _with_distances(graph: FactorGraph, used: NDArray[np.bool_], distance: Array) -> FactorGraph:
    return replace(
        graph,
        range_first=graph.range_first[used],
        range_second=graph.range_second[used],
        range_distance=distance[used],
        range_variance=graph.range_variance[used],
    )


def _check_rows(graph: FactorGraph, r: TimedRanges) -> None:
    ends = np.sort(np.stack([r.transmitter, r.receiver], axis=1), axis=1)
    rows = np.sort(np.stack([graph.range_first, graph.range_second], axis=1), axis=1)
    if not np.array_equal(ends, rows):
        raise EstimationError(
            f"{len(ends)} timed ranges do not join the variables of the graph's {len(rows)} ranges; take"
            " both from the same measurements, ranges and links"
        )
