"""
Grid points of a valid ocean as arrays for interpolation: extended below the sea bed and over land,
with sound speed and sea floor.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import xarray as xr

from pymantaray.arrays import AnyArray, Array, Indices, Instants, Mask
from pymantaray.ocean.equations import check_equation
from pymantaray.ocean.names import Equation
from pymantaray.ocean.schema import VARIABLES, validate_ocean
from pymantaray.ocean.sea_floor import (
    extended_down,
    fill_below_sea_bed,
    nearest_wet_columns,
    sea_floor_depth,
)
from pymantaray.ocean.seawater import sound_speed

Places = tuple[Indices, Indices]
"""Rows and columns of grid points."""


@dataclass(frozen=True, eq=False)
class GridPoints:
    """
    Grid points of a valid ocean, checked once by `of`.

    Parts share sound speeds with the whole. Those of a water column are computed when a part first
    needs them; they do not depend on other columns.
    """

    lat: Array
    """Shape (lat,). [degrees]"""
    lon: Array
    """Shape (lon,). [degrees]"""
    depth: Array
    """Shape (depth,). [m]"""
    fields: dict[str, AnyArray]
    """Variables (depth, lat, lon); NaN below the sea bed and on land."""
    sea_floor: Array
    """Depth (lat, lon) of the sea floor from the levels, see `sea_floor_depth`. [m]"""
    equation: Equation
    time: Instants
    """Instant of the fields (UTC)."""
    attrs: dict[str, Any]
    """Attributes of the ocean: title, source, synthetic."""
    _speed: Array
    _has_speed: Mask

    @classmethod
    def of(cls, ocean: xr.Dataset, equation: Equation = "teos-10") -> Self:
        """
        Grid points of an ocean with its sound speed by an equation; raises OceanError if the ocean
        is invalid.
        """
        validate_ocean(ocean)
        check_equation(equation)
        lat, lon, depth = (
            np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon", "depth")
        )
        shape = depth.size, lat.size, lon.size
        return cls(
            lat,
            lon,
            depth,
            {v.name: ocean[v.name].values for v in VARIABLES},
            sea_floor_depth(ocean).values,
            equation,
            ocean["time"].values,
            {name: ocean.attrs[name] for name in ("title", "source", "synthetic")},
            np.empty(shape),
            np.zeros(shape[1:], dtype=bool),
        )

    def part(self, rows: slice, columns: slice) -> Self:
        """Grid points of a rectangle of rows and columns."""
        return replace(
            self,
            lat=self.lat[rows],
            lon=self.lon[columns],
            fields={name: field[:, rows, columns] for name, field in self.fields.items()},
            sea_floor=self.sea_floor[rows, columns],
            _speed=self._speed[:, rows, columns],
            _has_speed=self._has_speed[rows, columns],
        )

    def around(self, places: tuple[Array, Array], n: int) -> Self:
        """
        Grid points of the rectangle that contains latitudes and longitudes [degrees], and n more on
        each side.
        """
        sides = []
        for axis, reach in zip((self.lat, self.lon), places, strict=True):
            first = int(np.searchsorted(axis, reach.min(), side="right")) - 1
            last = int(np.searchsorted(axis, reach.max(), side="left"))
            sides.append(slice(max(first - n, 0), last + n + 1))
        return self.part(*sides)

    @property
    def wet(self) -> Mask:
        """True (lat, lon) at columns with water."""
        return np.asarray(np.isfinite(self.fields["water_temp"][0]))

    def extended(self, name: str, n_added: int = 0) -> Array:
        """
        Variable (depth + n_added, lat, lon) as from `fill_below_sea_bed`; added levels repeat the
        last one.
        """
        filled = fill_below_sea_bed(self.fields[name], self.lat)
        return np.concatenate([filled, np.repeat(filled[-1:], n_added, axis=0)])

    def sound_speed(self, added: Array) -> Array:
        """
        Sound speed (depth + added, lat, lon) of the extended temperature and salinity, also at
        added levels. [m/s]
        """
        wet = self.wet
        self._convert_missing(wet & ~self._has_speed)
        if wet.all() and not added.size:
            return self._speed
        nearest = nearest_wet_columns(wet, self.lat)
        speed = self._speed.copy()
        rows, columns = np.nonzero(~wet)
        if rows.size:
            water = nearest[0][rows, columns], nearest[1][rows, columns]
            speed[:, rows, columns] = self._converted((rows, columns), water, self.depth)
        if not added.size:
            return speed
        rows, columns = np.nonzero(np.ones(wet.shape))
        water = nearest[0].ravel(), nearest[1].ravel()
        below = self._converted((rows, columns), water, added, last=True)
        return np.concatenate([speed, below.reshape(added.size, *wet.shape)])

    def _convert_missing(self, missing: Mask) -> None:
        """Compute the sound speed of the rectangle that contains the missing water columns."""
        if not missing.any():
            return
        rows, columns = (slice(int(i.min()), int(i.max()) + 1) for i in np.nonzero(missing))
        T, S = (
            extended_down(self.fields[name][:, rows, columns])
            for name in ("water_temp", "salinity")
        )
        place = self.depth[:, None, None], self.lat[rows, None], self.lon[columns]
        self._speed[:, rows, columns] = sound_speed(T, S, *place, equation=self.equation)
        self._has_speed[rows, columns] = True

    def _converted(self, at: Places, water: Places, depth: Array, *, last: bool = False) -> Array:
        """
        Sound speed (depth, n) at n columns with the water of n wet columns; on request, with that
        of their last level.
        """
        T, S = (
            extended_down(self.fields[name][:, water[0], water[1]])
            for name in ("water_temp", "salinity")
        )
        if last:
            T = T[-1:]
            S = S[-1:]
        place = depth[:, None], self.lat[at[0]], self.lon[at[1]]
        return sound_speed(T, S, *place, equation=self.equation)
