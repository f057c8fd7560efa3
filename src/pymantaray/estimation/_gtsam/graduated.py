"""Graduated non-convexity: from nearly a square to the loss itself, each optimum the start for the next."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pymantaray.estimation._gtsam.optimize import optimize
from pymantaray.estimation._gtsam.robust import RobustExpandedRanges, descend, descend_steps
from pymantaray.estimation._gtsam.vector_factor import ExpandedRanges
from pymantaray.estimation.gate import Progress, SolveOptions
from pymantaray.estimation.losses import Loss

ROBUST_STEPS = 300
"""Least number of steps allowed to a robust solve: re-weighting takes more of them than least squares."""
_STEP = 1.4  # by which the control parameter falls from one surrogate to the next, GTSAM's default
_ROUGH = SolveOptions(step_tolerance=1.0, max_iterations=1)  # of one surrogate
_FIRST = SolveOptions(step_tolerance=1.0)


def minimize(
    factors: Callable[[Loss | None], Any],
    residuals: Callable[[Any], Any],
    loss: Loss,
    initial: Any,
    ordering: Any,
    options: SolveOptions,
) -> tuple[Any, Progress]:
    """
    Minimize the cost of a graph under a loss, by graduated non-convexity if the loss says so.

    Parameters
    ----------
    factors : callable
        Gives the graph with its ranges under a loss, or least squares for None.
    residuals : callable
        Gives the whitened residuals of the ranges at values, in any order. [-]
    loss : Loss
    initial : gtsam.Values
    ordering : gtsam.Ordering
    options : SolveOptions

    Returns
    -------
    values : gtsam.Values
    progress : Progress
        Of the loss itself: its cost at the start and at the end, and the steps of all stages.

    Notes
    -----
    The least-squares optimum comes first; its largest residual r gives the first control parameter
    2 r²/k², for which the surrogate is convex over all residuals. It falls by a factor of 1.4 from one surrogate
    to the next, each descended by one step, until it is 1 and the surrogate the loss, which is then minimized to
    the full tolerance.
    """
    final = factors(loss)
    if not loss.graduated:
        return descend(final, initial, ordering, options)
    progress, values = descend_steps(factors(None), initial, ordering, _FIRST)
    steps = progress.iterations
    largest = float(np.abs(residuals(values)).max(initial=0.0))
    control = 2.0 * (largest / loss.scale) ** 2
    while control > 1.0 and not progress.singular:
        surrogate = factors(replace(loss, scale=loss.scale * np.sqrt(control)))
        progress, values = descend_steps(surrogate, values, ordering, _ROUGH)
        steps += progress.iterations
        control /= _STEP
    values, progress = descend(final, values, ordering, options)
    return values, replace(
        progress, iterations=steps + progress.iterations, initial_cost=float(final.error(initial))
    )


def minimize_expanded(
    parts: tuple[Any, ...],
    loss: Loss | None,
    initial: Any,
    ordering: Any,
    options: SolveOptions,
    *,
    first: bool,
) -> tuple[Any, Progress]:
    """
    Minimize the cost of travel times expanded about one place, under a loss or by least squares.

    Parameters
    ----------
    parts : tuple
        What `ExpandedRanges` is made of.
    loss : Loss or None
    initial : gtsam.Values
    ordering : gtsam.Ordering
    options : SolveOptions
    first : bool
        Whether this is the first expansion; only then is the loss graduated.

    Returns
    -------
    values : gtsam.Values
    progress : Progress
    """
    if loss is None:
        return optimize(ExpandedRanges(*parts), initial, ordering, options)
    under = RobustExpandedRanges(loss, *parts)
    return minimize(
        lambda narrowed: (
            ExpandedRanges(*parts) if narrowed is None else RobustExpandedRanges(narrowed, *parts)
        ),
        lambda values: np.concatenate([np.empty(0), *under.whitened(values)]),
        loss if first else replace(loss, graduated=False),
        initial,
        ordering,
        replace(options, max_iterations=max(options.max_iterations, ROBUST_STEPS)),
    )
