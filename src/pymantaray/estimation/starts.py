"""Where to start: dead reckoning over a fleet's odometry or a graph's edges, and anchors for what floats."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph import FactorGraph, GraphValues, connected_parts
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix
from pymantaray.records import Measurements

Array = NDArray[np.float64]

_JUMP = 1e9  # weight of an edge that is not from one pose to the next of its vehicle, which has 1


def dead_reckon(measurements: Measurements) -> tuple[Array, Array]:
    """
    Trajectories that odometry alone gives, from the mean of each vehicle's first-pose prior.

    Returns
    -------
    position : ndarray, shape (n_agents, n_times, 3)
        North, east, down in the local frame. [m]
    quaternion : ndarray, shape (n_agents, n_times, 4)
        Rotation body to world, (w, x, y, z) with w >= 0.

    Raises
    ------
    EstimationError
        If a vehicle has no first-pose prior or an odometry edge is not finite.
    """
    o = measurements
    for what, values in (
        ("first-pose prior", np.concatenate([o.first_position, o.first_quaternion], axis=1)),
        ("odometry", np.concatenate([o.odometry_rotation, o.odometry_translation], axis=2)),
    ):
        fine = np.isfinite(values).reshape(o.name.size, -1).all(axis=1)
        if not fine.all():
            raise EstimationError(
                f"vehicle {o.name[np.argmin(fine)]}: {what} is not finite; dead reckoning needs all of it"
            )
    n_agents, n_times = o.depth.shape
    step = matrix_from_quaternion(o.odometry_rotation)
    rotation = np.empty((n_times, n_agents, 3, 3))
    rotation[0] = matrix_from_quaternion(o.first_quaternion)
    for k in range(n_times - 1):
        np.matmul(rotation[k], step[:, k], out=rotation[k + 1])
    moved = np.einsum("taij,atj->ati", rotation[:-1], o.odometry_translation)
    position = np.concatenate([o.first_position[:, None], moved], axis=1).cumsum(axis=1)
    return position, quaternion_from_matrix(np.swapaxes(rotation, 0, 1))


def dead_reckon_graph(graph: FactorGraph, values: GraphValues) -> tuple[GraphValues, int]:
    """
    Values that the edges of a graph give when composed from its pose priors, and the count of those taken as they are.

    A pose is reached from the nearest prior over the fewest edges that are not odometry (one pose to the next
    of a vehicle, either way), and over the fewest edges among these. The first pose of a chain without a prior
    and landmarks without one have their ``values``.
    """
    n = graph.n_poses
    prior, edge, survey = graph["prior"], graph["edge"], graph["survey"]
    at_prior = np.unique(prior.subject)
    ends = edge.variables.astype(int)
    links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
    _, chain = connected_components(links, directed=False)
    first = np.unique(chain, return_index=True)[1]
    first = first[~np.isin(chain[first], chain[at_prior])]
    parent, order, tree_edge = _shortest_tree(graph, np.concatenate([at_prior, first]))
    position, rotation = np.array(values.position), matrix_from_quaternion(values.quaternion)
    position[prior.subject] = prior.column("position")
    rotation[prior.subject] = matrix_from_quaternion(prior.column("quaternion"))
    turn, step = matrix_from_quaternion(edge.column("quaternion")), edge.column("position")
    for pose in order:
        before = parent[pose]
        if before == n:
            continue
        k = tree_edge[before, pose]
        if ends[k, 0] == before:
            position[pose] = position[before] + rotation[before] @ step[k]
            rotation[pose] = rotation[before] @ turn[k]
        else:
            rotation[pose] = rotation[before] @ turn[k].T
            position[pose] = position[before] - rotation[pose] @ step[k]
    landmark = np.array(values.landmark_position)
    landmark[survey.subject - n] = survey.column("position")
    reckoned = GraphValues(
        position=position, quaternion=quaternion_from_matrix(rotation), landmark_position=landmark
    )
    return reckoned, int(first.size + landmark.shape[0] - np.unique(survey.subject).size)


def anchor_loose_parts(
    graph: FactorGraph, values: GraphValues, *, sigma: float = 1e-3
) -> tuple[FactorGraph, NDArray[np.int32]]:
    """
    Give a prior, sigma on each axis [m, rad], to the first pose of each part that nothing ties to the world.

    It is where the values have it. Poses that now have one are named beside; a part without poses gets none.
    """
    part, loose = connected_parts(graph)
    n = graph.n_poses
    first = np.unique(part[:n], return_index=True)[1]
    poses = np.sort(first[loose[:n][first]]).astype(np.int32)
    anchors = graph["prior"].kind.table(
        poses,
        [values.position[poses], values.quaternion[poses]],
        np.tile(sigma**2 * np.eye(6), (poses.size, 1, 1)),
    )
    return graph.with_factors(prior=graph["prior"].joined(anchors)), poses


def _shortest_tree(
    graph: FactorGraph, starts: NDArray[np.int_]
) -> tuple[list[int], list[int], dict[tuple[int, int], int]]:
    """
    Shortest ways from the starts: before each pose the one it is reached from (n_poses at a start), and the order.

    Beside, the row of the edge between two poses, either way.
    """
    n = graph.n_poses
    ends = graph["edge"].variables.astype(int)
    agent, number = graph.pose_agent.astype(int)[ends], graph.pose_number.astype(int)[ends]
    next_one = (agent[:, 0] == agent[:, 1]) & (np.abs(number[:, 0] - number[:, 1]) == 1)
    weight = np.where(next_one, 1.0, _JUMP)
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
