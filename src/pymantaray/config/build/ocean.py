"""Fields of an ocean in the local frame, and their medium, currents and absorption for rays."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Absorption, Currents, Medium
from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.profiles import Profile
from pymantaray.config.estimators import InternalTideSection
from pymantaray.config.sections import OceanSection
from pymantaray.errors import OceanError, StudyError
from pymantaray.geometry.sphere import Earth
from pymantaray.ocean import (
    crop_around,
    holds_casts,
    ocean_times,
    open_ocean,
    open_ocean_series,
    open_sea_floor,
    region_table,
    sound_speed_profile_spread,
    to_local,
    window_of,
)
from pymantaray.ocean.internal_tide import displaced, has_internal_tide, with_internal_tide
from pymantaray.ocean.open import Source
from pymantaray.ocean.schema import reading_notes
from pymantaray.user_files import exists
from pymantaray.ocean.instants import utc_instant
from pymantaray.config.build.metres import local_of, metres_of, section_in_metres
from pymantaray.config.build.uniform import (
    columns_spread,
    geographic_of,
    one_profile,
    profile_region,
    profile_spread,
    uniform_water,
    with_section_ice,
)
from pymantaray.ocean.varying import series_of, snapshot_at

_MARGIN_COLUMNS = 24  # the effect of a spline's end decreases by 0.27 from column to column


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
    profile: xr.Dataset
    """
    Mean, minimum and maximum sound speed of each level, in the requested domain or else the whole
    region.
    """
    region: pd.DataFrame
    """Properties of the region, one per row."""
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

    @property
    def drift(self) -> xr.Dataset:
        """Local ocean for the simulation of the fleet, over time if it varies."""
        return self.local if self.series is None else self.series

    @property
    def varies(self) -> bool:
        """True if the sound speed varies in time."""
        return self.series is not None or has_internal_tide(self.local)

    def absorption(self, formula: str, centre: tuple[float, float] | None) -> Absorption | None:
        """
        Absorption in the water by a formula, or ``none``; most formulas need temperature and
        salinity.
        """
        if formula == "none":
            return None
        if formula == "thorp":
            return Absorption.thorp()
        known: Any = formula
        if self.geographic is not None:
            return Absorption.from_dataset(self.geographic, centre=centre, formula=known)
        if self.cast is None or self.cast.water is None:
            raise StudyError(
                f"detection.absorption is {formula}, but"
                f" {self.local.attrs.get('title', 'the water')} has no temperature or salinity; set"
                " detection.absorption to thorp or none"
            )
        return Absorption.from_profile(self.cast.depth, *self.cast.water, formula=known)

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


def build_ocean(
    section: OceanSection,
    duration: float,
    *,
    interpolation: Interpolation = "smooth",
    data: xr.Dataset | None = None,
) -> OceanFields:
    """
    Build the ocean of a configuration over the duration of a mission [s], in its local frame.

    ``data`` is an ocean in memory that replaces the section's source. The interpolation of the
    medium affects thinned profiles.
    """
    if (metres := metres_of(section, data)) is not None:
        return local_fields(section, metres)
    if data is None and is_profile(section):
        return profile_fields(section, one_profile(section), interpolation)
    for key in ("thin", "smooth"):
        if getattr(section, key) is not None:
            raise OceanError(
                f"ocean.{key} (--{key}) applies to a profile, not to an ocean; remove it"
            )
    oceans, time = _open(section, duration, data)
    geographic = oceans[0]
    sea_floor = build_sea_floor(section, geographic)

    def local_ones() -> Iterator[xr.Dataset]:
        oceans.reverse()
        while oceans:  # frees each ocean after its interpolation to the local grid
            yield local_ocean(section, oceans.pop(), sea_floor)

    series = series_of(local_ones(), time) if section.time_varying else None
    domain = at_domain(section, geographic)
    profile = sound_speed_profile_spread(domain, equation=section.equation)
    whole = profile if domain is geographic else None
    return OceanFields(
        geographic=geographic,
        local=next(local_ones()) if series is None else series.isel(time=0, drop=True),
        profile=profile,
        region=region_table(geographic, equation=section.equation, profile=whole),
        series=series,
        notes=tuple(f"{geographic.attrs['title']}: {line}" for line in reading_notes(geographic)),
    )


def is_profile(section: OceanSection) -> bool:
    """True if the source is a profile or cast: horizontally uniform water."""
    first = section.source[0]
    return exists(first) and not section_in_metres(section) and holds_casts(first)


def local_fields(section: OceanSection, data: xr.Dataset) -> OceanFields:
    """Build an ocean from a data set in metres."""
    local = with_tide(section.internal_tide, with_section_ice(section, local_of(section, data)))
    return OceanFields(
        geographic=None,
        local=local,
        profile=columns_spread(local),
        region=profile_region(local),
    )


def profile_fields(
    section: OceanSection, profile: Profile, interpolation: Interpolation
) -> OceanFields:
    """Build a horizontally uniform ocean from one profile."""
    water = uniform_water(section, profile, interpolation)
    local = with_tide(section.internal_tide, water.local)
    return OceanFields(
        geographic=None,
        local=local,
        profile=profile_spread(water.local),
        region=profile_region(water.local),
        cast=profile,
        unbounded=section.half_extent is None and section.internal_tide is None,
        record=water.record,
        notes=water.notes,
    )


def at_domain(section: OceanSection, geographic: xr.Dataset) -> xr.Dataset:
    """Crop an ocean to the domain of a section; unchanged without a half extent."""
    if section.half_extent is None:
        return geographic
    return crop_around(geographic, section.centre, section.half_extent)


def local_ocean(
    section: OceanSection, geographic: xr.Dataset, sea_floor: xr.DataArray | None
) -> xr.Dataset:
    """Ocean in the local frame of a study, with ice."""
    local = to_local(
        geographic,
        centre=section.centre,
        half_extent=section.half_extent,
        sea_floor=sea_floor,
        equation=section.equation,
    )
    return with_tide(section.internal_tide, with_section_ice(section, local))


def with_tide(tide: InternalTideSection | None, local: xr.Dataset) -> xr.Dataset:
    """Local ocean with an internal tide instead of its own; unchanged without one."""
    if tide is None:
        return local
    return with_internal_tide(
        local, amplitude=tide.amplitude, period=3600.0 * tide.period_h, wavelength=tide.wavelength
    )


def build_sea_floor(section: OceanSection, geographic: xr.Dataset) -> xr.DataArray | None:
    """
    Sea floor of a section on latitude and longitude, from a file or of constant depth; None without
    a sea floor. [m]
    """
    bed = section.bathymetry
    if bed is None:
        return None
    if isinstance(bed, str):
        return open_sea_floor(bed, window=window_of(geographic), crs=section.bathymetry_crs)
    flat = xr.full_like(geographic["water_temp"].isel(depth=0, drop=True), bed)
    return flat.rename("sea_floor_depth").assign_attrs(units="m", source="one depth")


def open_start(section: OceanSection) -> xr.Dataset:
    """Open the geographic ocean at a study's start; for a cast, horizontally uniform."""
    if section_in_metres(section):
        raise OceanError(
            f"{section.source[0]}: water in metres has no latitude, longitude, temperature and"
            " salinity, which this task needs; use an ocean that has them"
        )
    if is_profile(section):
        return geographic_of(section, one_profile(section))
    return _open(section, 0.0, None)[0][0]


