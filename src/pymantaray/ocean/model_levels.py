"""
Depths of a model's own levels, which vary horizontally, and interpolation of its columns to fixed
depths.
"""

import numpy as np

from pymantaray.arrays import Array

_LEAST_STEP, _STEP_SHARE = 0.5, 0.02  # m, and of the depth: least distance of fixed depths


def s_level_depth(
    s: Array, stretching: Array, critical_depth: float, bed: Array, sea_level: Array, transform: int
) -> Array:
    """
    Depth of levels that follow the sea bed, (levels, ...). [m]

    Positive down from the mean sea level, by the equations of ROMS: ``transform`` 1 of Song and
    Haidvogel (1994, https://doi.org/10.1006/jcph.1994.1189), 2 of Shchepetkin and McWilliams (2005,
    https://doi.org/10.1016/j.ocemod.2004.08.002), CF ``ocean_s_coordinate_g1`` and ``_g2``.

    Parameters
    ----------
    s, stretching : ndarray, shape (levels,)
        Coordinate from -1 at the bed to 0 at the surface, and the stretching curve.
    critical_depth : float
        Depth ``hc`` that separates uniform from stretched levels. [m]
    bed, sea_level : ndarray, shape (...)
        Depth of the bed below, and sea level above, the mean sea level. [m]
    transform : {1, 2}
        Equation.
    """
    column = (slice(None), *(None,) * np.ndim(bed))
    s, stretching = s[column], stretching[column]
    if transform == 1:
        still = critical_depth * s + (bed - critical_depth) * stretching
        return np.asarray(-(still + sea_level * (1.0 + still / bed)))
    share = (critical_depth * s + bed * stretching) / (critical_depth + bed)
    return np.asarray(-(sea_level + (sea_level + bed) * share))


def cell_depth(thickness: Array, full: Array | None) -> Array:
    """
    Depth of the middles of cells (levels, ...) from their thickness. [m]

    ``full`` contains the depths (levels,) of full cells, which are not exactly in the middle of
    stretched cells; only cells that are cut by the sea bed have others. None if all cells vary.
    """
    thickness = np.nan_to_num(thickness)
    middle = np.cumsum(thickness, axis=0) - 0.5 * thickness
    if full is None:
        return np.asarray(middle)
    column = (slice(None), *(None,) * (thickness.ndim - 1))
    largest = thickness.reshape(len(thickness), -1).max(axis=1)[column]
    return np.where(thickness < 0.999 * largest, middle, full[column])


def fixed_depths(depth: Array, bed: Array) -> Array:
    """
    Fixed depths for levels (levels, rows, columns) that vary: 0, and the levels of the shallowest,
    the median and the deepest wet column and of the one between, without those that are nearly
    equal. [m]
    """
    columns = np.flatnonzero(np.isfinite(bed) & (bed > 0.0) & np.isfinite(depth).all(axis=0))
    flat = depth.reshape(len(depth), -1)[:, columns]
    order = np.argsort(bed.ravel()[columns], kind="stable")
    some = order[np.round(np.array([0.0, 0.5, 0.9, 1.0]) * (order.size - 1)).astype(int)]
    chosen = [0.0]
    for level in np.sort(np.maximum(flat[:, some], 0.0).ravel()):
        if level - chosen[-1] >= max(_LEAST_STEP, _STEP_SHARE * level):
            chosen.append(float(level))
    return np.array([*chosen, max(float(bed.ravel()[columns].max()), chosen[-1] + 1.0)])


def to_depths(values: Array, depth: Array, bed: Array, fixed: Array) -> Array:
    """
    Interpolate columns linearly to fixed depths, (fixed, rows, columns); NaN below the sea bed.

    Above the first and below the last valid level the value is constant.

    Parameters
    ----------
    values, depth : ndarray, shape (levels, rows, columns)
        Values, NaN where the model has none, and increasing depths. [m]
    bed : ndarray, shape (rows, columns)
        Sea bed. [m]
    fixed : ndarray, shape (fixed,)
        Increasing depths. [m]
    """
    count = np.isfinite(values).sum(axis=0)
    last = np.maximum(count - 1, 0)
    result = np.full((len(fixed), *bed.shape), np.nan)
    for k, level in enumerate(fixed):
        below = np.minimum(np.sum(depth <= level, axis=0), last)[None]
        above = np.maximum(below - 1, 0)
        z0, z1 = (np.take_along_axis(depth, i, axis=0)[0] for i in (above, below))
        f0, f1 = (np.take_along_axis(values, i, axis=0)[0] for i in (above, below))
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.clip(np.where(z1 > z0, (level - z0) / (z1 - z0), 0.0), 0.0, 1.0)
        result[k] = np.where((count > 0) & (level <= bed), f0 + share * (f1 - f0), np.nan)
    return result
