"""
Columns of graph files: the numbers of each type of line, and their conversion from and to the
columns of a graph.

PyFactorGraph and g2o files have the same columns: x y z and qx qy qz qw, or x y and an angle in two
dimensions, and the upper triangle of a matrix, translation first. Lines in two dimensions are
lifted as they are read, and flattened as they are written.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.graph.graph import KINDS, Residual
from pymantaray.estimation.graph.text import Word

_VERTICES = {"pose": 7, "landmark": 3}  # measured numbers
_IN_PLANE = {6: [0, 1, 5], 3: [0, 1]}  # of x y z rx ry rz, and of x y z
ROTATION_FIRST = [3, 4, 5, 0, 1, 2]  # order of a tangent, from translation first and back
TO_XYZW = [1, 2, 3, 0]
TO_WXYZ = [3, 0, 1, 2]


def columns(role: str, *, timed: bool = False, more_names: int = 0) -> Word:
    """Fields of a line in three dimensions, of a pose, a landmark or a kind of factor."""
    if role in _VERTICES:
        return Word(timed, 1 + more_names, _VERTICES[role], 0, False)
    kind = KINDS[role]
    measurement = sum(width for _, width, _ in kind.columns)
    # lines of distances are the same in two and in three dimensions
    planar = None if kind.residual is Residual.DISTANCE else False
    return Word(timed, len(kind.ends) + more_names, measurement, kind.rows, planar)


def to_graph(values: Array, grammar: Word, *, planar: bool) -> tuple[Array, Array]:
    """
    Measured columns and matrices of a graph from the numbers of lines: quaternions w x y z,
    rotation before translation.
    """
    measurement = values[:, : grammar.values]
    matrix = from_triangle(values[:, grammar.values :], grammar.matrix)
    if planar:
        measurement = lift(measurement)
        matrix = lift_matrix(matrix) if grammar.matrix else matrix
    if measurement.shape[1] == 7:
        measurement = np.concatenate([measurement[:, :3], measurement[:, 3:][:, TO_WXYZ]], axis=1)
    size = matrix.shape[1]
    return measurement, matrix[:, ROTATION_FIRST][:, :, ROTATION_FIRST] if size == 6 else matrix


def to_file(
    measurement: Array, matrix: Array | None, *, planar: bool
) -> tuple[Array, Array | None]:
    """Numbers and matrices of lines from the columns of a graph: the inverse of `to_graph`."""
    if measurement.shape[1] == 7:
        measurement = np.concatenate([measurement[:, :3], measurement[:, 3:][:, TO_XYZW]], axis=1)
    if matrix is not None and matrix.shape[1] == 6:
        matrix = matrix[:, ROTATION_FIRST][:, :, ROTATION_FIRST]
    if planar:
        measurement = flatten(measurement)
        matrix = matrix if matrix is None else flat_matrix(matrix)
    return measurement, matrix


def write_rows(
    words: tuple[str, str | None],
    heads: Iterable[str],
    measurement: Array,
    matrix: Array | None = None,
    *,
    planar: bool,
    digits: int = 17,
) -> Iterator[str]:
    """
    Lines of a word, given with its word in two dimensions (None if it is the same), from the
    columns of a graph, with numbers of this many significant digits.
    """
    flat = planar and words[1] is not None
    word = words[1] if flat else words[0]
    measurement, matrix = to_file(measurement, matrix, planar=flat)
    table = (
        measurement if matrix is None else np.concatenate([measurement, triangle(matrix)], axis=1)
    )
    bits = np.ascontiguousarray(table).view(np.int64)  # zeros have signs
    same = (bits == bits[:1]).all(axis=0) & bool(len(table))
    numbers = [
        f"{table[0, k]:.{digits}g}" if same[k] else f"%.{digits}g" for k in range(table.shape[1])
    ]
    form = f"{word} %s {' '.join(numbers)}\n"
    for head, row in zip(heads, table[:, ~same].tolist(), strict=True):
        yield form % (head, *row)


def flatten(measurement: Array) -> Array:
    """
    Planar part of x y z, (n, 3), or of x y z and a quaternion x y z w, (n, 7): x y, and the angle
    about down.
    """
    if measurement.shape[1] == 3:
        return measurement[:, :2]
    z = measurement[:, 5]
    w = measurement[:, 6]
    sign = np.where(w < 0.0, -1.0, 1.0)
    return np.column_stack([measurement[:, :2], 2.0 * np.arctan2(sign * z, sign * w)])


def lift(measurement: Array) -> Array:
    """The inverse of `flattened`: x y, (n, 2), or x y and an angle, (n, 3)."""
    none = np.zeros((len(measurement), 3))
    if measurement.shape[1] == 2:
        return np.column_stack([measurement, none[:, 0]])
    half = 0.5 * measurement[:, 2]
    return np.column_stack([measurement[:, :2], none, np.sin(half), np.cos(half)])


def flat_matrix(matrices: Array) -> Array:
    """Planar part of matrices over x y z rx ry rz, (n, 6, 6), or x y z, (n, 3, 3)."""
    inside = _IN_PLANE[matrices.shape[1]]
    return np.asarray(matrices[:, inside][:, :, inside])


def lift_matrix(matrices: Array) -> Array:
    """The inverse of `flat_matrix`; out of the plane there is a unit."""
    size = {3: 6, 2: 3}[matrices.shape[1]]
    inside = np.array(_IN_PLANE[size])
    out = np.tile(np.eye(size), (len(matrices), 1, 1))
    out[:, inside[:, None], inside] = matrices
    return out


def triangle(matrices: Array) -> Array:
    """Upper triangles by rows of matrices (n, k, k)."""
    rows, columns = np.triu_indices(matrices.shape[-1])
    return np.asarray(matrices[:, rows, columns])


def from_triangle(triangles: Array, size: int) -> Array:
    """Symmetric matrices of their upper triangles by rows."""
    out = np.zeros((triangles.shape[0], size, size))
    rows, columns = np.triu_indices(size)
    out[:, rows, columns] = out[:, columns, rows] = triangles
    return out
