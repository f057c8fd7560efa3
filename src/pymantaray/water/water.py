"""Water from any source: what sound runs through, how it is heard, and where on the globe that is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium
from pymantaray.acoustics.profiles import Profile
from pymantaray.config import SoundConfig
from pymantaray.config.checks import parse
from pymantaray.config.common import IN_MEMORY
from pymantaray.config.load import load_sound
from pymantaray.config.options import dotted_keys, names_configuration
from pymantaray.errors import AcousticsError, WaterError
from pymantaray.geometry import LocalFrame
from pymantaray.sensing import OneWay, Reception, Timing
from pymantaray.water.listening import build_reception, build_timing
from pymantaray.water.ocean import (
    OceanFields,
    build_currents,
    build_medium,
    is_profile,
    mission_ocean,
    mission_start,
    profile_fields,
)
from pymantaray.water.uniform import label, read_section_profiles

Array = NDArray[np.float64]
Source = SoundConfig | Medium | xr.Dataset | str | Path | Sequence[str | Path]
"""What `open_water` takes: files, a profile or cast, a synthetic ocean's name, a preset, a TOML file, a data set or a medium."""

_PROJECTING = Lock()  # an object of PROJ serves one thread at a time


@dataclass(frozen=True, eq=False)
class Water:
    """
    What sound runs through, how it is heard, and where that is on the globe; made by `open_water`.

    Attributes
    ----------
    medium, currents, reception, timing
        As `pymantaray.sensing.measure_ranges` takes them; functions of time [s] if the ocean varies.
    local : xarray.Dataset or None
        The local ocean, at the start if it varies; None of a bare medium.
    span : tuple of float
        Times for which there is water; infinite if it does not vary. [s]
    start : str or None
        When time 0 is, in UTC.
    name : str
        Of a cast, by which events choose it.
    time : numpy.datetime64
        Of a cast, by which events choose it; NaT if it is unknown.
    uniform : bool
        True if the water is the same everywhere, so that only depths and distances matter.
    record : dict
        How the water was made, for files.
    notes : tuple of str
        What is doubtful about it.
    frame : LocalFrame or None
        North and east are 0 at its centre; None if the water has no place on the globe.
    """

    medium: Medium | Callable[[float], Medium]
    currents: Currents | Callable[[float], Currents] | None = None
    reception: Reception = field(default_factory=Reception)
    timing: Timing = field(default_factory=OneWay)
    local: xr.Dataset | None = None
    span: tuple[float, float] = (-np.inf, np.inf)
    start: str | None = None
    name: str = ""
    time: np.datetime64 = field(default_factory=lambda: np.datetime64("NaT", "ns"))
    uniform: bool = False
    record: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    frame: LocalFrame | None = None

    def to_local(self, places: Array, velocities: Array) -> tuple[Array, Array]:
        """
        Positions and velocities (n, 3) in the local frame.

        Of latitude, longitude [degrees] and depth, and of components along true north and east.
        """
        if self.frame is None:
            raise WaterError(
                "geographic positions: this water has no place on the globe; give positions north, east, down, or the"
                " centre of its frame"
            )
        with _PROJECTING:
            north, east = self.frame.to_local(places[:, 0], places[:, 1])
            bearing = self.frame.convergence(places[:, 0], places[:, 1])
        if not np.isfinite([north, east]).all():
            raise WaterError(
                f"geographic positions: latitudes {places[:, 0].min():g} to {places[:, 0].max():g}; they must lie in -90 to 90,"
                " and nobody at the other end of the earth"
            )
        cos, sin = np.cos(bearing), np.sin(bearing)
        v_north, v_east, v_down = velocities.T
        along = [v_north * cos - v_east * sin, v_north * sin + v_east * cos, v_down]
        return np.stack([north, east, places[:, 2]], axis=-1), np.stack(along, axis=-1)

    def require(self, time: float) -> None:
        """Refuse a time for which there is no water. [s]"""
        if not self.span[0] <= time <= self.span[1]:
            raise WaterError(
                f"time: {time:g} s; there is water from {self.span[0]:g} to {self.span[1]:g} s after {self.start} UTC"
            )

    def at(self, time: float) -> tuple[Medium, Currents | None]:
        """Medium and currents at a time. [s]"""
        medium = self.medium(time) if callable(self.medium) else self.medium
        return medium, self.currents(time) if callable(self.currents) else self.currents

    @property
    def at_start(self) -> tuple[Medium, Currents | None]:
        """Medium and currents at time 0, or at the first time for which there is water."""
        return self.at(max(self.span[0], 0.0))

    @property
    def varies(self) -> bool:
        """True if it differs from time to time."""
        return callable(self.medium)

    def __repr__(self) -> str:
        """Name the source, the medium and the reception in a line."""
        title = "medium" if self.local is None else self.local.attrs.get("title", "local ocean")
        medium, _ = self.at_start
        return f"<Water {title}{', varying' if self.varies else ''}: {medium!r}>"


