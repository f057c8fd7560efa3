"""
Oceans that estimators assume: exact, perturbed, averaged, of one cast, of another day, from a file,
or by other numerics.
"""

import datetime as dt
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium
from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.arrays import Array
from pymantaray.config.common import own_files, utc_instant
from pymantaray.config.door.metres import section_in_metres
from pymantaray.config.door.ocean import (
    build_ocean,
    build_sea_floor,
    is_profile,
    local_ocean,
    mission_ocean,
    mission_start,
    open_start,
    with_tide,
)
from pymantaray.config.door.sound import build_sound
from pymantaray.config.estimators import (
    AnyBelief,
    CastBelief,
    ExactBelief,
    FileBelief,
    InternalTideBelief,
    MeanBelief,
    ModesSection,
    NumericsBelief,
    OffsetBelief,
    OtherDayBelief,
    PerturbedBelief,
)
from pymantaray.config.fleet import StationVehicle
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame, stream
from pymantaray.ocean import (
    Cast,
    SoundSpeedCovariance,
    VerticalModes,
    cast_ocean,
    column_ocean,
    holds_casts,
    mean_ocean,
    ocean_times,
    open_ocean,
    pooled_rms,
    read_cast,
    read_casts,
    sea_floor_depth,
    vertical_modes,
)
from pymantaray.ocean.cast import notes_of_casts
from pymantaray.ocean.local import TensorSpline
from pymantaray.ocean.metres import file_in_metres, ocean_in_metres, read_file_in_metres
from pymantaray.ocean.names import Equation
from pymantaray.ocean.perturb import draw_sound_speed_error
from pymantaray.ocean.schema import reading_notes
from pymantaray.ocean.window import Window
from pymantaray.quantities.checks import distinct_digits
from pymantaray.range_models.eigenray_model import EigenrayModel
from pymantaray.records import Trajectories
from pymantaray.sensing import ReceptionOptions

_DOMAIN = ("centre_lat", "centre_lon", "half_extent_north", "half_extent_east")


class KnownMission(Protocol):
    """Configuration and truth of a mission, such as a run, from which assumed oceans derive."""

    @property
    def config(self) -> StudyConfig:
        """Configuration of the study."""

    @property
    def ocean(self) -> xr.Dataset:
        """Local ocean at the start."""

    @property
    def truth(self) -> Trajectories:
        """True poses of the fleet."""

    def ocean_in(self, realization: int) -> xr.Dataset:
        """Local ocean with the ice of a realization."""


@dataclass(frozen=True, eq=False)
class Belief:
    """Ocean that an estimator assumes."""

    local: xr.Dataset
    medium: Medium
    currents: Currents | None
    """None unless the study's rays run through currents."""
    spreading_cutoff_db: float | None

    @cached_property
    def rays(self) -> EigenrayModel:
        """Eigenrays through this ocean, shared by all estimators that assume it."""
        return EigenrayModel(
            self.medium, spreading_cutoff_db=self.spreading_cutoff_db, currents=self.currents
        )

    def profile(self) -> tuple[Array, Array]:
        """Levels [m], and the horizontal mean of the sound speed at each level [m/s]."""
        return self.medium.depth, self.medium.sound_speed.mean(axis=(0, 1))


