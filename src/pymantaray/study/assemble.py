"""From configuration to the objects that the other folders work with."""

import datetime as dt
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import (
    Absorption,
    Currents,
    FluidBottom,
    IceCover,
    Leakage,
    Medium,
    SeaSurface,
    Sonar,
    WenzNoise,
)
from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.profiles import Profile
from pymantaray.config.sections import (
    AnyVehicle,
    DetectionSection,
    DriftingVehicle,
    FloatSection,
    FloatVehicle,
    OceanSection,
    PingsSection,
    RangingSection,
    SlotsSection,
    SoundConfig,
    StationVehicle,
    StudyConfig,
    TwistVehicle,
)
from pymantaray.errors import StudyError
from pymantaray.exchange.table import read_pings
from pymantaray.fleet import (
    Behaviour,
    ConstantTwist,
    Drifting,
    FloatCycle,
    StationKeeping,
    Vehicle,
    Waypoints,
)
from pymantaray.fleet.simulate import fleet_refusals
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.grid import linear_interpolator
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
from pymantaray.ocean.schema import Finding
from pymantaray.records import Trajectories
from pymantaray.sensing import (
    ClockModel,
    Detector,
    Landmark,
    OneWay,
    Picker,
    PingSchedule,
    Reception,
    Schedule,
    SlotSchedule,
    Timing,
    TwoWay,
)
from pymantaray.study.tracks import read_fleet
from pymantaray.study.varying import series_of, snapshot_at


@dataclass(frozen=True, eq=False)
class StudyOcean:
    """The water of a study; where its source varies, all but `series` is of the last snapshot at or before the start."""

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


def build_ocean(section: OceanSection, duration: float) -> StudyOcean:
    """Ocean of a study over the duration of its mission [s], in its local frame."""
    oceans, time = _open(section, duration)
    geographic = oceans[0]
    sea_floor = build_sea_floor(section, geographic)

    def local_ones() -> Iterator[xr.Dataset]:
        oceans.reverse()
        while oceans:  # each is let go once it is brought to the local grid
            yield local_ocean(section, oceans.pop(), sea_floor)

    series = series_of(local_ones(), time) if section.time_varying else None
    return StudyOcean(
        geographic=geographic,
        local=next(local_ones()) if series is None else series.isel(time=0, drop=True),
        profile=sound_speed_profile_spread(_at_domain(section, geographic), equation=section.equation),
        region=region_table(geographic, equation=section.equation),
        series=series,
    )


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


def gnss_depth(config: StudyConfig, ocean: StudyOcean, truth: Trajectories) -> float | NDArray[np.float64]:
    """Depth above which vehicles have a GNSS fix: that of the mission, 0 under ice. [m]"""
    if "sea_ice_draft" not in ocean.local:
        return config.mission.gnss_depth
    ice = ocean.local["sea_ice_draft"].values
    if not ice.ndim:
        return config.mission.gnss_depth if ice == 0.0 else 0.0
    look_up = linear_interpolator((ocean.local["north"].values, ocean.local["east"].values), ice)
    draft = look_up(truth.position[..., :2].reshape(-1, 2)).reshape(truth.position.shape[:2])
    return np.where(draft > 0.0, 0.0, config.mission.gnss_depth)


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


def build_fleet(config: StudyConfig) -> list[Vehicle]:
    """Vehicles of a study, in the configured order."""
    floats = config.fleet.floats
    return [
        Vehicle(
            name=vehicle.name,
            position=np.array([vehicle.north, vehicle.east, _start_depth(vehicle, floats)]),
            behaviour=_behaviour(vehicle, floats),
            heading=math.radians(vehicle.heading_deg),
        )
        for vehicle in config.fleet.vehicles
    ]


def fleet_plan(config: StudyConfig) -> dict[str, NDArray[np.float64]]:
    """
    Points (n, 3) that each vehicle and landmark starts from and plans to reach, drift not foreseen; of trajectories, all. [m]

    Those that have latitudes and longitudes need the frame's centre in the configuration, see `with_tracks`.
    """
    marks = {mark.name: np.array([[mark.north, mark.east, mark.depth]]) for mark in config.landmarks}
    plan = {vehicle.name: [tuple(vehicle.position)] for vehicle in build_fleet(config)}
    for vehicle in config.fleet.vehicles:
        if vehicle.kind == "float":
            plan[vehicle.name].append((vehicle.north, vehicle.east, vehicle.target_depth))
        elif vehicle.kind == "waypoints":
            plan[vehicle.name].extend(vehicle.points)
    if config.fleet.trajectories:
        tracks = read_fleet(config.fleet)
        frame = LocalFrame(*(config.ocean.centre or (0.0, 0.0)))  # of places in the frame itself any will do
        return {p.name: p.place for p in tracks.in_frame(frame)} | marks
    return {name: np.array(points, dtype=float) for name, points in plan.items()} | marks


