"""
Configuration of a study as strict, frozen sections, whose defaults are the paper's tables, with
checks between sections.
"""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    create_model,
    model_validator,
)

from pymantaray.acoustics.levels.absorption import Formula
from pymantaray.acoustics.reflection import Sediment, SurfaceLoss, sediment_source
from pymantaray.acoustics.selection import ArrivalRule
from pymantaray.config.checks import NAME, NAMED
from pymantaray.config.common import (
    Degrees,
    Hertz,
    Hours,
    InputFile,
    Instant,
    Metres,
    MetresPerSecond,
    NonNegativeFloat,
    OceanSource,
    PositiveFloat,
    Radians,
    RadiansPerSecond,
    Seconds,
    Section,
    own_files,
    require_unique,
)
from pymantaray.config.conditions import DEFAULT
from pymantaray.config.estimators import (
    AnyBatchSolver,
    AnySolver,
    BatchSolver,
    ConditionSection,
    InternalTideSection,
    Start,
)
from pymantaray.config.fleet import FleetSection, LandmarkSection
from pymantaray.config.geographic import with_local_places
from pymantaray.config.keys import changed, described, words_of
from pymantaray.config.mission import MissionSection, PingsSection
from pymantaray.config.parse import parse
from pymantaray.config.references import References, data_references
from pymantaray.geometry.sphere import Earth
from pymantaray.ocean.equations import EQUATIONS
from pymantaray.ocean.names import SYNTHETIC, CurrentsPolicy, Equation
from pymantaray.quantities.units import is_like_quantity, quantity_of
from pymantaray.records.digits import counted
from pymantaray.records.status import TRUTH
from pymantaray.sensing import ClockModel
from pymantaray.sensing.noise import NoiseModel

Bounces = Annotated[int, Field(ge=0, le=15)]  # maximum of the ray solver
AbsorptionName = Literal[Formula, "thorp", "none"]


_SURFACE_LOSS = {"bubbles": ("apl-uw1994",), "coherent": ("pierson1964",)}
_ABSORPTION = {
    "francois-garrison": ("francois1982a", "francois1982b"),
    "ainslie-mccolm": ("ainslie1998",),
    "thorp": ("thorp1967", "jensen"),
}
"""Keys of the publications about each formula."""


class AcousticsSection(Section):
    """
    Search for eigenrays, selection of the ranged arrival, and the effect of currents on sound.
    """

    spreading_cutoff_db: PositiveFloat | Literal["none"] = 15.0
    """
    Eigenrays weaker than spherical spreading by more than this are discarded; ``"none"`` keeps all.
    Not in the paper, record 0001. [dB]
    """
    interpolation: Literal["smooth", "linear"] = "smooth"
    """
    Interpolation of the sound speed: cubic splines, or linear as in Bellhop. Not in the paper,
    record 0001.
    """
    max_surface_bounces: Bounces = 0
    """Maximum number of reflections at the surface or under ice."""
    surface_loss: Literal["none", SurfaceLoss] = "none"
    """
    Loss of a reflection at a rough sea surface: absorption by bubbles, or loss of coherence; needs
    ``[detection]``.
    """
    ice_loss_db: NonNegativeFloat | None = None
    """Loss of each reflection under ice; needs ``ocean.ice`` and ``[detection]``. [dB]"""
    max_bottom_bounces: Bounces = 0
    """Maximum number of reflections at the sea bed."""
    sediment: Sediment = "none"
    """
    Sediment of the sea bed, for the loss of reflections; ``"none"`` has no loss; needs
    ``[detection]``.
    """
    arrival: ArrivalRule = "direct"
    """
    Arrival that is the range: the earliest without a reflection, the earliest of all, the one with
    the smallest loss, or the earliest of all only if each has a reflection.
    """
    currents: bool = False
    """True if currents change travel times along the rays."""
    cone_deg: Degrees[Annotated[float, Field(gt=0.0, le=180.0)]] | None = None
    """
    Half-angle of the transmitter's fan about the chord, as ``beam_spread_deg`` of the authors'
    program; rays launched outside are lost. None without a limit. [degrees]
    """
    earth: Earth = "flat"
    """Shape of the Earth for rays and straight distances: a plane, as in the paper, or a sphere."""

    def references(self) -> References:
        """Publications about rays, currents and losses of reflections."""
        yield "dormand1980", "integration of rays"
        if self.spreading_cutoff_db != "none":
            yield "snieder1998", "reciprocal spreading of rays, by which weak rays are excluded"
        if self.currents:
            yield "munk1995", "sound in moving water"
        for key in _SURFACE_LOSS.get(self.surface_loss, ()):
            yield key, "loss at the surface"
        if (source := sediment_source(self.sediment)) is not None:
            yield source, "sediments"

    @property
    def cutoff_db(self) -> float | None:
        """Spreading cut-off for `find_eigenrays`; None for no cut-off. [dB]"""
        return None if self.spreading_cutoff_db == "none" else float(self.spreading_cutoff_db)


