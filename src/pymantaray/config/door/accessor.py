"""Accessor ``mantaray`` of xarray data sets: sound speed, sections, media and eigenrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.arrays import Array
from pymantaray.config.door.water import open_water
from pymantaray.errors import WaterError
from pymantaray.messages import one_line
from pymantaray.ocean import cf, open_ocean
from pymantaray.ocean.convert import levels
from pymantaray.ocean.files import open_file
from pymantaray.ocean.metres import is_in_metres, ocean_in_metres
from pymantaray.ocean.names import Equation
from pymantaray.ocean.seawater import ocean_sound_speed
from pymantaray.records import Arrivals
from pymantaray.sensing.water import Water

_SPEED = {
    "standard_name": "speed_of_sound_in_sea_water",
    "long_name": "sound speed",
    "units": "m s-1",
}


class OceanAccessor:
    """
    Sound in an ocean data set: ``data.mantaray``.

    The data set is any source of `pymantaray.ocean.open_ocean`, or water in metres. Importing
    `pymantaray.xarray` registers the accessor.
    """

    def __init__(self, data: xr.Dataset) -> None:
        self._data = data

    def sound_speed(self, *, equation: Equation = "teos-10", **options: Any) -> xr.DataArray:
        """
        Return the sound speed at the grid points.

        Parameters
        ----------
        equation : str
            Key of `pymantaray.ocean.equations.EQUATIONS`.
        **options
            Options of `pymantaray.ocean.open_ocean`: ``time``, ``window`` and ``names``.

        Returns
        -------
        xarray.DataArray
            Shape (depth, latitude, longitude), with the dimensions and levels of the data set in
            increasing order, so that sums and differences with its variables align; NaN below the
            sea bed. Values of levels of pressure are those at their depths at the middle latitude.
            [m s-1]

        Examples
        --------
        >>> import pymantaray.xarray
        >>> from pymantaray.ocean import open_ocean
        >>> ocean = open_ocean("synthetic:fram")
        >>> print(f"{float(ocean.mantaray.sound_speed()[0, 40, 120]):.1f} m/s")
        1458.2 m/s
        """
        if is_in_metres(self._data):
            return ocean_in_metres(self._data)["sound_speed"].where(
                self._data["sound_speed"].notnull()
            )
        ocean = open_ocean(self._data, **{"currents": "rest", **options})
        speed = xr.DataArray(
            ocean_sound_speed(ocean, equation=equation),
            ocean["water_temp"].coords,
            ocean["water_temp"].dims,
            "sound_speed",
            {**_SPEED, "sound_speed_equation": equation},
        )
        return self._on_own_axes(speed, options.get("names") or {})

    def medium(self, **options: Any) -> Medium:
        """
        Build the medium of rays, at the start if the water varies.

        Parameters
        ----------
        **options
            Options of `pymantaray.open_water`, such as ``centre=(lat, lon)``, ``half_extent`` and
            ``bathymetry``.

        Returns
        -------
        Medium
        """
        return open_water(self._data, **options).at_start[0]

    def section(
        self,
        start: tuple[float, float],
        end: tuple[float, float],
        *,
        points: int = 201,
        **options: Any,
    ) -> xr.DataArray:
        """
        Return the sound speed of a vertical section, with the interpolation of rays.

        Parameters
        ----------
        start, end : tuple of float
            Ends of a straight line in the local frame: latitude and longitude [degrees], or north
            and east if the data set is in metres. [m]
        points : int
            Number of points along the line.
        **options
            As in `medium`.

        Returns
        -------
        xarray.DataArray
            Shape (depth, distance), with the positions of the points as coordinates; NaN outside
            the water. [m s-1]
        """
        if points < 2:
            raise WaterError(f"points is {points!r}; a section needs 2 or more points")
        water = open_water(self._data, **options)
        medium, _ = water.at_start
        ends = self._positions(water, {"start": start, "end": end}, 2)
        share = np.linspace(0.0, 1.0, points)[:, None]
        north, east = (ends["start"][0, :2] * (1.0 - share) + ends["end"][0, :2] * share).T
        grid = np.broadcast_arrays(north, east, medium.depth[:, None])
        speed = medium.sound_speed_at(np.stack(grid, axis=-1).reshape(-1, 3))
        if np.isnan(speed).all():
            raise WaterError(
                f"section from {one_line(repr(start), 60)} to {one_line(repr(end), 60)}: no point"
                f" of it is in the water; {medium!r}"
            )
        coords: dict[str, Any] = {
            "depth": ("depth", medium.depth, {"units": "m", "positive": "down"}),
            "distance": ("distance", np.hypot(north - north[0], east - east[0]), {"units": "m"}),
            "north": ("distance", north, {"units": "m"}),
            "east": ("distance", east, {"units": "m"}),
        }
        if water.frame is not None:
            for name, values in zip(
                ("latitude", "longitude"), water.frame.to_geodetic(north, east), strict=True
            ):
                unit = f"degrees_{'north' if name == 'latitude' else 'east'}"
                coords[name] = ("distance", values, {"standard_name": name, "units": unit})
        dims = ("depth", "distance")
        return xr.DataArray(speed.reshape(-1, points), coords, dims, "sound_speed", _SPEED)

    def eigenrays(self, source: ArrayLike, receiver: ArrayLike, **options: Any) -> Arrivals:
        """
        Find the eigenrays between positions.

        Parameters
        ----------
        source, receiver : array_like, shape (n, 3) or (3,)
            Latitude and longitude in degrees, and depth in metres; north, east, down in metres if
            the data set is in metres.
        **options
            As in `medium`; also ``max_surface_bounces``, ``max_bottom_bounces`` and
            ``spreading_cutoff_db``.

        Returns
        -------
        Arrivals
        """
        water = open_water(self._data, **options)
        ends = self._positions(water, {"source": source, "receiver": receiver}, 3)
        search = water.reception
        return find_eigenrays(
            water.at_start[0],
            ends["source"],
            ends["receiver"],
            search.max_surface_bounces,
            search.max_bottom_bounces,
            search.spreading_cutoff_db,
        )

    def _on_own_axes(self, field: xr.DataArray, names: Mapping[str, str]) -> xr.DataArray:
        """Field of an opened ocean on the levels and with the dimensions of the data set."""
        data = open_file(self._data)
        cf.with_standard_names([data], names)
        layout = cf.layout_of(data)
        own = data[layout.depth]
        below, _ = levels(data, layout.depth)
        # a level at the surface is added to data that begin below it
        field = field.isel(depth=slice(field.sizes["depth"] - below.size, None))
        labels = ("depth", own.values[np.argsort(below)], self._data[layout.depth].attrs)
        field = field.drop_vars("depth").assign_coords(depth=labels)
        axes = {"depth": layout.depth, "lat": layout.lat, "lon": layout.lon}
        return field.rename({old: new for old, new in axes.items() if new != old})

    def _positions(self, water: Water, ends: dict[str, Any], size: int) -> dict[str, Array]:
        """Positions by name (n, 3) in the local frame, at depth 0 if they have two numbers. [m]"""
        local = is_in_metres(self._data)
        words = ("north", "east", "down") if local else ("latitude", "longitude", "depth")
        out = {}
        for name, given in ends.items():
            try:
                position = np.atleast_2d(np.asarray(given, dtype=float))
            except (TypeError, ValueError):
                position = np.empty((0, 0))
            if position.ndim != 2 or position.shape[1] != size or not np.isfinite(position).all():
                raise WaterError(
                    f"{name} is {one_line(repr(given), 60)}; it must be {', '.join(words[:size])},"
                    " all finite numbers"
                )
            position = np.pad(position, ((0, 0), (0, 3 - size)))
            out[name] = position if local else water.to_local(position, 0.0 * position)[0]
        return out
