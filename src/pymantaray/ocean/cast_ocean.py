"""An ocean from one cast: the same water everywhere, at rest, on stated levels down to a stated bottom."""

from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.cast import Cast
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.schema import assemble_ocean, with_history
from pymantaray.ocean.seawater import Equation, sound_speed

Array = NDArray[np.float64]
_STEPS = ((100.0, 2.5), (200.0, 5.0), (500.0, 10.0), (1000.0, 25.0), (2000.0, 50.0), (12_000.0, 100.0))
_POINTS = 9  # along each horizontal axis; the water is the same at all
_MARGIN = 1.02  # of the window beyond the half extent
_EDGE_POINTS = 101
_SHORTEST = 0.5  # of the last step: a level nearer to the bottom than that is left out


def cast_levels(bottom_depth: float) -> Array:
    """
    Levels that keep the ducts of a cast without following its noise.

    Parameters
    ----------
    bottom_depth : float
        [m]

    Returns
    -------
    ndarray, shape (n,)
        From 0 every 2.5 m to 100 m, 5 m to 200 m, 10 m to 500 m, 25 m to 1000 m, 50 m to 2000 m, then 100 m;
        the last is the bottom. [m]

    Examples
    --------
    >>> cast_levels(12.0)
    array([ 0. ,  2.5,  5. ,  7.5, 10. , 12. ])
    """
    levels = [0.0]
    for until, step in _STEPS:
        while levels[-1] < until and levels[-1] + (1.0 + _SHORTEST) * step <= bottom_depth:
            levels.append(levels[-1] + step)
    return np.array([*levels, float(bottom_depth)])


def cast_ocean(
    cast: Cast,
    *,
    bottom_depth: float | None = None,
    half_extent: tuple[float, float] = (60e3, 60e3),
    levels: ArrayLike | None = None,
    below: Literal["refuse", "constant"] | Cast = "refuse",
    time: str | np.datetime64 | None = None,
    equation: Equation = "teos-10",
) -> xr.Dataset:
    """
    Horizontally uniform ocean at rest from one cast.

    Parameters
    ----------
    cast : Cast
    bottom_depth : float, optional
        Depth of the flat sea bed, the deepest level. Default: the cast's own, if it tells one. [m]
    half_extent : tuple of float
        Half sides (north, east) of a rectangle about the cast that the window holds. [m]
    levels : array_like, shape (n,), optional
        From 0, strictly increasing; those at or below the bottom are replaced by one there. Default:
        `cast_levels`. [m]
    below : {"refuse", "constant"} or Cast
        What lies between the deepest sample and the bottom: an error; the temperature and salinity of the
        deepest sample, so that sound speed rises with pressure alone; or the samples of a deeper cast that lie
        below this one's.
    time : str or numpy.datetime64, optional
        Instant (UTC) of the ocean. Default: the cast's.
    equation : {"teos-10", "del-grosso", "unesco"}
        For the change of sound speed that the history tells.

    Returns
    -------
    xarray.Dataset
        A valid ocean. Its history tells the change of sound speed by averaging (rms and greatest, over the
        samples), how far it was extended up and down, and that it is at rest.

    Raises
    ------
    OceanError
        If the bottom or the time is unknown, the bottom is deeper than the samples and ``below`` refuses, a
        level is wrong, or the window reaches over a pole.

    Notes
    -----
    Temperature and salinity are averaged over the cell of each level (`Cast.cell_means`). Above the
    shallowest sample they are constant. "Uniform" holds for temperature and salinity at a depth: sound speed
    then varies by some mm/s over 100 km, since pressure at a depth and the composition of sea water
    depend on the place.
    """
    bottom = cast.bottom_depth if bottom_depth is None else float(bottom_depth)
    if not (np.isfinite(bottom) and bottom > 0.0):
        raise OceanError(f"cast {cast.name}: bottom_depth is {bottom:g} m; give the sea bed's positive depth")
    instant = cast.time if time is None else parse_instant(time)
    if np.isnat(instant):
        raise OceanError(f"cast {cast.name}: its time is unknown; give one, as in 2014-07-24T19:20 (UTC)")
    z, cut = _levels(cast, levels, bottom)
    used, history = _extended(cast, bottom, below)
    temperature, salinity = used.cell_means(z)
    lat, lon = _axes(cast, half_extent)
    shape = (z.size, lat.size, lon.size)
    fields = {
        "water_temp": np.broadcast_to(temperature[:, None, None], shape).copy(),
        "salinity": np.broadcast_to(salinity[:, None, None], shape).copy(),
        "water_u": np.zeros(shape),
        "water_v": np.zeros(shape),
    }
    ocean = assemble_ocean(
        {"depth": z, "lat": lat, "lon": lon},
        instant,
        fields,
        title=f"Cast {cast.name}",
        source=f"one cast at {cast.lat:g} N {cast.lon:g} E, the same water everywhere",
        synthetic=False,
    )
    sampled = cast.depth <= bottom
    change = (
        sound_speed(
            np.interp(cast.depth, z, temperature),
            np.interp(cast.depth, z, salinity),
            *(cast.depth, cast.lat, cast.lon),
            equation=equation,
        )
        - cast.sound_speed(equation)
    )[sampled]
    first = (
        f"cast {cast.name}: {cast.depth.size} samples averaged onto {z.size} levels, sound speed changed by"
        f" {np.sqrt(np.mean(change**2)):.2g} m/s rms, {np.abs(change).max():.2g} m/s at most"
    )
    rest = "horizontally uniform, currents at rest"
    for line in (*cast.notes, first, *cut, *history, rest):
        ocean = with_history(ocean, line)
    return ocean


