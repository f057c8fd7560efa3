"""
Oceans that estimators assume: one table from a section's kind to its builder.

A new one is an entry here, a section in `AnyBelief` of `config.estimators`, and a test.
"""

import datetime as dt
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

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

    def plus(self, profiles: Array, fields: Array) -> "Belief":
        """
        Ocean with an error of sound speed: profiles [m/s] at the levels of the medium times
        horizontal fields at its nodes.
        """
        medium = self.medium.plus(profiles, fields)
        speed = self.local["sound_speed"]
        # the medium may have more levels than the ocean
        distance = np.abs(medium.depth[:, None] - self.local["depth"].values)
        values = medium.sound_speed[..., distance.argmin(axis=0)]
        changed = xr.DataArray(values, dims=("north", "east", "depth")).transpose(*speed.dims)
        local = self.local.assign(sound_speed=speed.copy(data=changed.values))
        return replace(self, local=local, medium=medium)


class Beliefs:
    """
    Assumed oceans of one run. Each is built once; a random ocean is built once per realization.

    ``ocean`` replaces the ocean of the run's configuration if it is in memory.
    """

    def __init__(self, run: KnownMission, ocean: OceanFields | None = None) -> None:
        self.config = run.config
        self.run = run
        self._ocean = ocean
        self._latest: dict[AnyBelief, tuple[int, Belief]] = {}
        self._over_time: dict[AnyBelief, OceanFields] = {}
        self._modes: dict[int | None, VerticalModes] = {}

    def believed(self, section: AnyBelief, realization: int) -> Belief:
        """
        Ocean that an estimator assumes; if the true ocean varies in time, a snapshot at its start.
        """
        own_ice = isinstance(section, ExactBelief) and self.config.ocean.ice_draw == "each"
        member = realization if section.random or own_ice else -1
        if section not in self._latest or self._latest[section][0] != member:
            self._latest[section] = member, BUILDERS[section.kind](section, self, realization)
        return self._latest[section][1]

    def varying(self, section: AnyBelief) -> OceanFields:
        """
        Assumed ocean that varies during the mission: like the study's ocean, like another day's, or
        with a tide.
        """
        if section not in self._over_time:
            ocean = self.config.ocean
            if isinstance(section, InternalTideBelief):
                self._over_time[section] = OceanFields(None, with_tide(section, self.run.ocean))
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
                    notes += notes_of_casts([self.cast(section)])
                else:
                    ocean = self.ocean_of_files(section)
                    notes += (f"{ocean.attrs['title']}: {note}" for note in reading_notes(ocean))
            notes += () if modes is None else notes_of_casts(self._read_casts(modes.casts))
        return [f"estimators: {note}" for note in dict.fromkeys(notes)]

    @cached_property
    def reception(self) -> ReceptionOptions:
        """Reception of the study, with the absorption in its ocean at the start."""
        ocean = self._ocean or mission_ocean(self.config)
        return build_sound(self.config).reception(ocean)

    def assumed(self, local: xr.Dataset, interpolation: Interpolation | None = None) -> Belief:
        """Belief of a local ocean; the interpolation is that of the study by default."""
        acoustics = self.config.acoustics
        return Belief(
            local=local,
            medium=Medium.from_dataset(
                local,
                interpolation=interpolation or acoustics.interpolation,
                earth=acoustics.earth,
            ),
            currents=Currents.from_dataset(local) if acoustics.currents else None,
            spreading_cutoff_db=acoustics.cutoff_db,
        )

    def in_domain(self, geographic: xr.Dataset, equation: Equation | None = None) -> xr.Dataset:
        """Local ocean over the study's domain and sea floor, by its equation or another."""
        ocean = self.config.ocean
        section = ocean.model_copy(update={"equation": equation or ocean.equation})
        return local_ocean(section, geographic, build_sea_floor(section, self.true))

    @property
    def in_metres(self) -> bool:
        """True if the study's water has no latitudes, temperatures and salinities."""
        no_columns = (
            self._ocean is not None and self._ocean.geographic is None and self._ocean.cast is None
        )
        return no_columns or section_in_metres(self.config.ocean)

    def require_columns(self, section: AnyBelief) -> None:
        """Refuse a belief that needs temperature and salinity if the water is in metres."""
        if self.in_metres:
            raise OceanError(
                f"belief {section.kind}: water in metres has no temperature and salinity, which"
                " this belief needs; use exact, mean, cast (without down_to), offset, numerics"
                " (without equation) or file"
            )

    @cached_property
    def true(self) -> xr.Dataset:
        """Geographic ocean at the start of the mission."""
        if self._ocean is not None and self._ocean.geographic is not None:
            return self._ocean.geographic
        return open_start(self.config.ocean)

    @cached_property
    def frame(self) -> LocalFrame:
        """Local frame of the study."""
        attrs = self.run.ocean.attrs
        return LocalFrame(attrs["centre_latitude_deg"], attrs["centre_longitude_deg"])

    @property
    def centre(self) -> tuple[float, float]:
        """Latitude and longitude of the frame's centre. [degrees]"""
        return self.frame.latitude_deg, self.frame.longitude_deg

    @cached_property
    def to_nodes(self) -> TensorSpline:
        """Interpolation from the geographic ocean to the nodes of the local ocean."""
        window = Window.of(self.true, self.centre)
        north, east = (
            np.asarray(self.run.ocean[name].values, dtype=float) for name in ("north", "east")
        )
        return TensorSpline(
            window.lat, window.lon, *window.geographic(north[:, None], east[None, :])
        )

    def ocean_modes(self, count: int | None) -> VerticalModes:
        """Vertical modes of the ocean: a number of them, or those with 99.99 % of the variance."""
        if count not in self._modes:
            equation = self.config.ocean.equation
            self._modes[count] = vertical_modes(self.true, n_modes=count, equation=equation)
        return self._modes[count]

    def cast(self, section: FileBelief) -> Cast:
        """Cast of a file."""
        return read_cast(
            section.source[0],
            name=section.cast,
            default_place=self.centre,
            repair_freezing=self.config.ocean.repair_freezing,
        )

    def ocean_of_files(self, section: FileBelief) -> xr.Dataset:
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

    def _read_casts(self, files: tuple[str, ...]) -> list[Cast]:
        repair = self.config.ocean.repair_freezing
        return read_casts(files, default_place=self.centre, repair_freezing=repair)

    def _scaled_modes(
        self, casts: tuple[str, ...], rms: float | None, down_to: float | None
    ) -> tuple[Array, Array, Array]:
        """
        Levels, shapes and standard deviations of the modes of the ocean, or of casts in files.
        """
        ocean = self.true
        if casts:
            modes = vertical_modes(self._read_casts(casts), equation=self.config.ocean.equation)
        else:
            modes = self.ocean_modes(None)
        depth = np.asarray(ocean["depth"].values, dtype=float)
        shapes = modes.at(depth)
        factor = (
            1.0 if rms is None else rms / pooled_rms(ocean, modes.variance @ shapes**2, down_to)
        )
        return depth, shapes, factor * np.sqrt(modes.variance)


