"""Where to start on a graph of any origin: dead reckoning over its edges, and anchors for what floats."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from pymantaray.estimation.graph import FactorGraph, GraphValues, parts
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix

Array = NDArray[np.float64]

_JUMP = 1e9  # weight of an edge that is not from one pose to the next of its vehicle, which has 1


def dead_reckon_graph(graph: FactorGraph, values: GraphValues) -> tuple[GraphValues, int]:
    """
    Values that the edges of a graph give when composed from its pose priors.

    Parameters
    ----------
    graph : FactorGraph
    values : GraphValues
        Taken where the graph itself has nothing to start from: the first pose of a chain that has no pose
        prior, and a landmark that has none.

    Returns
    -------
    reckoned : GraphValues
    taken : int
        How many variables are as ``values`` has them.

    Notes
    -----
    A pose is reached from the nearest prior over the fewest edges that are not odometry (one pose to the next
    of a vehicle, either way), and over the fewest edges among these. Ranges and fixes are not used.
    """
    n = graph.n_poses
    root = n  # one more node, tied to each pose that a chain starts from
    at_prior = np.unique(graph.prior_pose)
    ends = (graph.edge_from.astype(int), graph.edge_to.astype(int))
    _, chain = connected_components(coo_array((np.ones(ends[0].size), ends), shape=(n, n)), directed=False)
    first = np.unique(chain, return_index=True)[1]
    first = first[~np.isin(chain[first], chain[at_prior])]
    starts = np.concatenate([at_prior, first])
    agent, number = graph.pose_agent.astype(int), graph.pose_number.astype(int)
    next_one = (agent[ends[0]] == agent[ends[1]]) & (np.abs(number[ends[0]] - number[ends[1]]) == 1)
    weight = np.where(next_one, 1.0, _JUMP)
    tree_edge = _edge_index(ends, weight)
    links = coo_array(
        (
            np.concatenate([weight[list(tree_edge.values())], np.ones(starts.size)]),
            (
                np.concatenate([[a for a, _ in tree_edge], np.full(starts.size, root)]).astype(int),
                np.concatenate([[b for _, b in tree_edge], starts]).astype(int),
            ),
        ),
        shape=(n + 1, n + 1),
    ).tocsr()
    far, parent = dijkstra(links, directed=True, indices=np.array([root]), return_predecessors=True)
    far, parent = far[0], parent[0]
    position, rotation = np.array(values.position), matrix_from_quaternion(values.quaternion)
    position[graph.prior_pose] = graph.prior_position
    rotation[graph.prior_pose] = matrix_from_quaternion(graph.prior_quaternion)
    turn = matrix_from_quaternion(graph.edge_quaternion)
    for pose in np.argsort(far[:n], kind="stable").tolist():
        before = int(parent[pose])
        if before == root:
            continue
        k = tree_edge[before, pose]
        if ends[0][k] == before:
            position[pose] = position[before] + rotation[before] @ graph.edge_translation[k]
            rotation[pose] = rotation[before] @ turn[k]
        else:
            rotation[pose] = rotation[before] @ turn[k].T
            position[pose] = position[before] - rotation[pose] @ graph.edge_translation[k]
    landmark = np.array(values.landmark_position)
    landmark[graph.survey_landmark] = graph.survey_position
    reckoned = GraphValues(
        position=position, quaternion=quaternion_from_matrix(rotation), landmark_position=landmark
    )
    return reckoned, int(first.size + landmark.shape[0] - np.unique(graph.survey_landmark).size)


def anchor_loose_parts(
    graph: FactorGraph, values: GraphValues, *, sigma: float = 1e-3
) -> tuple[FactorGraph, NDArray[np.int32]]:
    """
    Give a prior to one pose of each part of a graph that nothing ties to the world.

    Parameters
    ----------
    graph : FactorGraph
    values : GraphValues
        The prior is where this has the pose.
    sigma : float
        Standard deviation of the prior on each axis. [m, rad]

    Returns
    -------
    anchored : FactorGraph
    poses : ndarray of int
        The first pose of each such part, which now has a prior; a part without poses gets none.
    """
    part, loose = parts(graph)
    n = graph.n_poses
    first = np.unique(part[:n], return_index=True)[1]
    poses = np.sort(first[loose[:n][first]]).astype(np.int32)
    anchored = replace(
        graph,
        prior_pose=np.concatenate([graph.prior_pose, poses]),
        prior_position=np.concatenate([graph.prior_position, values.position[poses]]),
        prior_quaternion=np.concatenate([graph.prior_quaternion, values.quaternion[poses]]),
        prior_covariance=np.concatenate(
            [graph.prior_covariance, np.tile(sigma**2 * np.eye(6), (poses.size, 1, 1))]
        ),
    )
    return anchored, poses


def _edge_index(ends: tuple[NDArray[np.int_], NDArray[np.int_]], weight: Array) -> dict[tuple[int, int], int]:
    """For each ordered pair of poses that an edge joins, either way, the row of the first lightest edge."""
    index: dict[tuple[int, int], int] = {}
    for k in np.argsort(weight, kind="stable").tolist():
        a, b = int(ends[0][k]), int(ends[1][k])
        index.setdefault((a, b), k)
        index.setdefault((b, a), k)
    return index