def open_water(source: Source, **options: Any) -> Water:
    """
    Water from any source.

    Parameters
    ----------
    source : str, Path, sequence of them, xarray.Dataset, SoundConfig or Medium
        Ocean files that belong together, a profile or cast, ``"synthetic:beaufort"`` or ``"synthetic:fram"``, the name of
        a preset or a study's TOML file; an ocean in memory, geographic as its file would be or local as `to_local` returns it;
        a configuration (`load_sound`); or a medium, which takes no options.
    **options
        Keys of the sections ``[ocean]`` and ``[acoustics]`` of a study, such as ``bathymetry=2680.0``, ``ice=1.5``,
        ``interpolation="linear"`` and ``max_surface_bounces=2``, and the sections ``mission``, ``ranging`` and ``detection`` as
        mappings. Besides them ``centre=(lat, lon)`` [degrees]; ``half_extent``, one number or (north, east) [m]; and
        ``currents``: "rest", the default except of configurations, "required", or "carry" if they carry sound along the rays.

    Returns
    -------
    Water

    Raises
    ------
    MantaRayError
        If the source cannot be opened or an option is unknown or not allowed.

    Examples
    --------
    >>> water = open_water("synthetic:fram", half_extent_north=20e3, half_extent_east=20e3)
    >>> water.medium.sound_speed_at([[0.0, 0.0, 100.0]]).round(1)
    array([1449.5])
    """
    waters = open_waters(source, **options)
    if len(waters) > 1:
        names = ", ".join(water.name for water in waters[:4]) + (", ..." if len(waters) > 4 else "")
        raise WaterError(f"{source}: holds {len(waters)} casts ({names}); one is needed: keep one")
    return waters[0]


def open_waters(source: Source, **options: Any) -> list[Water]:
    """Waters of a source that may hold several profiles or casts, one each; otherwise as `open_water`."""
    if isinstance(source, Medium):
        if options:
            raise WaterError(f"a medium takes no options; found {', '.join(options)}")
        return [Water(source)]
    if isinstance(source, xr.Dataset):
        return [_in_memory(source, options)]
    config = configuration_of(source, options)
    if not is_profile(config.ocean):
        return [water_of(config)]
    return [_of_profile(config, profile) for profile in read_section_profiles(config.ocean)]


def _of_profile(config: SoundConfig, profile: Profile) -> Water:
    try:
        return _assembled(config, profile_fields(config.ocean, profile, config.acoustics.interpolation))
    except AcousticsError as error:
        where = label(config.ocean, profile)
        raise WaterError(str(error) if str(error).startswith(where) else f"{where}: {error}") from None


def water_of(config: SoundConfig, ocean: OceanFields | None = None) -> Water:
    """Water of a configuration, by its ocean if that is built already."""
    return _assembled(config, mission_ocean(config) if ocean is None else ocean)


def open_local(local: xr.Dataset, *, geographic: xr.Dataset | None = None, **options: Any) -> Water:
    """
    Water of a local ocean, whose grid, sea floor and ice are as they are; options otherwise as of `open_water`.

    A sonar needs the ``geographic`` ocean, with temperature and salinity, for most formulas of absorption.
    """
    fixed = [key for key in dotted_keys(options) if key.startswith("ocean.") and key != "ocean.currents"]
    if fixed:
        raise WaterError(
            f"{fixed[0]}: a local ocean is what it is; leave it out, or give the ocean before to_local"
        )
    config = configuration_of(IN_MEMORY, options)
    medium = Medium.from_dataset(local, interpolation=config.acoustics.interpolation)
    return Water(
        medium,
        Currents.from_dataset(local) if config.acoustics.currents else None,
        build_reception(config, OceanFields(geographic, local, xr.Dataset(), pd.DataFrame())),
        build_timing(config.ranging),
        local=local,
        start=local.attrs.get("time"),
        record=_record(config, medium, local),
        frame=_frame(local),
    )


def _in_memory(data: xr.Dataset, options: dict[str, Any]) -> Water:
    if "sound_speed" in data and {"north", "east"} <= set(data.dims):
        return open_local(data, **options)
    config = configuration_of(IN_MEMORY, options)
    return _assembled(config, mission_ocean(config, data), data)


def configuration_of(source: Any, options: dict[str, Any]) -> SoundConfig:
    """Configuration of a source with some of its keys changed."""
    changes = dotted_keys(options)
    if isinstance(source, SoundConfig):
        return source.with_(**changes) if changes else source
    words = [str(word) for word in ([source] if isinstance(source, str | Path) else source)]
    if names_configuration(words):
        return load_sound(words[0], **changes)
    config = parse(SoundConfig, {"ocean": {"source": words, "currents": "rest"}}, "ocean", None)
    return config.with_(**changes) if changes else config


def _frame(local: xr.Dataset) -> LocalFrame | None:
    if "centre_latitude_deg" not in local.attrs:
        return None
    return LocalFrame(*(float(local.attrs[f"centre_{axis}_deg"]) for axis in ("latitude", "longitude")))


def _record(config: SoundConfig, medium: Medium, local: xr.Dataset) -> dict[str, Any]:
    """How water was made, for files; a reduced profile's record comes on top."""
    out: dict[str, Any] = {"interpolation": medium.interpolation}
    frame = _frame(local)
    if frame is not None:
        out["centre_deg"] = [frame.latitude_deg, frame.longitude_deg]
    if medium.north.size > 1:
        out["half_extent_m"] = [float(medium.north[-1]), float(medium.east[-1])]
    for key in ("bathymetry", "ice"):
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
    medium = build_medium(config, ocean)
    kind = "ocean" if ocean.cast is None else "profile"
    made = {kind: list(config.ocean.source) if data is None else [IN_MEMORY]}
    first = medium(max(span[0], 0.0)) if callable(medium) else medium
    return Water(
        medium,
        build_currents(config, ocean),
        build_reception(config, ocean),
        build_timing(config.ranging),
        ocean.local,
        span,
        start,
        name=ocean.cast.name if ocean.cast is not None else "",
        time=ocean.cast.time if ocean.cast is not None else np.datetime64("NaT", "ns"),
        uniform=ocean.cast is not None,
        record={**made, **ocean.record, **_record(config, first, ocean.local)},
        notes=ocean.notes,
        frame=_frame(ocean.local),
    )