def open_geographic(section: OceanSection) -> tuple[xr.Dataset, xr.DataArray | None]:
    """Open the geographic ocean at a study's start, and its sea floor if it has one. [m]"""
    geographic = open_start(section)
    return geographic, build_sea_floor(section, geographic)


def mission_start(section: OceanSection, data: xr.Dataset | None = None) -> np.datetime64:
    """Start of a mission; without one, the first time of the source."""
    if section.time is None:
        return np.datetime64(ocean_times(_source(section, data), section.standard_names)[0], "ns")
    return utc_instant(section.time)


def _source(section: OceanSection, data: xr.Dataset | None) -> Source:
    return section.source if data is None else data


def _open(
    section: OceanSection, duration: float, data: xr.Dataset | None
) -> tuple[list[xr.Dataset], NDArray[np.float64]]:
    """Snapshots of a mission, one for a constant ocean, and their times. [s]"""
    source = _source(section, data)
    options: dict[str, Any] = {"currents": section.currents, "names": section.standard_names}
    if not section.time_varying:
        time = None if section.time is None else mission_start(section)
        return [open_ocean(source, time=time, **options)], np.zeros(1)
    start = mission_start(section, data)
    second = np.timedelta64(1_000_000_000, "ns")
    stop = start + round(duration * 1e9) * np.timedelta64(1, "ns")
    oceans = list(open_ocean_series(source, start, stop, **options))
    return oceans, np.array([(ocean["time"].values - start) / second for ocean in oceans])


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
        local = local.isel(
            north=[0], east=[0]
        )  # an axis with one point has no variation and no end
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
        axis = ocean.local[name].values
        first, last = np.searchsorted(axis, [along.min(), along.max()])
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
