"""
Starting values: dead reckoning over odometry or a graph's edges, chordal initialization, and
anchors of free parts.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import (
    FactorGraph,
    GraphValues,
    connected_parts,
    joined_parts,
)
from pymantaray.estimation.solvers.normal_equations import symmetric_factor
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix
from pymantaray.records import Measurements

ANCHOR_SIGMA = 1e-3  # m and rad; of the prior of a part that nothing ties to the world
_GOLDEN_ANGLE = 2.399963  # rad; directions by it are far from each other
_LEAST_WEIGHT = 1e-12  # of the largest weight in chordal initialization
_LOOP_CLOSURE_WEIGHT = 1e9  # weight of an edge other than odometry, which has weight 1


def dead_reckon(measurements: Measurements) -> tuple[Array, Array]:
    """
    Dead-reckon trajectories by odometry alone, from the mean of each vehicle's first-pose prior.

    Parameters
    ----------
    measurements : Measurements

    Returns
    -------
    position : ndarray, shape (n_vehicles, n_times, 3)
        North, east, down in the local frame. [m]
    quaternion : ndarray, shape (n_vehicles, n_times, 4)
        Rotation body to world, (w, x, y, z) with w >= 0.

    Raises
    ------
    EstimationError
        If a vehicle has no first-pose prior or an odometry edge is not finite.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import dead_reckon
    >>> position, quaternion = dead_reckon(noisy)
    >>> print(np.linalg.norm(position - truth.position, axis=-1).round(1))
    [[ 0.2 15.2]
     [ 0.2 13.6]]
    """
    for what, values in (
        (
            "first-pose prior",
            np.concatenate([measurements.first_position, measurements.first_quaternion], axis=1),
        ),
        (
            "odometry",
            np.concatenate(
                [measurements.odometry_rotation, measurements.odometry_translation], axis=2
            ),
        ),
    ):
        fine = np.isfinite(values).reshape(measurements.name.size, -1).all(axis=1)
        if not fine.all():
            raise EstimationError(
                f"vehicle {measurements.name[np.argmin(fine)]}: {what} is not finite; dead"
                " reckoning needs all of it"
            )
    n_vehicles, n_times = measurements.depth.shape
    step = matrix_from_quaternion(measurements.odometry_rotation)
    rotation = np.empty((n_times, n_vehicles, 3, 3))
    rotation[0] = matrix_from_quaternion(measurements.first_quaternion)
    for k in range(n_times - 1):
        np.matmul(rotation[k], step[:, k], out=rotation[k + 1])
    displacement = np.einsum("taij,atj->ati", rotation[:-1], measurements.odometry_translation)
    position = np.concatenate([measurements.first_position[:, None], displacement], axis=1).cumsum(
        axis=1
    )
    return position, quaternion_from_matrix(np.swapaxes(rotation, 0, 1))


class StartingValues(NamedTuple):
    """
    Starting values, and the variables that keep their earlier values because only ranges constrain
    them.
    """

    values: GraphValues
    unchanged: Indices


def dead_reckon_graph(
    graph: FactorGraph, values: GraphValues, *, rng: np.random.Generator | None = None
) -> StartingValues:
    """
    Compose the edges of a graph from its pose priors.

    The path to a pose starts at the nearest prior and has as few edges other than odometry as
    possible, then as few edges as possible. A landmark has the position of its prior, else of its
    first sighting. The first pose of a chain without a prior, and landmarks without prior and
    sighting, keep their ``values``. A random generator selects random paths instead.
    """
    n = graph.n_poses
    prior = graph["prior"]
    edge = graph["edge"]
    at_prior = np.unique(prior.subject)
    ends = edge.variables.astype(int)
    first = first_of_chains(graph)
    parent, order, tree_edge = _shortest_tree(graph, np.concatenate([at_prior, first]), rng)
    position = np.array(values.position)
    rotation = matrix_from_quaternion(values.quaternion)
    position[prior.subject] = prior.column("position")
    rotation[prior.subject] = matrix_from_quaternion(prior.column("quaternion"))
    rotation_step = matrix_from_quaternion(edge.column("quaternion"))
    translation_step = edge.column("position")
    for pose in order:
        before = parent[pose]
        if before == n:
            continue
        k = tree_edge[before, pose]
        if ends[k, 0] == before:
            position[pose] = position[before] + rotation[before] @ translation_step[k]
            rotation[pose] = rotation[before] @ rotation_step[k]
        else:
            rotation[pose] = rotation[before] @ rotation_step[k].T
            position[pose] = position[before] - rotation[pose] @ translation_step[k]
    landmark = np.array(values.landmark_position)
    sightings = graph.of_ends(("pose", "landmark"))
    surveys = graph.of_ends(("landmark",))
    for sighting in (table[::-1] for table in reversed(sightings)):  # so that the first is kept
        pose, landmark_of = sighting.variables.T
        translation_step = np.einsum("nij,nj->ni", rotation[pose], sighting.column("position"))
        landmark[landmark_of - n] = position[pose] + translation_step
    for survey in reversed(surveys):
        landmark[survey.subject - n] = survey.column("position")
    reckoned = GraphValues(
        position=position, quaternion=quaternion_from_matrix(rotation), landmark_position=landmark
    )
    located = np.concatenate([table.variables[:, -1] for table in (*sightings, *surveys)])
    unseen = np.setdiff1d(np.arange(n, graph.n_variables), located)
    return StartingValues(reckoned, np.concatenate([first, unseen]))


def separated(graph: FactorGraph, values: GraphValues) -> GraphValues:
    """
    Values without ranges between ends at one place, where a distance has no derivative and a solve
    would stay: the second end moves horizontally by a thousandth of the measured distance.
    """
    ranges = graph["range"]
    first, second = ranges.variables.T
    position = np.concatenate([values.position, values.landmark_position])
    rows = np.flatnonzero((position[first] == position[second]).all(axis=1))
    if not rows.size:
        return values
    angle = _GOLDEN_ANGLE * np.arange(rows.size)  # several ranges of one end differ in direction
    step = 1e-3 * ranges.column("distance")[rows]
    np.add.at(
        position,
        second[rows],
        step[:, None] * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1),
    )
    n = graph.n_poses
    return GraphValues(position[:n], values.quaternion, position[n:])


def chordal(graph: FactorGraph, values: GraphValues) -> StartingValues:
    """
    Chordal initialization: linear least squares of all rotations, then of all positions.

    Rotations are first solved as unconstrained matrices and then projected to the nearest
    rotations. The first pose of a chain without a prior, and landmarks that only ranges constrain,
    keep their ``values``. GTSAM's `InitializePose3` does the same for edges alone.
    """
    n = graph.n_poses
    prior = graph["prior"]
    edge = graph["edge"]
    sightings = graph.of_ends(("pose", "landmark"))
    first = first_of_chains(graph)
    # rotations: linear least squares of all nine entries, then the nearest rotations
    rotation_step = matrix_from_quaternion(edge.column("quaternion"))
    known = np.concatenate([prior.column("quaternion"), values.quaternion[first]])
    at = np.concatenate([prior.subject, first])
    transposed = np.swapaxes(matrix_from_quaternion(known), 1, 2)
    of_edge, of_prior = (1.0 / table.variance[:, :3].mean(axis=1) for table in (edge, prior))
    matrix = _linear(
        edge.variables,
        np.swapaxes(rotation_step, 1, 2),
        of_edge,
        at,
        transposed,
        np.append(of_prior, np.ones(first.size)),
        n,
    )
    left, _, right = np.linalg.svd(np.swapaxes(matrix, 1, 2))
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    rotation = left @ right

    # positions: linear least squares with these rotations
    translation_step = np.concatenate([table.column("position") for table in (edge, *sightings)])
    ends = np.concatenate([table.variables for table in (edge, *sightings)])
    weight = np.concatenate(
        [1.0 / table.variance[:, -3:].mean(axis=1) for table in (edge, *sightings)]
    )
    anchors = [
        table
        for table in graph.of_ends(("pose",), ("landmark",))
        if "position" in table.kind.columns_at and not table.kind.is_partial
    ]
    at = np.concatenate([table.subject for table in anchors])
    position = np.concatenate([table.column("position") for table in anchors])
    anchor_weight = np.concatenate([1.0 / table.variance[:, -3:].mean(axis=1) for table in anchors])
    # a part of the graph without an anchor stays at its first variable
    loose = _first_of_parts(graph.n_variables, ends, at)
    every = np.concatenate([values.position, values.landmark_position])
    displacement = np.einsum("nij,nj->ni", rotation[ends[:, 0]], translation_step)
    positions = _linear(
        ends,
        np.ones((len(ends), 1, 1)),
        weight,
        np.concatenate([at, loose]),
        np.concatenate([position, every[loose]])[:, None],
        np.append(anchor_weight, np.ones(loose.size)),
        graph.n_variables,
        displacement[:, None],
    )[:, 0]
    # a planar graph has no depth and no other axis
    quaternion = quaternion_from_matrix(rotation)
    if graph.planar:
        positions[:, 2] = 0.0
        quaternion[:, 1:3] = 0.0
    unit = quaternion / np.linalg.norm(quaternion, axis=1)[:, None]
    unchanged = np.union1d(first, loose)
    return StartingValues(GraphValues(positions[:n], unit, positions[n:]), unchanged)


def _linear(
    ends: Indices,
    rotation: Array,
    weight: Array,
    at: Indices,
    known: Array,
    known_weight: Array,
    size: int,
    step: Array | float = 0.0,
) -> Array:
    """
    Solve linear least squares of ``X_b - rotation X_a - step`` over pairs (a, b) and of ``X_i -
    known`` for blocks X (size, k, 3).

    ``rotation`` has shape (n, k, k); ``step`` and ``known`` have shape (n, k, 3). Weights below
    ``_LEAST_WEIGHT`` of the largest one are raised to it: rounding of the normal equations would
    make them singular.
    """
    k = rotation.shape[1]
    n = len(ends)
    least = _LEAST_WEIGHT * max(weight.max(initial=0.0), known_weight.max(initial=0.0))
    weight = np.maximum(weight, least)
    known_weight = np.maximum(known_weight, least)
    row, column = np.indices((k, k)).reshape(2, -1)
    rows = k * np.arange(n)[:, None]
    root = np.sqrt(weight)
    unit = np.arange(k)
    entries = [
        (rows + row, k * ends[:, :1] + column, (-root[:, None, None] * rotation).reshape(n, k * k)),
        (rows + unit, k * ends[:, 1:] + unit, np.repeat(root[:, None], k, axis=1)),
    ]
    entries.append(
        (
            k * (n + np.arange(len(at)))[:, None] + unit,
            k * at[:, None] + unit,
            np.repeat(np.sqrt(known_weight)[:, None], k, axis=1),
        )
    )
    i, j, value = (np.concatenate([entry[c].ravel() for entry in entries]) for c in range(3))
    a = coo_array((value, (i, j)), shape=(k * (n + len(at)), k * size)).tocsr()
    right = np.concatenate(
        [
            np.broadcast_to(root[:, None, None] * step, (n, k, 3)),
            np.sqrt(known_weight)[:, None, None] * known,
        ]
    ).reshape(-1, 3)
    return np.asarray(symmetric_factor((a.T @ a).tocsc()).solve(a.T @ right)).reshape(size, k, 3)


def first_of_chains(graph: FactorGraph) -> Indices:
    """First pose of each chain of edges without a pose prior."""
    return _first_of_parts(graph.n_poses, graph["edge"].variables, graph["prior"].subject)


def _first_of_parts(size: int, ends: Indices, known: Indices) -> Indices:
    """First variable of each set that pairs (n, 2) connect, for sets without known variables."""
    part = joined_parts(size, ends)
    first = np.unique(part, return_index=True)[1]
    return np.asarray(first[~np.isin(part[first], part[known])])


def anchor_loose_parts(
    graph: FactorGraph, values: GraphValues
) -> tuple[FactorGraph, NDArray[np.int32]]:
    """
    Add a prior at the first pose of each part that nothing ties to the world; return these poses,
    too.

    The prior has the mean of ``values`` and `ANCHOR_SIGMA` on each axis. A part without poses gets
    none.
    """
    part, loose = connected_parts(graph)
    n = graph.n_poses
    first = np.unique(part[:n], return_index=True)[1]
    poses = np.sort(first[loose[:n][first]]).astype(np.int32)
    anchors = graph["prior"].kind.table(
        poses,
        [values.position[poses], values.quaternion[poses]],
        np.tile(ANCHOR_SIGMA**2 * np.eye(6), (poses.size, 1, 1)),
    )
    return graph.with_factors(prior=graph["prior"].append(anchors)), poses


def _shortest_tree(
    graph: FactorGraph, starts: Indices, rng: np.random.Generator | None
) -> tuple[list[int], list[int], dict[tuple[int, int], int]]:
    """
    Shortest paths from the starts: the predecessor of each pose (n_poses at a start), the order of
    poses, and edge rows.

    The edge rows are indexed by pairs of poses, in both directions. A generator gives edges random
    lengths.
    """
    n = graph.n_poses
    ends = graph["edge"].variables.astype(int)
    vehicle = graph.pose_vehicle.astype(int)[ends]
    number = graph.pose_number.astype(int)[ends]
    next_one = (vehicle[:, 0] == vehicle[:, 1]) & (np.abs(number[:, 0] - number[:, 1]) == 1)
    weight = (
        np.where(next_one, 1.0, _LOOP_CLOSURE_WEIGHT)
        if rng is None
        else 1e-6 + rng.exponential(size=len(ends))
    )
    tree_edge: dict[tuple[int, int], int] = {}
    for k in np.argsort(weight, kind="stable").tolist():
        a, b = ends[k].tolist()
        tree_edge.setdefault((a, b), k)
        tree_edge.setdefault((b, a), k)
    pairs = np.array(list(tree_edge), dtype=int).reshape(-1, 2)
    tail = np.concatenate([pairs[:, 0], np.full(starts.size, n)])
    head = np.concatenate([pairs[:, 1], starts])
    length = np.concatenate([weight[list(tree_edge.values())], np.ones(starts.size)])
    links = coo_array((length, (tail, head)), shape=(n + 1, n + 1)).tocsr()
    far, parent = dijkstra(links, directed=True, indices=np.array([n]), return_predecessors=True)
    return parent[0].tolist(), np.argsort(far[0, :n], kind="stable").tolist(), tree_edge
