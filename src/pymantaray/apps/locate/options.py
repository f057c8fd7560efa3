"""
Options of the solver and of plans.

The module imports little, because the command line generates its options from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, get_args

from pymantaray.apps.locate.survey import LeverArm, PlatformError
from pymantaray.errors import LocateError
from pymantaray.quantities.checks import check_magnitudes

if TYPE_CHECKING:
    from pymantaray.ocean.modes import VerticalModes

Kind = Literal["known", "scale", "time", "gradient", "modes"]
KINDS: tuple[Kind, ...] = get_args(Kind)
PlanKind = Literal["known", "scale", "time", "gradient"]
Arrangement = Literal["free", "rigid"]
EarthOption = Literal["auto", "flat", "sphere"]
Earth = Literal["flat", "sphere"]
Criterion = Literal["position", "horizontal", "depth", "volume", "hours"]
CRITERIA: Mapping[Criterion, tuple[str, str]] = MappingProxyType(
    {
        "position": ("sigma_position_m", "standard deviation of the position in 3-D"),
        "horizontal": ("sigma_horizontal_m", "horizontal standard deviation"),
        "depth": ("sigma_depth_m", "standard deviation of depth"),
        "volume": ("sigma_volume_m", "volume of the error ellipsoid"),
        "hours": ("hours_to_1_m", "hours until the standard deviation in 3-D is 1 m"),
    }
)
"""Column of a plan that is smallest at the best radius, and its meaning."""


@dataclass(frozen=True)
class SpeedPrior:
    """
    Prior of the sound speed.

    Parameters
    ----------
    scale : float
        Standard deviation of the relative error of the whole profile of sound speed. [-]
    gradient : float
        Standard deviation of constant horizontal gradients of the relative error of the sound
        speed. [1/km]
    knot_interval : float
        Spacing of the splines' knots; 0 for one eightieth of the survey, but at least 5 min. [s]

    Examples
    --------
    >>> from pymantaray.apps.locate import LocateOptions, SpeedPrior
    >>> LocateOptions(speed_prior=SpeedPrior(scale=0.002)).speed_prior.scale
    0.002
    """

    scale: float = 5e-3
    gradient: float = 1e-4
    knot_interval: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (self.scale > 0.0 and self.gradient > 0.0 and self.knot_interval >= 0.0):
            raise LocateError(
                f"speed_prior: scale {self.scale:g}, gradient {self.gradient:g}, knot_interval"
                f" {self.knot_interval:g} s; all must be positive"
            )
        check_magnitudes(LocateError, "speed_prior: scale", self.scale)
        check_magnitudes(LocateError, "speed_prior: gradient", self.gradient, unit="1/km")


@dataclass(frozen=True, eq=False)
class LocateOptions:
    """
    Options of the solver.

    Parameters
    ----------
    speed_model : {"auto", "known", "scale", "time", "gradient", "modes"}
        Model of the sound speed relative to the profile; ``auto`` averages the positions over all
        by their marginal likelihood.
    correlation : {"auto", "none"}
        Correlated noise of pings: ``auto`` selects it by the marginal likelihood, ``none`` excludes
        it.
    gross : float
        Limit for gross errors, in robust standard deviations of the residuals. [-]
    arrangement : {"free", "rigid"}, optional
        ``rigid`` moves all nodes together in their prior arrangement. Default: as in the survey's
        files, else ``free``.
    speed_prior : SpeedPrior
        Prior of the sound speed.
    modes : VerticalModes, optional
        Vertical modes for the model ``modes``.
    earth : {"auto", "flat", "sphere"}
        Shape of the Earth: ``auto`` is the sphere if the survey has a geographic frame, else that
        of the water. If neither states it, both are averaged by their marginal likelihood.

    Examples
    --------
    >>> from pymantaray.apps.locate import LocateOptions
    >>> LocateOptions(speed_model="time", earth="sphere").gross
    5.0
    """

    speed_model: Literal["auto", "known", "scale", "time", "gradient", "modes"] = "auto"
    correlation: Literal["auto", "none"] = "auto"
    gross: float = 5.0
    arrangement: Arrangement | None = None
    speed_prior: SpeedPrior = field(default_factory=SpeedPrior)
    modes: "VerticalModes | None" = None
    earth: EarthOption = "auto"

    def __post_init__(self) -> None:
        """Check all values."""
        for name, allowed in (
            ("speed_model", ("auto", *KINDS)),
            ("correlation", ("auto", "none")),
            ("earth", get_args(EarthOption)),
        ):
            if getattr(self, name) not in allowed:
                raise LocateError(
                    f"{name} is {getattr(self, name)!r}; allowed: {', '.join(allowed)}"
                )
        if not self.gross > 2.0:
            raise LocateError(
                f"gross is {self.gross:g}; it must be greater than 2 standard deviations"
            )

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """
        Candidate models, simplest first.

        ``known`` is not among them: its evidence is high if the data cannot test it.
        """
        if self.speed_model != "auto":
            return (self.speed_model,)
        unused = {"known"} if self.modes is not None else {"known", "modes"}
        return tuple(kind for kind in KINDS if kind not in unused)


@dataclass(frozen=True)
class PlanOptions:
    """
    Assumptions of a plan.

    Parameters
    ----------
    depth : float
        Depth of the node. [m]
    sigma : float
        Standard deviation of two-way times. [s]
    speed_model : {"known", "scale", "time", "gradient"}
        Model of the sound speed in the solver.
    node_sigma : tuple of float
        Prior standard deviations of the node: north, east, depth. [m]
    transducer_depth : float
        Depth of the transducer. [m]
    turn_around_sigma : float
        Prior standard deviation of the turn-around time. [s]
    lever : LeverArm
        Lever arm with standard deviations; the platform heads along its course.
    platform_error : PlatformError
        Errors of the platform's positions.
    speed_prior : SpeedPrior
        Prior of the sound speed.
    ship_speed : float
        Speed along the track; the pings are evenly spaced in time. [m/s]
    turn_time : float
        Time of a turn between two lines. [s]
    criterion : {"position", "horizontal", "depth", "volume", "hours"}
        What is smallest at the best radius; ``hours`` are those until the standard deviation of the
        position is 1 m.

    Examples
    --------
    >>> from pymantaray.apps.locate import PlanOptions
    >>> PlanOptions(depth=1300.0, sigma=1e-4).ship_speed
    2.0
    """

    depth: float
    sigma: float = 1e-3
    speed_model: PlanKind = "scale"
    node_sigma: tuple[float, float, float] = (500.0, 500.0, 100.0)
    transducer_depth: float = 5.0
    turn_around_sigma: float = 0.0
    lever: LeverArm = field(default_factory=LeverArm)
    platform_error: PlatformError = field(default_factory=PlatformError)
    speed_prior: SpeedPrior = field(default_factory=SpeedPrior)
    ship_speed: float = 2.0
    turn_time: float = 300.0
    criterion: Criterion = "position"

    def __post_init__(self) -> None:
        """Check."""
        if not (self.depth > self.transducer_depth >= 0.0):
            raise LocateError(
                f"plan: depth of the node is {self.depth:g} m, of the transducer"
                f" {self.transducer_depth:g} m; the node must be deeper"
            )
        if not (self.sigma > 0.0 and self.ship_speed > 0.0 and self.turn_time >= 0.0):
            raise LocateError(
                f"plan: sigma is {self.sigma:g} s, ship_speed {self.ship_speed:g} m/s, turn_time"
                f" {self.turn_time:g} s; sigma and speed must be positive, the time not negative"
            )
        check_magnitudes(LocateError, "plan: sigma", self.sigma, unit="s")
        check_magnitudes(LocateError, "plan: ship_speed", self.ship_speed, unit="m/s")
        if self.criterion not in CRITERIA:
            raise LocateError(
                f"plan: criterion is {self.criterion!r}; allowed: {', '.join(CRITERIA)}"
            )
        if self.speed_model not in get_args(PlanKind):
            raise LocateError(
                f"plan: speed_model is {self.speed_model!r}; allowed:"
                f" {', '.join(get_args(PlanKind))}"
            )