class RangingSection(Section):
    """
    Measurement of travel times; the paper has synchronous clocks, one-way times, and a fleet at
    rest.

    With ``mistaken``, receivers cannot distinguish the direct arrival: they take the first or the
    strongest arrival that they detect, by ``[detection]`` or otherwise by a threshold below the
    strongest arrival of the link. A choice lasts for about ``mistaken_correlation_s``.
    """

    timing: Literal["one-way", "two-way"] = "one-way"
    """One-way travel times between synchronous clocks, or two-way travel times with an answer."""
    turn_around_s: Seconds[NonNegativeFloat] = 0.0
    """Time from the reception of a ping to the answer; for two-way times. [s]"""
    mistaken: Literal["none", "first-detected", "strongest-detected"] = "none"
    """
    Errors of receivers: ``"none"`` if they find the direct arrival; otherwise they take the first
    or the strongest detected arrival.
    """
    below_strongest_db: NonNegativeFloat | None = None
    """
    Arrivals are detected if they are at most this much weaker than the strongest of their link;
    only without ``[detection]``. [dB]
    """
    mistaken_correlation_s: Seconds[NonNegativeFloat] = 0.0
    """Correlation time of the choice of an arrival by a receiver. [s]"""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.timing == "one-way" and self.turn_around_s > 0.0:
            raise ValueError(
                f"turn_around_s is {self.turn_around_s:g} s, but timing is one-way, without"
                " answers;"
                ' remove the key or set timing = "two-way"'
            )
        if self.mistaken_correlation_s > 0.0 and self.mistaken == "none":
            raise ValueError(
                f"mistaken_correlation_s is {self.mistaken_correlation_s:g} s, but mistaken is"
                " none; remove the key or set"
                ' mistaken = "first-detected"'
            )
        if self.below_strongest_db is not None and self.mistaken != "first-detected":
            raise ValueError(
                f"below_strongest_db is {self.below_strongest_db:g}, but mistaken is"
                f" {self.mistaken}, which does not"
                ' use it; remove the key or set mistaken = "first-detected"'
            )
        return self