def _exact(_section: ExactBelief, beliefs: Beliefs, realization: int) -> Belief:
    return beliefs.assumed(beliefs.run.ocean_in(realization))


def _perturbed(section: PerturbedBelief, beliefs: Beliefs, realization: int) -> Belief:
    exact = beliefs.believed(ExactBelief(kind="exact"), realization)
    config = beliefs.config
    try:
        error = draw_sound_speed_error(
            beliefs.true,
            rms=section.rms,
            horizontal_scale=section.horizontal_scale,
            down_to=section.down_to,
            modes=beliefs.ocean_modes(section.n_modes),
            rng=stream(config.study.seed, realization, "belief", "perturbed"),
            equation=config.ocean.equation,
        )
    except OceanError as problem:
        raise OceanError(
            f"belief perturbed by {section.rms:g} m/s, realization {realization}: {problem}"
        ) from None
    fields = np.moveaxis(beliefs.to_nodes(error.fields), -1, 0)
    return exact.plus(error.profiles(exact.medium.depth), fields)


def _mean(_section: MeanBelief, beliefs: Beliefs, _n: int) -> Belief:
    if beliefs.in_metres:
        local = beliefs.run.ocean
        return beliefs.assumed(_uniform(local, local["sound_speed"].mean(("north", "east"))))
    return beliefs.assumed(beliefs.in_domain(mean_ocean(beliefs.true)))