class Beliefs:
    """
    Assumed oceans of one run. Each is built once; a random ocean is built once per realization.

    ``ocean`` replaces the ocean of the run's configuration if it is in memory.
    """

    def __init__(self, run: KnownMission, ocean: OceanFields | None = None) -> None:
        self.config = run.config
        self._run = run
        self._ocean = ocean
        self._latest: dict[AnyBelief, tuple[int, Belief]] = {}
        self._over_time: dict[AnyBelief, OceanFields] = {}
        self._modes: dict[int | None, VerticalModes] = {}

    def believed(self, section: AnyBelief, realization: int) -> Belief:
        """
        Ocean that an estimator assumes; if the true ocean varies in time, a snapshot at its start.
        """
        drawn = isinstance(section, PerturbedBelief) or (
            isinstance(section, CastBelief) and (section.bias_sigma or section.noise_sigma) > 0.0
        )
        own_ice = isinstance(section, ExactBelief) and self.config.ocean.ice_draw == "each"
        member = realization if drawn or own_ice else -1
        if section not in self._latest or self._latest[section][0] != member:
            belief = self._draw(section, realization) if drawn else self._make(section, realization)
            self._latest[section] = member, belief
        return self._latest[section][1]

    def varying(self, section: AnyBelief) -> OceanFields:
        """
        Assumed ocean that varies during the mission: like the study's ocean, like another day's, or
        with a tide.
        """
        if section not in self._over_time:
            ocean = self.config.ocean
            if isinstance(section, InternalTideBelief):
                self._over_time[section] = OceanFields(None, with_tide(section, self._run.ocean))
                return self._over_time[section]
            if isinstance(section, OtherDayBelief):
                day = mission_start(ocean) - np.timedelta64(dt.timedelta(days=section.days_earlier))
                ocean = ocean.model_copy(update={"time": day.astype("datetime64[us]").item()})
            self._over_time[section] = build_ocean(ocean, self.config.mission.duration_h * 3600.0)
        return self._over_time[section]

    def covariance(
        self, rms: float, horizontal_scale: float, down_to: float | None
    ) -> SoundSpeedCovariance:
        """
        Covariance of an error with an RMS [m/s] down to a depth [m], in the vertical modes of the
        region.
        """
        depth, shapes, sigma = self._scaled_modes((), rms, down_to)
        matrix = np.einsum("k,ki,kj->ij", sigma**2, shapes, shapes)
        return SoundSpeedCovariance(depth, 0.5 * (matrix + matrix.T), horizontal_scale)

    def modes(self, section: ModesSection) -> tuple[Array, Array, Array]:
        """Levels [m], shapes (n_modes, n_levels) and prior sigma [m/s] of the estimated modes."""
        depth, shapes, sigma = self._scaled_modes(section.casts, section.rms, section.down_to)
        if section.count > sigma.size:
            raise OceanError(
                f"modes: count is {section.count}, but only {sigma.size} modes vary; give at most"
                f" {sigma.size}"
            )
        return depth, shapes[: section.count], sigma[: section.count]

    def notes(self) -> list[str]:
        """Notes of the readers of the casts and oceans in files that estimators assume."""
        notes: list[str] = []
        for condition in self.config.conditions:
            section, modes = condition.belief, condition.modes
            if isinstance(section, FileBelief) and not file_in_metres(section.source[0]):
                if holds_casts(section.source[0]):
                    notes += notes_of_casts([self._cast(section)])
                else:
                    ocean = self._ocean_of_files(section)
                    notes += (f"{ocean.attrs['title']}: {note}" for note in reading_notes(ocean))
            notes += () if modes is None else notes_of_casts(self._read_casts(modes.casts))
        return [f"estimators: {note}" for note in dict.fromkeys(notes)]

    @cached_property
    def reception(self) -> ReceptionOptions:
        """Reception of the study, with the absorption in its ocean at the start."""
        ocean = self._ocean or mission_ocean(self.config)
        return build_sound(self.config).reception(ocean)

    def _read_casts(self, files: tuple[str, ...]) -> list[Cast]:
        repair = self.config.ocean.repair_freezing
        return read_casts(files, default_place=self._centre, repair_freezing=repair)

    def _scaled_modes(
        self, casts: tuple[str, ...], rms: float | None, down_to: float | None
    ) -> tuple[Array, Array, Array]:
        """
        Levels, shapes and standard deviations of the modes of the ocean, or of casts in files.
        """
        ocean = self._true
        if casts:
            modes = vertical_modes(self._read_casts(casts), equation=self.config.ocean.equation)
        else:
            modes = self._ocean_modes(None)
        depth = np.asarray(ocean["depth"].values, dtype=float)
        shapes = modes.at(depth)
        factor = (
            1.0 if rms is None else rms / pooled_rms(ocean, modes.variance @ shapes**2, down_to)
        )
        return depth, shapes, factor * np.sqrt(modes.variance)

    def _ocean_modes(self, count: int | None) -> VerticalModes:
        """Vertical modes of the ocean: a number of them, or those with 99.99 % of the variance."""
        if count not in self._modes:
            equation = self.config.ocean.equation
            self._modes[count] = vertical_modes(self._true, n_modes=count, equation=equation)
        return self._modes[count]

    def _draw(self, section: AnyBelief, realization: int) -> Belief:
        """Draw a random ocean: an ocean without random errors, and its errors of sound speed."""
        if isinstance(section, PerturbedBelief):
            base = self.believed(ExactBelief(kind="exact"), realization)
            profiles, fields = self._perturbation(section, base.medium.depth, realization)
        else:
            assert isinstance(
                section, CastBelief
            )  # for the type checker; no other belief is random
            without = section.model_copy(update={"bias_sigma": 0.0, "noise_sigma": 0.0})
            base = self.believed(without, realization)
            levels = base.local["depth"].values
            error = self._instrument_error(section, levels.size, realization)
            profiles = np.interp(base.medium.depth, levels, error)[None]
            fields = np.ones((1, *base.medium.sound_speed.shape[:2]))
        medium = base.medium.plus(profiles, fields)
        return replace(base, local=_with_speed_of(base.local, medium), medium=medium)

    def _perturbation(
        self, section: PerturbedBelief, depth: Array, realization: int
    ) -> tuple[Array, Array]:
        """
        Profiles [m/s] at levels [m], and horizontal fields at the nodes of the local ocean, of a
        random error.
        """
        config = self.config
        try:
            error = draw_sound_speed_error(
                self._true,
                rms=section.rms,
                horizontal_scale=section.horizontal_scale,
                down_to=section.down_to,
                modes=self._ocean_modes(section.n_modes),
                rng=stream(config.study.seed, realization, "belief", "perturbed"),
                equation=config.ocean.equation,
            )
        except OceanError as problem:
            raise OceanError(
                f"belief perturbed by {section.rms:g} m/s, realization {realization}: {problem}"
            ) from None
        return error.profiles(depth), np.moveaxis(self._to_nodes(error.fields), -1, 0)

    @cached_property
    def _to_nodes(self) -> TensorSpline:
        """Interpolation from the geographic ocean to the nodes of the local ocean."""
        window = Window.of(self._true, self._centre)
        north, east = (
            np.asarray(self._run.ocean[name].values, dtype=float) for name in ("north", "east")
        )
        return TensorSpline(
            window.lat, window.lon, *window.geographic(north[:, None], east[None, :])
        )

    def _make(self, section: AnyBelief, realization: int) -> Belief:
        ocean = self.config.ocean
        acoustics = self.config.acoustics
        local = self._run.ocean
        interpolation = acoustics.interpolation
        if isinstance(section, ExactBelief):
            local = self._run.ocean_in(realization)
        if isinstance(section, FileBelief):
            local = self._from_files(section)
        elif self._in_metres and not isinstance(section, ExactBelief | OffsetBelief):
            local, interpolation = self._belief_in_metres(section)
        elif isinstance(section, OffsetBelief):
            local = _offset(
                local, np.interp(local["depth"].values, section.depth, section.sound_speed)
            )
        elif isinstance(section, NumericsBelief):
            equation = section.equation or ocean.equation
            interpolation = section.interpolation or interpolation
            if equation != ocean.equation or section.every_level > 1:
                levels = _every(self._true["depth"].size, section.every_level)
                local = self._local_by(equation, self._true.isel(depth=levels))
        elif not isinstance(section, ExactBelief):
            local = self._local_by(ocean.equation, self._geographic_belief(section))
        return Belief(
            local=local,
            medium=Medium.from_dataset(local, interpolation=interpolation, earth=acoustics.earth),
            currents=Currents.from_dataset(local) if acoustics.currents else None,
            spreading_cutoff_db=acoustics.cutoff_db,
        )

    @property
    def _in_metres(self) -> bool:
        """True if the study's water has no latitudes, temperatures and salinities."""
        no_columns = (
            self._ocean is not None and self._ocean.geographic is None and self._ocean.cast is None
        )
        return no_columns or section_in_metres(self.config.ocean)

    def _belief_in_metres(self, section: AnyBelief) -> tuple[xr.Dataset, Interpolation]:
        """Local ocean and interpolation of a belief about water in metres."""
        local = self._run.ocean
        interpolation = self.config.acoustics.interpolation
        speed = local["sound_speed"]
        if isinstance(section, NumericsBelief) and section.equation is None:
            levels = _every(local["depth"].size, section.every_level)
            return local.isel(depth=levels), section.interpolation or interpolation
        if isinstance(section, MeanBelief):
            column = speed.mean(("north", "east"))
        elif isinstance(section, CastBelief) and section.down_to is None:
            north, east = self._local_cast_place(section)
            column = speed.interp(north=north, east=east)
        else:
            raise OceanError(
                f"belief {section.kind}: water in metres has no temperature and salinity, which"
                " this belief needs; use exact, mean, cast (without down_to), offset, numerics"
                " (without equation) or file"
            )
        uniform = column.broadcast_like(speed).transpose(*speed.dims).assign_attrs(speed.attrs)
        return local.assign(sound_speed=uniform), interpolation

    def _local_by(self, equation: Equation, geographic: xr.Dataset) -> xr.Dataset:
        """Local ocean over the study's domain and sea floor."""
        section = self.config.ocean.model_copy(update={"equation": equation})
        return local_ocean(section, geographic, build_sea_floor(section, self._true))

    def _instrument_error(self, section: CastBelief, n_levels: int, realization: int) -> Array:
        """Bias of a cast plus its noise at each level. [m/s]"""
        rng = stream(self.config.study.seed, realization, "belief", "cast")
        bias = rng.standard_normal()
        noise = rng.standard_normal(n_levels)
        return np.asarray(section.bias_sigma * bias + section.noise_sigma * noise)

    def _from_files(self, section: FileBelief) -> xr.Dataset:
        """
        Local ocean of files or of a cast, over the part of the study's domain that they cover; it
        must contain the fleet.
        """
        name = ", ".join(section.source)
        try:
            local = self._local_of_files(section)
            self._check_holds_fleet(local)
        except OceanError as error:
            raise OceanError(f"belief {name}: {str(error).removeprefix(f'{name}: ')}") from None
        return local

    def _local_of_files(self, section: FileBelief) -> xr.Dataset:
        if file_in_metres(section.source[0]):
            return self._local_in_metres(section)
        if self._in_metres:
            raise OceanError(
                "has latitudes and longitudes, or is a cast, but the water of the study is in"
                " metres; give a file in metres"
            )
        is_cast = holds_casts(section.source[0])
        return self._local_of_cast(section) if is_cast else self._local_of_ocean(section)

    def _local_in_metres(self, section: FileBelief) -> xr.Dataset:
        """Ocean of a file in metres, about the study's centre."""
        if len(section.source) > 1:
            raise OceanError("several files; name one file in metres")
        if section.cast is not None or section.time is not None:
            raise OceanError(
                "a file in metres has no casts and no time; remove the keys cast and time"
            )
        path = section.source[0]
        return ocean_in_metres(read_file_in_metres(path), path)

    def _local_of_cast(self, section: FileBelief) -> xr.Dataset:
        """Water of a cast everywhere, over the sea floor of the study."""
        if len(section.source) > 1:
            raise OceanError(
                "several files, of which the first contains casts; name one file of casts, or"
                " files of an ocean"
            )
        ocean, (north, east, bottom) = self.config.ocean, _reach(self._run.ocean).tolist()
        frame = self._frame
        geographic = cast_ocean(
            replace(self._cast(section), lat=frame.latitude_deg, lon=frame.longitude_deg),
            bathymetry=bottom,
            half_extent=(north, east),
            below="constant",
            time=mission_start(ocean),
            equation=ocean.equation,
        )
        sea_floor = build_sea_floor(ocean, self._true)
        return self._local(
            geographic, sea_floor_depth(self._true) if sea_floor is None else sea_floor
        )

    def _cast(self, section: FileBelief) -> Cast:
        """Cast of a file."""
        return read_cast(
            section.source[0],
            name=section.cast,
            default_place=self._centre,
            repair_freezing=self.config.ocean.repair_freezing,
        )

    def _local_of_ocean(self, section: FileBelief) -> xr.Dataset:
        """Ocean of files over the study's domain."""
        geographic = self._ocean_of_files(section)
        return self._local(geographic, build_sea_floor(self.config.ocean, self._true))

    def _ocean_of_files(self, section: FileBelief) -> xr.Dataset:
        """Ocean of files, with currents only where rays need them."""
        if section.cast is not None:
            raise OceanError(
                f"cast is {section.cast!r}, but the file is an ocean without casts; remove the key"
                " cast"
            )
        ocean = self.config.ocean
        time = None if section.time is None else utc_instant(section.time)
        if time is None and (
            own_files(section.source) == () or len(ocean_times(section.source)) > 1
        ):
            time = mission_start(ocean)
        currents = ocean.currents if self.config.acoustics.currents else "rest"
        return open_ocean(section.source, time=time, currents=currents)

    def _local(self, geographic: xr.Dataset, sea_floor: xr.DataArray | None) -> xr.Dataset:
        """Part of the study's domain that an ocean covers, around the study's centre."""
        centre = self._centre
        window, (north, east, _) = Window.of(geographic, centre), _reach(self._run.ocean).tolist()
        half_extent = (north, east) if window.holds(north, east) else window.largest_rectangle()
        domain = dict(zip(_DOMAIN, (*centre, *half_extent), strict=True))
        return local_ocean(self.config.ocean.model_copy(update=domain), geographic, sea_floor)

    def _check_holds_fleet(self, local: xr.Dataset) -> None:
        there = _reach(local)
        whole = _reach(self._run.ocean)
        fleet = np.minimum(
            np.abs(self._run.truth.position).max(axis=(0, 1)), whole
        )  # vehicles may have left the domain
        if np.any(fleet > there):
            (north, far_north), (east, far_east), (depth, deep) = map(distinct_digits, there, fleet)
            raise OceanError(
                f"covers +-{north} m north and +-{east} m east of the study's centre, down to"
                f" {depth} m, but the fleet reaches {far_north}, {far_east} and {deep} m; give a"
                " larger ocean"
            )

    def _geographic_belief(self, section: AnyBelief) -> xr.Dataset:
        true = self._true
        config = self.config
        if isinstance(section, MeanBelief):
            return mean_ocean(true)
        if isinstance(section, CastBelief):
            cast = column_ocean(true, self._cast_place(section))
            return cast if section.down_to is None else _constant_below(cast, section.down_to)
        assert isinstance(
            section, OtherDayBelief
        )  # for the type checker; the exact ocean is on disk
        if is_profile(config.ocean):
            raise OceanError(
                f"belief other-day: {config.ocean.source[0]} is a profile of one time; use the"
                ' belief { kind = "file", source = ... } with an earlier cast'
            )
        earlier = np.timedelta64(round(section.days_earlier * 86400), "s")
        time = np.datetime64(str(true["time"].values), "ns") - earlier
        return open_ocean(config.ocean.source, time=time, currents=config.ocean.currents)

    @cached_property
    def _true(self) -> xr.Dataset:
        """Geographic ocean at the start of the mission."""
        if self._ocean is not None and self._ocean.geographic is not None:
            return self._ocean.geographic
        return open_start(self.config.ocean)

    def _local_cast_place(self, section: CastBelief) -> tuple[float, float]:
        """Position of the cast north and east. [m]"""
        if section.north is not None and section.east is not None:
            return section.north, section.east
        stations = (v for v in self.config.fleet.vehicles if isinstance(v, StationVehicle))
        first = next(stations, None)
        return (0.0, 0.0) if first is None else (first.north, first.east)

    def _cast_place(self, section: CastBelief) -> tuple[float, float]:
        """Latitude and longitude of the cast. [degrees]"""
        lat, lon = self._frame.to_geodetic(*self._local_cast_place(section))
        return float(lat), float(lon)

    @property
    def _centre(self) -> tuple[float, float]:
        """Latitude and longitude of the frame's centre. [degrees]"""
        return self._frame.latitude_deg, self._frame.longitude_deg

    @cached_property
    def _frame(self) -> LocalFrame:
        attrs = self._run.ocean.attrs
        return LocalFrame(attrs["centre_latitude_deg"], attrs["centre_longitude_deg"])