class DetectionSection(Section):
    """
    Sonar equation of the modems; without this section every arrival is detected, as in the paper.

    Noise is Wenz's, by wind and shipping, unless its spectral level is given.
    """

    source_level_db: float
    """Level of a ping at 1 m, in the band. [dB re 1 µPa]"""
    frequency_hz: Hertz[PositiveFloat]
    """Middle of the band. [Hz]"""
    bandwidth_hz: Hertz[PositiveFloat]
    """Width of the band. [Hz]"""
    wind_speed: MetresPerSecond[NonNegativeFloat] = 5.0
    """Wind speed, for noise and for ``acoustics.surface_loss``. [m/s]"""
    shipping: float | None = Field(default=None, ge=0.0, le=1.0)
    """
    Shipping activity for noise, from 0 (no ships near) to 1 (heavy traffic). Default: 0.5. [-]
    """
    noise_spectral_level_db: float | None = None
    """
    Spectral level of the noise at the receiver, constant in the band; replaces noise of wind and
    ships. [dB re 1 µPa²/Hz]
    """
    processing_gain_db: float = 0.0
    """Gain in signal-to-noise ratio by pulse compression and directivity. [dB]"""
    threshold_db: float = 10.0
    """Signal-to-noise ratio at which half of the pings are detected. [dB]"""
    spread_db: NonNegativeFloat = 6.0
    """
    Standard deviation of the level around its prediction; with 0, detection is certain or
    impossible. [dB]
    """
    absorption: AbsorptionName = "francois-garrison"
    """Formula of absorption by sea water."""
    coherent: bool | Literal["auto"] = "auto"
    """
    Interference of the arrivals of a ping: ``"auto"`` if the band does not separate them, true
    always, as for a tone, false never.
    """
    leakage: bool = False
    """True if sound leaks from the nearest ray to receivers in shadow zones."""
    leakage_reach_m: Metres[PositiveFloat] = 200.0
    """Maximum distance of leakage from the nearest ray. [m]"""
    scatter_db: NonNegativeFloat | None = None
    """
    Level of scattered sound in shadow zones below spherical spreading. Default: no scattered sound.
    [dB]
    """

    def references(self) -> References:
        """Publications about absorption, noise and leakage."""
        for key in _ABSORPTION.get(self.absorption, ()):
            yield key, "absorption"
        if self.noise_spectral_level_db is None:
            yield "wenz1962", "ambient noise, in the form of Coates (1990)"
        if self.leakage:
            yield "itu-p526", "sound behind an edge"

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.scatter_db is not None and not self.leakage:
            raise ValueError(
                f"scatter_db is {self.scatter_db:g}, but leakage is false: no sound arrives without"
                " a ray; remove the key or set leakage = true"
            )
        if self.bandwidth_hz >= 2.0 * self.frequency_hz:
            raise ValueError(
                f"bandwidth_hz is {self.bandwidth_hz:g}, but frequency_hz, the middle of the band,"
                f" is {self.frequency_hz:g}: the band would begin below 0 Hz; it must be less than"
                " twice that"
            )
        if self.noise_spectral_level_db is not None and self.shipping is not None:
            raise ValueError(
                "shipping and noise_spectral_level_db cannot be combined: the level replaces the"
                " noise of ships; remove one of them"
            )
        return self


class StudySection(Section):
    """Name, seed and size of the Monte Carlo study."""

    name: str = Field(pattern=NAME)
    """Letters, digits, dot, _ and -."""
    description: str = ""
    """One line for lists and reports."""
    seed: int = Field(default=20140715, ge=0)
    """Seed of all random numbers. Not in the paper, record 0001."""
    realizations: int = Field(default=25, ge=1, le=10**9)
    """Number of realizations of the noise."""


def _as_texts(value: object) -> object:
    """Convert one name, a list of names or a table to a list of ``VARIABLE=STANDARD_NAME``."""
    if isinstance(value, Mapping):
        return tuple(f"{variable}={meaning}" for variable, meaning in value.items())
    return (value,) if isinstance(value, str) else value


def _metres_or_file(value: Any) -> Any:
    """Return the value, unless its text is a number with a unit that is no length."""
    return quantity_of(value, "m") if isinstance(value, str) and is_like_quantity(value) else value


StandardNames = Annotated[
    tuple[Annotated[str, Field(pattern=NAMED)], ...],
    BeforeValidator(_as_texts, json_schema_input_type=str | tuple[str, ...]),
    Field(strict=False),
]


