"""Line by line reader of g2o text; `pymantaray.estimation.g2o` is its public face."""

import math
import re
from collections import Counter
from collections.abc import Collection
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation._pyfg_words import EDGE, POSE, TO_FILE
from pymantaray.estimation._refusals import LARGEST, QUATERNION_TOLERANCE, SMALLEST_EIGENVALUE, VARIANCES
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph
from pymantaray.estimation.pyfg import GraphFile

Array = NDArray[np.float64]

SYMBOL_SHIFT = 56  # GTSAM's symbols: a letter in the uppermost byte, a number below
_LARGEST_ID = 2**31 - 1  # g2o's ids are C ints
_INTEGER = re.compile("[0-9]{1,20}")


def load_g2o(path: Path | str, *, leave_out: Collection[str] = (), half_angles: bool = False) -> GraphFile:
    """
    Read a pose graph from g2o text in three dimensions.

    Parameters
    ----------
    path : pathlib.Path or str
    leave_out : collection of str
        Words of lines to skip and count, such as ``VERTEX_TRACKXYZ`` or ``FIX``; any other word than those of
        poses and edges is refused.
    half_angles : bool
        As in `write_g2o`.

    Returns
    -------
    GraphFile
        Graph without priors; values of the vertices, which in this format are a starting point; and how
        many lines were left out. Ids that are GTSAM symbols become vehicle and number; others belong to a
        vehicle A. The format has no times: a pose's number stands for it. [s]

    Raises
    ------
    EstimationError
        If the file cannot be read or a line is not in the grammar; the message names the line.
    """
    path = Path(path)
    vertices: dict[int, list[float]] = {}
    edges: list[tuple[int, int, int, list[float]]] = []
    left_out: Counter[str] = Counter()
    try:
        with path.open(encoding="ascii") as file:
            for number, line in enumerate(file, start=1):
                fields = line.split()
                if not fields or fields[0].startswith("#"):
                    continue
                word = fields[0]
                if word == POSE:
                    ((pose,), values) = _take(path, number, fields, 1, 7)
                    if pose in vertices:
                        _refuse(path, number, f"second vertex {pose}", "one vertex for each id")
                    vertices[pose] = values
                elif word == EDGE:
                    ((a, b), values) = _take(path, number, fields, 2, 7 + 21)
                    edges.append((number, a, b, values))
                elif word in leave_out:
                    left_out[word] += 1
                else:
                    _refuse(
                        path, number, f"begins with {word[:40]!r}", f"{POSE}, {EDGE}, or what is left out"
                    )
    except (OSError, UnicodeDecodeError) as error:
        raise EstimationError(f"{path}: not a readable text file: {error}") from None
    if not vertices:
        raise EstimationError(f"{path}: no {POSE} in the file; at least one pose is needed")
    graph, values_of = _graph(path, vertices, edges, half_angles=half_angles)
    return GraphFile(graph, values_of, dict(left_out))


def _graph(
    path: Path,
    vertices: dict[int, list[float]],
    edges: list[tuple[int, int, int, list[float]]],
    *,
    half_angles: bool,
) -> tuple[FactorGraph, GraphValues]:
    row = {pose: i for i, pose in enumerate(vertices)}
    for number, a, b, _ in edges:
        for end in (a, b):
            if end not in row:
                _refuse(path, number, f"id {end}", "ids of the file's vertices")
    names = [_name(pose) for pose in vertices]
    agents = list(dict.fromkeys(agent for agent, _ in names))
    numbers = np.array([k for _, k in names])
    vertex = np.array(list(vertices.values())).reshape(-1, 7)
    edge = np.array([values for *_, values in edges]).reshape(-1, 28)
    information = np.zeros((len(edges), 6, 6))
    upper = np.triu_indices(6)
    information[:, upper[0], upper[1]] = information[:, upper[1], upper[0]] = edge[:, 7:]
    if half_angles:
        information *= angle_scale(0.5)
    none, three = np.empty(0), np.empty((0, 3))
    graph = FactorGraph(
        agent_name=np.array(agents),
        landmark_name=np.array([], dtype=str),
        pose_agent=np.array([agents.index(agent) for agent, _ in names]),
        pose_number=numbers,
        pose_time=numbers.astype(float),
        prior_pose=none,
        prior_position=three,
        prior_quaternion=np.empty((0, 4)),
        prior_covariance=np.empty((0, 6, 6)),
        fix_pose=none,
        fix_position=three,
        fix_covariance=np.empty((0, 3, 3)),
        depth_pose=none,
        depth=none,
        depth_variance=none,
        survey_landmark=none,
        survey_position=three,
        survey_covariance=np.empty((0, 3, 3)),
        edge_from=np.array([row[a] for _, a, _, _ in edges]),
        edge_to=np.array([row[b] for _, _, b, _ in edges]),
        edge_quaternion=edge[:, [6, 3, 4, 5]],
        edge_translation=edge[:, :3],
        edge_covariance=inverse(path, information, [n for n, *_ in edges])[:, TO_FILE][:, :, TO_FILE],
        range_first=none,
        range_second=none,
        range_distance=none,
        range_variance=none,
    )
    try:
        check_graph(graph)
    except EstimationError as error:
        raise EstimationError(f"{path}: {error}") from None
    values = GraphValues(position=vertex[:, :3], quaternion=vertex[:, [6, 3, 4, 5]], landmark_position=three)
    return graph, values


