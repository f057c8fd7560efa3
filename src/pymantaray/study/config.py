"""What a study is: strict, frozen sections whose defaults are the paper's tables."""

import datetime as dt
import math
from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, get_args

from pydantic import Field, create_model, model_validator

from pymantaray.sensing.noise import NoiseModel
from pymantaray.study.config_estimators import (
    Depth,
    Hours,
    InputFile,
    InputFiles,
    NonNegativeFloat,
    OceanSource,
    PositiveFloat,
    PositiveHours,
    PositiveSeconds,
    RangeEstimatorSection,
    Seconds,
    Section,
    own_files,
    require_unique,
)
from pymantaray.study.geographic import with_local_places

Bounces = Annotated[int, Field(ge=0, le=15, description="what the solver can count")]


class AcousticsSection(Section):
    """How eigenrays are looked for, which of them is ranged on, and whether the current carries them."""

    spreading_cutoff_db: PositiveFloat | Literal["off"] = 15.0
    interpolation: Literal["smooth", "linear"] = "smooth"
    max_surface_bounces: Bounces = 0
    max_bottom_bounces: Bounces = 0
    arrival: Literal["direct", "first", "strongest"] = "direct"
    currents: bool = False

    @property
    def cutoff_db(self) -> float | None:
        """The spreading cut-off as `find_eigenrays` takes it, None for off. [dB]."""
        return None if self.spreading_cutoff_db == "off" else float(self.spreading_cutoff_db)


class RangingSection(Section):
    """
    How travel times are measured; the paper has synchronous clocks, one way, and a fleet at rest.

    With ``mistaken`` the receiver does not know the direct arrival from the others: it takes the first or the
    strongest that it detects, by ``[detection]`` or, without, by a threshold below the link's strongest
    arrival. It stays with it for about ``mistaken_correlation_s``.
    """

    timing: Literal["one-way", "two-way"] = "one-way"
    turn_around_s: Seconds = 0.0
    clock_offset_sigma: NonNegativeFloat = 0.0
    clock_skew_sigma: NonNegativeFloat = 0.0
    mistaken: Literal["off", "first-detected", "strongest-detected"] = "off"
    below_strongest_db: NonNegativeFloat | None = None
    mistaken_correlation_s: Seconds = 0.0

    @model_validator(mode="after")
    def _only_two_way_turns_around(self) -> Self:
        if self.timing == "one-way" and self.turn_around_s > 0.0:
            raise ValueError(
                f"turn_around_s is {self.turn_around_s:g} s, but timing is one-way, where nobody answers;"
                ' leave it out or set timing = "two-way"'
            )
        return self

    @model_validator(mode="after")
    def _only_mistakes_stay(self) -> Self:
        if self.mistaken_correlation_s > 0.0 and self.mistaken == "off":
            raise ValueError(
                f"mistaken_correlation_s is {self.mistaken_correlation_s:g} s, but mistaken is off; leave it out or set"
                ' mistaken = "first-detected"'
            )
        return self

    @model_validator(mode="after")
    def _only_the_first_needs_a_threshold(self) -> Self:
        if self.below_strongest_db is not None and self.mistaken != "first-detected":
            raise ValueError(
                f"below_strongest_db is {self.below_strongest_db:g}, but mistaken is {self.mistaken}, which has no"
                ' use for it; leave it out or set mistaken = "first-detected"'
            )
        return self


