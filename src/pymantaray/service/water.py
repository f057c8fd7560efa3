"""What a service's sound runs through: built as a study builds it, from the same kinds of source."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium
from pymantaray.config.checks import parse
from pymantaray.errors import ServiceError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import to_local
from pymantaray.sensing import OneWay, Reception, Timing, TwoWay
from pymantaray.study import SoundConfig, StudyConfig
from pymantaray.study.tracks import with_tracks
from pymantaray.water.listening import build_reception, build_timing
from pymantaray.water.ocean import build_currents, build_medium, mission_ocean, mission_start

Array = NDArray[np.float64]
Ocean = SoundConfig | Medium | xr.Dataset | str | Path | Sequence[str | Path]

_PROJECTING = Lock()  # an object of PROJ serves one thread at a time


@dataclass(frozen=True, eq=False)
class Water:
    """
    What sound runs through, how it is heard, and where that is on the globe.

    Parameters
    ----------
    medium, currents, reception, timing
        As `pymantaray.sensing.measure_ranges` takes them; functions of time [s] where the ocean varies.
    local : xarray.Dataset, optional
        The local ocean, at the start where it varies. A bare medium has none, and no place on the globe.
    span : tuple of float
        Times for which there is water; everlasting where it stands still. [s]
    start : str, optional
        When time 0 is, in UTC.
    """

    medium: Medium | Callable[[float], Medium]
    currents: Currents | Callable[[float], Currents] | None = None
    reception: Reception = field(default_factory=Reception)
    timing: Timing = field(default_factory=OneWay)
    local: xr.Dataset | None = None
    span: tuple[float, float] = (-np.inf, np.inf)
    start: str | None = None

    @classmethod
    def of(cls, ocean: Ocean) -> Self:
        """Water of a configuration, of files or a synthetic ocean by name, of an open ocean, or a medium."""
        if isinstance(ocean, Medium):
            return cls(ocean)
        if isinstance(ocean, xr.Dataset):
            local = to_local(ocean) if "lat" in ocean.dims else ocean
            return cls(Medium.from_dataset(local), local=local, start=local.attrs.get("time"))
        if isinstance(ocean, SoundConfig):
            return cls._configured(ocean)
        sources = [ocean] if isinstance(ocean, str | Path) else list(ocean)
        for source in map(str, sources):
            if source.endswith(".toml"):
                raise ServiceError(f"{source}: is a configuration and no ocean; give load_sound({source!r})")
        tree = {"ocean": {"source": [str(source) for source in sources]}}
        return cls._configured(parse(SoundConfig, tree, "ocean", None))

    @classmethod
    def _configured(cls, config: SoundConfig) -> Self:
        if isinstance(config, StudyConfig):
            config = with_tracks(config)  # whose frame may be about its vehicles
        ocean = mission_ocean(config)
        span = (-np.inf, np.inf)
        start = str(ocean.local.attrs["time"])
        if ocean.series is not None:
            instants = ocean.series["time"].values
            span = (float(instants[0]), float(instants[-1]))
            start = str(np.datetime_as_string(mission_start(config.ocean), unit="s"))
        return cls(
            build_medium(config, ocean),
            build_currents(config, ocean),
            build_reception(config, ocean),
            build_timing(config.ranging),
            ocean.local,
            span,
            start,
        )

    @cached_property
    def frame(self) -> LocalFrame:
        """Where north and east are 0."""
        if self.local is None:
            raise ServiceError(
                "geographic positions: a bare medium has no place on the globe; give positions north, east, down, or an"
                " ocean in place of the medium"
            )
        return LocalFrame(self.local.attrs["centre_latitude_deg"], self.local.attrs["centre_longitude_deg"])

    def to_local(self, places: Array, velocities: Array) -> tuple[Array, Array]:
        """
        Positions and velocities (n, 3) in the local frame.

        Of latitude, longitude [degrees] and depth, and of components along true north and east.
        """
        with _PROJECTING:
            frame = self.frame
            north, east = frame.to_local(places[:, 0], places[:, 1])
            bearing = frame.convergence(places[:, 0], places[:, 1])
        if not np.isfinite([north, east]).all():
            raise ServiceError(
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
            raise ServiceError(
                f"time: {time:g} s; there is water from {self.span[0]:g} to {self.span[1]:g} s after {self.start} UTC"
            )

    def require_place(self, name: str, place: Array) -> None:
        """Refuse a place beyond the horizontal extent, which is a fault of who asks and no outcome of a ping. [m]"""
        for k, along in enumerate(("north", "east")):
            axis = getattr(self._first, along)
            if axis.size > 1 and not axis[0] <= place[k] <= axis[-1]:
                raise ServiceError(
                    f"{name}: {along} {place[k]:.6g} m is outside the ocean, which reaches from {axis[0]:.6g} to"
                    f" {axis[-1]:.6g} m; move it or take a larger ocean"
                )

    @cached_property
    def _first(self) -> Medium:
        """Medium at the start, on the grid of all times."""
        return self.at(max(self.span[0], 0.0))[0]

    def at(self, time: float) -> tuple[Medium, Currents | None]:
        """Medium and currents at a time. [s]"""
        medium = self.medium(time) if callable(self.medium) else self.medium
        return medium, self.currents(time) if callable(self.currents) else self.currents

    @property
    def varies(self) -> bool:
        """Whether it is another at another time."""
        return callable(self.medium)

    def facts(self) -> dict[str, Any]:
        """What to know before the first ping, as JSON takes it."""
        medium = self._first
        detector, timing = self.reception.detector, self.timing
        out: dict[str, Any] = {
            name: _ends(axis) if axis.size > 1 else None
            for name, axis in (("north", medium.north), ("east", medium.east))
        }
        out["sea_floor_depth"] = _ends(medium.bathymetry)
        out["sound_speed"] = _ends(_in_water(medium))
        out["start"] = self.start
        out["time"] = [float(t) for t in self.span] if self.varies else None
        for name in ("title", "source", "centre_latitude_deg", "centre_longitude_deg"):
            out[name] = None if self.local is None else self.local.attrs.get(name)
        out["arrival"] = self.reception.arrival
        out["max_surface_bounces"] = self.reception.max_surface_bounces
        out["max_bottom_bounces"] = self.reception.max_bottom_bounces
        out["currents"] = self.currents is not None
        out["timing"] = "two-way" if isinstance(timing, TwoWay) else "one-way"
        out["turn_around"] = timing.turn_around if isinstance(timing, TwoWay) else None
        out["source_level_db"] = None if detector is None else detector.sonar.source_level_db
        out["noise_level_db"] = None if detector is None else detector.sonar.noise_level_db
        return out


def _in_water(medium: Medium) -> Array:
    """Sound speeds at the grid points that are in the water, and at its bed and surface below and above them. [m/s]"""
    north, east = (x.ravel() for x in np.meshgrid(medium.north, medium.east, indexing="ij"))
    columns = np.stack([north, east], axis=-1)
    top, bed = (depth[:, None] for depth in (medium.surface_depth(columns), medium.bottom_depth(columns)))
    speed = medium.sound_speed.reshape(len(columns), -1)
    ends = [
        medium.sound_speed_at(np.column_stack([columns, depth]))
        for depth in (top, np.minimum(bed, medium.depth[-1]))
    ]
    inside = speed[(medium.depth >= top) & (medium.depth <= bed)]
    return np.concatenate([inside, *(values[np.isfinite(values)] for values in ends)])


def _ends(values: Array) -> list[float]:
    """Least and greatest value."""
    return [float(values.min()), float(values.max())]
