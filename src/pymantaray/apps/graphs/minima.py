"""
Search for the lowest minimum of a graph's cost: several starts, mirrored landmarks, random starts.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from pymantaray.apps.graphs.chordal_problem import ChordalProblem
from pymantaray.apps.graphs.staircase import can_relax, relax, rounded
from pymantaray.arrays import Array, Indices
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.solvers.descents import finish, lowest, same_cost
from pymantaray.estimation.solvers.problems import Distances, FactorsExceptRanges, GraphState
from pymantaray.estimation.solvers.solution import GraphSolution
from pymantaray.estimation.solvers.starts import (
    StartingValues,
    chordal,
    dead_reckon_graph,
    first_of_chains,
)
from pymantaray.estimation.solvers.trilateration import (
    range_only_landmarks,
    trilaterate,
    with_landmarks,
)
from pymantaray.geometry import stream

SolveFrom = Callable[[GraphValues, float], GraphSolution]
"""Solve from some values, unless the descent is certain to stay above a cost."""

_SAME_POSITION = 1e-3  # of the extent of all positions; smaller differences are of one minimum
# of the extent, and of quaternions; files with six digits differ less from composed edges
_SAME_START = 1e-4
_PLAUSIBLE = 0.95  # quantile of chi-square within which a second minimum is plausible, too
_MAX_MIRRORED = 64  # solves from mirrored landmarks


@dataclass(frozen=True, eq=False)
class StartOutcome:
    """
    Solution from one start.

    ``unchanged`` lists the variables that start at the file's values in spite of another start,
    because only ranges constrain them.
    """

    name: str
    initial: GraphValues
    unchanged: Indices
    solution: GraphSolution

    @property
    def cost(self) -> float:
        """Final cost, also of a descent that did not converge; infinite if the solve failed."""
        return self.solution.cost

    @property
    def converged(self) -> bool:
        """True if the solution is a converged optimum."""
        return self.solution.usable


def search_minima(
    graph: FactorGraph,
    values: GraphValues,
    solve: SolveFrom,
    *,
    random_starts: int = 0,
    seed: int = 0,
    first: str = "file",
) -> list[StartOutcome]:
    """
    Solve a graph from several starts; results are in the order of the solves.

    The starts are the given values (``first`` is their name), composed edges, chordal
    initialization, trilateration of range-only landmarks, random starts, the relaxation from the
    lowest of these unless that is certified, and then the lowest of all with one landmark after the
    other at its mirrored positions. The descent of the lowest one is continued if it has not
    converged.

    Solves begin with the start of lowest cost. A descent may end early if it falls too slowly to
    reach a plausible cost. Equal starts have one solution.
    """
    starts = list(_starts(graph, values, random_starts, seed, first=first))
    outcomes = _solve_all(graph, starts, solve)
    _finish(outcomes, solve)
    outcomes += _relaxed(graph, lowest(outcomes), solve)
    _finish(outcomes, solve)
    outcomes += _mirrored(graph, lowest(outcomes), solve)
    _finish(outcomes, solve)
    return outcomes


def _solve_all(
    graph: FactorGraph, starts: list[tuple[str, StartingValues]], solve: SolveFrom
) -> list[StartOutcome]:
    """Outcome of each start, in their order."""
    factors = FactorsExceptRanges(graph)
    ranges = Distances(graph)

    def cost(row: int) -> float:
        state = GraphState.of(starts[row][1].values)
        return factors.cost(state) + ranges.cost(state, None)

    done: dict[int, StartOutcome] = {}
    for row in sorted(range(len(starts)), key=cost):
        name, start = starts[row]
        equal = (o.solution for o in done.values() if _same_start(o.initial, start.values))
        solution = next(equal, None)
        if solution is None:
            solution = solve(start.values, _plausible_cost(graph, done.values()))
        done[row] = StartOutcome(name, start.values, start.unchanged, solution)
    return [done[row] for row in range(len(starts))]


def _finish(outcomes: list[StartOutcome], solve: SolveFrom) -> None:
    """Finish the descent of the lowest outcome, in place."""
    best = lowest(outcomes)

    def further(outcome: StartOutcome) -> StartOutcome:
        again = solve(outcome.solution.values, np.inf)
        return replace(outcome, solution=outcome.solution.append(again))

    outcomes[outcomes.index(best)] = finish(best, further)


def plausible_alternative(
    graph: FactorGraph, outcomes: Sequence[StartOutcome]
) -> StartOutcome | None:
    """
    Lowest other minimum whose cost is within chi-square of the lowest one; None if there is none.

    Twice the difference of the costs, a log-likelihood ratio, is compared with the 95 % quantile of
    chi-square with the degrees of freedom of one position.
    """
    best = lowest(outcomes)
    limit = _plausible_cost(graph, outcomes)
    others = [
        o for o in outcomes if o.solution.usable and o.cost <= limit and not same_minimum(best, o)
    ]
    return min(others, key=lambda o: o.cost) if others else None


def _plausible_cost(graph: FactorGraph, outcomes: Collection[StartOutcome]) -> float:
    """Largest plausible cost of a second minimum; infinite without outcomes."""
    cost = min((outcome.cost for outcome in outcomes), default=np.inf)
    return cost + 0.5 * float(chdtri(2 if graph.planar else 3, 1.0 - _PLAUSIBLE))


def same_minimum(one: StartOutcome, other: StartOutcome) -> bool:
    """True if two solutions have equal costs and positions."""
    if not same_cost(one.cost, other.cost):
        return False
    a = _positions(one.solution.values)
    b = _positions(other.solution.values)
    extent = float(np.linalg.norm(np.ptp(a, axis=0)))
    return float(np.abs(a - b).max(initial=0.0)) <= _SAME_POSITION * extent


def _same_start(one: GraphValues, other: GraphValues) -> bool:
    """True if a solve from one start is one from the other, except for rounding."""
    a = _positions(one)
    extent = float(np.linalg.norm(np.ptp(a, axis=0)))
    sign = np.where(np.sum(one.quaternion * other.quaternion, axis=1) < 0.0, -1.0, 1.0)
    turn = np.abs(one.quaternion - sign[:, None] * other.quaternion).max(initial=0.0)
    far = np.abs(a - _positions(other)).max(initial=0.0)
    return bool(turn <= _SAME_START and far <= _SAME_START * extent)


def largest_difference(
    graph: FactorGraph, one: StartOutcome, other: StartOutcome
) -> tuple[str, float]:
    """Name of the variable whose positions in two solutions differ most, and the distance [m]."""
    far = np.linalg.norm(
        _positions(one.solution.values) - _positions(other.solution.values), axis=1
    )
    return graph.variable_name(int(far.argmax())), float(far.max())


def _positions(values: GraphValues) -> Array:
    return np.concatenate([values.position, values.landmark_position])


def _starts(
    graph: FactorGraph, values: GraphValues, random_starts: int, seed: int, *, first: str
) -> Iterator[tuple[str, StartingValues]]:
    none = np.empty(0, dtype=np.intp)
    yield first, StartingValues(values, none)
    composed = dead_reckon_graph(graph, values)
    yield "dead-reckoning", composed
    if len(graph["edge"]):
        composed = chordal(graph, values)
        if first != "chordal":
            yield "chordal", composed
    solutions = trilaterate(graph, composed.values)
    if solutions:
        nearest = {landmark: found[0] for landmark, found in solutions.items()}
        unchanged = np.setdiff1d(composed.unchanged, list(nearest))
        yield (
            "trilateration",
            StartingValues(with_landmarks(graph, composed.values, nearest), unchanged),
        )
    for k in range(random_starts):
        rng = stream(seed, k, "estimation", "random start")
        yield f"random-{k + 1}", StartingValues(random_start(graph, composed.values, rng), none)


def random_start(graph: FactorGraph, values: GraphValues, rng: np.random.Generator) -> GraphValues:
    """
    Random values: noisy edges, composed along a random tree from the priors.

    A chain without a prior gets a random first pose within the spread of all positions, and a
    range-only landmark a random position at its measured distance from one of the poses.
    """
    n = graph.n_poses
    edge = graph["edge"]
    every = _positions(values)
    position = np.array(values.position)
    quaternion = np.array(values.quaternion)
    first = first_of_chains(graph)
    position[first] = every.mean(axis=0) + every.std(axis=0) * rng.standard_normal((first.size, 3))
    quaternion[first] = _quaternions(
        Rotation.from_rotvec(_rotations(rng, first.size, planar=graph.planar))
    )
    noise = np.sqrt(edge.variance) * rng.standard_normal((len(edge), 6))
    if graph.planar:
        noise[:, [0, 1, 5]] = 0.0
        position[first, 2] = 0.0
    measured = Rotation.from_quat(edge.column("quaternion")[:, [1, 2, 3, 0]]) if len(edge) else None
    if measured is not None:
        turned = _quaternions(measured * Rotation.from_rotvec(noise[:, :3]))
        edge = edge.with_columns(position=edge.column("position") + noise[:, 3:], quaternion=turned)
    start = replace(values, position=position, quaternion=quaternion)
    composed = dead_reckon_graph(graph.with_factors(edge=edge), start, rng=rng).values
    ranges = graph["range"]
    landmarks = {}
    for landmark in range_only_landmarks(graph).tolist():
        rows = np.flatnonzero((ranges.variables[:, 1] == landmark) & (ranges.variables[:, 0] < n))
        if rows.size:
            row = int(rng.choice(rows))
            direction = rng.standard_normal(3) * ([1.0, 1.0, 0.0] if graph.planar else 1.0)
            step = ranges.column("distance")[row] * direction / np.linalg.norm(direction)
            landmarks[landmark] = composed.position[ranges.variables[row, 0]] + step
    return with_landmarks(graph, composed, landmarks)


def _rotations(rng: np.random.Generator, size: int, *, planar: bool) -> Array:
    """Rotation vectors of uniformly distributed rotations."""
    if planar:
        return np.column_stack([np.zeros((size, 2)), rng.uniform(-np.pi, np.pi, size)])
    quaternion = rng.standard_normal((size, 4))
    return np.asarray(Rotation.from_quat(quaternion).as_rotvec()) if size else np.empty((0, 3))


def _quaternions(rotation: Rotation) -> Array:
    """Quaternions (w, x, y, z)."""
    return np.asarray(rotation.as_quat())[:, [3, 0, 1, 2]]


def _relaxed(graph: FactorGraph, best: StartOutcome, solve: SolveFrom) -> list[StartOutcome]:
    """
    Outcome from the minimum of the relaxation; none if it is the minimum already found, or the
    graph has no relaxation.
    """
    if not can_relax(graph):
        return []
    values = best.solution.values if best.cost < np.inf else best.initial
    problem = ChordalProblem(graph)
    relaxation = relax(problem, problem.matrix(values))
    if relaxation.tight and best.solution.usable:
        return []
    start = rounded(problem, relaxation.point, values)
    solution = solve(start, _plausible_cost(graph, [best]))
    return [StartOutcome("relaxation", start, np.empty(0, dtype=np.intp), solution)]


def _mirrored(graph: FactorGraph, best: StartOutcome, solve: SolveFrom) -> list[StartOutcome]:
    """
    Outcomes with one landmark after the other at its other solutions, each from the lowest minimum
    so far.
    """
    outcomes: list[StartOutcome] = []
    landmarks = range_only_landmarks(graph).tolist() if best.cost < np.inf else []
    lower = True
    while lower:
        lower = False
        for landmark in landmarks:
            values = best.solution.values
            at = values.landmark_position[landmark - graph.n_poses]
            found = sorted(
                trilaterate(graph, values, [landmark]).get(landmark, []),
                key=lambda x: float(np.linalg.norm(x - at)),
            )
            for position in found[1:]:
                if len(outcomes) == _MAX_MIRRORED:
                    return outcomes
                start = with_landmarks(graph, values, {landmark: position})
                name = f"mirrored-{graph.variable_name(landmark)}"
                solution = solve(start, _plausible_cost(graph, [best]))
                outcomes.append(StartOutcome(name, start, np.empty(0, dtype=np.intp), solution))
                if lowest([best, outcomes[-1]]) is not best:
                    best = outcomes[-1]
                    lower = True
    return outcomes