class DetectionSection(Section):
    """
    The modems' sonar equation; without this section every arrival is heard, as in the paper.

    Levels are in dB re 1 µPa, the source's at 1 m and in the band. Noise is Wenz's, by wind and shipping (0.5
    if not given), unless its spectral level is given, in dB re 1 µPa²/Hz. Where no ray arrives, with ``leakage`` sound
    leaks past the nearest ray within ``leakage_reach_m``, and scattered sound is so many dB weaker than spherical spreading.
    """

    source_level_db: float
    frequency_hz: PositiveFloat
    bandwidth_hz: PositiveFloat
    wind_speed: NonNegativeFloat = 5.0
    shipping: float | None = Field(default=None, ge=0.0, le=1.0)
    noise_spectral_level_db: float | None = None
    processing_gain_db: float = 0.0
    threshold_db: float = 10.0
    spread_db: NonNegativeFloat = 6.0
    absorption: Literal["francois-garrison", "ainslie-mccolm", "thorp", "none"] = "francois-garrison"
    surface_loss: Literal["none", "bubbles", "coherent"] = "none"
    ice_loss_db: NonNegativeFloat | None = None
    sediment: Literal["none", "clay", "silt", "sand", "gravel", "moraine"] = "none"
    leakage: bool = False
    leakage_reach_m: PositiveFloat = 200.0
    scatter_db: NonNegativeFloat | None = None

    @model_validator(mode="after")
    def _scatter_is_part_of_leakage(self) -> Self:
        if self.scatter_db is not None and not self.leakage:
            raise ValueError(
                f"scatter_db is {self.scatter_db:g}, but leakage is false: nothing arrives without a ray; leave it out or set"
                " leakage = true"
            )
        return self

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.bandwidth_hz >= 2.0 * self.frequency_hz:
            raise ValueError(
                f"bandwidth_hz is {self.bandwidth_hz:g}, but frequency_hz, the middle of the band, is"
                f" {self.frequency_hz:g}: the band would begin below 0 Hz; it must be less than twice that"
            )
        if self.noise_spectral_level_db is not None and self.shipping is not None:
            raise ValueError(
                "shipping and noise_spectral_level_db exclude each other: one makes the noise, the other gives it"
            )
        return self


ParticipantName = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$", description="letters, digits, _ and -, 64 at most")
]


class FloatSection(Section):
    """What all floats share unless a vehicle says otherwise."""

    hold_depth_h: Hours = 24.0
    hold_surface_h: Hours = 1.0
    vertical_speed: PositiveFloat = 0.5
    surface_depth: Depth = 0.5
    depth_gain: PositiveFloat = 0.1
    arrival_tolerance: PositiveFloat = 0.1


class _Placed(Section):
    """A vehicle's name and starting place in the local frame; a file may give it by ``lat`` and ``lon``, see `with_local_places`."""

    name: ParticipantName
    north: float
    east: float
    heading_deg: float = 0.0


class FloatVehicle(_Placed):
    """Argo-style float: sink, hold, rise, hold at the surface; drifts with the current."""

    kind: Literal["float"]
    target_depth: Depth
    start_delay_h: Hours = 0.0
    hold_depth_h: Hours | None = None
    hold_surface_h: Hours | None = None
    vertical_speed: PositiveFloat | None = None
    surface_depth: Depth | None = None
    depth_gain: PositiveFloat | None = None
    arrival_tolerance: PositiveFloat | None = None


class StationVehicle(_Placed):
    """Station-keeping vehicle: stays where it is put."""

    kind: Literal["station"]
    depth: Depth = 0.5


class DriftingVehicle(_Placed):
    """Buoy that drifts with the current at its depth, or at that of its drogue."""

    kind: Literal["drifting"]
    depth: Depth = 0.5
    drogue_depth: Depth | None = None


class TwistVehicle(_Placed):
    """
    Vehicle under one constant body twist, angular velocity first. [rad/s, m/s].

    Over ground, or with ``current`` through water that carries it.
    """

    kind: Literal["twist"]
    depth: Depth
    twist: tuple[float, float, float, float, float, float] = Field(strict=False)
    current: bool = False


class WaypointVehicle(_Placed):
    """
    Vehicle that steers for points (north, east, depth) at one speed and a limited turn rate.

    The speed is over ground, or with ``current`` through water that carries the vehicle.
    """

    kind: Literal["waypoints"]
    depth: Depth
    points: tuple[Annotated[tuple[float, float, Depth], Field(strict=False)], ...] = Field(
        min_length=1, strict=False
    )
    speed: PositiveFloat
    turn_rate_deg: PositiveFloat = 5.0
    capture_radius: PositiveFloat = 20.0
    loop: bool = False
    current: bool = False


