"""Fields of an ocean over a mission, and their medium and currents for rays."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics.currents import Currents
from pymantaray.acoustics.medium import Interpolation, Medium
from pymantaray.acoustics.profiles import Profile
from pymantaray.geometry.sphere import Earth
from pymantaray.ocean.internal_tide import displaced, has_internal_tide
from pymantaray.ocean.varying import snapshot_at

_MARGIN_COLUMNS = 24  # the effect of a spline's end decreases by 0.27 from column to column


def _no_summary() -> tuple[xr.Dataset, pd.DataFrame]:
    """Summary of water that nobody describes."""
    return xr.Dataset(), pd.DataFrame()


@dataclass(frozen=True, eq=False)
class OceanFields:
    """
    Fields of an ocean over a mission; for a varying source, all except `series` are from the last
    snapshot at or before the start.
    """

    geographic: xr.Dataset | None
    """Temperature, salinity and currents of the source (depth, lat, lon); None for a profile."""
    local: xr.Dataset
    """Local ocean (north, east, depth)."""
    series: xr.Dataset | None = None
    """Local ocean over the mission (time [s], north, east, depth); None if it does not vary."""
    cast: Profile | None = None
    """Profile of uniform water, else None."""
    unbounded: bool = False
    """
    True if the domain has no sides for rays: uniform water without a map and without a half extent.
    """
    record: dict[str, Any] = field(default_factory=dict)
    """Reduction of a profile, for files."""
    notes: tuple[str, ...] = ()
    """Doubts about the source."""
    summarize: Callable[[], tuple[xr.Dataset, pd.DataFrame]] = _no_summary
    """Function that gives `profile` and `region`, called at their first use; it can be pickled."""

    @property
    def profile(self) -> xr.Dataset:
        """
        Mean, minimum and maximum sound speed of each level, in the requested domain or else the
        whole region.
        """
        return self._summary[0]

    @property
    def region(self) -> pd.DataFrame:
        """Properties of the region, one per row."""
        return self._summary[1]

    @cached_property
    def _summary(self) -> tuple[xr.Dataset, pd.DataFrame]:
        return self.summarize()

    @property
    def drift(self) -> xr.Dataset:
        """Local ocean for the simulation of the fleet, over time if it varies."""
        return self.local if self.series is None else self.series

    @property
    def varies(self) -> bool:
        """True if the sound speed varies in time."""
        return self.series is not None or has_internal_tide(self.local)

    def local_at(
        self, time: float, columns: Mapping[str, slice] = MappingProxyType({})
    ) -> xr.Dataset:
        """
        Local ocean, or some of its columns north and east, at a time after the start of the
        mission. [s]
        """
        if has_internal_tide(self.local):
            return displaced(self.local, time, columns)
        if self.series is None:
            return self.local.isel(columns)
        return snapshot_at(self.series.isel(columns), time)


def build_medium(
    ocean: OceanFields, interpolation: Interpolation, earth: Earth = "flat"
) -> Medium | Callable[[float], Medium]:
    """
    Build the medium for rays; if the ocean varies, a function of the time after the start of the
    mission [s].
    """
    at = partial(_medium_at, ocean, interpolation, earth)  # a partial can be pickled
    return at if ocean.varies else at(0.0)


def _medium_at(
    ocean: OceanFields, interpolation: Interpolation, earth: Earth, time: float
) -> Medium:
    local = ocean.local_at(time)
    if ocean.unbounded:
        # an axis with one point has no variation and no end
        local = local.isel(north=[0], east=[0])
    return Medium.from_dataset(local, interpolation=interpolation, earth=earth)


def medium_around(
    ocean: OceanFields,
    interpolation: Interpolation,
    earth: Earth,
    time: float,
    positions: NDArray[np.float64],
) -> Medium:
    """
    Build the medium at a time [s] from the columns around positions (n, 3) [m].

    It has 24 more columns on each side. The spline there differs from that of all columns by a part
    in 10^13 of the difference at its edge, and a medium of a few kilometres within a large region
    takes a small part of the time.
    """
    if ocean.unbounded:
        return _medium_at(ocean, interpolation, earth, time)
    columns = {}
    for name, along in (("north", positions[:, 0]), ("east", positions[:, 1])):
        first, last = np.searchsorted(ocean.local[name].values, [along.min(), along.max()])
        columns[name] = slice(max(int(first) - _MARGIN_COLUMNS, 0), int(last) + _MARGIN_COLUMNS)
    return Medium.from_dataset(
        ocean.local_at(time, columns), interpolation=interpolation, earth=earth
    )


def build_currents(ocean: OceanFields) -> Currents | Callable[[float], Currents]:
    """Build the currents along rays, as in `build_medium`."""
    at = partial(_currents_at, ocean)
    return at if ocean.varies else at(0.0)


def _currents_at(ocean: OceanFields, time: float) -> Currents:
    return Currents.from_dataset(ocean.local_at(time))