class OceanSection(Section):
    """
    Source of the water and the sea floor, their variation in time, and the centre of the local
    frame.
    """

    source: OceanSource
    """
    Files that belong together, a profile or cast, ``"synthetic:beaufort"`` or ``"synthetic:fram"``;
    files are relative to this one.
    """
    names: StandardNames = ()
    """
    CF standard names of the files' variables that lack one, such as
    ``temp=sea_water_potential_temperature``.
    """
    cast: str | None = Field(default=None, min_length=1)
    """
    Name of the cast to use of files with several casts, or ``"nearest"`` to the centre; of those
    within 1 km of the nearest, the one nearest in time. Default: all casts; a study needs one.
    """
    bearing: Degrees[float] | None = Field(default=None, ge=-360.0, le=360.0)
    """
    Direction of a section of sound speed by range and depth, clockwise from north. Default: 0.
    [degrees]
    """
    thin: MetresPerSecond[NonNegativeFloat] | None = None
    """
    Remove levels of a profile if interpolation stays within this error; 0 keeps all levels.
    Default: 0.02 m/s for a raw cast, whose levels are less than 2 m apart; otherwise 0. [m/s]
    """
    smooth: Metres[PositiveFloat] | None = None
    """Length of the average that smooths a profile. [m]"""
    time: Instant | None = None
    """
    Time of the ocean (UTC), and start of the mission if it varies. Default: the only time of the
    files.
    """
    time_varying: bool = False
    """True if the ocean varies during the mission."""
    currents: CurrentsPolicy = "required"
    """If the ocean has no currents: ``"required"`` is an error, ``"rest"`` sets them to zero."""
    equation: Equation = "teos-10"
    """Equation of sound speed from temperature, salinity and pressure."""
    bathymetry: Annotated[
        Metres[PositiveFloat] | InputFile | None,
        Field(union_mode="left_to_right"),
        BeforeValidator(_metres_or_file),
    ] = None
    """
    Depth of a flat sea floor, or a file with a finer sea floor than the ocean has; required for a
    profile. [m]
    """
    bathymetry_crs: str | None = None
    """Projection of a sea floor's file that does not name it, such as ``"EPSG:3996"`` of IBCAO."""
    ice: Annotated[
        Metres[NonNegativeFloat] | InputFile | None,
        Field(union_mode="left_to_right"),
        BeforeValidator(_metres_or_file),
    ] = None
    """Draft of a uniform ice cover, or a file with drafts. [m]"""
    ice_slope_deg: Degrees[NonNegativeFloat] | None = Field(default=None, lt=25.0)
    """
    Standard deviation of the slope of the ice's underside along any line, for rays. Default: smooth
    ice. [degrees]
    """
    ice_length: Metres[PositiveFloat] = 20.0
    """Correlation length of the roughness of the ice. [m]"""
    ice_draw: Annotated[int, Field(ge=0)] | Literal["each"] = 0
    """
    Number of the draw of the rough ice, the same in all realizations; or ``"each"``: realization n
    of a study has draw n.
    """
    repair_freezing: bool = False
    """
    Raise the salinity of casts below the freezing point to the freezing line, instead of a note
    only.
    """
    internal_tide: InternalTideSection | None = None
    """Internal tide in the true ocean. Default: none."""
    centre_lat: Degrees[float] | None = Field(default=None, ge=-90.0, le=90.0)
    """Latitude of the local frame's centre. Default: the middle of the data. [degrees]"""
    centre_lon: Degrees[float] | None = Field(default=None, ge=-180.0, le=360.0)
    """Longitude of the local frame's centre. Default: the middle of the data. [degrees]"""
    half_extent_north: Metres[PositiveFloat] | None = None
    """Half of the domain's side from south to north. Default: the largest that fits. [m]"""
    half_extent_east: Metres[PositiveFloat] | None = None
    """Half of the domain's side from west to east. Default: the largest that fits. [m]"""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.synthetic and len(self.source) > 1:
            raise ValueError(
                f"source is {', '.join(self.source)}; a synthetic ocean cannot be combined with"
                " others; give one"
            )
        for one, other in (
            ("centre_lat", "centre_lon"),
            ("half_extent_north", "half_extent_east"),
        ):
            if (getattr(self, one) is None) != (getattr(self, other) is None):
                raise ValueError(f"{one} and {other} must be given together")
        if self.thin is not None and self.smooth is not None:
            raise ValueError("thin and smooth cannot be combined; remove one of them")
        if self.ice_slope_deg is not None and self.ice is None:
            raise ValueError(
                "ice_slope_deg is given, but there is no ice; give ice, or remove ice_slope_deg"
            )
        if self.ice_draw == "each" and self.ice_slope_deg is None:
            raise ValueError(
                "ice_draw is each, but the ice is smooth, so all draws are equal; give"
                " ice_slope_deg, or remove ice_draw"
            )
        if self.internal_tide is not None and self.time_varying:
            raise ValueError(
                "internal_tide needs a single snapshot, but time_varying is true; set time_varying"
                " = false or remove it"
            )
        return self

    def references(self) -> References:
        """Owners of the data, and the equation of sound speed."""
        for source in self.source:
            yield from data_references(source, "ocean")
        if isinstance(self.bathymetry, str):
            yield from data_references(self.bathymetry, "sea floor")
        for key in EQUATIONS[self.equation].references:
            yield key, "sound speed"

    @property
    def first_ice_draw(self) -> int:
        """Draw of the rough ice in the first realization, and where there are no realizations."""
        return 0 if self.ice_draw == "each" else self.ice_draw

    @property
    def standard_names(self) -> dict[str, str]:
        """CF standard names by variable."""
        named = (name.partition("=") for name in self.names)
        return {variable.strip(): meaning.strip() for variable, _, meaning in named}

    @property
    def synthetic(self) -> bool:
        """True if the water is synthetic, not read from files."""
        return any(name.startswith(SYNTHETIC) for name in self.source)

    @property
    def files(self) -> tuple[str, ...]:
        """
        Input files, those of the sea floor and ice last; a synthetic ocean has no files for water.
        """
        from pymantaray.ocean.environment import files_of
        from pymantaray.ocean.range_section import files_of_section

        return (
            *(
                file
                for name in own_files(self.source)
                for part in files_of(name)
                for file in files_of_section(part)
            ),
            *(file for file in (self.bathymetry, self.ice) if isinstance(file, str)),
        )

    @property
    def centre(self) -> tuple[float, float] | None:
        """
        Latitude and longitude of the frame's centre; None for the middle of the data. [degrees]
        """
        if self.centre_lat is None or self.centre_lon is None:
            return None
        return self.centre_lat, self.centre_lon

    @property
    def half_extent(self) -> tuple[float, float] | None:
        """Half extents of the local window north and east; None for all data. [m]"""
        if self.half_extent_north is None or self.half_extent_east is None:
            return None
        return self.half_extent_north, self.half_extent_east


