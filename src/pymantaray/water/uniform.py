"""Water of one profile or cast, the same everywhere: thinned or smoothed, over a sea bed and under ice."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import smooth_profile, thin_profile
from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.profiles import Profile, is_raw_cast, read_profiles
from pymantaray.config.sections import OceanSection
from pymantaray.errors import AcousticsError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import Cast, cast_ocean, open_sea_floor, with_ice
from pymantaray.ocean.local import assemble_local
from pymantaray.ocean.sea_floor import local_floor
from pymantaray.ocean.synthetic import EPOCH
from pymantaray.ocean.window import Window
from pymantaray.water.instants import utc_instant

Array = NDArray[np.float64]
UNBOUNDED = 1e6
"""Half side of the domain of a profile whose size nobody gave. [m]"""
_GAP = 100.0  # m; a profile that ends higher above the sea bed is worth a note
_NODES = 65  # of a horizontal axis under a map of ice


@dataclass(frozen=True, eq=False)
class UniformWater:
    """Local ocean of one profile, how it was made, and what of that to tell the user."""

    profile: Profile
    local: xr.Dataset
    record: dict[str, Any]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Levels:
    depth: Array
    sound_speed: Array
    record: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def read_section_profiles(section: OceanSection) -> list[Profile]:
    """Profiles of the files of a section, by its place where a file does not say its own."""
    return [profile for path in section.source for profile in read_profiles(path, section.centre)]


def one_profile(section: OceanSection) -> Profile:
    """Profile of a section; several are refused."""
    profiles = read_section_profiles(section)
    if len(profiles) > 1:
        names = ", ".join(profile.name for profile in profiles[:4]) + (", ..." if len(profiles) > 4 else "")
        raise AcousticsError(
            f"{Path(section.source[0]).name}: holds {len(profiles)} casts ({names}); one is needed: keep one"
        )
    return profiles[0]


def uniform_water(section: OceanSection, profile: Profile, interpolation: Interpolation) -> UniformWater:
    """
    Local ocean at rest with one profile everywhere.

    Parameters
    ----------
    section : OceanSection
        Its ``bathymetry`` is needed; ``thin`` and ``smooth`` reduce the profile.
    profile : Profile
    interpolation : {"smooth", "linear"}
        Of the medium to be made, by which a raw cast is refused or thinned.

    Raises
    ------
    MantaRayError
        If the sea bed is not given, a raw cast is neither thinned nor smoothed, or a map has no domain.
    """
    where = label(section, profile)
    if section.bathymetry is None:
        raise OceanError(
            f"{where}: a profile has no sea bed; give its depth in metres, ocean.bathymetry (--sea-floor)"
        )
    if section.time_varying:
        raise OceanError(f"{where}: one profile does not vary; leave out ocean.time_varying")
    levels = _reduced(section, profile, interpolation)
    place = section.centre or profile.position
    half = section.half_extent or (UNBOUNDED, UNBOUNDED)
    maps = [name for name in ("bathymetry", "ice") if isinstance(getattr(section, name), str)]
    if maps and (place is None or section.half_extent is None):
        raise OceanError(
            f"{where}: ocean.{maps[0]} is a map; over a profile it needs the frame's centre and the domain's half extent"
            " (--centre, --half-extent), or give metres"
        )
    n = _NODES if isinstance(section.ice, str) else 2
    north, east = (np.linspace(-h, h, n) for h in half)
    shape = north.size, east.size, levels.depth.size
    floor = _sea_floor(section, place, half, shape[:2])
    local = assemble_local(
        {"north": north, "east": east, "depth": levels.depth},
        np.broadcast_to(levels.sound_speed, shape).copy(),
        (np.zeros(shape), np.zeros(shape)),
        floor,
    )
    time = profile.time if section.time is None else utc_instant(section.time)
    local.attrs |= {"title": profile.name, "source": section.source[0], "synthetic": 0}
    if not np.isnat(time):
        local.attrs["time"] = str(np.datetime_as_string(time, unit="s"))
    if place is not None:
        local.attrs |= {
            "centre_latitude_deg": place[0],
            "centre_longitude_deg": place[1],
            "proj_string": LocalFrame(*place).proj_string,
        }
    if section.ice is not None:
        local = with_ice(local, section.ice)
    deepest = float(np.max(floor))
    record = {**levels.record, "levels": int(levels.depth.size), "last_level_m": float(profile.depth[-1])}
    record["bottom_depth_m"] = deepest
    notes = [*profile.notes, *levels.notes, *_reach_notes(profile, deepest)]
    return UniformWater(profile, local, record, tuple(f"{where}: {note}" for note in notes))


def label(section: OceanSection, profile: Profile) -> str:
    """Name of a profile for messages: that of its file, and its own if it is another."""
    name = Path(section.source[0]).name
    return name if profile.name == Path(name).stem else f"{name}: {profile.name}"


def geographic_of(section: OceanSection, profile: Profile) -> xr.Dataset:
    """Ocean on latitude and longitude of a profile with temperature and salinity, for what needs these on a grid."""
    place, bottom = section.centre or profile.position, section.bathymetry
    if profile.water is None or place is None or not isinstance(bottom, float):
        lacks = (
            "temperature and salinity"
            if profile.water is None
            else "its place"
            if place is None
            else "a flat sea bed"
        )
        raise OceanError(
            f"{label(section, profile)}: the profile lacks {lacks}, which is needed here; give a cast that has them, or an ocean"
        )
    temperature, salinity = profile.water
    start: np.datetime64 = np.datetime64(EPOCH) if np.isnat(profile.time) else profile.time
    if section.time is not None:
        start = utc_instant(section.time)
    cast = Cast(profile.name, *place, start, profile.depth, temperature, salinity)
    options: dict[str, Any] = {} if section.half_extent is None else {"half_extent": section.half_extent}
    return cast_ocean(cast, bottom_depth=bottom, below="constant", equation=section.equation, **options)


def profile_spread(local: xr.Dataset) -> xr.Dataset:
    """Sound speed of the levels as `sound_speed_profile_spread` has it: mean, least and greatest are the same."""
    speed = local["sound_speed"][0, 0]
    count = xr.ones_like(speed, dtype=int).assign_attrs(
        long_name="wet grid points", units="1", standard_name=""
    )
    spread = dict.fromkeys(("mean", "min", "max"), speed.drop_vars(("north", "east"))) | {
        "count": count.drop_vars(("north", "east"))
    }
    return xr.Dataset(spread, attrs={name: local.attrs[name] for name in ("title", "source", "synthetic")})


def profile_region(local: xr.Dataset) -> pd.DataFrame:
    """Properties of the water, one row each, as `region_table` has them of a gridded ocean."""
    speed, floor = local["sound_speed"].values, local["sea_floor_depth"].values
    rows: dict[str, object] = {
        "levels": int(local.sizes["depth"]),
        "time [UTC]": local.attrs.get("time", "unknown"),
        "shallowest sea floor [m]": float(floor.min()),
        "deepest sea floor [m]": float(floor.max()),
        "lowest sound speed [m/s]": float(speed.min()),
        "highest sound speed [m/s]": float(speed.max()),
        "synthetic": "no",
        "source": str(local.attrs["source"]),
    }
    table = pd.DataFrame({str(local.attrs["title"]): pd.Series(rows, dtype=object)})
    table.index.name = "property"
    return table


def _reduced(section: OceanSection, profile: Profile, interpolation: Interpolation) -> _Levels:
    """Levels of a profile, thinned or smoothed as a section says; a raw cast must be."""
    depth, speed = profile.depth, profile.sound_speed
    record: dict[str, Any] = {"raw_levels": int(depth.size)}
    if profile.position is not None:
        record |= {"position_deg": list(profile.position), "computed": "TEOS-10"}
    if section.thin is not None:
        reduced = thin_profile(depth, speed, tolerance=section.thin, interpolation=interpolation)
        size = {"tolerance_m_s": section.thin}
    elif section.smooth is not None:
        reduced = smooth_profile(depth, speed, length=section.smooth, interpolation=interpolation)
        size = {"length_m": section.smooth}
    else:
        if interpolation == "smooth" and is_raw_cast(depth):
            raise AcousticsError(
                f"{label(section, profile)}: {depth.size} levels less than 2 m apart are a raw cast; thin it, as by --thin 0.1"
                " (ocean.thin, m/s), smooth it, as by --smooth 10 (ocean.smooth, m), or take --interpolation linear"
                " (acoustics.interpolation)"
            )
        return _Levels(depth, speed, record)
    record[reduced.method] = size | {
        "rms_change_m_s": reduced.rms_change,
        "greatest_change_m_s": reduced.greatest_change,
    }
    return _Levels(reduced.depth, reduced.sound_speed, record, (str(reduced),))


def _sea_floor(
    section: OceanSection,
    place: tuple[float, float] | None,
    half: tuple[float, float],
    shape: tuple[int, int],
) -> Array | xr.DataArray:
    """Flat sea bed on the water's grid, or that of a file on axes of its own. [m]"""
    bed = section.bathymetry
    if not isinstance(bed, str):
        return np.full(shape, bed, dtype=float)
    assert place is not None  # checked with the maps
    frame = LocalFrame(*place)
    lat, lon = frame.to_geodetic(*np.meshgrid(*([-1.1 * h, 1.1 * h] for h in half), indexing="ij"))
    box = float(lat.min()), float(lat.max()), float(lon.min()), float(lon.max())
    coarse = Window(np.array(box[:2]), np.array(box[2:]), frame)
    floor = local_floor(open_sea_floor(bed, window=box, crs=section.bathymetry_crs), coarse, half)
    if floor is None:
        raise OceanError(
            f"{bed}: its grid is coarser than the domain of +-{half[0]:g} by +-{half[1]:g} m; give a flat depth"
        )
    return floor


def _reach_notes(profile: Profile, bottom: float) -> list[str]:
    """What is doubtful about the first and the last level of a profile."""
    first, last = float(profile.depth[0]), float(profile.depth[-1])
    notes = []
    if first > 0.0:
        notes.append(f"starts at {first:g} m; the sound speed there is taken up to the surface")
    if bottom > last + _GAP:
        notes.append(
            f"ends at {last:g} m, above the sea bed at {bottom:g} m; sound speed is continued from there to a constant"
            " within some 400 m, so add levels if rays go that deep"
        )
    return notes