def fleet_findings(
    config: StudyConfig, geographic: xr.Dataset, sea_floor: xr.DataArray | None
) -> list[Finding]:
    """What a run of a study in an ocean would refuse of its vehicles, by the run's own check; nothing of given trajectories."""
    local = local_ocean(config.ocean, geographic, sea_floor)
    refusals = fleet_refusals(build_fleet(config), local, config.mission.physics_step_s)
    return [Finding("wrong", "fleet", str(refusal)) for refusal in refusals]


def build_schedule(config: StudyConfig) -> Schedule:
    """Who pings when in a study."""
    schedule = config.mission.schedule
    if isinstance(schedule, SlotsSection):
        return SlotSchedule(schedule.slots, schedule.slot_s, schedule.start_s)
    if isinstance(schedule, PingsSection):
        start = None if config.ocean.time is None else utc_instant(config.ocean.time)
        if config.fleet.trajectories:
            start = read_fleet(config.fleet).start
        return read_pings(Path(schedule.file), start)
    return PingSchedule(interval=config.mission.ping_interval_h * 3600.0)


def build_landmarks(config: StudyConfig) -> list[Landmark]:
    """Landmarks of a study, in the configured order."""
    return [
        Landmark(name=mark.name, position=np.array([mark.north, mark.east, mark.depth]))
        for mark in config.landmarks
    ]


def _start_depth(vehicle: AnyVehicle, floats: FloatSection) -> float:
    if isinstance(vehicle, FloatVehicle):
        return floats.surface_depth if vehicle.surface_depth is None else vehicle.surface_depth
    return vehicle.depth


def _behaviour(vehicle: AnyVehicle, floats: FloatSection) -> Behaviour:
    if isinstance(vehicle, FloatVehicle):
        own = {name: getattr(vehicle, name) for name in FloatSection.model_fields}
        merged = floats.model_copy(update={name: value for name, value in own.items() if value is not None})
        return FloatCycle(
            target_depth=vehicle.target_depth,
            start_delay=vehicle.start_delay_h * 3600.0,
            hold_depth_time=merged.hold_depth_h * 3600.0,
            hold_surface_time=merged.hold_surface_h * 3600.0,
            vertical_speed=merged.vertical_speed,
            surface_depth=merged.surface_depth,
            depth_gain=merged.depth_gain,
            arrival_tolerance=merged.arrival_tolerance,
        )
    if isinstance(vehicle, StationVehicle):
        return StationKeeping(depth=vehicle.depth)
    if isinstance(vehicle, DriftingVehicle):
        drogue = vehicle.depth if vehicle.drogue_depth is None else vehicle.drogue_depth
        return Drifting(depth=vehicle.depth, drogue_depth=drogue)
    if isinstance(vehicle, TwistVehicle):
        return ConstantTwist(twist=np.array(vehicle.twist), current=vehicle.current)
    return Waypoints(
        points=np.array(vehicle.points),
        speed=vehicle.speed,
        turn_rate=math.radians(vehicle.turn_rate_deg),
        capture_radius=vehicle.capture_radius,
        loop=vehicle.loop,
        current=vehicle.current,
    )


def build_timing(section: RangingSection) -> Timing:
    """Timing scheme of a study."""
    return OneWay() if section.timing == "one-way" else TwoWay(turn_around=section.turn_around_s)


def build_clocks(section: RangingSection) -> ClockModel | None:
    """Clocks of a study's vehicles; None if they are synchronous."""
    if section.clock_offset_sigma == 0.0 and section.clock_skew_sigma == 0.0:
        return None
    return ClockModel(offset_sigma=section.clock_offset_sigma, skew_sigma=section.clock_skew_sigma)


def build_picker(section: RangingSection, sonar: Sonar | None) -> Picker | None:
    """Rule by which a study's receivers take an arrival for the direct one; None if they never err."""
    if section.mistaken == "off":
        return None
    return Picker(
        rule=section.mistaken,
        sonar=sonar,
        below_strongest_db=section.below_strongest_db,
    )