if TYPE_CHECKING:
    _Levels = Section
else:
    _SIGN = {True: NonNegativeFloat, False: PositiveFloat}
    _OF_UNIT = {"m": Metres, "m/s": MetresPerSecond, "rad": Radians, "rad/s": RadiansPerSecond}

    def _level(description: str, number: Any) -> Any:
        unit = description.rpartition("[")[2].removesuffix("]")
        return _OF_UNIT[unit][number] if unit in _OF_UNIT else number

    _Levels = create_model(
        "_Levels",
        __base__=Section,
        **{
            f.name: (
                _level(f.metadata["description"], _SIGN[f.metadata["may_be_zero"]]),
                Field(default=f.default, description=f.metadata["description"]),
            )
            for f in fields(NoiseModel)
        },
    )


class NoiseSection(_Levels):
    """
    Standard deviations of all noise, from the paper's table; record 0001 lists those that the paper
    does not specify.

    A table ``[noise.NAME]`` has the levels of a sensor of another package in ``mission.sensors``.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, dict[str, float]] = Field(init=False)

    clock_offset_sigma: Seconds[NonNegativeFloat] = 0.0
    """Standard deviation of the clocks' offsets at the start of the mission. [s]"""
    clock_skew_sigma: NonNegativeFloat = 0.0
    """Standard deviation of the clocks' rate errors. [-]"""

    @property
    def model(self) -> NoiseModel:
        """Noise of all sensors but clocks."""
        return NoiseModel(**{f.name: getattr(self, f.name) for f in fields(NoiseModel)})

    def of_other(self, sensor: str) -> dict[str, float]:
        """Levels of a sensor of another package that are not its defaults."""
        return dict(self.__pydantic_extra__.get(sensor, {}))

    @property
    def clocks(self) -> ClockModel | None:
        """Clocks of vehicles; None if they are synchronous."""
        if self.clock_offset_sigma == 0.0 and self.clock_skew_sigma == 0.0:
            return None
        return ClockModel(offset_sigma=self.clock_offset_sigma, skew_sigma=self.clock_skew_sigma)


