"""
Sections of a configuration about conditions: estimators, and the oceans that they assume; in one
module because checks compare them.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from pymantaray.config.checks import NAME
from pymantaray.config.common import (
    Days,
    Depth,
    Hours,
    InputFile,
    Instant,
    Metres,
    MetresPerSecond,
    NonNegativeFloat,
    OceanSource,
    PositiveFloat,
    Seconds,
    Section,
    own_files,
)
from pymantaray.config.references import References, data_references
from pymantaray.estimation.names import (
    STANDARD as STANDARD_CONDITIONS,
    LinkChoice,
    LossName,
    Ranges,
)
from pymantaray.ocean.equations import EQUATIONS
from pymantaray.ocean.names import Equation

KindAlone = BeforeValidator(lambda value: {"kind": value} if isinstance(value, str) else value)
"""A table with its ``kind``, or the kind alone."""


class BeliefSection(Section):
    """Ocean that an estimator assumes."""

    @property
    def random(self) -> bool:
        """True if each realization has its own errors."""
        return False

    @property
    def varies(self) -> bool:
        """True if the ocean varies in time."""
        return getattr(self, "time_varying", False)


class ExactBelief(BeliefSection):
    """
    The true ocean; if it varies, its first snapshot, or with ``time_varying`` the ocean at each
    ping.
    """

    kind: Literal["exact"]
    """The true ocean."""
    time_varying: bool = False
    """True if the assumed ocean varies with time; otherwise it is the first snapshot."""


class PerturbedBelief(BeliefSection):
    """
    The true ocean with random errors in its vertical modes, one member for each realization.

    ``rms`` of the sound speed is over the water column, or its upper ``down_to`` metres. Beliefs of
    one study that differ only in ``rms`` have proportional errors.
    """

    kind: Literal["perturbed"]
    """The true ocean with random errors."""
    rms: MetresPerSecond[PositiveFloat]
    """Root mean square of the errors of sound speed. [m/s]"""
    horizontal_scale: Metres[PositiveFloat]
    """Correlation length of the errors. [m]"""
    down_to: Metres[PositiveFloat] | None = None
    """Depth limit of the water for ``rms``. Default: the sea bed. [m]"""
    n_modes: int | None = Field(default=None, ge=1)
    """Number of vertical modes with errors. Default: modes with 99.99 % of the variance."""

    @property
    def random(self) -> bool:
        """True if each realization has its own errors."""
        return True


class MeanBelief(BeliefSection):
    """Horizontal mean of each level, as in a climatology."""

    kind: Literal["mean"]
    """The region's mean profile."""


class CastBelief(BeliefSection):
    """
    One cast at the start, for the whole domain. Default: at the first vehicle on station, or at the
    centre.

    Its sound speed has a bias and noise at each level, drawn for each realization. Water below
    ``down_to`` has its last temperature and salinity.
    """

    kind: Literal["cast"]
    """One cast of the true ocean."""
    north: Metres[float] | None = None
    """North of the cast, with ``east``; or ``lat``, in degrees. [m]"""
    east: Metres[float] | None = None
    """East of the cast, with ``north``; or ``lon``, in degrees. [m]"""
    bias_sigma: MetresPerSecond[NonNegativeFloat] = 0.0
    """Standard deviation of the instrument's bias of sound speed. [m/s]"""
    noise_sigma: MetresPerSecond[NonNegativeFloat] = 0.0
    """Standard deviation of sound speed at each level. [m/s]"""
    down_to: Metres[PositiveFloat] | None = None
    """Greatest depth of the cast. Default: the sea bed. [m]"""

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.north is None) != (self.east is None):
            raise ValueError("north and east must be given together")
        return self

    @property
    def random(self) -> bool:
        """True if each realization has its own errors."""
        return max(self.bias_sigma, self.noise_sigma) > 0.0


