"""Graphs as PyFactorGraph reads them: isotropic covariances, and a form of depths that it keeps."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import KINDS, FactorGraph, Factors, GraphValues

ABOVE = 5e8
"""Height above the sea surface of the landmark that ranges give depths to. [m]"""
_SURVEY_SIGMA = 1e-3  # m, of this landmark


def isotropic(graph: FactorGraph) -> tuple[FactorGraph, int]:
    """
    Replace all covariances by isotropic ones, as PyFactorGraph's reader does [1]_.

    Parameters
    ----------
    graph : FactorGraph

    Returns
    -------
    graph : FactorGraph
        Graph whose translations and rotations have the mean of their variances on each axis,
        without covariances.
    lost : int
        Number of depths, which PyFactorGraph reads as priors of all axes with a precision of about
        1e-12: none.

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
    depths = {name: table[:0] for name, table in tables.items() if table.kind.is_depth}
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


class DepthsAsRanges(NamedTuple):
    """Graph whose depths are ranges, and its values."""

    graph: FactorGraph
    values: GraphValues


def depths_as_ranges(graph: FactorGraph, values: GraphValues) -> DepthsAsRanges:
    """
    Replace depths by ranges to one landmark that is 5e8 m above the frame's centre, a form that
    PyFactorGraph keeps.

    Parameters
    ----------
    graph : FactorGraph
    values : GraphValues
        Values of its variables: where a range has its direction, and so also a small part of the
        horizontal position. For a vehicle 10 km from the centre, an error of 100 m in the values
        shifts the depth by 2 mm.

    Returns
    -------
    DepthsAsRanges

    Raises
    ------
    EstimationError
        If the graph is planar, so has no depths.
    """
    if graph.planar:
        raise EstimationError("a planar graph has no depths; leave them as they are")
    depths = {name: table for name, table in graph.tables.items() if table.kind.is_depth}
    pose = np.concatenate([table.subject for table in depths.values()])
    depth = np.concatenate([table.column("depth") for table in depths.values()])
    variance = np.concatenate([table.covariance for table in depths.values()])
    above = np.array([[0.0, 0.0, -ABOVE]])
    from_above = np.column_stack([values.position[pose, :2], depth + ABOVE])
    landmark = np.full(len(pose), graph.n_variables, dtype=np.int32)
    more = KINDS["range"].table(
        np.column_stack([pose, landmark]), [np.linalg.norm(from_above, axis=1)], variance
    )
    survey = KINDS["survey"].table([[graph.n_variables]], [above], [_SURVEY_SIGMA**2 * np.eye(3)])
    names = graph.landmark_name.tolist()
    name = next(f"L{k}" for k in range(len(names) + 1) if f"L{k}" not in names)
    whole = replace(graph, landmark_name=np.array([*names, name])).with_factors(
        **{name: table[:0] for name, table in depths.items()},
        range=graph["range"].append(more),
        survey=graph["survey"].append(survey),
    )
    positions = np.concatenate([values.landmark_position.reshape(-1, 3), above])
    return DepthsAsRanges(whole, replace(values, landmark_position=positions))
