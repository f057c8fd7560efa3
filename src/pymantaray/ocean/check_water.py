"""Is it sea water: sound speed, stability, gaps and jumps of a valid ocean."""

import gsw
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.ocean.check_schema import place_of
from pymantaray.ocean.findings import Finding, doubtful, wrong
from pymantaray.ocean.seawater import Equation, absolute_and_conservative, sound_speed

Array = NDArray[np.float64]
SLOWEST, FASTEST = 1_400.0, 1_600.0
"""Sound speed of sea water anywhere. [m/s]"""
DENSITY_NOISE = 2e-3
"""Fall of density with depth that is not worth a word: twice what HYCOM's packing can do. [kg/m3]"""
SPIKE, JUMP = 10.0, 40.0
"""Sound speed by which a point may differ from all its neighbours, and from one. [m/s]"""
STEEPEST = 5.0
"""Vertical gradient of sound speed: 1 K/m or so. [s-1]"""
MIN_LEVELS, UPPER, MIN_UPPER = 15, 200.0, 6
"""Levels in all and in the upper so many metres."""
_GRAVITY = 9.81


def check_water(ocean: xr.Dataset, equation: Equation = "teos-10") -> list[Finding]:
    """
    List what is wrong or doubtful about the water itself.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    equation : {"teos-10", "del-grosso", "unesco"}
        Equation of sound speed.

    Returns
    -------
    list of Finding

    Notes
    -----
    Stability is the square of the buoyancy frequency by TEOS-10 between neighbouring levels [1]_, turned
    into the fall of density that it amounts to.

    References
    ----------
    .. [1] Documentation of ``gsw_Nsquared`` in the Gibbs SeaWater toolbox (opened as reproduced in the
       manual of its R package).
    """
    depth, lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("depth", "lat", "lon"))
    water = (ocean["water_temp"].values, ocean["salinity"].values)
    place = (depth[:, None, None], lat[:, None], lon)
    speed = sound_speed(*water, *place, equation=equation)
    wet = np.isfinite(water[0])
    return [
        *_speed(ocean, speed, wet),
        *_inversions(ocean, absolute_and_conservative(*water, *place)),
        *_islands(ocean, wet),
        *_jumps(ocean, speed, depth),
        *_levels(depth, wet, water),
    ]


def _speed(ocean: xr.Dataset, speed: Array, wet: NDArray[np.bool_]) -> list[Finding]:
    bad = wet & ~((speed >= SLOWEST) & (speed <= FASTEST))
    if not bad.any():
        return []
    worst = np.where(bad, np.abs(speed - 0.5 * (SLOWEST + FASTEST)), -np.inf)
    worst = np.where(bad & np.isnan(speed), np.inf, worst)
    at = np.unravel_index(int(np.argmax(worst)), speed.shape)
    return [
        wrong(
            "sound speed",
            f"{int(bad.sum())} of {int(wet.sum())} wet points, the worst {speed[at]:.1f} m/s",
            f"{SLOWEST:g} to {FASTEST:g} m/s",
            "check units and fill values of temperature and salinity",
            where=place_of(ocean, at),
        )
    ]


def _inversions(ocean: xr.Dataset, water: tuple[Array, Array, Array]) -> list[Finding]:
    SA, CT, p = water
    lat = np.broadcast_to(ocean["lat"].values[:, None], SA.shape)
    squared, _ = gsw.Nsquared(SA, CT, p, lat=lat, axis=0)
    thickness = np.diff(np.asarray(ocean["depth"].values, dtype=float))[:, None, None]
    rise = np.asarray(squared * 1_027.0 * thickness / _GRAVITY)  # kg/m3
    unstable = rise < -DENSITY_NOISE
    if not unstable.any():
        return []
    k, i, j = np.unravel_index(int(np.nanargmin(rise)), rise.shape)
    depth = ocean["depth"].values
    return [
        doubtful(
            "density inversions",
            f"{int(unstable.sum())} of {int(np.isfinite(rise).sum())} pairs of levels, the largest"
            f" {-rise[k, i, j]:.3f} kg/m3 between {depth[k]:g} and {depth[k + 1]:g} m (N2 ="
            f" {squared[k, i, j]:.1e} s-2)",
            f"{DENSITY_NOISE:g} kg/m3, which is rounding",
            "interpolation or assimilation can do this; look at a section there",
            where=place_of(ocean, (k, i, j)),
        )
    ]