AnyVehicle = Annotated[
    FloatVehicle | StationVehicle | DriftingVehicle | TwistVehicle | WaypointVehicle,
    Field(discriminator="kind"),
]


class FleetSection(Section):
    """
    The vehicles, and what the floats among them share; or files with trajectories of vehicles that moved elsewhere.

    ``enu``: TUM files among them have east, north, up and bodies forward, left, up.
    """

    floats: FloatSection = FloatSection()
    vehicles: tuple[AnyVehicle, ...] = Field(default=(), strict=False)
    trajectories: InputFiles = ()
    enu: bool = False

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        require_unique("vehicle names", [v.name for v in self.vehicles])
        return self

    @model_validator(mode="after")
    def _one_or_the_other(self) -> Self:
        if bool(self.vehicles) == bool(self.trajectories):
            there = "both are given" if self.vehicles else "neither is given"
            raise ValueError(f"vehicles or trajectories make a fleet; {there}")
        return self


class LandmarkSection(Section):
    """Fixed point whose surveyed place is known; takes part in ranging."""

    name: ParticipantName
    north: float
    east: float
    depth: Depth


Condition = Literal["odometry", "straight", "refracted", "straight-all", "no-ranges"]


class StudySection(Section):
    """Name, seed and size of the Monte Carlo study; without conditions and estimators it has ranges alone."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    description: str = ""
    seed: int = Field(default=20140715, ge=0)
    realizations: int = Field(default=25, ge=1, le=10**9)
    conditions: tuple[Condition, ...] = Field(default=("odometry", "straight", "refracted"), strict=False)

    @model_validator(mode="after")
    def _no_duplicates(self) -> Self:
        require_unique("conditions", self.conditions)
        return self


class InternalTideSection(Section):
    """A first-mode internal tide that lifts and lowers the true water as it runs east; estimators know nothing of it."""

    amplitude: PositiveFloat
    period_h: PositiveFloat = 12.42
    wavelength: PositiveFloat = 1e5


class OceanSection(Section):
    """Where the water and the sea floor come from, whether they vary, and the centre of the local frame."""

    source: OceanSource
    time: dt.datetime | None = None
    time_varying: bool = False
    currents: Literal["required", "rest"] = "required"
    equation: Literal["teos-10", "del-grosso", "unesco"] = "teos-10"
    bathymetry: InputFile | None = None
    ice: NonNegativeFloat | InputFile | None = None
    internal_tide: InternalTideSection | None = None
    centre_latitude_deg: float | None = Field(default=None, ge=-90.0, le=90.0)
    centre_longitude_deg: float | None = Field(default=None, ge=-180.0, le=360.0)
    half_extent_north: PositiveFloat | None = None
    half_extent_east: PositiveFloat | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.synthetic and len(self.source) > 1:
            raise ValueError(f"a synthetic source stands alone; found {', '.join(self.source)}")
        for one, other in (
            ("centre_latitude_deg", "centre_longitude_deg"),
            ("half_extent_north", "half_extent_east"),
        ):
            if (getattr(self, one) is None) != (getattr(self, other) is None):
                raise ValueError(f"{one} and {other} must be given together")
        if self.internal_tide is not None and self.time_varying:
            raise ValueError(
                "internal_tide runs through one snapshot; set time_varying = false or leave it out"
            )
        return self

    @property
    def synthetic(self) -> bool:
        """Whether the water is made up, not read from files."""
        return any(name.startswith("synthetic:") for name in self.source)

    @property
    def files(self) -> tuple[str, ...]:
        """Input files, those of the sea floor and of ice last; a synthetic ocean has none of its own."""
        return (
            *own_files(self.source),
            *(file for file in (self.bathymetry, self.ice) if isinstance(file, str)),
        )

    @property
    def centre(self) -> tuple[float, float] | None:
        """Latitude and longitude of the frame's centre, None for the middle of the data. [degrees]."""
        if self.centre_latitude_deg is None or self.centre_longitude_deg is None:
            return None
        return self.centre_latitude_deg, self.centre_longitude_deg

    @property
    def half_extent(self) -> tuple[float, float] | None:
        """Half the local window's size north and east, None for all of the data. [m]."""
        if self.half_extent_north is None or self.half_extent_east is None:
            return None
        return self.half_extent_north, self.half_extent_east


