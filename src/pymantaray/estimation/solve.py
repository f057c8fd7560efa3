"""Batch solves of factor graphs, each passed through the health gate; gtsam is loaded at first use."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.covariance import EpochCovariances, factor_covariances
from pymantaray.estimation.diagnose import diagnose
from pymantaray.estimation.gate import Progress, SolveOptions, gate
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.outer import Outcome, iterate, solve_vector_factors, unknowns_at
from pymantaray.estimation.range_weights import BelievedRanges
from pymantaray.estimation.robust import minimize_robust, robust_solution
from pymantaray.estimation.unknowns import UnknownsEstimate
from pymantaray.records import SolveStatus

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solution:
    """
    Values that a solve ended with, and its health; the values are NaN unless ``usable``.

    Fields mean what they mean in `Estimates`; ``position`` and ``quaternion`` have one row for each pose
    of the graph, or the shape ``(n_agents, n_times, ...)`` where `solve_conditions` returns them. Of a solve
    with a range model, ``gated_links`` counts the ranges that the believed ocean does not allow in the end, and
    ``expansions`` the times that the model was asked and the graph solved.
    """

    position: Array
    quaternion: Array
    landmark_position: Array
    status: SolveStatus
    iterations: int
    initial_cost: float
    final_cost: float
    expected_cost: float
    gradient_norm: float
    gated_links: int = 0
    expansions: int = 0
    covariances: EpochCovariances | None = None
    """At the epochs asked for; None if none were, or the values are not usable."""
    unknowns: UnknownsEstimate | None = None
    """What the ranges share, if anything was to be estimated of it and the values are usable."""
    diagnosis: str | None = None
    """From `GraphSolver.solve`, of values that are not usable: what is singular or badly conditioned, if anything is."""

    @property
    def usable(self) -> bool:
        """Whether the values are a converged optimum."""
        return self.status in {SolveStatus.OK, SolveStatus.OVER_CHI_SQUARE}


class Variant(NamedTuple):
    """One of several graphs that differ in their ranges only, and how it is to be solved."""

    graph: FactorGraph
    model_is_right: bool
    believed: BelievedRanges | None = None
    """What is believed of its ranges; None takes them as the distances that the graph has."""
    initial: GraphValues | None = None
    """Where to start if not where all do."""
    loss: Loss | None = None
    """Of the ranges; None is least squares."""
    incremental: bool = False
    """Whether the factors are replayed in the order of time; only for ranges as distances."""
    vector_factors: bool = False
    """Whether what is believed is solved by nonlinear factors that ask the model, in place of outer iterations."""


class GraphSolver:
    """
    Solves factor graphs; keeps noise models, orderings and starting values that successive graphs share.

    One solver belongs to one process. Results do not depend on what it has solved before.

    Parameters
    ----------
    options : SolveOptions
    """

    def __init__(self, options: SolveOptions | None = None) -> None:
        from pymantaray.estimation._gtsam.factors import FactorBuilder

        self.options = options or SolveOptions()
        self._builder = FactorBuilder()

    def solve(
        self,
        graph: FactorGraph,
        initial: GraphValues,
        *,
        model_is_right: bool = True,
        believed: BelievedRanges | None = None,
        vector_factors: bool = False,
    ) -> Solution:
        """
        Solve one graph.

        Parameters
        ----------
        graph : FactorGraph
        initial : GraphValues
            Where to start.
        model_is_right : bool
            Whether the final cost has to lie within its chi-square bounds.
        believed : BelievedRanges, optional
            Range model and what was measured, for outer iterations. By default the graph's ranges are distances.
        vector_factors : bool
            Solve with nonlinear factors that ask the model at every evaluation instead, one for each ping. Slow: the
            check of the outer iterations.

        Returns
        -------
        Solution
            If not usable, with its ``diagnosis``: one line that names a variable.

        Raises
        ------
        EstimationError
            If a measurement or a noise level of the graph cannot be used, or the starting point does not
            fit the graph or is not finite, or what is believed is of other ranges.
        """
        check_graph(graph)
        check_values(graph, initial)
        solution = self.solve_variants(
            {"": Variant(graph, model_is_right, believed, vector_factors=vector_factors)},
            initial,
        )[""]
        return solution if solution.usable else replace(solution, diagnosis=diagnose(graph, initial))

    def solve_variants(
        self,
        graphs: Mapping[str, Variant | tuple[FactorGraph, bool]],
        initial: GraphValues,
        *,
        covariance_poses: NDArray[np.intp] | None = None,
    ) -> dict[str, Solution]:
        """
        Solve graphs that differ in nothing but their ranges; the common part is built once.

        Parameters
        ----------
        graphs : mapping of str to Variant
            Graphs that pass `check_graph`, and whether the model is right in each.
        initial : GraphValues
            Where to start, for all that have no start of their own.
        covariance_poses : ndarray of int, shape (n_epochs, n_agents), optional
            Poses whose covariances are wanted. By default none are computed; a replay and a robust loss have none.

        Returns
        -------
        dict of str to Solution

        Raises
        ------
        EstimationError
            If a starting point does not fit the graphs or is not finite.
        """
        from pymantaray.estimation._gtsam.optimize import optimize

        solutions: dict[str, Solution] = {}
        common = None
        for name, given in graphs.items():
            variant = Variant(*given)
            graph = variant.graph
            start = initial if variant.initial is None else variant.initial
            if common is None:
                _check_initial(graph, initial)
                common = self._builder.base(graph)
            if variant.initial is not None:
                _check_initial(graph, start)
            factors: Any = None
            first_range: int | None = common.size()
            if variant.incremental:
                from pymantaray.estimation.incremental import (
                    replay,
                )  # takes Solution from here

                if variant.believed is not None:
                    raise EstimationError(
                        "a replay takes ranges as distances; choose constant or transmitter"
                    )
                solutions[name] = replay(graph, start, loss=variant.loss).solution
            elif variant.believed is None and variant.loss is not None:
                values, progress = minimize_robust(
                    self._builder, common, graph, variant.loss, start, self.options
                )
                solutions[name] = self._solution(variant, start, values, progress)
            elif variant.believed is None:
                factors = self._builder.with_ranges(common, graph)
                values, progress = optimize(
                    factors,
                    self._builder.values(start),
                    self._builder.ordering(graph, factors),
                    self.options,
                )
                solutions[name] = self._solution(variant, start, values, progress)
            else:
                problem = (
                    self._builder,
                    common,
                    graph,
                    variant.believed,
                    start,
                    self.options,
                )
                if variant.vector_factors:
                    end = solve_vector_factors(*problem)
                else:
                    end = iterate(*problem, loss=variant.loss)
                gated = int(np.count_nonzero(~end.possible))
                solutions[name] = replace(
                    self._solution(variant, start, end.values, end.progress, gated),
                    gated_links=gated,
                    expansions=end.expansions,
                )
                if solutions[name].usable:
                    solutions[name] = replace(solutions[name], unknowns=_unknowns(variant, end))
                if variant.loss is None:
                    factors, values = end.factors, end.values
                if variant.vector_factors:
                    first_range = None  # there the ranges come first
            if covariance_poses is not None and factors is not None and solutions[name].usable:
                found = factor_covariances(factors, values, graph, covariance_poses, first_range)
                solutions[name] = replace(solutions[name], covariances=found)
        return solutions

    def _solution(
        self,
        variant: Variant,
        initial: GraphValues,
        values: object,
        progress: Progress,
        gated: int = 0,
    ) -> Solution:
        """Values and verdict of one solve."""
        from pymantaray.estimation._gtsam.factors import to_graph_values

        if variant.loss is not None:
            return robust_solution(to_graph_values(values, initial), progress, self.options)
        freedom = variant.graph.degrees_of_freedom - gated
        status = gate(progress, freedom, self.options, model_is_right=variant.model_is_right)
        found = to_graph_values(values, initial)
        mask = 1.0 if status in {SolveStatus.OK, SolveStatus.OVER_CHI_SQUARE} else np.nan
        return Solution(
            position=found.position * mask,
            quaternion=found.quaternion * mask,
            landmark_position=found.landmark_position * mask,
            status=status,
            iterations=progress.iterations,
            initial_cost=progress.initial_cost,
            final_cost=progress.final_cost,
            expected_cost=freedom / 2.0,
            gradient_norm=progress.gradient_norm,
        )


def _unknowns(variant: Variant, end: Outcome) -> UnknownsEstimate | None:
    """What was found of the unknowns, in their units."""
    unknowns = None if variant.believed is None else variant.believed.unknowns
    if unknowns is None or end.shared is None:
        return None
    from pymantaray.estimation._gtsam.marginals import vector_marginal

    sigma = unknowns.sigma
    covariance = np.full((sigma.size, sigma.size), np.nan)
    if variant.loss is None:
        covariance = sigma[:, None] * vector_marginal(end.factors, end.values, end.shared) * sigma
    value = sigma * unknowns_at(end.values, end.shared)
    return UnknownsEstimate(unknowns.name, unknowns.unit, sigma, value, covariance)


def _check_initial(graph: FactorGraph, initial: GraphValues) -> None:
    found = initial.position.shape[0], initial.landmark_position.shape[0]
    needed = graph.n_poses, graph.landmark_name.size
    if found != needed:
        raise EstimationError(
            f"starting point has {found[0]} poses and {found[1]} landmarks; the graph has {needed[0]} and {needed[1]}"
        )
    fine = np.concatenate(
        [
            np.isfinite(initial.position).all(axis=1) & np.isfinite(initial.quaternion).all(axis=1),
            np.isfinite(initial.landmark_position).all(axis=1),
        ]
    )
    if not fine.all():
        name = graph.variable_name(int(np.argmin(fine)))
        raise EstimationError(f"{name}: starting point is not finite; needs a position and a unit quaternion")
