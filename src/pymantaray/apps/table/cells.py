"""
Cells of a travel-time table: a binary tree of halved boxes, the arrival at the corners of each
cell, and the interpolation between them.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array

LEAF = 3  # in place of the axis of a branch
_AXIS_BITS = 2
REFERENCE_SLOWNESS = 1.0 / 1500.0  # s/m; a table stores the relative difference from it


class CellStatus(IntEnum):
    """Outcome of a look-up in a travel-time table."""

    DIRECT = 0  # one arrival without reflections
    BOUNCED = 1  # the selected arrival is reflected
    AMBIGUOUS = 2  # other arrivals have the same numbers of reflections; the selected one is given
    SHADOW = 3  # no arrival
    BORDER = 4  # next to a shadow or between two families of arrivals: not interpolated
    OUTSIDE = 5  # outside the limits of the table, or outside the water


HAS_RANGE = (CellStatus.DIRECT, CellStatus.BOUNCED, CellStatus.AMBIGUOUS)
"""Outcomes with a range and a travel time."""


class Tree(NamedTuple):
    """
    Arrays of a travel-time table; all that a file stores besides its limits.

    Attributes
    ----------
    branch : ndarray of uint32, shape (n_branches,)
        The lowest two bits are the axis that is halved (source depth, receiver depth, range) and
        the others the number of the lower half; the upper half has the next number. If the axis is
        3, this is a cell: the third bit is 1 if it has an arrival, and the others are its number,
        or otherwise its status.
    status, surface_bounces, bottom_bounces : ndarray of uint8, shape (n_cells,)
        Of the cells with an arrival.
    corner : ndarray of uint32, shape (n_cells, 8)
        Rows of the corners; bit k of a corner's number is its side along axis k.
    value : ndarray of float32, shape (n_corners, 4)
        Relative difference of the mean slowness from 1/1500 s/m, and its derivatives by source
        depth, receiver depth and range. [1, 1/m]
    sigma : ndarray of float32, shape (n_corners,) or (0,)
        Standard deviation of the relative mean slowness over an ensemble of oceans.
    root : ndarray of uint32, shape (n_sectors,)
        First branch of each sector.
    """

    branch: NDArray[np.uint32]
    status: NDArray[np.uint8]
    surface_bounces: NDArray[np.uint8]
    bottom_bounces: NDArray[np.uint8]
    corner: NDArray[np.uint32]
    value: NDArray[np.float32]
    sigma: NDArray[np.float32]
    root: NDArray[np.uint32]

    @property
    def nbytes(self) -> int:
        """Size of the arrays. [B]"""
        return sum(column.nbytes for column in self)


class Cell(NamedTuple):
    """
    Cells of ``n`` places: status, number (-1 without an arrival), and position and size of the box.
    """

    status: NDArray[np.int64]
    number: NDArray[np.int64]
    at: Array
    size: Array


class InterpolatedSlowness(NamedTuple):
    """
    Relative mean slowness at ``n`` places, its derivatives by the coordinates, and its standard
    deviation (NaN if unknown).
    """

    value: Array
    gradient: Array
    sigma: Array


def find_cells(
    tree: Tree, lower: Array, upper: Array, sector: NDArray[np.int64], places: Array
) -> Cell:
    """
    Descend to the cells that contain places.

    Parameters
    ----------
    tree : Tree
    lower, upper : ndarray, shape (3,)
        Limits of the table. [m]
    sector : ndarray of int, shape (n,)
    places : ndarray, shape (n, 3)
        Source depth, receiver depth and range. [m]

    Returns
    -------
    Cell
    """
    n = len(places)
    inside = np.all((places >= lower) & (places <= upper), axis=1)
    low = np.tile(lower, (n, 1))
    size = np.tile(upper - lower, (n, 1))
    word = tree.branch[tree.root[sector]].astype(np.int64)
    active = np.flatnonzero(inside & (word & LEAF != LEAF))
    while active.size:
        axis = word[active] & LEAF
        half = 0.5 * size[active, axis]
        middle = low[active, axis] + half
        above = places[active, axis] >= middle
        low[active, axis] = np.where(above, middle, low[active, axis])
        size[active, axis] = half
        word[active] = tree.branch[(word[active] >> _AXIS_BITS) + above]
        active = active[word[active] & LEAF != LEAF]
    content = word >> _AXIS_BITS
    has = inside & (content & 1 == 1)
    number = np.where(has, content >> 1, -1)
    status = np.where(inside, content >> 1, int(CellStatus.OUTSIDE))
    status[has] = tree.status[number[has]]
    return Cell(status, number, (places - low) / size, size)


def mean_slowness(tree: Tree, cell: Cell) -> InterpolatedSlowness:
    """
    Interpolate the relative mean slowness in cells; NaN without an arrival.

    Parameters
    ----------
    tree : Tree
    cell : Cell
        From `find_cells`.

    Returns
    -------
    InterpolatedSlowness
    """
    n = cell.number.size
    value = np.full(n, np.nan)
    gradient = np.full((n, 3), np.nan)
    sigma = np.full(n, np.nan)
    has = np.flatnonzero(cell.number >= 0)
    rows = tree.corner[cell.number[has]]
    corners = tree.value[rows].astype(np.float64)
    value[has], gradient[has] = interpolate(
        cell.at[has], cell.size[has], corners[..., 0], corners[..., 1:]
    )
    if tree.sigma.size:
        linear = tree.sigma[rows].astype(np.float64)
        sigma[has] = interpolate(
            cell.at[has], cell.size[has], linear, np.zeros((*rows.shape, 3))
        ).value
    return InterpolatedSlowness(value, gradient, sigma)


def joined(trees: list[Tree]) -> Tree:
    """
    Join the trees of several sectors.

    Parameters
    ----------
    trees : list of Tree
        One per sector.

    Returns
    -------
    Tree
    """
    branches = 0
    cells = 0
    corners = 0
    parts = []
    for tree in trees:
        content = tree.branch >> _AXIS_BITS
        has = (tree.branch & LEAF == LEAF) & (content & 1 == 1)
        shift = np.where(tree.branch & LEAF != LEAF, branches, np.where(has, 2 * cells, 0))
        parts.append(
            tree._replace(
                branch=(tree.branch + (shift << _AXIS_BITS)).astype(np.uint32),
                corner=(tree.corner + corners).astype(np.uint32),
                root=(tree.root + branches).astype(np.uint32),
            )
        )
        branches = branches + tree.branch.size
        cells = cells + len(tree.corner)
        corners = corners + len(tree.value)
    return Tree(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class Interpolated(NamedTuple):
    """Value of a function and its derivatives by the three coordinates, shapes (n,) and (n, 3)."""

    value: Array
    gradient: Array


def interpolate(at: Array, size: Array, values: Array, gradients: Array) -> Interpolated:
    """
    Interpolate within cells: cubic along each axis from the values and gradients at the corners,
    linear across it.

    The three one-dimensional Hermite corrections are added to the trilinear interpolation, so that
    all cubic polynomials are reproduced and the error is of fourth order in the size of the cell.

    Parameters
    ----------
    at : ndarray, shape (n, 3)
        Position within each cell, from 0 to 1 along each axis.
    size : ndarray, shape (n, 3)
        Lengths of the edges.
    values : ndarray, shape (n, 8)
        Values at the corners; bit k of a corner's number is its side along axis k.
    gradients : ndarray, shape (n, 8, 3)
        Derivatives at the corners.

    Returns
    -------
    Interpolated
        Derivatives are those of the interpolating polynomial.
    """
    weight = np.stack([1.0 - at, at])
    slope = (-1.0, 1.0)
    value = np.zeros(len(at))
    derivative = np.zeros((3, len(at)))
    for corner in range(8):
        i = corner & 1
        j = corner >> 1 & 1
        k = corner >> 2 & 1
        a = weight[i, :, 0]
        b = weight[j, :, 1]
        c = weight[k, :, 2]
        f = values[:, corner]
        value += a * b * c * f
        derivative[0] += slope[i] * (b * c * f)
        derivative[1] += slope[j] * (a * c * f)
        derivative[2] += slope[k] * (a * b * f)
    for axis in range(3):
        _add_hermite(
            axis, at[:, axis], size[:, axis], weight, (values, gradients), (value, derivative)
        )
    return Interpolated(value, derivative.T / size)


def _add_hermite(
    axis: int,
    t: Array,
    length: Array,
    weight: Array,
    corners: tuple[Array, Array],
    sums: tuple[Array, Array],
) -> None:
    """
    Add the difference between cubic Hermite and linear interpolation along the four edges of an
    axis.
    """
    values, gradients = corners
    value, derivative = sums
    u = (axis + 1) % 3
    v = (axis + 2) % 3
    left = t * (1.0 - t) * (1.0 - t)
    right = t * t * (1.0 - t)
    left_slope = (1.0 - t) * (1.0 - 3.0 * t)
    right_slope = t * (2.0 - 3.0 * t)
    for side in range(4):
        p = side & 1
        q = side >> 1
        low = (p << u) + (q << v)
        high = low + (1 << axis)
        step = values[:, high] - values[:, low]
        first = gradients[:, low, axis] * length - step
        last = step - gradients[:, high, axis] * length
        excess = left * first + right * last
        a = weight[p, :, u]
        b = weight[q, :, v]
        value += a * b * excess
        derivative[axis] += a * b * (left_slope * first + right_slope * last)
        derivative[u] += (1.0 if p else -1.0) * (b * excess)
        derivative[v] += (1.0 if q else -1.0) * (a * excess)
