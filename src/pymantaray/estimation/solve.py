"""Batch solves of factor graphs, each passed through the health gate; gtsam is loaded at first use."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.gate import SolveOptions, gate
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph
from pymantaray.records import SolveStatus

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solution:
    """
    Values that a solve ended with, and its health; the values are NaN unless ``usable``.

    Fields mean what they mean in `Estimates`; ``position`` and ``quaternion`` have one row for each pose
    of the graph, or the shape ``(n_agents, n_times, ...)`` where `solve_conditions` returns them.
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

    @property
    def usable(self) -> bool:
        """Whether the values are a converged optimum."""
        return self.status in {SolveStatus.OK, SolveStatus.OVER_CHI_SQUARE}


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

    def solve(self, graph: FactorGraph, initial: GraphValues, *, model_is_right: bool = True) -> Solution:
        """
        Solve one graph.

        Parameters
        ----------
        graph : FactorGraph
        initial : GraphValues
            Where to start.
        model_is_right : bool
            Whether the final cost has to lie within its chi-square bounds.

        Returns
        -------
        Solution

        Raises
        ------
        EstimationError
            If a measurement or a noise level of the graph cannot be used, or the starting point does not
            fit the graph or is not finite.
        """
        check_graph(graph)
        return self.solve_variants({"": (graph, model_is_right)}, initial)[""]

    def solve_variants(
        self, graphs: Mapping[str, tuple[FactorGraph, bool]], initial: GraphValues
    ) -> dict[str, Solution]:
        """
        Solve graphs that differ in nothing but their ranges; the common part is built once.

        Parameters
        ----------
        graphs : mapping of str to (FactorGraph, bool)
            Graphs that pass `check_graph`, and whether the model is right in each.
        initial : GraphValues
            Where to start, for all of them.

        Returns
        -------
        dict of str to Solution

        Raises
        ------
        EstimationError
            If the starting point does not fit the graphs or is not finite.
        """
        from pymantaray.estimation._gtsam.factors import to_graph_values
        from pymantaray.estimation._gtsam.optimize import optimize

        solutions: dict[str, Solution] = {}
        common = None
        for name, (graph, model_is_right) in graphs.items():
            if common is None:
                _check_initial(graph, initial)
                common = self._builder.base(graph)
            factors = self._builder.with_ranges(common, graph)
            values, progress = optimize(
                factors, self._builder.values(initial), self._builder.ordering(graph, factors), self.options
            )
            status = gate(progress, graph.degrees_of_freedom, self.options, model_is_right=model_is_right)
            found = to_graph_values(values, initial)
            mask = 1.0 if status in {SolveStatus.OK, SolveStatus.OVER_CHI_SQUARE} else np.nan
            solutions[name] = Solution(
                position=found.position * mask,
                quaternion=found.quaternion * mask,
                landmark_position=found.landmark_position * mask,
                status=status,
                iterations=progress.iterations,
                initial_cost=progress.initial_cost,
                final_cost=progress.final_cost,
                expected_cost=graph.degrees_of_freedom / 2.0,
                gradient_norm=progress.gradient_norm,
            )
        return solutions


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