class SlotsSection(Section):
    """Vehicles ping in turn, one a slot, over and over: TDMA."""

    kind: Literal["slots"]
    slots: tuple[str, ...] = Field(min_length=1, strict=False)
    slot_s: PositiveSeconds
    start_s: Seconds = 0.0


class PingsSection(Section):
    """Pings one by one, from a table of times, transmitters and, if not everybody listens, receivers."""

    kind: Literal["pings"]
    file: InputFile


AnySchedule = Annotated[SlotsSection | PingsSection, Field(discriminator="kind")]


class MissionSection(Section):
    """
    Durations and periods, the paper's table of mission timing.

    Without a ``schedule`` all vehicles ping at every multiple of ``ping_interval_h``. Trajectories that are given last from
    their first pose to their last; ``duration_h`` may cut them.
    """

    duration_h: PositiveHours = 168.0
    physics_step_s: PositiveSeconds = 0.125
    sampling_period_s: PositiveSeconds = 200.0
    ping_interval_h: PositiveHours = 4.0
    schedule: AnySchedule | None = None
    gnss_depth: PositiveFloat = 1.0


if TYPE_CHECKING:
    NoiseSection = Section
else:
    _SIGN = {True: NonNegativeFloat, False: PositiveFloat}
    NoiseSection = create_model(
        "NoiseSection",
        __base__=Section,
        __doc__="Levels of `NoiseModel`, the paper's table of noise; those it leaves open are in record 0001.",
        **{f.name: (_SIGN[f.metadata["may_be_zero"]], f.default) for f in fields(NoiseModel)},
    )


class EstimatorSection(Section):
    """Where the optimizer starts from, and how often covariances are kept, the end included."""

    initialise: Literal["truth", "dead-reckoning"] = "truth"
    covariance_interval_h: PositiveHours = 24.0


class SoundConfig(Section):
    """What of a study decides who hears whom, and when, but the places: all that ranging needs without a fleet."""

    ocean: OceanSection
    mission: MissionSection = MissionSection()
    acoustics: AcousticsSection = AcousticsSection()
    ranging: RangingSection = RangingSection()
    detection: DetectionSection | None = None

    @model_validator(mode="after")
    def _mistakes_need_a_rule(self) -> Self:
        ranging, arrival = self.ranging, self.acoustics.arrival
        if ranging.mistaken == "off":
            return self
        if self.detection is not None and self.detection.leakage:
            raise ValueError(
                f"ranging.mistaken is {ranging.mistaken} and detection.leakage is true: what leaks is no candidate; leave one"
                " of them out"
            )
        if arrival != "direct":
            raise ValueError(
                f"ranging.mistaken is {ranging.mistaken}, but acoustics.arrival is {arrival}: what is taken for the"
                " direct arrival has no meaning there; leave one of them out"
            )
        if ranging.below_strongest_db is None:
            if ranging.mistaken == "first-detected" and self.detection is None:
                raise ValueError(
                    "ranging.mistaken is first-detected, but nothing says what is detected; add [detection] or"
                    " ranging.below_strongest_db, such as 12.0"
                )
        elif self.detection is not None:
            raise ValueError(
                "ranging.below_strongest_db and [detection] exclude each other: both say what is detected; leave one out"
            )
        return self

    @model_validator(mode="after")
    def _losses_need_bounces(self) -> Self:
        if self.detection is None:
            return self
        for key, value, bounces in (
            ("surface_loss", self.detection.surface_loss, "max_surface_bounces"),
            ("ice_loss_db", self.detection.ice_loss_db or "none", "max_surface_bounces"),
            ("sediment", self.detection.sediment, "max_bottom_bounces"),
        ):
            if value != "none" and getattr(self.acoustics, bounces) == 0:
                raise ValueError(
                    f"detection.{key} is {value}, but acoustics.{bounces} is 0: no sound is reflected there;"
                    " leave it out or allow bounces"
                )
        if self.detection.ice_loss_db is not None:
            if self.ocean.ice is None:
                raise ValueError(
                    "detection.ice_loss_db is given, but there is no ice: give ocean.ice or leave it out"
                )
            if self.detection.surface_loss != "none":
                raise ValueError(
                    f"detection.ice_loss_db and surface_loss = {self.detection.surface_loss} exclude each other: sound is"
                    " reflected by ice or by a sea under wind"
                )
        return self


