"""The same ocean on another grid: a smooth medium sampled for Bellhop, and grids of two files made one."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, RegularGridInterpolator, make_interp_spline

from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
_SAME_PLACE = 1e-6  # m; points of two axes nearer than this are one


def linear_medium(medium: Medium, *, horizontal: int = 1, vertical: int = 1) -> Medium:
    """
    Sample a medium on a finer grid, with straight lines between the points.

    Parameters
    ----------
    medium : Medium
        Smooth or linear; a linear one stays the same ocean.
    horizontal, vertical : int
        Parts that each cell is cut into, along north and east and along depth.

    Returns
    -------
    Medium
        With ``linear`` interpolation. Its difference from a smooth medium falls as the square of the parts.

    Raises
    ------
    AcousticsError
        If a number of parts is below 1.
    """
    if horizontal < 1 or vertical < 1:
        raise AcousticsError(f"horizontal {horizontal}, vertical {vertical}; at least 1 part a cell")
    north, east = _cut(medium.north, horizontal), _cut(medium.east, horizontal)
    depth = _cut(medium.depth, vertical)
    c = medium.sound_speed
    if medium.interpolation == "smooth":
        c = CubicSpline(medium.depth, c, axis=2, bc_type="natural")(depth)
        for axis, (old, new) in enumerate(((medium.north, north), (medium.east, east))):
            if old.size > 1:
                c = make_interp_spline(old, c, k=min(3, old.size - 1), axis=axis)(new)
    else:
        c = _linear((medium.north, medium.east, medium.depth), c, (north, east, depth))
    bed_north, bed_east = _cut(medium.bed_north, horizontal), _cut(medium.bed_east, horizontal)
    bed = _linear((medium.bed_north, medium.bed_east), medium.bathymetry, (bed_north, bed_east))
    return Medium.from_grid(
        north,
        east,
        depth,
        c,
        bathymetry=bed,
        bed_north=bed_north,
        bed_east=bed_east,
        interpolation="linear",
    )


def merge_grids(
    water: tuple[Array, Array, Array], bed: tuple[Array, Array, Array], name: str
) -> tuple[Array, Array, Array, Array]:
    """
    Bring sound speed and sea bed to one horizontal grid, without a change to linear interpolation.

    Parameters
    ----------
    water : tuple of ndarray
        North, east and sound speed (n_north, n_east, n_depth).
    bed : tuple of ndarray
        North, east and depth of the sea bed (n_north, n_east).
    name : str
        For messages.

    Returns
    -------
    north, east, sound_speed, bathymetry : ndarray
        On the points of both grids inside the rectangle that both cover; an axis of one point is no limit.

    Raises
    ------
    AcousticsError
        If the grids do not overlap.
    """
    (wn, we, c), (bn, be, z) = water, bed
    if c.shape[:2] == (1, 1) and np.ptp(z) == 0.0:  # one profile over a flat bed: unbounded
        return (bn if bn.size == 1 else wn), (be if be.size == 1 else we), c, z[:1, :1]
    north, east = _union(wn, bn, f"{name}: north"), _union(we, be, f"{name}: east")
    c = _linear((wn, we), c, (north, east))
    return north, east, c, _linear((bn, be), z, (north, east))


def _cut(axis: Array, parts: int) -> Array:
    if axis.size == 1 or parts == 1:
        return axis
    inner = axis[:-1, None] + np.diff(axis)[:, None] * (np.arange(parts) / parts)
    return np.append(inner.ravel(), axis[-1])


def _union(a: Array, b: Array, name: str) -> Array:
    """Points of both axes where both are defined; a single point says nothing of its place."""
    if a.size == 1:
        return b
    if b.size == 1 or np.array_equal(a, b):
        return a
    low, high = max(a[0], b[0]), min(a[-1], b[-1])
    if not low < high:
        raise AcousticsError(
            f"{name}: the sound speed covers {a[0]:g} to {a[-1]:g} m, the sea bed {b[0]:g} to {b[-1]:g} m;"
            " they must overlap"
        )
    both = np.union1d(a, b)
    both = both[(both >= low) & (both <= high)]
    return np.asarray(both[np.append(True, np.diff(both) > _SAME_PLACE)])


def _linear(axes: tuple[Array, ...], values: Array, new: tuple[Array, ...]) -> Array:
    """Linear interpolation along the leading axes; an axis of one point is constant, equal axes are kept."""
    for k, (old, wanted) in enumerate(zip(axes, new, strict=True)):
        if old.size == 1:
            values = np.repeat(values, wanted.size, axis=k)
        elif not np.array_equal(old, wanted):
            moved = np.moveaxis(values, k, 0)
            values = np.moveaxis(RegularGridInterpolator((old,), moved)(wanted[:, None]), 0, k)
    return np.asarray(values)