class OffsetBelief(BeliefSection):
    """
    The true ocean with an error of sound speed [m/s] that depends on depth alone: linear between
    depths, constant beyond.
    """

    kind: Literal["offset"]
    """The true ocean with an error that depends on depth."""
    depth: tuple[Depth, ...] = Field(default=(0.0,), strict=False, min_length=1)
    """Depths of the table, increasing. [m]"""
    sound_speed: tuple[MetresPerSecond[float], ...] = Field(strict=False, min_length=1)
    """Errors at these depths. [m/s]"""

    @model_validator(mode="after")
    def _a_table(self) -> Self:
        rising = all(a < b for a, b in pairwise(self.depth))
        if len(self.depth) != len(self.sound_speed) or not rising:
            raise ValueError(
                f"depth has {len(self.depth)} values, sound_speed {len(self.sound_speed)}; both"
                " must have the same number of values, with increasing depths"
            )
        return self


class NumericsBelief(BeliefSection):
    """
    The true ocean with other numerical options: fewer levels, another equation of sound speed,
    another interpolation.
    """

    kind: Literal["numerics"]
    """The true ocean with other numerical options."""
    every_level: int = Field(default=1, ge=1)
    """Step through the levels of the ocean; 2 uses every second level."""
    equation: Equation | None = None
    """Equation of sound speed. Default: that of the study."""
    interpolation: Literal["smooth", "linear"] | None = None
    """Interpolation of the sound speed. Default: that of the study."""

    def references(self) -> References:
        """The equation, if it is another."""
        for key in () if self.equation is None else EQUATIONS[self.equation].references:
            yield key, "sound speed that an estimator assumes"


class InternalTideSection(Section):
    """First-mode internal tide that propagates to the east."""

    amplitude: Metres[PositiveFloat]
    """Amplitude of the vertical displacement. [m]"""
    period_h: Hours[PositiveFloat] = 12.42
    """Period. [h]"""
    wavelength: Metres[PositiveFloat] = 1e5
    """Wavelength. [m]"""


class InternalTideBelief(InternalTideSection, BeliefSection):
    """
    The first snapshot of the true ocean with an internal tide, which replaces that of the true
    ocean.
    """

    kind: Literal["internal-tide"]
    """The true ocean with an internal tide."""

    @property
    def varies(self) -> bool:
        """True if the ocean varies in time."""
        return True


class OtherDayBelief(BeliefSection):
    """
    The same source at an earlier time: a snapshot, or with ``time_varying`` the ocean from that
    time on.
    """

    kind: Literal["other-day"]
    """The source at another time."""
    days_earlier: Days[float]
    """Time before the start of the study. [days]"""
    time_varying: bool = False
    """True if the assumed ocean varies from that time on."""


class FileBelief(BeliefSection):
    """
    Another ocean, from files as in ``[ocean]``, or from a cast, which gives horizontally uniform
    water.

    ``time`` selects one of several times of an ocean (default: the start of the mission); ``cast``
    selects one of several casts of a file.
    """

    kind: Literal["file"]
    """An ocean of its own."""
    source: OceanSource
    """Source as in ``ocean.source``, or a file of casts; relative to this file."""
    time: Instant | None = None
    """Time of the ocean (UTC). Default: the start of the mission."""
    cast: str | None = None
    """Name of the cast, if the file contains several."""

    def references(self) -> References:
        """Owners of the data."""
        for source in self.source:
            yield from data_references(source, "ocean that an estimator assumes")


AnyBelief = Annotated[
    ExactBelief
    | PerturbedBelief
    | MeanBelief
    | CastBelief
    | OffsetBelief
    | NumericsBelief
    | InternalTideBelief
    | OtherDayBelief
    | FileBelief,
    Field(discriminator="kind"),
    KindAlone,
]


