"""The ocean of a section: fields over a mission, local ocean, sea floor and start."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.acoustics.profiles import Profile
from pymantaray.arrays import Array
from pymantaray.config.common import utc_instant
from pymantaray.config.door.metres import local_of, metres_of, section_in_metres
from pymantaray.config.door.uniform import (
    geographic_of,
    label,
    one_profile,
    read_section_profiles,
    start_in,
    uniform_water,
    with_section_ice,
)
from pymantaray.config.estimators import InternalTideSection
from pymantaray.config.sections import OceanSection, SoundConfig
from pymantaray.errors import OceanError
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
from pymantaray.ocean.internal_tide import with_internal_tide
from pymantaray.ocean.names import Equation
from pymantaray.ocean.open import Source
from pymantaray.ocean.schema import reading_notes
from pymantaray.ocean.sea_floor_water import sea_floor_notes
from pymantaray.ocean.summary import columns_spread, profile_region, profile_spread
from pymantaray.ocean.varying import series_of
from pymantaray.ocean.window import domain_window
from pymantaray.user_files import exists


@dataclass(frozen=True, eq=False)
class MissionOcean:
    """Ocean of a mission before it is opened."""

    section: OceanSection
    duration: float
    """Time over which it varies; 0 if it is constant. [s]"""

    def open(
        self, interpolation: Interpolation = "smooth", data: xr.Dataset | None = None
    ) -> OceanFields:
        """
        Fields of the ocean, or of one in memory, over the mission, see `varies_with_interpolation`.
        """
        return build_ocean(self.section, self.duration, interpolation=interpolation, data=data)

    def geographic_start(self) -> xr.Dataset:
        """Geographic ocean at the start; for a cast, horizontally uniform."""
        return open_start(self.section)

    def in_domain(self) -> tuple[xr.Dataset, xr.DataArray | None]:
        """Geographic ocean at the start in its domain, and its sea floor if it has one. [m]"""
        ocean = at_domain(self.section, self.geographic_start())
        return ocean, self.sea_floor(ocean)

    def sea_floor(self, geographic: xr.Dataset) -> xr.DataArray | None:
        """Sea floor on latitude and longitude; None if the ocean's own is used. [m]"""
        return build_sea_floor(self.section, geographic)

    def notes(self) -> tuple[str, ...]:
        """Notes of the readers of profiles, or of the ocean at its start and its sea floor."""
        if self.in_metres:
            return ()
        if self.is_profile:
            profiles = self.profiles()
            return tuple(f"{label(self.section, p)}: {note}" for p in profiles for note in p.notes)
        return _notes(*self.in_domain())

    def notes_of(self, ocean: xr.Dataset, sea_floor: xr.DataArray | None) -> tuple[str, ...]:
        """Notes of the readers of an opened ocean and its sea floor."""
        return _notes(ocean, sea_floor)

    def with_ice(self, local: xr.Dataset) -> xr.Dataset:
        """Local ocean with ice, smooth or rough; unchanged without ice."""
        return with_section_ice(self.section, local)

    def profiles(self) -> list[Profile]:
        """Profiles of the files."""
        return read_section_profiles(self.section)

    def profile(self) -> Profile:
        """The only profile of the files; several raise an error."""
        return one_profile(self.section)

    def instants(self) -> list[np.datetime64]:
        """Known instants of the source; none for a profile."""
        if self.is_profile:
            return []
        times = ocean_times(self.section.source, self.section.standard_names)
        return [time for time in times if not np.isnat(time)]

    def at(self, time: np.datetime64) -> "MissionOcean":
        """The ocean at one of its instants."""
        instant = time.astype("datetime64[us]").item()
        return replace(self, section=self.section.model_copy(update={"time": instant}))

    def local_start(self) -> xr.Dataset:
        """Local ocean at the start, without the checks of a domain's spread."""
        if self.in_metres:
            return build_ocean(self.section, 0.0).local
        geographic = open_start(self.section)
        return local_ocean(self.section, geographic, build_sea_floor(self.section, geographic))

    @property
    def source(self) -> tuple[str, ...]:
        """Files, a profile, or the name of a synthetic ocean."""
        return self.section.source

    @property
    def files(self) -> tuple[str, ...]:
        """All files that the ocean is read from."""
        return self.section.files

    @property
    def reading(self) -> dict[str, Any]:
        """Options of `open_ocean`: whether currents are required, and names of variables."""
        return {"currents": self.section.currents, "names": self.section.standard_names}

    @property
    def domain(self) -> dict[str, Any]:
        """Centre [degrees] and half extents [m] of the domain; None for all data."""
        return {"centre": self.section.centre, "half_extent": self.section.half_extent}

    @property
    def time(self) -> np.datetime64 | None:
        """Time of the ocean; None for the first of the source."""
        return None if self.section.time is None else utc_instant(self.section.time)

    @property
    def has_ice(self) -> bool:
        """True if there is ice."""
        return self.section.ice is not None

    @property
    def has_sea_floor(self) -> bool:
        """True if the sea floor is not that of the source."""
        return self.section.bathymetry is not None

    @property
    def maps(self) -> list[str]:
        """Files of sea floor and ice."""
        return [f for f in (self.section.bathymetry, self.section.ice) if isinstance(f, str)]

    @property
    def has_tide(self) -> bool:
        """True if an internal tide moves the water."""
        return self.section.internal_tide is not None

    @property
    def values(self) -> dict[str, Any]:
        """Values of everything but source and time, as in JSON."""
        return self.section.model_dump(mode="json", exclude={"source", "time"})

    @property
    def in_metres(self) -> bool:
        """True if the source is water in metres."""
        return section_in_metres(self.section)

    @property
    def time_varying(self) -> bool:
        """True if the source varies during the mission."""
        return self.section.time_varying

    @property
    def is_profile(self) -> bool:
        """True if the source is a profile or cast."""
        return is_profile(self.section)

    @property
    def varies_with_interpolation(self) -> bool:
        """
        True if the fields depend on the interpolation of the medium: thinned levels of a profile,
        and the grid of a section of sound speed that is turned.
        """
        return self.is_profile or self.section.bearing is not None

    @property
    def own_ice(self) -> bool:
        """True if each realization has its own draw of rough ice."""
        return self.section.ice_draw == "each"

    @property
    def centre(self) -> tuple[float, float] | None:
        """Latitude and longitude of the frame's centre; None for the data's middle. [degrees]"""
        return self.section.centre

    @property
    def equation(self) -> Equation:
        """Equation of sound speed."""
        return self.section.equation