class EstimatorSection(Section):
    """
    Defaults of all conditions: the start of the optimizer, and the interval of stored covariances,
    which include the end.
    """

    start: Start = "truth"
    """Start of the optimizer, if the condition has no ``start``. Not in the paper, record 0001."""
    covariance_interval_h: Hours[PositiveFloat] = 24.0
    """Interval of stored covariances of poses. [h]"""


class SoundConfig(Section):
    """
    Sections of a study that ranging needs without a fleet: water, acoustics, timing and detection.
    """

    in_toml: ClassVar[bool] = True

    ocean: OceanSection
    """Water and sea floor."""
    mission: MissionSection = MissionSection()
    """Durations and periods."""
    acoustics: AcousticsSection = AcousticsSection()
    """Search for eigenrays."""
    ranging: RangingSection = RangingSection()
    """Measurement of travel times."""
    detection: DetectionSection | None = None
    """Sonar equation of the modems. Default: every arrival is detected."""

    def with_(self, **changes: Any) -> Self:
        """
        Copy the configuration with other values by dotted key, and check it again; the description
        lists the changes.

        Parameters
        ----------
        **changes
            Values by dotted key, such as ``**{"noise.range_sigma": 2.0}``. Part of a key may be the
            name of an entry (``fleet.vehicles.B.target_depth``), a table replaces a whole section,
            and ``"none"`` removes a value. Names of files are relative to the working folder.

        Returns
        -------
        SoundConfig or StudyConfig
            Configuration of the same type.

        Raises
        ------
        StudyError
            If a key is unknown or a value is not allowed; one line per finding.
        """
        tree = changed(self.model_dump(exclude_none=True, exclude_unset=True), changes)
        label = "configuration"
        study = tree.get("study")
        words = words_of(changes)
        if isinstance(study, Mapping) and "name" in study and words:
            label = str(study["name"])
            tree = described(tree, label, words)
        return parse(type(self), tree, label, None)

    @classmethod
    def _checked(cls, tree: dict[str, Any]) -> Self:
        return parse(cls, tree, cls.__name__, None)

    @model_validator(mode="after")
    def _mistakes_need_a_rule(self) -> Self:
        ranging = self.ranging
        arrival = self.acoustics.arrival
        if ranging.mistaken == "none":
            return self
        if arrival != "direct":
            raise ValueError(
                f"ranging.mistaken is {ranging.mistaken}, which needs direct arrivals, but"
                f" acoustics.arrival is {arrival}; remove one of them"
            )
        if ranging.below_strongest_db is None:
            if ranging.mistaken == "first-detected" and self.detection is None:
                raise ValueError(
                    "ranging.mistaken is first-detected, but there is no rule of detection; add"
                    " [detection] or ranging.below_strongest_db, such as 12.0"
                )
        elif self.detection is not None:
            raise ValueError(
                "ranging.below_strongest_db and [detection] cannot be combined: both are rules of"
                " detection; remove one of them"
            )
        return self

    @model_validator(mode="after")
    def _mistakes_need_one_ice(self) -> Self:
        if self.ranging.mistaken != "none" and self.ocean.ice_draw == "each":
            raise ValueError(
                f"ranging.mistaken is {self.ranging.mistaken}, which needs the same ice in all"
                " realizations, but ocean.ice_draw is each; give ice_draw a number, or remove"
                " ranging.mistaken"
            )
        return self

    @model_validator(mode="after")
    def _losses_need_bounces(self) -> Self:
        a = self.acoustics
        for key, value, bounces in (
            ("surface_loss", a.surface_loss, "max_surface_bounces"),
            ("ice_loss_db", a.ice_loss_db or "none", "max_surface_bounces"),
            ("sediment", a.sediment, "max_bottom_bounces"),
        ):
            if value != "none" and getattr(a, bounces) == 0:
                raise ValueError(
                    f"acoustics.{key} is {value}, but acoustics.{bounces} is 0, so no arrival is"
                    " reflected there; remove the key or allow bounces"
                )
            if value != "none" and self.detection is None:
                raise ValueError(
                    f"acoustics.{key} is {value}, but without [detection] every arrival is"
                    " detected; remove the key or add [detection]"
                )
        if a.ice_loss_db is not None:
            if self.ocean.ice is None:
                raise ValueError(
                    "acoustics.ice_loss_db is given, but there is no ice; give ocean.ice or remove"
                    " the key"
                )
            if a.surface_loss != "none":
                raise ValueError(
                    f"acoustics.ice_loss_db and surface_loss = {a.surface_loss} cannot be combined:"
                    " the surface is either ice or an open sea; remove one of them"
                )
        return self