def build_medium(config: SoundConfig, ocean: StudyOcean) -> Medium | Callable[[float], Medium]:
    """Medium of a study's rays; a function of the time since the mission's start [s] if the ocean varies."""
    at = partial(_medium_at, ocean, config.acoustics.interpolation)  # which another process can be given
    return at if ocean.varies else at(0.0)


def _medium_at(ocean: StudyOcean, interpolation: Interpolation, time: float) -> Medium:
    return Medium.from_dataset(ocean.local_at(time), interpolation=interpolation)


def build_currents(config: SoundConfig, ocean: StudyOcean) -> Currents | Callable[[float], Currents] | None:
    """Currents along the rays of a study, like `build_medium`; None if rays run through water at rest."""
    if not config.acoustics.currents:
        return None

    at = partial(_currents_at, ocean)
    return at if ocean.varies else at(0.0)


def _currents_at(ocean: StudyOcean, time: float) -> Currents:
    return Currents.from_dataset(ocean.local_at(time))


def build_detector(config: SoundConfig, ocean: StudyOcean) -> Detector | None:
    """Sonar and losses of a study, absorption by its first snapshot; None if every arrival is heard."""
    s = config.detection
    if s is None:
        return None
    return detector_of(s, ocean_absorption(s, ocean.geographic, config.ocean.centre))


def detector_of(s: DetectionSection, absorption: Absorption | None) -> Detector:
    """Sonar and losses of a section in water of some absorption."""
    return Detector(
        sonar=sonar_of(s),
        absorption=absorption,
        bottom=None if s.sediment == "none" else FluidBottom.standard(s.sediment),
        surface=_surface(s),
    )


def build_reception(config: SoundConfig, ocean: StudyOcean) -> Reception:
    """What the receivers of a study listen for."""
    acoustics = config.acoustics
    return Reception(
        spreading_cutoff_db=acoustics.cutoff_db,
        max_surface_bounces=acoustics.max_surface_bounces,
        max_bottom_bounces=acoustics.max_bottom_bounces,
        arrival=acoustics.arrival,
        detector=build_detector(config, ocean),
        leakage=leakage_of(config.detection),
    )


def leakage_of(s: DetectionSection | None) -> Leakage | None:
    """What arrives where no ray does; None if nothing."""
    return Leakage(s.leakage_reach_m, s.scatter_db) if s is not None and s.leakage else None


def build_sonar(s: DetectionSection | None) -> Sonar | None:
    """Modems of a study; None if every arrival is heard."""
    return None if s is None else sonar_of(s)


def sonar_of(s: DetectionSection) -> Sonar:
    """Modems of a section."""
    noise: WenzNoise | float
    if s.noise_spectral_level_db is None:
        noise = WenzNoise(wind_speed=s.wind_speed, shipping=0.5 if s.shipping is None else s.shipping)
    else:
        noise = s.noise_spectral_level_db
    return Sonar(
        source_level_db=s.source_level_db,
        frequency_hz=s.frequency_hz,
        bandwidth_hz=s.bandwidth_hz,
        noise=noise,
        processing_gain_db=s.processing_gain_db,
        threshold_db=s.threshold_db,
        spread_db=s.spread_db,
    )


def _surface(s: DetectionSection) -> SeaSurface | IceCover | None:
    if s.ice_loss_db is not None:
        return IceCover(s.ice_loss_db)
    return None if s.surface_loss == "none" else SeaSurface(wind_speed=s.wind_speed, model=s.surface_loss)


def cast_absorption(s: DetectionSection, profile: Profile) -> Absorption | None:
    """Absorption of a section in the water of a cast, which must have temperature and salinity for most formulas."""
    if s.absorption == "none":
        return None
    if s.absorption == "thorp":
        return Absorption.thorp()
    if profile.water is None:
        raise StudyError(
            f"detection.absorption is {s.absorption}, but cast {profile.name} lacks temperature or salinity; take thorp or none"
        )
    return Absorption.from_profile(profile.depth, *profile.water, formula=s.absorption)


def ocean_absorption(
    s: DetectionSection, geographic: xr.Dataset, centre: tuple[float, float] | None
) -> Absorption | None:
    """Absorption of a section in an ocean as its source has it."""
    if s.absorption == "none":
        return None
    if s.absorption == "thorp":
        return Absorption.thorp()
    return Absorption.from_dataset(geographic, centre=centre, formula=s.absorption)