def _islands(ocean: xr.Dataset, wet: NDArray[np.bool_]) -> list[Finding]:
    found = []
    beside = _neighbours(wet)
    lone = wet & (beside == 0)
    if lone.any():
        found.append(
            doubtful(
                "isolated wet points",
                f"{int(lone.sum())} points without a wet neighbour at their level",
                "",
                "a hole of one point in the sea bed; interpolation across it is guesswork",
                where=place_of(ocean, np.argwhere(lone)[0]),
            )
        )
    land = ~wet[0] & (_neighbours(wet[:1])[0] == _FOUR)
    if land.any():
        i, j = np.argwhere(land)[0]
        found.append(
            doubtful(
                "land of one point",
                f"{int(land.sum())} columns",
                "",
                "an islet, or a gap in the data",
                where=place_of(ocean, (0, i, j)),
            )
        )
    return found


_FOUR = 4


def _neighbours(flag: NDArray[np.bool_]) -> NDArray[np.int8]:
    """How many of the four horizontal neighbours have a flag; beyond the edge none has."""
    wide = np.pad(flag, ((0, 0), (1, 1), (1, 1))).astype(np.int8)
    count = wide[:, :-2, 1:-1] + wide[:, 2:, 1:-1] + wide[:, 1:-1, :-2] + wide[:, 1:-1, 2:]
    return np.asarray(count)


def _jumps(ocean: xr.Dataset, speed: Array, depth: Array) -> list[Finding]:
    found = []
    wide = np.pad(speed, ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
    around = np.stack([wide[:, :-2, 1:-1], wide[:, 2:, 1:-1], wide[:, 1:-1, :-2], wide[:, 1:-1, 2:]])
    step = speed - around
    known = np.isfinite(step)
    above = np.where(known, step, np.inf).min(axis=0)
    below = np.where(known, step, -np.inf).max(axis=0)
    lone = np.where(known.sum(axis=0) >= _FOUR - 1, np.maximum(above, -below), 0.0)
    largest = np.where(known, np.abs(step), 0.0).max(axis=0)
    for what, size, limit, remedy in (
        ("spikes", lone, SPIKE, "no front does this; look for a wrong value"),
        (
            "jumps between neighbours",
            largest,
            JUMP,
            "a front this sharp is not resolved; look for a wrong value",
        ),
    ):
        bad = size > limit
        if bad.any():
            at = np.unravel_index(int(np.argmax(size)), size.shape)
            found.append(
                doubtful(
                    what,
                    f"sound speed at {int(bad.sum())} points, the largest by {size[at]:.1f} m/s",
                    f"{limit:g} m/s",
                    remedy,
                    where=place_of(ocean, at),
                )
            )
    slope = np.abs(np.diff(speed, axis=0)) / np.diff(depth)[:, None, None]
    if np.any(slope > STEEPEST):
        at = np.unravel_index(int(np.nanargmax(slope)), slope.shape)
        found.append(
            doubtful(
                "jumps between levels",
                f"gradient of sound speed at {int((slope > STEEPEST).sum())} points, the largest {slope[at]:.2g} s-1",
                f"{STEEPEST:g} s-1",
                "look for a wrong value or a level out of place",
                where=place_of(ocean, at),
            )
        )
    return found


def _levels(depth: Array, wet: NDArray[np.bool_], water: tuple[Array, Array]) -> list[Finding]:
    found = []
    used = depth[wet.any(axis=(1, 2))]
    upper = int(np.count_nonzero(used <= UPPER))
    if used.size < MIN_LEVELS or (used[-1] > UPPER and upper < MIN_UPPER):
        found.append(
            doubtful(
                "few levels",
                f"{used.size} down to {used[-1]:g} m, {upper} in the upper {UPPER:g} m",
                f"{MIN_LEVELS} and {MIN_UPPER}",
                "ducts between the levels are lost; take a source with more",
            )
        )
    both = wet[0] & wet[1]
    if both.any() and all(np.array_equal(field[0][both], field[1][both]) for field in water):
        found.append(
            doubtful(
                "first level carried up",
                f"temperature and salinity at 0 m equal those at {depth[1]:g} m everywhere",
                "",
                "nothing was known above; ducts at the surface depend on it",
            )
        )
    return found