def _cast(section: CastBelief, beliefs: Beliefs, realization: int) -> Belief:
    """Column of the true ocean everywhere, with the instrument's bias and noise at each level."""
    if section.random:
        without = section.model_copy(update={"bias_sigma": 0.0, "noise_sigma": 0.0})
        right = beliefs.believed(without, realization)
        levels = right.local["depth"].values
        rng = stream(beliefs.config.study.seed, realization, "belief", "cast")
        bias = section.bias_sigma * rng.standard_normal()
        error = bias + section.noise_sigma * rng.standard_normal(levels.size)
        profile = np.interp(right.medium.depth, levels, error)
        return right.plus(profile[None], np.ones((1, *right.medium.sound_speed.shape[:2])))
    stations = (v for v in beliefs.config.fleet.vehicles if isinstance(v, StationVehicle))
    first = next(stations, None)
    north, east = (0.0, 0.0) if first is None else (first.north, first.east)
    if section.north is not None and section.east is not None:
        north, east = section.north, section.east
    if beliefs.in_metres and section.down_to is None:
        local = beliefs.run.ocean
        return beliefs.assumed(_uniform(local, local["sound_speed"].interp(north=north, east=east)))
    beliefs.require_columns(section)
    lat, lon = beliefs.frame.to_geodetic(north, east)
    cast = column_ocean(beliefs.true, (float(lat), float(lon)))
    if section.down_to is not None:
        cast = _constant_below(cast, section.down_to)
    return beliefs.assumed(beliefs.in_domain(cast))


def _offset(section: OffsetBelief, beliefs: Beliefs, _n: int) -> Belief:
    local = beliefs.run.ocean
    speed = local["sound_speed"]
    error = np.interp(local["depth"].values, section.depth, section.sound_speed)
    wrong = (speed + xr.DataArray(error, dims="depth")).assign_attrs(speed.attrs)
    return beliefs.assumed(local.assign(sound_speed=wrong))


def _numerics(section: NumericsBelief, beliefs: Beliefs, _n: int) -> Belief:
    local = beliefs.run.ocean
    if beliefs.in_metres and section.equation is None:
        local = local.isel(depth=_every(local["depth"].size, section.every_level))
    else:
        beliefs.require_columns(section)
        other_equation = section.equation not in (None, beliefs.config.ocean.equation)
        if other_equation or section.every_level > 1:
            levels = _every(beliefs.true["depth"].size, section.every_level)
            local = beliefs.in_domain(beliefs.true.isel(depth=levels), section.equation)
    return beliefs.assumed(local, section.interpolation)


def _other_day(section: OtherDayBelief, beliefs: Beliefs, _n: int) -> Belief:
    beliefs.require_columns(section)
    ocean = beliefs.config.ocean
    start = np.datetime64(str(beliefs.true["time"].values), "ns")
    if is_profile(ocean):
        raise OceanError(
            f"belief other-day: {ocean.source[0]} is a profile of one time; use the"
            ' belief { kind = "file", source = ... } with an earlier cast'
        )
    earlier = np.timedelta64(round(section.days_earlier * 86400), "s")
    geographic = open_ocean(ocean.source, time=start - earlier, currents=ocean.currents)
    return beliefs.assumed(beliefs.in_domain(geographic))


