"""Ranges under a robust loss, and descent by re-weighted steps with a line search."""

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation._gtsam.optimize import optimize
from pymantaray.estimation._gtsam.vector_factor import ExpandedRanges
from pymantaray.estimation.gate import Progress, SolveOptions
from pymantaray.estimation.graph import FactorGraph
from pymantaray.estimation.losses import Loss

Array = NDArray[np.float64]
_LONGEST = 64.0  # times the step that the re-weighted system asks for
_SHORTEST = 1e-4
_POLISH = 50  # full steps at most
_MIN_WEIGHT = 1e-12  # of an expanded range; less would leave its rows without digits


def m_estimator(loss: Loss) -> Any:
    """
    GTSAM's object of a loss.

    Parameters
    ----------
    loss : Loss

    Returns
    -------
    gtsam.noiseModel.mEstimator.Base
    """
    kinds = gtsam.noiseModel.mEstimator
    create: dict[str, Any] = {
        "huber": kinds.Huber.Create,
        "cauchy": kinds.Cauchy.Create,
        "geman-mcclure": kinds.GemanMcClure.Create,
    }
    return create[loss.kind](loss.scale)


def robust_factors(builder: Any, base: Any, graph: FactorGraph, loss: Loss | None) -> Any:
    """
    A graph that shares the factors of ``base`` and has the ranges of ``graph`` under a loss.

    Parameters
    ----------
    builder : FactorBuilder
    base : gtsam.NonlinearFactorGraph
    graph : FactorGraph
    loss : Loss or None
        None for least squares.

    Returns
    -------
    gtsam.NonlinearFactorGraph
        Factors in the order in which ``builder`` puts them.
    """
    plain = builder.with_ranges(base, graph)
    if loss is None:
        return plain
    out, robust = gtsam.NonlinearFactorGraph(), m_estimator(loss)
    out.push_back(base)
    models: dict[float, Any] = {}
    for i, variance in enumerate(graph.range_variance.tolist(), start=base.size()):
        model = models.get(variance)
        if model is None:
            gaussian = gtsam.noiseModel.Diagonal.Sigmas(np.array([np.sqrt(variance)]))
            models[variance] = model = gtsam.noiseModel.Robust.Create(robust, gaussian)
        out.add(plain.at(i).cloneWithNewNoiseModel(model))
    return out


class RobustExpandedRanges(ExpandedRanges):
    """
    Travel times expanded about one place, each under a loss; for `descend` as a graph of factors is.

    Parameters
    ----------
    loss : Loss
        Of the whitened residual of each range; the covariances of the epochs have to be diagonal.
    *arguments
        As `ExpandedRanges` takes them; ``stock`` gives factors under the same loss.
    """

    def __init__(self, loss: Loss, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._loss = loss

    def error(self, values: Any) -> float:
        """
        Cost at values.

        Parameters
        ----------
        values : gtsam.Values

        Returns
        -------
        float
        """
        cost = sum(float(self._loss.cost(u).sum()) for u in self.whitened(values))
        return self._error_without_ranges(values) + cost

    def linearize(self, values: Any) -> Any:
        """
        Linear system at values, ranges weighted as the loss has it there.

        Parameters
        ----------
        values : gtsam.Values

        Returns
        -------
        gtsam.GaussianFactorGraph
        """
        weighted = []
        for t, u in zip(self._terms, self.whitened(values), strict=True):
            weight = np.maximum(self._loss.weight(u), _MIN_WEIGHT)
            weighted.append(t._replace(root=t.root / np.sqrt(weight)))
        same = ExpandedRanges.__new__(ExpandedRanges)
        same.__dict__.update(self.__dict__, _terms=weighted)
        return same.linearize(values)

    def whitened(self, values: Any) -> list[Array]:
        """
        Residuals in their standard deviations, epoch by epoch.

        Parameters
        ----------
        values : gtsam.Values

        Returns
        -------
        list of ndarray
            [-]
        """
        residual, _, _ = self._at(values)
        return [residual[t.rows] / np.diagonal(t.root) for t in self._terms]


def descend(graph: Any, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Any, Progress]:
    """
    Minimize the cost of a graph with robust losses.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph or RobustExpandedRanges
    initial : gtsam.Values
    ordering : gtsam.Ordering
    options : SolveOptions
        ``max_iterations`` as they are.

    Returns
    -------
    values : gtsam.Values
        Where it ended.
    progress : Progress
        Its last step, gradient and decrement are those of the system that is re-weighted at the end, of which
        the gradient is the robust cost's own.

    Notes
    -----
    The step is the solution of the linear system with each range weighted as its loss has it at the estimate
    (iteratively re-weighted least squares). It always points downhill, but is too short wherever the losses are
    flatter than their weights say, so that full steps creep; and too long where rotations turn far. A line search
    doubles or halves it, and the cost falls in every step.
    """
    progress, values = descend_steps(graph, initial, ordering, options)
    if progress.singular or not np.isfinite(progress.final_cost):
        return values, progress
    # one full step more proves convergence or the want of it; some more where costs no longer differ, but steps do
    end, proof = optimize(graph, values, ordering, replace(options, max_iterations=_POLISH))
    if not proof.final_cost <= proof.initial_cost + 1e-9 * (1.0 + proof.initial_cost):
        end, proof = values, replace(proof, final_cost=proof.initial_cost, last_step=np.nan)
    return end, replace(
        proof, iterations=progress.iterations + proof.iterations, initial_cost=progress.initial_cost
    )


def descend_steps(graph: Any, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Progress, Any]:
    """
    Take steps as `descend` does, without its proof at the end.

    Parameters
    ----------
    graph, initial, ordering, options
        As in `descend`.

    Returns
    -------
    progress : Progress
        Without gradient and decrement.
    values : gtsam.Values
    """
    values, cost = initial, float(graph.error(initial))
    progress = Progress(iterations=0, initial_cost=cost, final_cost=cost)
    for iteration in range(1, options.max_iterations + 1):
        linear = graph.linearize(values)
        try:
            step = linear.eliminateSequential(ordering).optimize()
        except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
            return replace(progress, singular=True), values
        found, lower = _along(graph, values, step, cost)
        if found is None:
            break
        values, cost = found, lower
        largest = float(np.abs(step.vector()).max())
        progress = replace(progress, iterations=iteration, final_cost=cost, last_step=largest)
        if largest <= options.step_tolerance:
            break
    return progress, values


def _along(graph: Any, values: Any, step: Any, cost: float) -> tuple[Any, float]:
    """Values of lowest cost among multiples of a step that are powers of two; None if none lowers it."""
    factor, best = 1.0, values.retract(step)
    lowest = float(graph.error(best))
    if lowest < cost:
        while factor < _LONGEST:
            factor *= 2.0
            trial = values.retract(step.scale(factor))
            trial_cost = float(graph.error(trial))
            if not trial_cost < lowest:
                break
            best, lowest = trial, trial_cost
        return best, lowest
    while factor > _SHORTEST:
        factor *= 0.5
        trial = values.retract(step.scale(factor))
        trial_cost = float(graph.error(trial))
        if trial_cost < cost:
            return trial, trial_cost
    return None, cost