def build_mission_ocean(config: SoundConfig) -> MissionOcean:
    """Ocean of a configuration over the duration of its mission if it varies."""
    varies = config.ocean.time_varying
    return MissionOcean(config.ocean, config.mission.duration_h * 3600.0 if varies else 0.0)


def mission_ocean(config: SoundConfig, data: xr.Dataset | None = None) -> OceanFields:
    """
    Build the ocean of a configuration, or in memory, over the duration of its mission if it varies.
    """
    return build_mission_ocean(config).open(config.acoustics.interpolation, data)


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
        local = with_section_ice(section, local_of(section, metres, interpolation))
        local = with_tide(section.internal_tide, local)
        summarize = partial(_local_summary, local, columns_spread)
        return OceanFields(geographic=None, local=local, summarize=summarize)
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
    return OceanFields(
        geographic=geographic,
        local=next(local_ones()) if series is None else series.isel(time=0, drop=True),
        series=series,
        notes=_notes(geographic, sea_floor),
        summarize=partial(_summary, section, geographic),
    )


def _summary(section: OceanSection, geographic: xr.Dataset) -> tuple[xr.Dataset, pd.DataFrame]:
    """Sound speed of each level of the domain, and properties of the region."""
    domain = at_domain(section, geographic)
    profile = sound_speed_profile_spread(domain, equation=section.equation)
    whole = profile if domain is geographic else None
    return profile, region_table(geographic, equation=section.equation, profile=whole)


def _local_summary(
    local: xr.Dataset, spread: Callable[[xr.Dataset], xr.Dataset]
) -> tuple[xr.Dataset, pd.DataFrame]:
    """Sound speed of each level, and properties of water without latitude and longitude."""
    return spread(local), profile_region(local)


def _notes(geographic: xr.Dataset, sea_floor: xr.DataArray | None) -> tuple[str, ...]:
    """Notes of the readers of an ocean and of its sea floor."""
    title = geographic.attrs["title"]
    own = (f"{title}: {line}" for line in reading_notes(geographic))
    return (*own, *sea_floor_notes(sea_floor))


def is_profile(section: OceanSection) -> bool:
    """True if the source is a profile or cast: horizontally uniform water."""
    first = section.source[0]
    return exists(first) and not section_in_metres(section) and holds_casts(first)


def profile_fields(
    section: OceanSection, profile: Profile, interpolation: Interpolation
) -> OceanFields:
    """Build a horizontally uniform ocean from one profile."""
    water = uniform_water(section, profile, interpolation)
    return OceanFields(
        geographic=None,
        local=with_tide(section.internal_tide, water.local),
        cast=profile,
        unbounded=section.half_extent is None and section.internal_tide is None,
        record=water.record,
        notes=water.notes,
        summarize=partial(_local_summary, water.local, profile_spread),
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
        return open_sea_floor(
            bed, window=window_of(geographic), crs=section.bathymetry_crs, ocean=geographic
        )
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


def mission_start(section: OceanSection, data: xr.Dataset | None = None) -> np.datetime64:
    """Start of a mission; without one, the time of a profile or the first time of the source."""
    if section.time is None and data is None and is_profile(section):
        return start_in(section, one_profile(section))
    if section.time is None:
        source: Source = section.source if data is None else data
        return np.datetime64(ocean_times(source, section.standard_names)[0], "ns")
    return utc_instant(section.time)


def _open(
    section: OceanSection, duration: float, data: xr.Dataset | None
) -> tuple[list[xr.Dataset], Array]:
    """Snapshots of a mission, one for a constant ocean, and their times. [s]"""
    source: Source = section.source if data is None else data
    options: dict[str, Any] = {"currents": section.currents, "names": section.standard_names}
    if section.centre is not None and section.half_extent is not None:
        options["around"] = domain_window(section.centre, section.half_extent)
    if not section.time_varying:
        time = None if section.time is None else mission_start(section)
        return [open_ocean(source, time=time, **options)], np.zeros(1)
    start = mission_start(section, data)
    second = np.timedelta64(1_000_000_000, "ns")
    stop = start + round(duration * 1e9) * np.timedelta64(1, "ns")
    oceans = list(open_ocean_series(source, start, stop, **options))
    return oceans, np.array([(ocean["time"].values - start) / second for ocean in oceans])
