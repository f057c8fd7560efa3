"""One realization under several ranging conditions, and all realizations as one record."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.assemble import CONDITIONS, build_graph, with_ranges
from pymantaray.estimation.dead_reckoning import dead_reckon
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph
from pymantaray.estimation.solve import GraphSolver, Solution
from pymantaray.records import Estimates, Observations, SolveStatus

Array = NDArray[np.float64]


def solve_conditions(
    observations: Observations,
    conditions: Sequence[str],
    initial: tuple[Array, Array] | None = None,
    *,
    solver: GraphSolver | None = None,
) -> dict[str, Solution]:
    """
    Estimate a fleet's trajectories from one realization under each of several ranging conditions.

    Parameters
    ----------
    observations : Observations
        With noise.
    conditions : sequence of str
        Keys of `CONDITIONS`. ``odometry`` is dead reckoning, the others are batch solves.
    initial : tuple of ndarray, optional
        Where the solver starts: positions of shape (n_agents, n_times, 3) [m] and quaternions (w, x, y, z)
        of shape (n_agents, n_times, 4). The paper starts at the truth; the default is dead reckoning.
        Landmarks start at their surveyed positions.
    solver : GraphSolver, optional
        Hand in the same one for all realizations of a process: it keeps what they share.

    Returns
    -------
    dict of str to Solution
        In the order of ``conditions``; arrays of shape ``(n_agents, n_times, ...)``.

    Raises
    ------
    EstimationError
        If a condition is unknown, or for what `build_graph` and `GraphSolver` refuse. A solve that fails
        is no error but has a status.
    """
    unknown = [c for c in conditions if c not in CONDITIONS]
    if unknown:
        raise EstimationError(f"unknown condition {unknown[0]!r}; allowed are {', '.join(CONDITIONS)}")
    o = observations
    solved: dict[str, Solution] = {}
    variants = _variants(o, conditions)
    if variants:
        position, quaternion = dead_reckon(o) if initial is None else initial
        start = GraphValues(
            position=np.asarray(position).reshape(-1, 3),
            quaternion=np.asarray(quaternion).reshape(-1, 4),
            landmark_position=o.landmark_position,
        )
        solved = (solver or GraphSolver()).solve_variants(variants, start)
    out = {}
    for name in conditions:
        if name in solved:
            flat = solved[name]
            out[name] = replace(
                flat,
                position=flat.position.reshape(*o.depth.shape, 3),
                quaternion=flat.quaternion.reshape(*o.depth.shape, 4),
            )
        else:
            out[name] = _reckoned(o)
    return out


def collect_estimates(observations: Observations, solutions: Sequence[Mapping[str, Solution]]) -> Estimates:
    """
    Put the solutions of all realizations into one record.

    Parameters
    ----------
    observations : Observations
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
        name=observations.name,
        time=observations.time,
        landmark_name=observations.landmark_name,
        position=table("position"),
        quaternion=table("quaternion"),
        landmark_position=table("landmark_position"),
        solve_status=table("status"),
        iterations=table("iterations"),
        initial_cost=table("initial_cost"),
        final_cost=table("final_cost"),
        expected_cost=table("expected_cost"),
        gradient_norm=table("gradient_norm"),
    )


def _variants(o: Observations, conditions: Sequence[str]) -> dict[str, tuple[FactorGraph, bool]]:
    variants: dict[str, tuple[FactorGraph, bool]] = {}
    base = None
    for name in conditions:
        c = CONDITIONS[name]
        if c.dead_reckoned:
            continue
        if base is None:
            base = graph = build_graph(o, c.ranges, c.links)
        else:
            graph = with_ranges(base, o, c.ranges, c.links)
            check_graph(graph)
        variants[name] = (graph, c.model_is_right)
    return variants


def _reckoned(o: Observations) -> Solution:
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
    )