class StudyConfig(SoundConfig):
    """
    Configuration of a whole study: everything that determines its results, except the content of
    input files.

    Examples
    --------
    >>> from pymantaray import load_study
    >>> config = load_study("quick", **{"noise.range_sigma": 0.1})
    >>> print(config.mission.duration_h, config.noise.range_sigma)
    24.0 0.1
    """

    study: StudySection
    """Name, seed and size."""
    noise: NoiseSection = NoiseSection()
    """Levels of all noise."""
    fleet: FleetSection
    """The vehicles."""
    landmarks: tuple[LandmarkSection, ...] = Field(default=(), strict=False)
    """Fixed points; a table ``[[landmarks]]`` for each."""
    solver: AnyBatchSolver = BatchSolver(kind="batch")
    """
    Solver of the conditions whose own is ``"batch"``: that, or ``"gtsam"``. Text is the kind alone.
    """
    estimator: EstimatorSection = EstimatorSection()
    """The optimizer."""
    conditions: tuple[ConditionSection, ...] = Field(
        default=tuple(ConditionSection(name=name) for name in DEFAULT), strict=False
    )
    """
    Estimators to compare; a table ``[[conditions]]`` for each, or ``[conditions.NAME]`` to change
    or add one. ``"none"`` computes ranges only.
    """

    @model_validator(mode="before")
    @classmethod
    def _places(cls, tree: Any) -> Any:
        return with_local_places(tree)

    def references(self) -> References:
        """Publications that the study relies on, in the order of the data flow."""
        yield "kogucki-papalia", "conditions and noise of the study"
        for section in (self.ocean, self.acoustics, self.detection):
            yield from () if section is None else section.references()
        for condition in self.conditions:
            yield from condition.references()
            yield from self.solver_of(condition).references()
        if self.solves:
            yield "sturm2012", "absolute trajectory error"

    @property
    def files(self) -> tuple[str, ...]:
        """All input files, of the ocean and of conditions, each once."""
        schedule = self.mission.schedule
        pings = (schedule.file,) if isinstance(schedule, PingsSection) else ()
        own = [*self.ocean.files, *self.fleet.trajectories, *pings]
        return tuple(dict.fromkeys([*own, *(file for c in self.conditions for file in c.files)]))

    @model_validator(mode="after")
    def _simulated_in_whole_steps(self) -> Self:
        if self.fleet.trajectories:
            return self
        m = self.mission
        duration = m.duration_h * 3600.0
        ping = m.ping_interval_h * 3600.0
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
                    f"mission: {long_name} is {long:g} s; it must be a whole multiple of"
                    f" {short_name}, {short:g} s"
                )
        if duration < ping and m.schedule is None:
            raise ValueError(
                f"mission: duration_h is {duration:g} s; it must not be less than ping_interval_h,"
                f" {ping:g} s"
            )
        return self

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        participants = [p.name for p in (*self.fleet.vehicles, *self.landmarks)]
        require_unique("names of vehicles and landmarks", participants)
        conditions = [c.name for c in self.conditions]
        require_unique("names of conditions", conditions)
        if TRUTH in conditions:
            raise ValueError(f"conditions: {TRUTH!r} is the name of the true poses; rename it")
        return self

    @model_validator(mode="after")
    def _conditions_fit(self) -> Self:
        for name in self.noise.__pydantic_extra__:
            if name not in self.mission.sensors:
                raise ValueError(
                    f"noise.{name}: no sensor of this name; add it to mission.sensors, or remove"
                    " the table"
                )
        own = self.noise.clock_offset_sigma, self.noise.clock_skew_sigma
        for c in self.conditions:
            if getattr(c.belief, "time_varying", False) and not self.ocean.time_varying:
                raise ValueError(
                    f"condition {c.name} assumes an ocean that varies, but the study's does not;"
                    " set ocean.time_varying = true, or remove time_varying from the belief"
                )
            if c.clocks is not None and not any(c.clocks.priors(*own)):
                raise ValueError(
                    f"condition {c.name} estimates clocks, but their priors are 0; give"
                    " noise.clock_offset_sigma or clock_skew_sigma, or offset_sigma or skew_sigma"
                    " in its clocks"
                )
        return self

    def solver_of(self, condition: ConditionSection) -> AnySolver:
        """
        Return the solver of a condition; that of the study replaces a batch.

        Parameters
        ----------
        condition : ConditionSection

        Returns
        -------
        BatchSolver, GtsamSolver, IncrementalSolver, FixedLagSolver, KalmanFilter or DeadReckoning
        """
        return self.solver if condition.solver.kind == "batch" else condition.solver

    @model_validator(mode="after")
    def _solver_fits(self) -> Self:
        for c in self.conditions if self.solver.kind != "batch" else ():
            if c.solver.kind == "batch":
                try:
                    ConditionSection.model_validate(
                        {**dict(c), "name": f"{c.name}-{self.solver.kind}", "solver": self.solver}
                    )
                except ValidationError as error:
                    problem = error.errors()[0]["msg"].removeprefix("Value error, ")
                    raise ValueError(
                        f"solver: condition {c.name} cannot use it: {problem}"
                    ) from None
        return self

    @property
    def solves(self) -> bool:
        """True if there are conditions to estimate; a study without conditions has ranges only."""
        return bool(self.conditions)

    def __repr__(self) -> str:
        """One line; `study_toml` returns the whole configuration."""
        own = self.fleet.trajectories and "duration_h" not in self.mission.model_fields_set
        fleet = counted(n, "vehicle") if (n := len(self.fleet.vehicles)) else "own vehicles"
        lasts = "as long as their trajectories" if own else f"{self.mission.duration_h:g} h"
        return (
            f"<StudyConfig {self.study.name}: {fleet}, {lasts},"
            f" {counted(self.study.realizations, 'realization')},"
            f" ocean {', '.join(self.ocean.source)}>"
        )

    __str__ = __repr__
