"""Horizontally uniform water from one profile or cast: thinning, smoothing, sea bed and ice."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.profiles import (
    Profile,
    names_of,
    only_one,
    read_profiles,
    reduce_profile,
)
from pymantaray.arrays import Array
from pymantaray.config.common import utc_instant
from pymantaray.config.sections import OceanSection
from pymantaray.errors import AcousticsError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.roughness import Roughness
from pymantaray.ocean import Cast, cast_ocean, open_sea_floor, with_ice, with_roughness
from pymantaray.ocean.local import assemble_local
from pymantaray.ocean.sea_floor import local_floor
from pymantaray.ocean.sea_floor_water import sea_floor_notes
from pymantaray.ocean.synthetic import EPOCH
from pymantaray.ocean.window import Window
from pymantaray.records.position_rows import distances

UNBOUNDED = 1e6
"""Default half side of the domain of a profile. [m]"""
_MAX_GAP = 100.0  # m; a larger distance between the end of a profile and the sea bed causes a note
NEAREST = "nearest"
"""Value of ``ocean.cast`` for the cast nearest to the centre."""
_SAME_STATION = 1000.0  # m; casts at most this much farther than the nearest are compared by time
_NODES = 65  # per horizontal axis under a map of ice


@dataclass(frozen=True, eq=False)
class UniformWater:
    """Local ocean from one profile, a record of its reduction, and notes for the user."""

    profile: Profile
    local: xr.Dataset
    record: dict[str, Any]
    notes: tuple[str, ...] = ()


def read_section_profiles(section: OceanSection) -> list[Profile]:
    """
    Read the profiles of a section's files, or the one that it selects; the place of the section
    applies to files without a place.
    """
    place = None if section.cast == NEAREST else section.centre
    repair = section.repair_freezing
    profiles = [
        p for path in section.source for p in read_profiles(path, place, repair_freezing=repair)
    ]
    if section.cast is None:
        return profiles
    named = [profile for profile in profiles if profile.name == section.cast]
    # ODV names a cast by cruise and station; the station suffices if no other cruise has it
    named = named or [p for p in profiles if p.name.rpartition("/")[2] == section.cast]
    if named or section.cast != NEAREST:
        if len(named) == 1:
            return named
        raise AcousticsError(
            f"{section.source[0]}: {len(named) or 'no'} casts are named {section.cast!r};"
            f" available: {names_of(profiles)}"
        )
    return [_nearest(profiles, section)]


def _nearest(profiles: list[Profile], section: OceanSection) -> Profile:
    """Profile nearest to the centre of a section; of several there, the nearest in time."""
    located = [profile for profile in profiles if profile.place is not None]
    if section.centre is None or not located:
        raise AcousticsError(
            f"{section.source[0]}: the nearest cast needs a `centre` and casts with"
            " positions; give the centre, or the name of a cast"
        )
    places = np.array([profile.place for profile in located])
    apart = distances(places, np.array(section.centre)[None], geographic=True)
    near = np.flatnonzero(apart <= apart.min() + _SAME_STATION)
    if section.time is None or near.size == 1:
        return located[int(apart.argmin())]
    wanted = utc_instant(section.time)
    late = [abs(located[k].time - wanted) for k in near]  # NaT sorts last
    return located[int(near[int(np.argsort(np.array(late), kind="stable")[0])])]


def one_profile(section: OceanSection) -> Profile:
    """Read the only profile of a section; several raise an error."""
    return only_one(Path(section.source[0]).name, read_section_profiles(section), AcousticsError)


def uniform_water(
    section: OceanSection, profile: Profile, interpolation: Interpolation
) -> UniformWater:
    """
    Build a local ocean at rest with one profile everywhere.

    Parameters
    ----------
    section : OceanSection
        Options. ``bathymetry`` is required; ``thin`` and ``smooth`` reduce the profile.
    profile : Profile
        Sound speed.
    interpolation : {"smooth", "linear"}
        Interpolation of the medium.

    Raises
    ------
    MantaRayError
        If there is no sea bed, or a map has no domain.
    """
    where = label(section, profile)
    if section.bathymetry is None:
        raise OceanError(
            f"{where}: a profile has no sea bed; give its depth in metres as bathymetry (in TOML:"
            " ocean.bathymetry)"
        )
    if section.time_varying:
        raise OceanError(f"{where}: one profile does not vary in time; remove ocean.time_varying")
    # maps need a place and an extent
    depth, speed, reduction, reduction_notes = _reduced(section, profile, interpolation)
    place = section.centre or profile.position or profile.place
    half = section.half_extent or (UNBOUNDED, UNBOUNDED)
    maps = [name for name in ("bathymetry", "ice") if isinstance(getattr(section, name), str)]
    if maps and (place is None or section.half_extent is None):
        raise OceanError(
            f"{where}: ocean.{maps[0]} is a map, which needs `centre` and `half_extent` for a"
            " profile; or give a value in metres"
        )
    # one column everywhere: two nodes a side, more only for a map of ice
    n = _NODES if isinstance(section.ice, str) else 2
    north, east = (np.linspace(-h, h, n) for h in half)
    shape = north.size, east.size, depth.size
    floor = _sea_floor(section, place, half, shape[:2])
    local = assemble_local(
        {"north": north, "east": east, "depth": depth},
        np.broadcast_to(speed, shape).copy(),
        (np.zeros(shape), np.zeros(shape)),
        floor,
        {"title": profile.name, "source": section.source[0], "synthetic": 0},
    )
    # time and place of the profile, if it has any
    time = profile.time if section.time is None else utc_instant(section.time)
    if not np.isnat(time):
        local.attrs["time"] = str(np.datetime_as_string(time, unit="s"))
    if place is not None:
        local.attrs |= {
            "centre_latitude_deg": place[0],
            "centre_longitude_deg": place[1],
            "proj_string": LocalFrame(*place).proj_string,
        }
    local = with_section_ice(section, local)
    # record of the reduction, and doubts about the profile
    deepest = float(np.max(floor))
    record = {
        **reduction,
        "levels": int(depth.size),
        "last_level_m": float(profile.depth[-1]),
        "bottom_depth_m": deepest,
    }
    notes = (*profile.notes, *reduction_notes, *_bed_notes(profile, floor, deepest))
    return UniformWater(profile, local, record, tuple(f"{where}: {note}" for note in notes))


def with_section_ice(section: OceanSection, local: xr.Dataset) -> xr.Dataset:
    """Local ocean with the ice of a section, smooth or rough; unchanged if it has none."""
    if section.ice is None:
        return local
    local = with_ice(local, section.ice)
    if section.ice_slope_deg is None:
        return local
    slope = float(np.radians(section.ice_slope_deg))
    return with_roughness(local, Roughness(slope, section.ice_length, draw=section.first_ice_draw))


def label(section: OceanSection, profile: Profile) -> str:
    """Name of a profile for messages: its file, and its own name if that differs."""
    name = Path(section.source[0]).name
    return name if profile.name == Path(name).stem else f"{name}: {profile.name}"


def geographic_of(section: OceanSection, profile: Profile) -> xr.Dataset:
    """
    Geographic ocean from a profile with temperature and salinity, for functions that need them on a
    grid.
    """
    place = section.centre or profile.position
    bottom = section.bathymetry
    if profile.water is None or place is None or not isinstance(bottom, float):
        lacks = (
            "temperature and salinity, which this task needs; use a cast with both, or an ocean"
            if profile.water is None
            else "position, which this task needs; give `centre=LAT LON`"
            if place is None
            else "sea bed of one depth, which this task needs; give it in metres as bathymetry"
        )
        raise OceanError(f"{label(section, profile)}: the profile has no {lacks}")
    temperature, salinity = profile.water
    cast = Cast(
        profile.name, *place, start_in(section, profile), profile.depth, temperature, salinity
    )
    options: dict[str, Any] = (
        {} if section.half_extent is None else {"half_extent": section.half_extent}
    )
    return cast_ocean(
        cast, bathymetry=bottom, below="constant", equation=section.equation, **options
    )


def start_in(section: OceanSection, profile: Profile) -> np.datetime64:
    """Start of a mission in a profile: by default its own time, or that of synthetic oceans."""
    if section.time is not None:
        return utc_instant(section.time)
    return np.datetime64(EPOCH) if np.isnat(profile.time) else profile.time


def _reduced(
    section: OceanSection, profile: Profile, interpolation: Interpolation
) -> tuple[Array, Array, dict[str, Any], tuple[str, ...]]:
    """
    Levels of a profile [m] and their sound speed [m/s], thinned or smoothed by the options of a
    section, a record of this and notes; without options, a raw cast is thinned.
    """
    depth = profile.depth
    speed = profile.sound_speed
    record: dict[str, Any] = {"raw_levels": int(depth.size)}
    if profile.position is not None:
        record |= {"position_deg": list(profile.position), "computed": "TEOS-10"}
    reduced = reduce_profile(
        depth, speed, thin=section.thin, smooth=section.smooth, interpolation=interpolation
    )
    if reduced is None:
        return depth, speed, record, ()
    size = "tolerance_m_s" if reduced.method == "thinned" else "length_m"
    record[reduced.method] = {
        size: reduced.parameter,
        "rms_change_m_s": reduced.rms_change,
        "greatest_change_m_s": reduced.greatest_change,
        "vertical_change_s": reduced.vertical_change,
    }
    return reduced.depth, reduced.sound_speed, record, (str(reduced),)


def _sea_floor(
    section: OceanSection,
    place: tuple[float, float] | None,
    half: tuple[float, float],
    shape: tuple[int, int],
) -> Array | xr.DataArray:
    """Flat sea bed on the grid of the water, or a sea bed from a file on its own axes. [m]"""
    bed = section.bathymetry
    if not isinstance(bed, str):
        return np.full(shape, bed)
    assert place is not None  # checked for maps
    frame = LocalFrame(*place)
    # the latitude of an edge in the north or south is extreme at its middle, not at the corners
    edges = (np.linspace(-1.1 * h, 1.1 * h, 3) for h in half)
    lat, lon = frame.to_geodetic(*np.meshgrid(*edges, indexing="ij"))
    box = float(lat.min()), float(lat.max()), float(lon.min()), float(lon.max())
    coarse = Window(np.array(box[:2]), np.array(box[2:]), frame)
    return local_floor(open_sea_floor(bed, window=box, crs=section.bathymetry_crs), coarse, half)


def _bed_notes(profile: Profile, floor: Array | xr.DataArray, bottom: float) -> Iterator[str]:
    """Doubts about the first and last level of a profile, and about a sea bed from a file."""
    first = float(profile.depth[0])
    last = float(profile.depth[-1])
    if first > 0.0:
        yield f"starts at {first:g} m; sound speed above is constant"
    if bottom > last + _MAX_GAP:
        yield (
            f"ends at {last:g} m, above the sea bed at {bottom:g} m; sound speed below is"
            " extrapolated to a constant within about 400 m; add levels if rays go that deep"
        )
    if isinstance(floor, xr.DataArray):
        yield from sea_floor_notes(floor)
        if floor.sel(floor_north=0.0, floor_east=0.0, method="nearest") <= 0.0:
            yield (
                f"{floor.attrs['source']}: land at the centre, where the profile has water down to"
                f" {last:g} m; check centre, sign and unit"
            )