def _file(section: FileBelief, beliefs: Beliefs, _n: int) -> Belief:
    """
    Ocean of files or of a cast, over the part of the study's domain that they cover; it must
    contain the fleet.
    """
    name = ", ".join(section.source)
    try:
        local = _local_of_files(section, beliefs)
        _check_holds_fleet(local, beliefs.run)
    except OceanError as error:
        raise OceanError(f"belief {name}: {str(error).removeprefix(f'{name}: ')}") from None
    return beliefs.assumed(local)


def _local_of_files(section: FileBelief, beliefs: Beliefs) -> xr.Dataset:
    """Local ocean of a file in metres, of a cast, or of other files."""
    # a study in metres needs a file in metres
    path = section.source[0]
    ocean = beliefs.config.ocean
    if file_in_metres(path):
        if len(section.source) > 1:
            raise OceanError("several files; name one file in metres")
        if section.cast is not None or section.time is not None:
            raise OceanError(
                "a file in metres has no casts and no time; remove the keys cast and time"
            )
        return ocean_in_metres(read_file_in_metres(path), path)
    if beliefs.in_metres:
        raise OceanError(
            "has latitudes and longitudes, or is a cast, but the water of the study is in metres;"
            " give a file in metres"
        )
    # an ocean or a cast with geographic positions
    centre = beliefs.centre
    north, east, bottom = _reach(beliefs.run.ocean).tolist()
    if not holds_casts(path):
        geographic = beliefs.ocean_of_files(section)
        sea_floor = build_sea_floor(ocean, beliefs.true)
    elif len(section.source) > 1:
        raise OceanError(
            "several files, of which the first contains casts; name one file of casts, or files of"
            " an ocean"
        )
    else:  # the water of a cast everywhere, over the sea floor of the study
        geographic = cast_ocean(
            replace(beliefs.cast(section), lat=centre[0], lon=centre[1]),
            bathymetry=bottom,
            half_extent=(north, east),
            below="constant",
            time=mission_start(ocean),
            equation=ocean.equation,
        )
        sea_floor = build_sea_floor(ocean, beliefs.true)
        sea_floor = sea_floor_depth(beliefs.true) if sea_floor is None else sea_floor
    # its local ocean, over the domain if it covers that
    window = Window.of(geographic, centre)
    half_extent = (north, east) if window.holds(north, east) else window.largest_rectangle()
    domain = ("centre_lat", "centre_lon", "half_extent_north", "half_extent_east")
    covered = ocean.model_copy(update=dict(zip(domain, (*centre, *half_extent), strict=True)))
    return local_ocean(covered, geographic, sea_floor)


def _check_holds_fleet(local: xr.Dataset, run: KnownMission) -> None:
    there = _reach(local)
    # vehicles may have left the domain
    fleet = np.minimum(np.abs(run.truth.position).max(axis=(0, 1)), _reach(run.ocean))
    if np.any(fleet > there):
        (north, far_north), (east, far_east), (depth, deep) = map(distinct_digits, there, fleet)
        raise OceanError(
            f"covers +-{north} m north and +-{east} m east of the study's centre, down to"
            f" {depth} m, but the fleet reaches {far_north}, {far_east} and {deep} m; give a"
            " larger ocean"
        )


BUILDERS: dict[str, Callable[[Any, Beliefs, int], Belief]] = {
    "exact": _exact,
    "perturbed": _perturbed,
    "mean": _mean,
    "cast": _cast,
    "offset": _offset,
    "numerics": _numerics,
    "other-day": _other_day,
    "file": _file,
}
"""Builder of each kind of belief; an internal tide always varies, see `Beliefs.varying`."""


def _uniform(local: xr.Dataset, column: xr.DataArray) -> xr.Dataset:
    """Local ocean with the sound speed of one column everywhere."""
    speed = local["sound_speed"]
    uniform = column.broadcast_like(speed).transpose(*speed.dims).assign_attrs(speed.attrs)
    return local.assign(sound_speed=uniform)


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
