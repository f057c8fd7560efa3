"""One cast: a measured profile at a place and time, and how raw rows become one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.schema import VARIABLES
from pymantaray.ocean.seawater import Equation, sound_speed

Array = NDArray[np.float64]
_SPAN = {v.name: (v.lowest, v.highest) for v in VARIABLES}
_DEEPEST = 12_000.0  # m


@dataclass(frozen=True, eq=False)
class Cast:
    """
    Temperature and salinity measured downward at one place.

    Attributes
    ----------
    name : str
    lat, lon : float
        [degrees]
    time : numpy.datetime64
        UTC; NaT if it is unknown.
    depth : ndarray, shape (n_levels,)
        Of the samples, strictly increasing, positive down. [m]
    temperature : ndarray, shape (n_levels,)
        In situ. [degC]
    salinity : ndarray, shape (n_levels,)
        Practical. [-]
    bottom_depth : float
        Depth of the sea bed that the file tells, else NaN. [m]
    dropped : int
        Rows of the file that were not used.
    notes : tuple of str
        What was dropped and converted.

    Raises
    ------
    OceanError
        If there are fewer than two levels, they do not increase, a value is not finite or physically
        impossible, or the place is none on Earth.
    """

    name: str
    lat: float
    lon: float
    time: np.datetime64
    depth: Array
    temperature: Array
    salinity: Array
    bottom_depth: float = float("nan")
    dropped: int = 0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Convert, check and freeze the arrays."""
        object.__setattr__(self, "name", " ".join(self.name.split()))  # goes into lines of text
        for field in ("depth", "temperature", "salinity"):
            array = np.array(getattr(self, field), dtype=float)
            if array.shape != (np.size(self.depth),) or array.size < 2:
                raise OceanError(
                    f"cast {self.name}: {field} has shape {array.shape}; needs {(np.size(self.depth),)}, at least 2"
                )
            if not np.all(np.isfinite(array)):
                raise OceanError(f"cast {self.name}: {field} is not finite; leave those levels out")
            array.setflags(write=False)
            object.__setattr__(self, field, array)
        object.__setattr__(self, "time", self.time.astype("datetime64[ns]"))
        if self.depth[0] < 0.0 or np.any(np.diff(self.depth) <= 0.0):
            raise OceanError(f"cast {self.name}: depth must increase from 0 m or below, positive down")
        for field, name in (("temperature", "water_temp"), ("salinity", "salinity")):
            low, high = _SPAN[name]
            found = getattr(self, field)
            if found.min() < low or found.max() > high:
                raise OceanError(
                    f"cast {self.name}: {field} spans {found.min():g} to {found.max():g}; allowed {low:g} to {high:g}"
                )
        if not (-90.0 <= self.lat <= 90.0 and -360.0 <= self.lon <= 360.0):
            raise OceanError(
                f"cast {self.name}: place {self.lat:g} N {self.lon:g} E; latitude lies in -90 to 90, longitude in"
                " -360 to 360 degrees"
            )

    def sound_speed(self, equation: Equation = "teos-10") -> Array:
        """
        Sound speed at the samples.

        Parameters
        ----------
        equation : {"teos-10", "del-grosso", "unesco"}

        Returns
        -------
        ndarray, shape (n_levels,)
            [m/s]
        """
        return sound_speed(self.temperature, self.salinity, self.depth, self.lat, self.lon, equation=equation)

    def cell_means(self, levels: ArrayLike) -> tuple[Array, Array]:
        """
        Temperature and salinity averaged over the cells of levels.

        A cell reaches half-way to the next level on either side, that of the first level up to it, that of
        the last down to it. Between samples the profile is linear; beyond the first and last sample it is
        constant. The average is exact for that.

        Parameters
        ----------
        levels : array_like, shape (n,)
            Strictly increasing. [m]

        Returns
        -------
        temperature, salinity : ndarray, shape (n,)
            [degC], [-]
        """
        z = np.asarray(levels, dtype=float)
        edges = np.concatenate([z[:1], 0.5 * (z[:-1] + z[1:]), z[-1:]])
        return self._means(edges, self.temperature), self._means(edges, self.salinity)

    def _means(self, edges: Array, values: Array) -> Array:
        nodes = np.union1d(edges, self.depth)
        at = np.interp(nodes, self.depth, values)
        integral = np.concatenate([[0.0], np.cumsum(0.5 * (at[1:] + at[:-1]) * np.diff(nodes))])
        return np.asarray(np.diff(np.interp(edges, nodes, integral)) / np.diff(edges))


def clean_cast(
    *,
    name: str,
    place: tuple[float, float],
    time: np.datetime64,
    profile: tuple[Array, Array, Array],
    bottom_depth: float = float("nan"),
    notes: Sequence[str] = (),
    where: str,
) -> Cast:
    """
    Cast from raw rows: what cannot be used is left out and counted.

    Parameters
    ----------
    name : str
    place : tuple of float
        Latitude and longitude. [degrees]
    time : numpy.datetime64
    profile : tuple of ndarray, shape (n_rows,)
        Depth [m], in-situ temperature [degC], practical salinity; NaN where missing.
    bottom_depth : float
        [m]
    notes : sequence of str
        What was done before.
    where : str
        File and station for messages.

    Returns
    -------
    Cast
        A profile that was written from the bottom up is turned round.

    Raises
    ------
    OceanError
        If fewer than two rows are left, or depth is negative in most.
    """
    depth, temperature, salinity = (np.asarray(column, dtype=float) for column in profile)
    told = list(notes)
    dropped: dict[str, int] = {}
    keep = np.isfinite(depth) & np.isfinite(temperature) & np.isfinite(salinity)
    dropped["with a missing value"] = int(np.count_nonzero(~keep))
    if np.count_nonzero(depth[keep] < 0.0) > 0.5 * np.count_nonzero(keep):
        raise OceanError(f"{where}: depth is negative in most rows; it must be positive down")
    possible = keep & (depth <= _DEEPEST)
    for values, variable in ((temperature, "water_temp"), (salinity, "salinity")):
        low, high = _SPAN[variable]
        possible &= (values >= low) & (values <= high)
    dropped["with an impossible value"] = int(np.count_nonzero(keep & ~possible))
    wet = possible & (depth >= 0.0)
    dropped["above the surface"] = int(np.count_nonzero(possible & ~wet))
    rows = np.flatnonzero(wet)
    steps = np.diff(depth[rows])
    if np.count_nonzero(steps < 0.0) > np.count_nonzero(steps >= 0.0):
        rows = rows[::-1]
        told.append("written from the bottom up: turned round")
    deepest = np.concatenate([[-1.0], np.maximum.accumulate(depth[rows])[:-1]]) if rows.size else np.empty(0)
    deeper = rows[depth[rows] > deepest]
    dropped["no deeper than one before"] = int(rows.size - deeper.size)
    told += [f"{count} of {depth.size} rows {why} dropped" for why, count in dropped.items() if count]
    if deeper.size < 2:
        raise OceanError(
            f"{where}: {deeper.size} usable levels; a cast needs at least 2"
            + (f" ({'; '.join(told)})" if told else "")
        )
    return Cast(
        name,
        float(place[0]),
        float(place[1]),
        time,
        depth[deeper],
        temperature[deeper],
        salinity[deeper],
        bottom_depth,
        sum(dropped.values()),
        tuple(told),
    )