def _levels(cast: Cast, levels: ArrayLike | None, bottom: float) -> tuple[Array, list[str]]:
    if levels is None:
        return cast_levels(bottom), []
    given = np.asarray(levels, dtype=float)
    if given.ndim != 1 or given.size < 2 or given[0] != 0.0 or not np.all(np.diff(given) > 0.0):
        raise OceanError(f"cast {cast.name}: levels must rise strictly from 0 m")
    kept = given[given < bottom]
    dropped = int(np.count_nonzero(given > bottom))
    told = [f"{dropped} levels below the bottom at {bottom:g} m left out"] if dropped else []
    if bottom not in given:
        told.append(f"level at the bottom, {bottom:g} m, added")
    return np.append(kept, bottom), told


def _extended(
    cast: Cast, bottom: float, below: Literal["refuse", "constant"] | Cast
) -> tuple[Cast, list[str]]:
    told = []
    if cast.depth[0] > 0.0:
        told.append(
            f"extended from {cast.depth[0]:.4g} m up to the surface at constant temperature and salinity"
        )
    last = float(cast.depth[-1])
    if bottom <= last:
        return cast, told
    if isinstance(below, Cast):
        deeper = below.depth > last
        if not deeper.any():
            raise OceanError(
                f"cast {below.name}: ends at {below.depth[-1]:g} m, not below the {last:g} m of {cast.name}; a deeper"
                " cast is needed"
            )
        jump = [
            float(np.interp(last, below.depth, getattr(below, q)) - getattr(cast, q)[-1])
            for q in ("temperature", "salinity")
        ]
        told.append(
            f"below {last:.6g} m the samples of cast {below.name}, which at that depth is warmer by {jump[0]:.2g} degC,"
            f" saltier by {jump[1]:.2g}"
        )
        joined = [
            np.concatenate([getattr(cast, q), getattr(below, q)[deeper]])
            for q in ("depth", "temperature", "salinity")
        ]
        cast = Cast(cast.name, cast.lat, cast.lon, cast.time, joined[0], joined[1], joined[2])
        last = float(cast.depth[-1])
    elif below == "refuse":
        raise OceanError(
            f"cast {cast.name}: its deepest sample is at {last:g} m, above the bottom at {bottom:g} m; give"
            f' bottom_depth={np.floor(last):g}, below="constant" or a deeper cast'
        )
    elif below != "constant":
        raise OceanError(f"below is {below!r}; allowed are 'refuse', 'constant' and a cast")
    if bottom > last:
        told.append(
            f"extended from {last:.6g} m down to the bottom at {bottom:.6g} m at constant temperature and salinity"
        )
    return cast, told


def _axes(cast: Cast, half_extent: tuple[float, float]) -> tuple[Array, Array]:
    """Latitudes and longitudes about the cast whose window holds the rectangle."""
    north, east = (float(h) for h in half_extent)
    if not (0.0 < north < 5e6 and 0.0 < east < 5e6):
        raise OceanError(
            f"half_extent is {half_extent} m; both half sides must be positive and below 5000 km"
        )
    frame = LocalFrame(cast.lat, cast.lon)
    s = np.linspace(-1.0, 1.0, _EDGE_POINTS)
    one = np.ones_like(s)
    lat, lon = frame.to_geodetic(
        north * np.concatenate([s, s, one, -one]), east * np.concatenate([one, -one, s, s])
    )
    half_lat = _MARGIN * float(np.abs(lat - cast.lat).max())
    half_lon = _MARGIN * float(np.abs(lon - frame.longitude_deg).max())
    if abs(cast.lat) + half_lat > 90.0 or half_lon >= 179.0:
        raise OceanError(
            f"cast {cast.name}: a window of +-{north / 1e3:g} by {east / 1e3:g} km about {cast.lat:g} N reaches over the"
            " pole, where latitude and longitude are no grid; give a smaller half_extent"
        )
    s = np.linspace(-1.0, 1.0, _POINTS)
    return cast.lat + half_lat * s, frame.longitude_deg + half_lon * s
