"""Water from any source, and the water of a configuration."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.acoustics import Currents, Medium
from pymantaray.acoustics.ocean_fields import OceanFields, build_currents, build_medium
from pymantaray.acoustics.profiles import Profile, only_one
from pymantaray.config import SoundConfig
from pymantaray.config.common import IN_MEMORY
from pymantaray.config.door.ocean import (
    is_profile,
    mission_ocean,
    mission_start,
    profile_fields,
)
from pymantaray.config.door.sound import build_sound, build_timing
from pymantaray.config.door.uniform import label, read_section_profiles
from pymantaray.config.load import dotted_keys, listed_sources, load_sound, names_configuration
from pymantaray.config.parse import parse
from pymantaray.errors import AcousticsError, WaterError
from pymantaray.geometry import LocalFrame
from pymantaray.sensing.water import Water

Source = SoundConfig | Medium | xr.Dataset | xr.DataArray | str | Path | Sequence[str | Path]
"""
Source of `open_water`: files, a profile or cast, name of a synthetic ocean, a preset, a TOML file,
a data set, a section of sound speed (range, depth) or a medium.
"""


def open_water(source: Source, **options: Any) -> Water:
    """
    Open water from any source.

    Parameters
    ----------
    source : str, Path, sequence of them, xarray.Dataset, xarray.DataArray, SoundConfig or Medium
        Ocean files that belong together; a profile or cast; a section of sound speed by range and
        depth, as a table, Bellhop's ``.ssp`` or a DataArray (range, depth) in metres and m/s;
        ``"synthetic:beaufort"`` or ``"synthetic:fram"``; the name of a preset or a study's TOML
        file; an ``environment.json`` of the paper's authors; a data set in memory, either an ocean
        on latitude and longitude or in metres (north, east, depth; sound_speed; optional currents
        and sea floor); a configuration (`load_sound`); or a medium, which allows no options.
    **options
        Keys of the sections ``[ocean]`` and ``[acoustics]`` of a study, such as
        ``bathymetry=2680.0``, ``ice=1.5``, ``interpolation="linear"`` and
        ``max_surface_bounces=2``, and the sections ``mission``, ``ranging`` and ``detection`` as
        mappings. ``earth="sphere"`` computes rays and straight distances on a spherical Earth. Also
        ``centre=(lat, lon)`` [degrees]; ``half_extent``, one number or (north, east) [m]; and
        ``currents``: "rest" (default except for configurations), "required", or "carry" to include
        them in travel times along rays.

    Returns
    -------
    Water

    Raises
    ------
    MantaRayError
        If the source cannot be opened, or an option is unknown or not allowed.

    Examples
    --------
    >>> water = open_water("synthetic:fram", half_extent_north=20e3, half_extent_east=20e3)
    >>> water.medium.sound_speed_at([[0.0, 0.0, 100.0]]).round(1)
    array([1449.5])
    """
    waters = open_waters(source, **options)
    name: object = source
    if isinstance(source, Sequence) and not isinstance(source, str):
        name = ", ".join(map(str, source))
    return only_one(name, waters, WaterError)


def open_waters(source: Source, **options: Any) -> list[Water]:
    r"""
    Open one water per profile or cast of a source.

    Parameters
    ----------
    source, **options
        As in `open_water`.

    Returns
    -------
    list of Water
        One element for sources other than profiles and casts.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray import open_waters
    >>> _ = Path("cast.csv").write_text("depth,sound_speed\n0,1450\n100,1455\n1000,1470\n")
    >>> (water,) = open_waters("cast.csv", bathymetry=1000.0)
    >>> print(water.medium.sound_speed_at([0.0, 0.0, 100.0]))
    [1455.]
    """
    if isinstance(source, Medium):
        if options:
            raise WaterError(f"a medium allows no options; remove {', '.join(options)}")
        return [Water(source)]
    if isinstance(source, xr.DataArray):
        source = source.to_dataset(name="sound_speed")
    if isinstance(source, xr.Dataset):
        config = configuration_of(IN_MEMORY, options)
        return [_assembled(config, mission_ocean(config, source), source)]
    config = configuration_of(source, options)
    if not is_profile(config.ocean):
        return [water_of(config)]
    return [_of_profile(config, profile) for profile in read_section_profiles(config.ocean)]


def _of_profile(config: SoundConfig, profile: Profile) -> Water:
    try:
        return _assembled(
            config, profile_fields(config.ocean, profile, config.acoustics.interpolation)
        )
    except AcousticsError as error:
        where = label(config.ocean, profile)
        raise WaterError(
            str(error) if str(error).startswith(where) else f"{where}: {error}"
        ) from None


def water_of(config: SoundConfig, ocean: OceanFields | None = None) -> Water:
    """
    Build the water of a configuration.

    Parameters
    ----------
    config : SoundConfig
        Configuration.
    ocean : OceanFields, optional
        Its ocean, if it exists already.

    Returns
    -------
    Water

    Examples
    --------
    >>> from pymantaray.config import load_sound
    >>> from pymantaray.config.door import water_of
    >>> sizes = {"ocean.half_extent_north": 10e3, "ocean.half_extent_east": 10e3}
    >>> water = water_of(load_sound("quick", **sizes))
    >>> print(water.medium.sound_speed_at([[0.0, 0.0, 100.0]]).round(1))
    [1441.8]
    """
    return _assembled(config, mission_ocean(config) if ocean is None else ocean)


def open_local(local: xr.Dataset, *, geographic: xr.Dataset | None = None, **options: Any) -> Water:
    """
    Build water from a local ocean without changing its grid, sea floor and ice.

    Parameters
    ----------
    local : xarray.Dataset
        Local ocean, as from `pymantaray.ocean.to_local`.
    geographic : xarray.Dataset, optional
        Ocean with temperature and salinity, which most formulas of absorption need.
    **options
        As in `open_water`, except options of the grid, sea floor and ice.

    Returns
    -------
    Water
    """
    fixed = [
        key for key in dotted_keys(options) if key.startswith("ocean.") and key != "ocean.currents"
    ]
    if fixed:
        raise WaterError(
            f"{fixed[0]}: this option does not apply to a local ocean; remove it, or give the"
            " ocean before to_local"
        )
    config = configuration_of(IN_MEMORY, options)
    medium = Medium.from_dataset(
        local, interpolation=config.acoustics.interpolation, earth=config.acoustics.earth
    )
    return Water(
        medium,
        Currents.from_dataset(local) if config.acoustics.currents else None,
        build_sound(config).reception(OceanFields(geographic, local)),
        build_timing(config.ranging),
        local=local,
        start=local.attrs.get("time"),
        record=_record(config, medium, local),
        notes=medium.notes,
        frame=_frame(local),
    )


def configuration_of(source: Any, options: dict[str, Any]) -> SoundConfig:
    """Configuration of a source with changed keys."""
    changes = dotted_keys(options)
    if isinstance(source, SoundConfig):
        return source.with_(**changes) if changes else source
    words = source_words(source)
    if names_configuration(words):
        return load_sound(words[0], **changes)
    config = parse(SoundConfig, {"ocean": {"source": words, "currents": "rest"}}, "ocean", None)
    return config.with_(**changes) if changes else config


def source_words(source: Any) -> list[str]:
    """
    Words of a source that consists of names or files; an object of another type raises an error.
    """
    if isinstance(source, Water):
        raise WaterError(
            "source is an opened Water; give the source that open_water had, and its options"
        )
    objects = "an xarray.Dataset, a SoundConfig or a Medium"
    return listed_sources(source, "source", WaterError, objects)


def _frame(local: xr.Dataset) -> LocalFrame | None:
    if "centre_latitude_deg" not in local.attrs:
        return None
    return LocalFrame(
        *(float(local.attrs[f"centre_{axis}_deg"]) for axis in ("latitude", "longitude"))
    )


def _record(config: SoundConfig, medium: Medium, local: xr.Dataset) -> dict[str, Any]:
    """Description of water for files; a reduced profile adds its own record."""
    out: dict[str, Any] = {"interpolation": medium.interpolation}
    frame = _frame(local)
    if frame is not None:
        out["centre_deg"] = [frame.latitude_deg, frame.longitude_deg]
    if medium.north.size > 1:
        out["half_extent_m"] = [float(medium.north[-1]), float(medium.east[-1])]
    if medium.notes:
        out["notes"] = list(medium.notes)
    rough = (
        ("ice_slope_deg", "ice_length", "ice_draw")
        if config.ocean.ice_slope_deg is not None
        else ()
    )
    for key in ("bathymetry", "ice", *rough):
        value = getattr(config.ocean, key)
        if value is not None:
            out[key] = value
    return out


def _assembled(config: SoundConfig, ocean: OceanFields, data: xr.Dataset | None = None) -> Water:
    span = (-np.inf, np.inf)
    start = ocean.local.attrs.get("time")
    if ocean.series is not None:
        instants = ocean.series["time"].values
        span = (float(instants[0]), float(instants[-1]))
        start = str(np.datetime_as_string(mission_start(config.ocean, data), unit="s"))
    medium = build_medium(ocean, config.acoustics.interpolation, config.acoustics.earth)
    kind = "ocean" if ocean.cast is None else "profile"
    made = {kind: list(config.ocean.source) if data is None else [IN_MEMORY]}
    first = medium(max(span[0], 0.0)) if callable(medium) else medium
    return Water(
        medium,
        build_currents(ocean) if config.acoustics.currents else None,
        build_sound(config).reception(ocean),
        build_timing(config.ranging),
        ocean.local,
        span,
        start,
        name=ocean.cast.name if ocean.cast is not None else "",
        time=ocean.cast.time if ocean.cast is not None else np.datetime64("NaT", "ns"),
        uniform=ocean.cast is not None,
        record={**made, **ocean.record, **_record(config, first, ocean.local)},
        notes=(*ocean.notes, *first.notes),
        frame=_frame(ocean.local),
    )