class ModesSection(Section):
    """
    Amplitudes of vertical sound-speed modes, uniform over the domain, that are estimated with the
    poses.

    They are the first ``count`` modes of the study's ocean or of casts, relative to the assumed
    ocean. Their prior standard deviations are those of the ocean or casts, or scaled such that all
    modes have ``rms`` over the water column or its upper ``down_to`` metres.
    """

    count: int = Field(ge=1)
    """Number of modes, largest variance first."""
    rms: MetresPerSecond[PositiveFloat] | None = None
    """Prior standard deviation of sound speed. Default: that of the region. [m/s]"""
    down_to: Metres[PositiveFloat] | None = None
    """Depth limit of the water for ``rms``. Default: the sea bed. [m]"""
    casts: tuple[InputFile, ...] = Field(default=(), strict=False)
    """Files of casts for the modes, instead of the ocean; relative to this file."""

    @model_validator(mode="after")
    def _depth_of_something(self) -> Self:
        if self.down_to is not None and self.rms is None:
            raise ValueError("down_to is given without rms, whose depth limit it is; give both")
        return self


class ClocksSection(Section):
    """
    Offsets and rate errors of all clocks, estimated with the poses. Default priors: those of the
    study.
    """

    offset_sigma: Seconds[NonNegativeFloat] | None = None
    """Prior standard deviation of clock offsets. Default: ``noise.clock_offset_sigma``. [s]"""
    skew_sigma: NonNegativeFloat | None = None
    """Prior standard deviation of clock rate errors. Default: ``noise.clock_skew_sigma``. [-]"""

    def priors(self, offset_sigma: float, skew_sigma: float) -> tuple[float, float]:
        """Standard deviations of offset and skew; the arguments are those of the study. [s, -]"""
        return (
            offset_sigma if self.offset_sigma is None else self.offset_sigma,
            skew_sigma if self.skew_sigma is None else self.skew_sigma,
        )


class TransmitterRangeModel(Section):
    """Distance over the sound speed measured at the transmitter."""

    kind: Literal["transmitter"]
    """The sound speed measured at the transmitter."""


class ConstantRangeModel(Section):
    """
    Distance over one sound speed: ``sound_speed``, or the mean of the assumed ocean down to the
    deepest vehicle.
    """

    kind: Literal["constant"]
    """One sound speed."""
    sound_speed: MetresPerSecond[PositiveFloat] | None = None
    """The sound speed; or ``belief``. [m/s]"""
    belief: AnyBelief | None = None
    """The assumed ocean; or ``sound_speed``. By its ``kind``; text is the kind alone."""

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.sound_speed is None) == (self.belief is None):
            both = "" if self.belief is None else ", not both"
            raise ValueError(f"range model constant needs sound_speed or belief{both}")
        return self


class MeanSlownessRangeModel(Section):
    """Mean slowness over the chord, in the mean profile of the assumed ocean."""

    kind: Literal["mean-slowness"]
    """The mean slowness over the chord."""
    belief: AnyBelief
    """The assumed ocean, by its ``kind``; text is the kind alone."""


class EigenrayRangeModel(Section):
    """Travel time of the earliest direct eigenray in the assumed ocean."""

    kind: Literal["eigenray"]
    """Rays through the assumed ocean."""
    belief: AnyBelief
    """The assumed ocean, by its ``kind``; text is the kind alone."""
    modes: ModesSection | None = None
    """Sound-speed modes that are estimated with the poses."""

    @model_validator(mode="after")
    def _modes_of_one_water(self) -> Self:
        if self.modes is not None and self.belief.varies:
            raise ValueError(
                "modes cannot be estimated for a belief that varies in time; remove one of the two"
            )
        return self


