"""Pose graphs as g2o text in three dimensions: poses and edges between them, nothing else."""

from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from pymantaray.errors import EstimationError
from pymantaray.estimation._g2o_reader import SYMBOL_SHIFT, angle_scale, inverse, load_g2o
from pymantaray.estimation._pyfg_words import EDGE, POSE, TO_FILE
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values

__all__ = ["LEFT_OUT", "load_g2o", "write_g2o"]

LEFT_OUT = ("ranges", "landmarks", "landmark priors", "pose priors", "fixes", "depth priors")


def write_g2o(
    graph: FactorGraph,
    path: Path | str,
    *,
    initial: GraphValues,
    leave_out: Collection[str] = (),
    symbols: bool = False,
    half_angles: bool = False,
) -> dict[str, int]:
    """
    Write the poses and edges of a factor graph as g2o text, whole or not at all.

    Parameters
    ----------
    graph : FactorGraph
    path : pathlib.Path or str
        File to make or replace; its folder must exist.
    initial : GraphValues
        Values of the vertices.
    leave_out : collection of str
        What the format cannot hold and the caller agrees to lose, from `LEFT_OUT`.
    symbols : bool
        Number vertices as GTSAM's symbols, which keep vehicle and number (vehicles of one letter only);
        g2o itself cannot read such large numbers. Else by the row of the pose.
    half_angles : bool
        Take the rotation part of the information for that of x, y, z of the quaternion, half the angle, as
        g2o itself does; else for that of the rotation vector, as GTSAM does.

    Returns
    -------
    dict of str to int
        How many of each were left out.

    Raises
    ------
    EstimationError
        If the graph has something that the format cannot hold and ``leave_out`` does not name, or the
        values do not fit the graph.

    Notes
    -----
    ``VERTEX_SE3:QUAT id x y z qx qy qz qw`` and ``EDGE_SE3:QUAT id id x y z qx qy qz qw information``, the
    upper triangle of the 6 x 6 information matrix by rows, translation first [1]_. The rotation
    part is that of x, y, z of the quaternion, says [2]_. GTSAM takes the same numbers for those of the
    rotation vector (checked with 4.3). Times of poses are lost.

    References
    ----------
    .. [1] g2o wiki, "File Format" and "File format slam 3d", https://github.com/RainerKuemmerle/g2o/wiki
    .. [2] g2o issue 699, https://github.com/RainerKuemmerle/g2o/issues/699
    """
    path = Path(path)
    if not set(leave_out) <= set(LEFT_OUT):
        raise EstimationError(f"{path}: leave out {sorted(leave_out)}; allowed: {', '.join(LEFT_OUT)}")
    check_graph(graph)
    check_values(graph, initial)
    sizes = (
        graph.range_first.size,
        graph.landmark_name.size,
        graph.survey_landmark.size,
        graph.prior_pose.size,
        graph.fix_pose.size,
        graph.depth_pose.size,
    )
    lost = {what: int(n) for what, n in zip(LEFT_OUT, sizes, strict=True) if n}
    refused = [f"{n} {what}" for what, n in lost.items() if what not in leave_out]
    if refused:
        raise EstimationError(
            f"{path}: g2o files hold poses and edges between them; the graph has {', '.join(refused)} besides:"
            " agree to leave them out (--leave-out all)"
        )
    ids = _symbols(graph, path) if symbols else list(range(graph.n_poses))
    temporary = path.with_name(path.name + ".part")
    try:
        with temporary.open("w", encoding="ascii", newline="\n") as file:
            file.writelines(_lines(graph, initial, ids, half_angles=half_angles))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return lost


def _lines(graph: FactorGraph, values: GraphValues, ids: list[int], *, half_angles: bool) -> Iterator[str]:
    for pose, p, q in zip(ids, values.position.tolist(), values.quaternion.tolist(), strict=True):
        yield _line(f"{POSE} {pose}", [*p, *q[1:], q[0]])
    covariance = graph.edge_covariance[:, TO_FILE][:, :, TO_FILE]
    information = inverse(Path(), covariance, [0] * len(covariance))
    if half_angles:
        information = information * angle_scale(2.0)
    rows, columns = np.triu_indices(6)
    for a, b, t, q, triangle in zip(
        graph.edge_from.tolist(),
        graph.edge_to.tolist(),
        graph.edge_translation.tolist(),
        graph.edge_quaternion.tolist(),
        information[:, rows, columns].tolist(),
        strict=True,
    ):
        yield _line(f"{EDGE} {ids[a]} {ids[b]}", [*t, *q[1:], q[0], *triangle])


def _line(head: str, values: list[float]) -> str:
    return f"{head} {' '.join(f'{v:.17g}' for v in values)}\n"


def _symbols(graph: FactorGraph, path: Path) -> list[int]:
    agents = graph.agent_name.tolist()
    if not all(len(a) == 1 and a.isascii() and a.isalpha() for a in agents) or graph.pose_number.min() < 0:
        raise EstimationError(
            f"{path}: symbols need vehicles named by one letter; found {', '.join(agents[:5])}"
        )
    poses = zip(graph.pose_agent.tolist(), graph.pose_number.tolist(), strict=True)
    return [ord(agents[a]) << SYMBOL_SHIFT | k for a, k in poses]