def _take(
    path: Path, number: int, fields: list[str], n_ids: int, n_values: int
) -> tuple[list[int], list[float]]:
    word = fields[0]
    if len(fields) != 1 + n_ids + n_values:
        _refuse(path, number, f"{word} with {len(fields)} fields", f"{1 + n_ids + n_values}")
    ids = []
    for field in fields[1 : 1 + n_ids]:
        if not _INTEGER.fullmatch(field) or (int(field) > _LARGEST_ID and not _symbol(int(field))):
            _refuse(path, number, f"id {field[:40]!r}", f"integers up to {_LARGEST_ID}, or GTSAM symbols")
        ids.append(int(field))
    if n_ids == 2 and ids[0] == ids[1]:
        _refuse(path, number, f"{word} from {ids[0]} to itself", "two different poses")
    try:
        values = [float(field) for field in fields[1 + n_ids :]]
    except ValueError as error:
        _refuse(path, number, f"{word}: {str(error)[:80]}", "numbers")
    finite = all(map(math.isfinite, values)) and max(map(abs, values)) <= VARIANCES[1]
    if not finite or max(map(abs, values[:3])) > LARGEST:
        _refuse(path, number, f"{word} with a value that is too large or not finite", f"up to {LARGEST:g} m")
    if abs(math.hypot(*values[3:7]) - 1.0) > QUATERNION_TOLERANCE:
        _refuse(path, number, f"{word}: quaternion {values[3:7]}", "x y z w of length 1")
    return ids, values


def inverse(path: Path, matrices: Array, lines: list[int]) -> Array:
    """
    Inverses of positive definite matrices, by way of their unit-diagonal forms.

    Parameters
    ----------
    path : pathlib.Path
    matrices : ndarray, shape (n, k, k)
    lines : list of int
        Where in the file each matrix is from, for messages.

    Returns
    -------
    ndarray, shape (n, k, k)

    Raises
    ------
    EstimationError
        If a matrix is not safely positive definite.
    """
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    fine = (diagonal > 0.0).all(axis=1)
    if not fine.all():
        row = int(np.argmin(fine))
        _refuse(path, lines[row], f"{EDGE} with information {diagonal[row].min():g}", "a positive diagonal")
    scale = 1.0 / np.sqrt(diagonal)
    scales = scale[:, :, None] * scale[:, None, :]
    correlation = matrices * scales
    if correlation.size:
        smallest = np.linalg.eigvalsh(correlation)[:, 0]
        fine = smallest >= SMALLEST_EIGENVALUE
        if not fine.all():
            row = int(np.argmin(fine))
            _refuse(path, lines[row], f"{EDGE} with singular information", "a positive definite matrix")
    inverse = np.linalg.inv(correlation) * scales
    return np.asarray(0.5 * (inverse + np.swapaxes(inverse, 1, 2)))


def angle_scale(factor: float) -> Array:
    """
    Factors of the entries of a matrix when its last three axes are stretched by a factor.

    Parameters
    ----------
    factor : float

    Returns
    -------
    ndarray, shape (6, 6)
    """
    axis = np.array([1.0] * 3 + [factor] * 3)
    return np.outer(axis, axis)


def _symbol(number: int) -> bool:
    letter = chr(number >> SYMBOL_SHIFT) if number >> SYMBOL_SHIFT < 128 else ""
    return letter.isalpha() and number & (2**SYMBOL_SHIFT - 1) <= _LARGEST_ID


def _name(number: int) -> tuple[str, int]:
    if number <= _LARGEST_ID:
        return "A", number
    return chr(number >> SYMBOL_SHIFT), number & (2**SYMBOL_SHIFT - 1)


def _refuse(path: Path, number: int, found: str, allowed: str) -> NoReturn:
    raise EstimationError(f"{path}, line {number}: {found}; allowed: {allowed}")
