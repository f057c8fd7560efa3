"""From the section `[ocean]` of a configuration to fields in the local frame, and to the medium and currents of rays."""

import datetime as dt
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium
from pymantaray.acoustics.medium import Interpolation
from pymantaray.config.sections import OceanSection, SoundConfig
from pymantaray.ocean import (
    crop_around,
    ocean_times,
    open_ocean,
    open_ocean_series,
    open_sea_floor,
    region_table,
    sound_speed_profile_spread,
    to_local,
    window_of,
    with_ice,
)
from pymantaray.ocean.internal_tide import displaced, has_internal_tide, with_internal_tide
from pymantaray.water.varying import series_of, snapshot_at


@dataclass(frozen=True, eq=False)
class OceanFields:
    """Fields of an ocean over a mission; if its source varies, all except `series` are of the last snapshot at or before the start."""

    geographic: xr.Dataset
    """Temperature, salinity and currents as the source has them: depth, lat, lon."""
    local: xr.Dataset
    """Dimensions north, east, depth."""
    profile: xr.Dataset
    """Mean, least and greatest sound speed of each level: of the domain's size that was asked for, else of the whole region."""
    region: pd.DataFrame
    """Properties of the region, one row each."""
    series: xr.Dataset | None = None
    """The local ocean over the mission: time [s], north, east, depth; None if it stands still."""

    @property
    def drift(self) -> xr.Dataset:
        """The local ocean that the fleet drifts in, over time where it varies."""
        return self.local if self.series is None else self.series

    @property
    def varies(self) -> bool:
        """Whether sound runs through other water at another time."""
        return self.series is not None or has_internal_tide(self.local)

    def local_at(self, time: float) -> xr.Dataset:
        """Local ocean at a time since the start of the mission. [s]"""
        if has_internal_tide(self.local):
            return displaced(self.local, time)
        return self.local if self.series is None else snapshot_at(self.series, time)


def build_ocean(section: OceanSection, duration: float) -> OceanFields:
    """Ocean of a configuration over the duration of a mission [s], in its local frame."""
    oceans, time = _open(section, duration)
    geographic = oceans[0]
    sea_floor = build_sea_floor(section, geographic)

    def local_ones() -> Iterator[xr.Dataset]:
        oceans.reverse()
        while oceans:  # each is let go once it is brought to the local grid
            yield local_ocean(section, oceans.pop(), sea_floor)

    series = series_of(local_ones(), time) if section.time_varying else None
    return OceanFields(
        geographic=geographic,
        local=next(local_ones()) if series is None else series.isel(time=0, drop=True),
        profile=sound_speed_profile_spread(_at_domain(section, geographic), equation=section.equation),
        region=region_table(geographic, equation=section.equation),
        series=series,
    )


def mission_ocean(config: SoundConfig) -> OceanFields:
    """Ocean of a configuration, over the duration of its mission if it varies."""
    section = config.ocean
    return build_ocean(section, config.mission.duration_h * 3600.0 if section.time_varying else 0.0)


def _at_domain(section: OceanSection, geographic: xr.Dataset) -> xr.Dataset:
    """Part of an ocean that encloses the domain of a study; all of it where no size was asked for."""
    if section.half_extent is None:
        return geographic
    return crop_around(geographic, section.centre, section.half_extent)


def local_ocean(section: OceanSection, geographic: xr.Dataset, sea_floor: xr.DataArray | None) -> xr.Dataset:
    """Ocean in the local frame of a study, under its ice."""
    local = to_local(
        geographic,
        centre=section.centre,
        half_extent=section.half_extent,
        sea_floor=sea_floor,
        equation=section.equation,
    )
    local = local if section.ice is None else with_ice(local, section.ice)
    tide = section.internal_tide
    if tide is None:
        return local
    return with_internal_tide(
        local, amplitude=tide.amplitude, period=3600.0 * tide.period_h, wavelength=tide.wavelength
    )


def build_sea_floor(section: OceanSection, geographic: xr.Dataset) -> xr.DataArray | None:
    """Sea floor of a study where it has a file of its own."""
    if section.bathymetry is None:
        return None
    return open_sea_floor(section.bathymetry, window=window_of(geographic))


def open_start(section: OceanSection) -> xr.Dataset:
    """Geographic ocean of a study's start."""
    return _open(section, 0.0)[0][0]


def mission_start(section: OceanSection) -> np.datetime64:
    """Start of a mission; the first time of its source if it names none."""
    if section.time is None:
        return np.datetime64(ocean_times(section.source)[0], "ns")
    return utc_instant(section.time)


def utc_instant(time: dt.datetime) -> np.datetime64:
    """Instant of a configuration's time, in UTC if it names no zone."""
    if time.tzinfo is not None:
        time = time.astimezone(dt.UTC).replace(tzinfo=None)
    return np.datetime64(time, "ns")


def _open(section: OceanSection, duration: float) -> tuple[list[xr.Dataset], NDArray[np.float64]]:
    """Snapshots of a mission, the only one where the ocean stands still, and when they are. [s]"""
    if not section.time_varying:
        time = None if section.time is None else mission_start(section)
        return [open_ocean(section.source, time=time, currents=section.currents)], np.zeros(1)
    start = mission_start(section)
    second = np.timedelta64(1_000_000_000, "ns")
    stop = start + round(duration * 1e9) * np.timedelta64(1, "ns")
    oceans = list(open_ocean_series(section.source, start, stop, currents=section.currents))
    return oceans, np.array([(ocean["time"].values - start) / second for ocean in oceans])


def build_medium(config: SoundConfig, ocean: OceanFields) -> Medium | Callable[[float], Medium]:
    """Medium of a study's rays; a function of the time since the mission's start [s] if the ocean varies."""
    at = partial(_medium_at, ocean, config.acoustics.interpolation)  # which another process can be given
    return at if ocean.varies else at(0.0)


def _medium_at(ocean: OceanFields, interpolation: Interpolation, time: float) -> Medium:
    return Medium.from_dataset(ocean.local_at(time), interpolation=interpolation)


def build_currents(config: SoundConfig, ocean: OceanFields) -> Currents | Callable[[float], Currents] | None:
    """Currents along the rays of a study, like `build_medium`; None if rays run through water at rest."""
    if not config.acoustics.currents:
        return None

    at = partial(_currents_at, ocean)
    return at if ocean.varies else at(0.0)


def _currents_at(ocean: OceanFields, time: float) -> Currents:
    return Currents.from_dataset(ocean.local_at(time))