class MixtureRangeModel(Section):
    """
    Mixture of all arrivals in the assumed ocean that the receiver may have taken, with the study's
    bounces and modems.

    Each range belongs to the most probable arrival, or to none of them.
    """

    kind: Literal["mixture"]
    """All arrivals that a receiver may take."""
    belief: AnyBelief
    """The assumed ocean, by its ``kind``; text is the kind alone."""
    weights: Literal["receiver", "equal"] = "receiver"
    """
    Probabilities of the arrivals of a link: by the rule ``ranging.mistaken``, or equal; without
    mistaken arrivals they are equal.
    """
    sound_speed_sigma: MetresPerSecond[NonNegativeFloat] = 0.0
    """
    Assumed error of the sound speed along a path, which adds to the standard deviation of each
    travel time. [m/s]
    """
    persistence_s: Seconds[NonNegativeFloat] = 0.0
    """
    Time constant with which a receiver stays with an arrival; 0 if successive picks are
    independent. [s]
    """
    null_weight: float = Field(default=0.01, ge=0.0, lt=1.0)
    """Probability that a range belongs to none of the arrivals. [-]"""
    null_width: Metres[PositiveFloat] = 1000.0
    """Width of the interval over which the error of such a range is uniformly distributed. [m]"""
    gate: PositiveFloat = 5.0
    """Largest innovation of an arrival when its ping is added, in standard deviations. [-]"""


AnyRangeModel = Annotated[
    TransmitterRangeModel
    | ConstantRangeModel
    | MeanSlownessRangeModel
    | EigenrayRangeModel
    | MixtureRangeModel,
    Field(discriminator="kind"),
    KindAlone,
]


class FixedVariance(Section):
    """Variance of a range as in the study."""

    kind: Literal["fixed"]
    """The study's."""


class RayVariance(Section):
    """
    Variance of a range plus the variance of travel times due to errors of the ocean. Default: the
    errors of a perturbed belief.
    """

    kind: Literal["per-link", "correlated"]
    """Variances alone, or with covariances between the links of a ping."""
    rms: MetresPerSecond[PositiveFloat] | None = None
    """Root mean square of the ocean's errors of sound speed; with ``horizontal_scale``. [m/s]"""
    horizontal_scale: Metres[PositiveFloat] | None = None
    """Correlation length of these errors; with ``rms``. [m]"""
    down_to: Metres[PositiveFloat] | None = None
    """Depth limit of the water for ``rms``. Default: the sea bed. [m]"""

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.rms is None) != (self.horizontal_scale is None) or (
            self.down_to is not None and self.rms is None
        ):
            raise ValueError(
                "rms and horizontal_scale must be given together, and down_to with them"
            )
        return self


class SolverSection(Section):
    """Solver of a condition."""

    publications: ClassVar[tuple[str, ...]] = ()
    """Keys of the publications about the solver."""
    if TYPE_CHECKING:
        kind: str

    def references(self) -> References:
        """Publications about the solver."""
        for key in self.publications:
            yield key, f"solver {self.kind}"


class BatchSolver(SolverSection):
    """Batch estimation."""

    kind: Literal["batch"]
    """Batch estimation."""


class GtsamSolver(SolverSection):
    """Batch estimation by GTSAM's Levenberg-Marquardt optimizer, as in the paper."""

    publications: ClassVar[tuple[str, ...]] = ("dellaert2012",)

    kind: Literal["gtsam"]
    """Batch estimation by GTSAM."""
    converged: bool = True
    """
    True to continue until the cost does not fall; False for GTSAM's default parameters, as in the
    authors' program.
    """


class IncrementalSolver(SolverSection):
    """Incremental estimation."""

    publications: ClassVar[tuple[str, ...]] = ("dellaert2012", "kaess2012")

    kind: Literal["incremental"]
    """Incremental estimation."""


class FixedLagSolver(SolverSection):
    """Fixed-lag smoothing."""

    publications: ClassVar[tuple[str, ...]] = ("dellaert2012",)

    kind: Literal["fixed-lag"]
    """Fixed-lag smoothing."""
    lag_h: Hours[PositiveFloat]
    """Lag: time after which poses are marginalized. [h]"""
    incremental: bool = False
    """
    True for an update by iSAM2 at each sample instead of a batch at each ping, which bounds the
    time of an update.
    """


