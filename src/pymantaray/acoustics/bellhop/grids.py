"""The hexahedral `.ssp` file and the `.bty` file: grids of sound speed and of the sea bed."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.bellhop.listing import ListReader, row
from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
_ONE = "one point at"


def ssp_text(x: Array, y: Array, depth: Array, sound_speed: Array, *, reach: float) -> str:
    """
    Write a grid of sound speed as a hexahedral `.ssp` file.

    Parameters
    ----------
    x, y, depth : ndarray, shape (n_x,), (n_y,), (n_depth,)
        Axes. One of a single point, no variation along it, becomes two points to either side, since
        Bellhop needs two. [m]
    sound_speed : ndarray, shape (n_x, n_y, n_depth)
        [m s⁻¹]
    reach : float
        How far to either side. [m]

    Returns
    -------
    str
        x, y in kilometres, depth in metres, and for each depth and each y a list along x.
    """
    lines: list[str] = []
    for axis in (x, y):
        lines += _axis_lines(axis, reach)
    lines += [f"{depth.size} /", row(depth)]
    c = np.repeat(np.repeat(sound_speed, _times(x), axis=0), _times(y), axis=1)
    lines += [row(c[:, j, k]) for k in range(depth.size) for j in range(c.shape[1])]
    return "\n".join(lines) + "\n"


def read_ssp(path: Path) -> tuple[Array, Array, Array, Array]:
    """
    Read a hexahedral `.ssp` file.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    x, y, depth, sound_speed : ndarray
        As `ssp_text` takes them.

    Raises
    ------
    AcousticsError
        If the file is damaged or an axis has fewer than two points.
    """
    reader = ListReader(path)
    x, one_x = _read_axis(reader, "x")
    y, one_y = _read_axis(reader, "y")
    n_depth = reader.count("number of depths", least=2)
    depth = reader.numbers(n_depth, "depths [m]")
    c = np.empty((x.size, y.size, n_depth))
    for k in range(n_depth):
        for j in range(y.size):
            c[:, j, k] = reader.numbers(x.size, f"sound speeds of depth {k + 1}, y {j + 1}")
    if one_x is not None:
        x, c = np.array([one_x]), c[:1]
    if one_y is not None:
        y, c = np.array([one_y]), c[:, :1]
    return x, y, depth, c


def bty_text(x: Array, y: Array, bathymetry: Array, *, reach: float) -> str:
    """
    Write the sea bed as a `.bty` file of BELLHOP3D, type R.

    Parameters
    ----------
    x, y : ndarray, shape (n_x,), (n_y,)
        Axes, see `ssp_text`. [m]
    bathymetry : ndarray, shape (n_x, n_y)
        Depth of the sea bed. [m]
    reach : float
        See `ssp_text`. [m]

    Returns
    -------
    str
        x, y in kilometres, and for each y a list of depths along x.
    """
    lines = ["'R'", *_axis_lines(x, reach), *_axis_lines(y, reach)]
    z = np.repeat(np.repeat(bathymetry, _times(x), axis=0), _times(y), axis=1)
    lines += [row(z[:, j]) for j in range(z.shape[1])]
    return "\n".join(lines) + "\n"


def read_bty(path: Path) -> tuple[Array, Array, Array]:
    """
    Read a `.bty` file of BELLHOP3D.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    x, y, bathymetry : ndarray
        As `bty_text` takes them.

    Raises
    ------
    AcousticsError
        If the file is damaged or not of type R or C.

    Notes
    -----
    The curvilinear type C has the same depths, only other normals in between. Provinces of the long format
    follow the depths and are not read: a medium has none.
    """
    reader = ListReader(path)
    kind = reader.word("the type")
    if kind[:1] not in ("R", "C"):
        raise reader.fail(f"type {kind!r}; a 3-D bathymetry has R or C")
    (x, one_x), (y, one_y) = _read_axis(reader, "x"), _read_axis(reader, "y")
    z = np.stack([reader.numbers(x.size, f"depths of y {j + 1}") for j in range(y.size)], axis=1)
    if one_x is not None:
        x, z = np.array([one_x]), z[:1]
    if one_y is not None:
        y, z = np.array([one_y]), z[:, :1]
    return x, y, z


def read_bty_2d(path: Path) -> tuple[Array, Array]:
    """
    Read a `.bty` file of BELLHOP, depths by range.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    ranges, depths : ndarray, shape (n,)
        [m]

    Raises
    ------
    AcousticsError
        If the file is damaged or not of type L or C.
    """
    reader = ListReader(path)
    kind = reader.word("the type").ljust(2)
    if kind[0] not in "LC":
        raise reader.fail(f"type {kind.strip()!r}; a 2-D bathymetry has L or C")
    n, columns = reader.count("number of points"), 7 if kind[1] == "L" else 2
    points = np.array([reader.numbers(columns, "range and depth", least=2)[:2] for _ in range(n)])
    return points[:, 0] * 1e3, points[:, 1]


def _times(axis: Array) -> int:
    return 2 if axis.size == 1 else 1


def _axis_lines(axis: Array, reach: float) -> list[str]:
    if axis.size > 1:
        return [f"{axis.size} /", row(axis, kilometres=True)]
    if not reach > 0.0:
        raise AcousticsError(f"reach: {reach}; a positive length is needed to either side of a single point")
    sides = (axis[0] - reach, axis[0] + reach)
    return [f"2 / {_ONE} {float(axis[0])!r}", row(sides, kilometres=True)]


def _read_axis(reader: ListReader, name: str) -> tuple[Array, float | None]:
    """Points of an axis, and the point it stands for where this package wrote two for one."""
    n, one = reader.count(f"number of points in {name}", least=2), None
    if n == 2 and reader.remark.startswith(_ONE):
        one = float(reader.remark.removeprefix(_ONE))
    axis = reader.spaced(n, f"{name} [km]", kilometres=True)
    if np.any(np.diff(axis) <= 0.0):
        raise reader.fail(f"{name}: the coordinates must increase")
    return axis, one