def _offset(local: xr.Dataset, by_level: Array) -> xr.Dataset:
    """Local ocean with an error of sound speed at each level. [m/s]"""
    speed = local["sound_speed"]
    return local.assign(
        sound_speed=(speed + xr.DataArray(by_level, dims="depth")).assign_attrs(speed.attrs)
    )


def _with_speed_of(local: xr.Dataset, medium: Medium) -> xr.Dataset:
    """
    Local ocean with the sound speed of a medium on its grid, which may have more levels.
    """
    speed = local["sound_speed"]
    distance = np.abs(medium.depth[:, None] - local["depth"].values)
    values = medium.sound_speed[..., distance.argmin(axis=0)]
    changed = xr.DataArray(values, dims=("north", "east", "depth")).transpose(*speed.dims)
    return local.assign(sound_speed=speed.copy(data=changed.values))


def _every(size: int, step: int) -> NDArray[np.intp]:
    """Indices of every n-th level, including the first and the last."""
    return np.unique(np.append(np.arange(0, size, step), size - 1))


def _constant_below(geographic: xr.Dataset, depth: float) -> xr.Dataset:
    """
    Ocean whose water below a depth has the temperature and salinity of the last level above that
    depth.
    """
    levels = geographic["depth"].values
    last = int(np.searchsorted(levels, depth, side="right")) - 1
    if last < 0:
        end, first = distinct_digits(depth, levels[0])
        raise OceanError(
            f"belief: the cast ends at {end} m, above the first level of the ocean, {first} m;"
            " give a deeper cast"
        )
    upper = geographic.isel(depth=np.minimum(np.arange(levels.size), last))
    return geographic.assign(
        {
            name: geographic[name].where(geographic[name].isnull(), upper[name].values)
            for name in ("water_temp", "salinity")
        }
    )


def _reach(local: xr.Dataset) -> Array:
    """Half extents north and east, and maximum depth, of a local ocean. [m]"""
    return np.array(
        [local["north"].values[-1], local["east"].values[-1], local["sea_floor_depth"].max()]
    )