class KalmanFilter(SolverSection):
    """Error-state extended Kalman filter, sample by sample from the priors."""

    publications: ClassVar[tuple[str, ...]] = ("sola2017",)

    kind: Literal["kalman-filter"]
    """Error-state extended Kalman filter."""


class DeadReckoning(SolverSection):
    """Odometry, attitude and depth alone; no graph is solved."""

    kind: Literal["dead-reckoning"]
    """No graph is solved; without ranges only."""


AnyVariance = Annotated[FixedVariance | RayVariance, Field(discriminator="kind"), KindAlone]
AnySolver = Annotated[
    BatchSolver | GtsamSolver | IncrementalSolver | FixedLagSolver | KalmanFilter | DeadReckoning,
    Field(discriminator="kind"),
    KindAlone,
]
AnyBatchSolver = Annotated[BatchSolver | GtsamSolver, Field(discriminator="kind"), KindAlone]
STANDARD: dict[str, dict[str, str]] = {
    name: {"ranges": condition.ranges or "none"}
    | ({"solver": "dead-reckoning"} if condition.dead_reckoned else {})
    | ({"links": condition.links} if condition.links != "refracted" else {})
    for name, condition in STANDARD_CONDITIONS.items()
}
"""Keys of the standard conditions, by name."""
Start = Literal["truth", "dead-reckoning"]
_Fault = tuple[bool, str]
"""True if a combination of keys is wrong, and the message about it."""


