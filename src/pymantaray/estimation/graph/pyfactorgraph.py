"""Graphs as PyFactorGraph reads them: isotropic covariances, and a form of depths that it keeps."""

from dataclasses import replace

import numpy as np

from pymantaray.arrays import Array, Mask
from pymantaray.estimation.graph.graph import KINDS, FactorGraph, Factors, GraphValues

ABOVE = 5e8
"""Height above the sea surface of the landmark that ranges give depths to. [m]"""
ABOVE_VARIANCE = 1e-6
"""Variance of its prior on each axis. [m2]"""


def isotropic(graph: FactorGraph, *, keep_depths: bool) -> tuple[FactorGraph, int]:
    """
    Replace all covariances by isotropic ones, as PyFactorGraph's reader does [1]_.

    Parameters
    ----------
    graph : FactorGraph
    keep_depths : bool
        True if the file has depths as ranges.

    Returns
    -------
    graph : FactorGraph
        Graph whose translations and rotations have the mean of their variances on each axis,
        without covariances.
    lost : int
        Number of depths as pose priors, which PyFactorGraph reads as priors of all axes with a
        precision of about 1e-12: none.

    Notes
    -----
    The reader keeps two numbers of a covariance: the precision 3 / tr of the translation, and 3 /
    (2 tr) of the rotation. In three dimensions an information matrix has twice the latter on its
    diagonal, so the variance is the mean. In the plane the precisions are 2 / tr and the inverse of
    the variance.

    References
    ----------
    .. [1] PyFactorGraph, ``py_factor_graph/utils/matrix_utils.py``, functions
       get_measurement_precisions_from_covariance_matrix and
       get_info_matrix_from_measurement_precisions,
       https://github.com/MarineRoboticsGroup/PyFactorGraph
    """
    tables = {name: table for name, table in graph.tables.items() if len(table)}
    depths = {
        name: table[:0] for name, table in tables.items() if table.kind.is_depth and not keep_depths
    }
    others = {
        name: _isotropic(table, planar=graph.planar)
        for name, table in tables.items()
        if name not in depths
    }
    return graph.with_factors(**others, **depths), sum(len(tables[name]) for name in depths)


def _isotropic(factors: Factors, *, planar: bool) -> Factors:
    """Factors with one variance of the rotation and one of the position."""
    kind = factors.kind
    diagonal = np.diagonal(factors.covariance, axis1=1, axis2=2).copy()
    for unit in ("rad", "m"):
        if rows := kind.rows_in(unit, planar=planar):
            diagonal[:, rows] = diagonal[:, rows].mean(axis=1, keepdims=True)
    columns = [factors.measurement[:, span] for span in kind.columns_at.values()]
    return kind.table(factors.variables, columns, diagonal[:, :, None] * np.eye(kind.rows))


def depths_from_above(depths: Factors, values: GraphValues) -> tuple[Array, Array]:
    """
    Distances (n, 1) of depths from a landmark `ABOVE` the frame's centre, and their variances.

    A range has its direction at the values, and so a small part of the horizontal position: an
    error of 100 m in the values shifts the depth of a vehicle 10 km from the centre by 2 mm.
    """
    below = depths.column("depth") + ABOVE
    across = np.square(values.position[depths.subject, :2]).sum(axis=1)
    distance = below + across / (below + np.sqrt(np.square(below) + across))
    return distance[:, None], depths.covariance


def is_above(position: Array) -> Mask:
    """True for each position (n, 3) of the landmark of `depths_from_above`."""
    return np.asarray((position == [0.0, 0.0, -ABOVE]).all(axis=1))


def with_depths(graph: FactorGraph, values: GraphValues) -> tuple[FactorGraph, GraphValues]:
    """
    Replace the ranges of `depths_from_above` by the depths, within 1e-7 m, and remove their
    landmark.
    """
    above = np.flatnonzero(is_above(values.landmark_position))
    landmark = graph.n_poses + int(above[0]) if above.size == 1 else -1
    to_it = {
        name: (table.variables == landmark).any(axis=1) for name, table in graph.tables.items()
    }
    ranges = graph["range"][to_it["range"]]
    pose = ranges.variables[:, 0]
    others = [rows.any() for name, rows in to_it.items() if name not in ("range", "survey")]
    if landmark < 0 or any(others) or (pose >= graph.n_poses).any():
        return graph, values
    distance = ranges.column("distance")
    across = np.square(values.position[pose, :2]).sum(axis=1)
    if (np.square(distance) <= across).any():  # no depth: the file is of another program
        return graph, values
    tables: dict[str, Factors] = {}
    for name, table in graph.tables.items():
        ends = table.variables - (table.variables > landmark)
        tables[name] = replace(table, variables=ends.astype(np.int32))[~to_it[name]]
    below = distance - across / (distance + np.sqrt(np.square(distance) - across))
    depths = KINDS["depth"].table(pose, [below - ABOVE], ranges.covariance)
    tables["depth"] = tables["depth"].append(depths)
    names = np.delete(graph.landmark_name, above)
    return replace(graph, landmark_name=names, factors=tables), replace(
        values, landmark_position=np.delete(values.landmark_position, above, axis=0)
    )