class StudyConfig(SoundConfig):
    """A whole study: everything that its results depend on, apart from the input files' content."""

    study: StudySection
    noise: NoiseSection = NoiseSection()
    fleet: FleetSection
    landmarks: tuple[LandmarkSection, ...] = Field(default=(), strict=False)
    estimator: EstimatorSection = EstimatorSection()
    estimators: tuple[RangeEstimatorSection, ...] | None = Field(default=None, strict=False)

    @model_validator(mode="before")
    @classmethod
    def _places(cls, tree: Any) -> Any:
        return with_local_places(tree)

    @property
    def files(self) -> tuple[str, ...]:
        """All input files, of the ocean and of estimators, each once."""
        schedule, estimators = self.mission.schedule, self.estimators or ()
        pings = (schedule.file,) if isinstance(schedule, PingsSection) else ()
        own = [*self.ocean.files, *self.fleet.trajectories, *pings]
        return tuple(dict.fromkeys([*own, *(file for e in estimators for file in e.files)]))

    @model_validator(mode="after")
    def _simulated_in_whole_steps(self) -> Self:
        if self.fleet.trajectories:
            return self
        m = self.mission
        duration, ping = m.duration_h * 3600.0, m.ping_interval_h * 3600.0
        ratios = [
            ("sampling_period_s", m.sampling_period_s, "physics_step_s", m.physics_step_s),
            ("ping_interval_h", ping, "sampling_period_s", m.sampling_period_s),
            ("duration_h", duration, "sampling_period_s", m.sampling_period_s),
        ]
        for long_name, long, short_name, short in ratios:
            if long_name == "ping_interval_h" and m.schedule is not None:
                continue
            ratio = long / short
            if not 0.5 <= ratio < math.inf or abs(ratio - round(ratio)) > 1e-9 * ratio:
                raise ValueError(
                    f"mission: {long_name} is {long:g} s; it must be a whole multiple of {short_name}, {short:g} s"
                )
        if duration < ping and m.schedule is None:
            raise ValueError(
                f"mission: duration_h is {duration:g} s; it must not be less than ping_interval_h, {ping:g} s"
            )
        return self

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        participants = [p.name for p in (*self.fleet.vehicles, *self.landmarks)]
        require_unique("names of vehicles and landmarks", participants)
        names = [e.name for e in self.estimators or ()]
        require_unique("names of conditions and estimators", [*get_args(Condition), *names])
        return self

    @model_validator(mode="after")
    def _estimators_fit(self) -> Self:
        own = self.ranging.clock_offset_sigma, self.ranging.clock_skew_sigma
        for e in self.estimators or ():
            if e.belief_varies and not self.ocean.time_varying:
                raise ValueError(
                    f"estimator {e.name} believes in water that varies, but the study's stands still: set"
                    " ocean.time_varying = true, or leave time_varying out of the belief"
                )
            if e.clocks is not None and not any(e.clocks.priors(*own)):
                raise ValueError(
                    f"estimator {e.name} estimates clocks, but their priors are 0: give ranging.clock_offset_sigma or"
                    " clock_skew_sigma, or offset_sigma or skew_sigma in its clocks"
                )
        return self

    @property
    def solves(self) -> bool:
        """Whether anything is estimated; a study without conditions and estimators has ranges alone."""
        return bool(self.study.conditions or self.estimators)

    def __repr__(self) -> str:
        """Give a line; `study_toml` gives all."""
        return (
            f"<StudyConfig {self.study.name}: {len(self.fleet.vehicles) or 'own'} vehicles, {self.mission.duration_h:g} h,"
            f" {self.study.realizations} realizations, ocean {', '.join(self.ocean.source)}>"
        )

    __str__ = __repr__