class ConditionSection(Section):
    """
    One condition of a study: which ranges are used, and how the trajectories are estimated from
    them.

    All conditions see the same noise. These names need no other keys: ``odometry`` (dead
    reckoning), ``no-ranges`` (all sensors but ranges), ``straight`` (straight ranges over the links
    that refracted ranges have), ``refracted`` (refracted ranges, interpreted by the sound speed at
    the transmitter) and ``straight-all`` (straight ranges over all links).
    """

    name: str = Field(pattern=NAME)
    """Unique; letters, digits, dot, _ and -."""
    ranges: Literal["none", Ranges] = "refracted"
    """Ranges to use."""
    links: LinkChoice = "refracted"
    """Links whose ranges are used: those with refracted ranges, or all."""
    range_model: AnyRangeModel = TransmitterRangeModel(kind="transmitter")
    """Prediction of travel times, by its ``kind``; text is the kind alone."""
    variance: AnyVariance = FixedVariance(kind="fixed")
    """Variance of a range, by its ``kind``; text is the kind alone."""
    loss: Literal["none", LossName] = "none"
    """Robust loss of ranges; ``"none"`` is least squares."""
    solver: AnySolver = BatchSolver(kind="batch")
    """Solver, by its ``kind``; text is the kind alone."""
    start: Start | None = None
    """Start of the optimizer. Default: ``estimator.start``."""
    clocks: ClocksSection | None = None
    """Estimation of clocks with the poses."""
    range_sigma: Metres[PositiveFloat] | Literal["fitted"] | None = None
    """
    Assumed standard deviation of ranges. Default: that of the study. ``"fitted"``: the value at
    which the cost equals its expectation. [m]
    """
    directions: Literal["each", "mean"] = "each"
    """Use each range of a pair, or the mean of both directions."""
    scale_sigma: PositiveFloat | None = None
    """
    Prior standard deviation of a common scale of all travel times; if given, the scale is
    estimated. [-]
    """
    bias_sigma: Metres[PositiveFloat] | None = None
    """
    Prior standard deviation of a bias of each ordered pair; if given, the biases are estimated. [m]
    """

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, tree: Any) -> Any:
        """Add the keys of a standard condition; text is the name alone."""
        tree = {"name": tree} if isinstance(tree, str) else tree
        if not isinstance(tree, Mapping) or not isinstance(tree.get("name"), str):
            return tree
        return {**STANDARD.get(tree["name"], {}), **tree}

    @model_validator(mode="after")
    def _standard_means_standard(self) -> Self:
        if not self.standard:
            return self
        keys = STANDARD[self.name]
        for key, field in type(self).model_fields.items():
            value = getattr(self, key)
            expected = keys.get(key, field.default)
            if key not in {"name", "start"} and getattr(value, "kind", value) != getattr(
                expected, "kind", expected
            ):
                raise ValueError(
                    f"{key} is given, but `{self.name}` is a standard condition, which allows only"
                    " start; give the condition another name"
                )
        self.model_fields_set.difference_update(keys)  # the name implies them
        return self

    @property
    def standard(self) -> bool:
        """True if the name defines the condition completely."""
        return self.name in STANDARD

    @property
    def standard_equivalent(self) -> str:
        """The standard condition with the same kind of measurements."""
        if self.standard:
            return self.name
        if self.ranges == "none":
            return "odometry" if self.solver.kind == "dead-reckoning" else "no-ranges"
        return "straight-all" if self.links == "all" else "straight"

    @property
    def belief(self) -> AnyBelief | None:
        """The ocean that the range model assumes."""
        return getattr(self.range_model, "belief", None)

    @property
    def modes(self) -> ModesSection | None:
        """Sound-speed modes that are estimated with the poses."""
        return getattr(self.range_model, "modes", None)

    @property
    def estimates_more(self) -> bool:
        """True if there are unknowns other than poses."""
        more = (self.modes, self.clocks, self.scale_sigma, self.bias_sigma)
        return any(prior is not None for prior in more)

    @property
    def files(self) -> tuple[str, ...]:
        """Input files: those of the assumed ocean, and casts for modes."""
        belief = own_files(self.belief.source) if isinstance(self.belief, FileBelief) else ()
        return belief if self.modes is None else (*belief, *self.modes.casts)

    @model_validator(mode="after")
    def _keys_fit_each_other(self) -> Self:
        for wrong, message in (
            *self._range_faults(),
            *self._model_faults(),
            *self._solver_faults(),
        ):
            if wrong:
                raise ValueError(message)
        return self

    def _range_faults(self) -> tuple[_Fault, ...]:
        """Combinations of keys about ranges that no estimator has."""
        of_ranges = (
            "variance",
            "loss",
            "clocks",
            "range_sigma",
            "directions",
            "scale_sigma",
            "bias_sigma",
        )
        fields = type(self).model_fields
        given = next((key for key in of_ranges if getattr(self, key) != fields[key].default), None)
        return (
            (
                self.ranges == "refracted" and self.links == "all",
                'refracted ranges over all links: a dropout has none; use links = "refracted"',
            ),
            (
                self.ranges != "refracted" and self.range_model.kind != "transmitter",
                (
                    f"range_model is {self.range_model.kind}, but ranges is {self.ranges}, which"
                    ' needs no travel times; remove it or set ranges = "refracted"'
                ),
            ),
            (
                self.solver.kind == "dead-reckoning" and self.ranges != "none",
                (
                    f'solver "dead-reckoning" uses no ranges, but ranges is {self.ranges}; set'
                    ' ranges = "none"'
                ),
            ),
            (
                self.ranges == "none" and given is not None,
                f'{given} is given, but ranges is "none"; remove one of the two',
            ),
            (
                self.directions == "mean"
                and (self.range_model.kind != "transmitter" or self.ranges != "refracted"),
                (
                    'directions "mean" is for refracted ranges that differ by the speed at their'
                    ' transmitter; set range_model = "transmitter"'
                ),
            ),
            (
                self.range_sigma == "fitted"
                and (
                    self.loss != "none"
                    or self.variance.kind != "fixed"
                    or self.solver.kind not in {"batch", "gtsam", "kalman-filter"}
                ),
                (
                    'range_sigma "fitted" needs a cost with an expected value: no loss, variance'
                    ' "fixed", and solver "batch", "gtsam" or "kalman-filter"'
                ),
            ),
        )

    def _model_faults(self) -> tuple[_Fault, ...]:
        """Combinations of keys about unknowns and range models that no estimator has."""
        return (
            (
                self.modes is not None and self.variance.kind != "fixed",
                (
                    f'modes are given and variance is "{self.variance.kind}": the error of the'
                    ' water would count twice; set "fixed"'
                ),
            ),
            (
                self.solver.kind != "batch" and self.estimates_more,
                (
                    f'solver "{self.solver.kind}" does not estimate modes, clocks, scale or biases;'
                    ' set solver = "batch"'
                ),
            ),
            (
                self.belief is not None
                and self.belief.varies
                and (self.range_model.kind != "eigenray" or self.variance.kind != "fixed"),
                'a belief that varies in time is for range_model "eigenray" with variance "fixed"',
            ),
            (
                self.range_model.kind == "mixture"
                and (self.loss != "none" or self.range_sigma == "fitted"),
                (
                    'range_model "mixture" has null_weight instead of a loss, and its cost has no'
                    ' expected value; remove loss and range_sigma = "fitted"'
                ),
            ),
        )

    def _solver_faults(self) -> tuple[_Fault, ...]:
        """Combinations of keys about solvers and variances that no estimator has."""
        solver, model = self.solver.kind, self.range_model.kind
        without = {"incremental": {"gnc", "tukey", "welsch"}, "gtsam": {"gnc"}}
        along_rays = isinstance(self.variance, RayVariance)
        return (
            (
                self.loss != "none" and self.variance.kind == "correlated",
                f'loss {self.loss} applies to single ranges; set variance = "fixed" or "per-link"',
            ),
            (
                solver not in {"batch", "kalman-filter"}
                and model not in {"constant", "transmitter"},
                (
                    f'range_model is {model}, but solver "{solver}" uses ranges as distances;'
                    " remove range_model"
                ),
            ),
            (
                self.loss in without.get(solver, ()),
                f'solver "{solver}" cannot use loss {self.loss}; set another loss',
            ),
            (
                solver in {"fixed-lag", "kalman-filter"} and self.loss != "none",
                f'solver "{solver}" has no robust loss; set loss = "none"',
            ),
            (
                solver == "kalman-filter" and self.variance.kind != "fixed",
                f'solver "kalman-filter" has no variance "{self.variance.kind}"; set "fixed"',
            ),
            (
                along_rays and model != "eigenray",
                (
                    f'variance "{self.variance.kind}" is computed along eigenrays, but range_model'
                    f' is {model}; set range_model = "eigenray"'
                ),
            ),
            (
                along_rays and self.uncertainty is None,
                (
                    f'variance "{self.variance.kind}" needs rms and horizontal_scale, unless the'
                    " belief is perturbed; give both"
                ),
            ),
        )

    def references(self) -> References:
        """Publications about the assumed ocean, its uncertainty and the loss."""
        if self.belief is not None:
            yield from self.belief.references()
        if self.modes is not None or self.variance.kind != "fixed":
            yield "munk1995", "travel times that depend on uncertain water"
        if self.loss == "gnc":
            yield "yang2020", "graduated non-convexity"

    @property
    def uncertainty(self) -> tuple[float, float, float | None] | None:
        """
        Uncertainty of sound speed: rms, horizontal scale and depth limit; None for a fixed
        variance. [m/s, m, m]
        """
        if not isinstance(self.variance, RayVariance):
            return None
        size = (
            self.belief
            if isinstance(self.belief, PerturbedBelief) and self.variance.rms is None
            else self.variance
        )
        if size.rms is None or size.horizontal_scale is None:
            return None
        return size.rms, size.horizontal_scale, size.down_to
