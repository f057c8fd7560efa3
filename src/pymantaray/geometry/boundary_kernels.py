"""Compiled bilinear interpolation on a grid of the local frame."""

from collections import namedtuple

from pymantaray.compile import kernel

BoundaryGrid = namedtuple("BoundaryGrid", "depth north east")
BoundaryGrid.__doc__ = """Depth (north, east) of a boundary of the water, and its axes. [m]

The depth does not vary along an axis with one point."""


@kernel
def interval_of(axis, x):
    """Index of the axis interval that holds x, limited to the axis; 0 on an axis of one point."""
    lo, hi = 0, axis.size - 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if x < axis[mid]:
            hi = mid
        else:
            lo = mid
    return lo


@kernel
def bilinear_weights(grid, n, e, n_mid, e_mid):
    """Cell of the point (n_mid, e_mid), local coordinates of (n, e) in it, and its sides. [1, m]"""
    north, east = grid.north, grid.east
    i = interval_of(north, n_mid)
    j = interval_of(east, e_mid)
    sn = 0.0
    se = 0.0
    dn = 1.0
    de = 1.0
    if north.size > 1:
        dn = north[i + 1] - north[i]
        sn = (n - north[i]) / dn
    if east.size > 1:
        de = east[j + 1] - east[j]
        se = (e - east[j]) / de
    return i, j, sn, se, dn, de


@kernel
def depth_at(grid, n, e):
    """
    Depth of a boundary at a position; beyond its edges that of the cell at the edge, continued. [m]
    """
    i, j, sn, se, _, _ = bilinear_weights(grid, n, e, n, e)
    di = 1 if grid.north.size > 1 else 0
    dj = 1 if grid.east.size > 1 else 0
    b = grid.depth
    b00 = b[i, j]
    b10 = b[i + di, j]
    b01 = b[i, j + dj]
    b11 = b[i + di, j + dj]
    return (b00 * (1.0 - sn) + b10 * sn) * (1.0 - se) + (b01 * (1.0 - sn) + b11 * sn) * se
