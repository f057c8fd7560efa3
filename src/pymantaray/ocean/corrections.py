"""Correction of a gridded ocean with casts by optimal interpolation, level by level."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.ocean.cast import Cast
from pymantaray.ocean.schema import place_text, validate_ocean, with_history
from pymantaray.ocean.seawater import density_fall
from pymantaray.ocean.window import Window, counted_place
from pymantaray.records.dates import seconds_since

_TRACERS = ("water_temp", "salinity")
INVERSION = 5e-3
"""Minimum excess of potential density over the level below that counts as an inversion. [kg/m3]"""


def correct_with_casts(
    ocean: xr.Dataset,
    casts: Sequence[Cast],
    *,
    horizontal_scale: float | tuple[float, float],
    noise_ratio: float = 0.1,
    time_scale: float | None = None,
    vertical_scale: float = 100.0,
) -> xr.Dataset:
    """
    Correct temperature and salinity of an ocean near casts.

    Parameters
    ----------
    ocean : xarray.Dataset
        The background: a valid ocean.
    casts : sequence of Cast
        Casts inside the window of the ocean and over its water.
    horizontal_scale : float or tuple of float
        Scale L of the correlation exp(-d²/2L²) of the background error; two values for north and
        east. [m]
    noise_ratio : float
        Error variance of a cast divided by the error variance of the background. The error of a
        cast includes variations that the grid does not resolve. [-]
    time_scale : float, optional
        Scale of the correlation in time. Default: all casts count as simultaneous with the ocean.
        [s]
    vertical_scale : float
        Scale of the Gaussian decay of a difference below the deepest and above the shallowest
        sample of a cast. [m]

    Returns
    -------
    xarray.Dataset
        A valid ocean on the same grid. Its history reports scales, differences and new density
        inversions. The currents of the background are unchanged, so they no longer balance the
        density.

    Raises
    ------
    OceanError
        If there is no cast, a cast is outside the window or over land or has no time although
        ``time_scale`` is given, a scale or the ratio is not positive, or the result is not a valid
        ocean.

    Notes
    -----
    At each level,

        x = x_b + B_gc (B_cc + r I)⁻¹ d

    where d is the cell means of the casts minus the background (bilinear) at their places, B is the
    correlation of the background error between grid points (g) and casts (c), and r is
    ``noise_ratio``. The same weights apply to temperature and salinity separately. The result is
    the least-squares estimate for errors with these covariances. As r approaches 0, the field
    passes through the casts. As r approaches infinity, it equals the background. Casts at one place
    share their weight. A cast is used at a level if the background is wet there. Distances are in
    the local frame around the middle of the window.

    References
    ----------
    .. [1] Bretherton, F. P., Davis, R. E. and Fandry, C. B. (1976), A technique for objective
       analysis and design of oceanographic experiments applied to MODE-73, Deep-Sea Res. 23,
       559-582; cited from general knowledge of the method.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import correct_with_casts
    >>> corrected = correct_with_casts(ocean, [cast], horizontal_scale=10e3)
    >>> change = (corrected["water_temp"] - ocean["water_temp"]).sel(depth=50.0)
    >>> print(change.sel(lat=78.0, lon=[0.0, 0.4], method="nearest").values.round(2))
    [2.44 1.58]
    """
    # check ocean, casts and scales
    validate_ocean(ocean)
    scale = np.broadcast_to(np.asarray(horizontal_scale, dtype=float), 2)
    if not casts:
        raise OceanError("casts: no cast; give at least one")
    positive = {
        "horizontal_scale": scale.min(),
        "noise_ratio": noise_ratio,
        "vertical_scale": vertical_scale,
    }
    for name, value in (positive | {"time_scale": time_scale}).items():
        if value is not None and not value > 0.0:
            raise OceanError(f"casts: {name} is {value:g}; it must be positive")
    # positions and times in units of the scales
    lat, lon = (np.asarray(ocean[n].values, dtype=float) for n in ("lat", "lon"))
    frame = Window.of(ocean).frame
    grid = np.stack(frame.to_local(lat[:, None], lon), axis=-1) / scale
    x = np.stack(frame.to_local([c.lat for c in casts], [c.lon for c in casts]), axis=-1) / scale
    t = np.zeros(len(casts)) if time_scale is None else _ages(ocean, casts) / time_scale
    # correlations, differences and their increment
    with np.errstate(over="ignore"):  # the correlation is 0 at very large distances
        between = np.exp(-0.5 * (np.sum((x[:, None] - x) ** 2, axis=-1) + (t[:, None] - t) ** 2))
        to_grid = np.exp(-0.5 * (np.sum((grid[:, :, None] - x) ** 2, axis=-1) + t**2))
        differences = np.stack([_difference(ocean, cast, vertical_scale) for cast in casts])
    increment = _increment(differences, between + noise_ratio * np.eye(len(casts)), to_grid)
    # temperature and salinity with the increment
    corrected = ocean.copy()
    for k, name in enumerate(_TRACERS):
        corrected[name] = ocean[name].copy(
            data=ocean[name].values.astype(float) + increment[..., k]
        )
    try:
        validate_ocean(corrected)
    except OceanError as error:
        raise OceanError(
            f"casts: the corrected ocean is invalid: {error}; check units and noise_ratio"
        ) from None
    # history: scales, differences and new inversions
    rms = np.sqrt(np.nanmean(differences**2, axis=(0, 1)))
    span = f"{scale[0] / 1e3:g} km" + (
        f" north by {scale[1] / 1e3:g} km east" if scale[0] != scale[1] else ""
    )
    names = ", ".join(cast.name for cast in casts[:4]) + (", ..." if len(casts) > 4 else "")
    corrected = with_history(
        corrected,
        f"corrected with {len(casts)} cast{'s' * (len(casts) > 1)} ({names}), rms difference"
        f" {rms[0]:.2g} degC and"
        f" {rms[1]:.2g} in salinity: Gaussian scale {span}, noise ratio {noise_ratio:g}, vertical"
        " scale"
        f" {vertical_scale:g} m" + (f", time scale {time_scale:g} s" if time_scale else ""),
    )
    before, after = (density_fall(x) > INVERSION for x in (ocean, corrected))
    return with_history(
        corrected,
        f"{np.count_nonzero(after & ~before)} new density inversions above {INVERSION:g} kg/m3 due"
        f" to the casts ({before.sum()} before); currents unchanged",
    )


def _ages(ocean: xr.Dataset, casts: Sequence[Cast]) -> Array:
    """Times of casts minus the time of the ocean. [s]"""
    if np.isnat(ocean["time"].values):
        raise OceanError(
            "ocean: its time is unknown; time_scale needs it; set it with open_ocean(time=...)"
        )
    for cast in casts:
        if np.isnat(cast.time):
            raise OceanError(f"cast {cast.name}: its time is unknown; time_scale needs it")
    return seconds_since(np.array([cast.time for cast in casts]), ocean["time"].values)


def _difference(ocean: xr.Dataset, cast: Cast, vertical_scale: float) -> Array:
    """
    Temperature and salinity (depth, 2) of a cast minus those of the ocean; NaN where the ocean is
    dry.

    Beyond the samples of the cast, the difference at the nearest level within the samples decays.
    """
    depth = np.asarray(ocean["depth"].values, dtype=float)
    value = np.stack(cast.cell_means(depth), axis=-1) - column_at(
        ocean, cast.lat, cast.lon, cast.name
    )
    beyond = np.maximum(depth - cast.depth[-1], cast.depth[0] - depth).clip(min=0.0)
    covered = np.flatnonzero(beyond == 0.0)
    if not covered.size:
        raise OceanError(
            f"cast {cast.name}: no level of the ocean is within its samples; remove the cast"
        )
    nearest = np.clip(np.arange(depth.size), covered[0], covered[-1])
    decayed = value[nearest] * np.exp(-0.5 * (beyond / vertical_scale) ** 2)[:, None]
    return np.where((beyond > 0.0)[:, None] & np.isfinite(value), decayed, value)


def column_at(ocean: xr.Dataset, lat: float, lon: float, name: str) -> Array:
    """
    Bilinear temperature and salinity (depth, 2) of a valid ocean at a place [degrees]; ``name`` is
    for messages.

    Only wet columns among the four around the place count, with normalized weights. NaN if all four
    are dry.
    """
    axes = [np.asarray(ocean[n].values, dtype=float) for n in ("lat", "lon")]
    at = counted_place(ocean, (lat, lon), f"cast {name}")
    corner = []
    share = []
    for x, axis in zip(at, axes, strict=True):
        i = int(np.clip(np.searchsorted(axis, x) - 1, 0, axis.size - 2))
        s = (x - axis[i]) / (axis[i + 1] - axis[i])
        corner.append(slice(i, i + 2))
        share.append(np.array([1.0 - s, s]))
    around = np.stack([ocean[n].values[:, corner[0], corner[1]] for n in _TRACERS], axis=-1).astype(
        float
    )
    weight = (share[0][:, None] * share[1])[None, ..., None] * np.isfinite(around)
    total = weight.sum(axis=(1, 2))
    column = np.full(around.shape[::3], np.nan)
    np.divide(np.nansum(weight * around, axis=(1, 2)), total, out=column, where=total > 0.0)
    if not np.all(np.isfinite(column[0])):
        raise OceanError(
            f"cast {name}: {place_text(lat, lon)} is on land in the ocean; remove the cast"
        )
    return column


def _increment(differences: Array, matrix: Array, to_grid: Array) -> Array:
    """Increment (depth, lat, lon, tracer) from the casts that are used at each level."""
    counts = np.isfinite(differences[..., 0])
    increment = np.zeros((counts.shape[1], *to_grid.shape[:2], differences.shape[-1]))
    patterns, which = np.unique(counts, axis=1, return_inverse=True)
    for j, pattern in enumerate(patterns.T):
        used = np.flatnonzero(pattern)
        levels = np.flatnonzero(which.ravel() == j)
        if used.size:
            d = differences[np.ix_(used, levels)].reshape(used.size, -1)
            weighted = np.linalg.solve(matrix[np.ix_(used, used)], d).reshape(
                used.size, levels.size, -1
            )
            increment[levels] = np.einsum("yxc,ckv->kyxv", to_grid[..., used], weighted)
    return increment
