"""Plans of surveys: expected standard deviations for patterns of pings."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.evidence import posterior
from pymantaray.apps.locate.linear import Linearization
from pymantaray.apps.locate.noise import Correlation
from pymantaray.apps.locate.options import PlanOptions
from pymantaray.apps.locate.sound_speed import sound_speed_terms
from pymantaray.apps.locate.survey import Node, Survey
from pymantaray.apps.locate.travel_times import predict
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.arrays import Array
from pymantaray.errors import LocateError

Shape = Literal["circle", "cross", "line", "rose", "lines"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
_PETALS = 4  # per rose
_LINES = 5  # parallel lines
_MAX_PINGS = 100_000


@dataclass(frozen=True)
class Pattern:
    """
    Pattern of a platform's pings around the node's drop point.

    Parameters
    ----------
    shape : {"circle", "cross", "line", "rose", "lines"}
        One full circle, two lines at right angles, one line, four petals through the middle, or
        five parallel lines.
    radius : float
        Extent of the pattern from its middle. [m]
    pings : int
        Number of pings.
    """

    shape: Shape
    radius: float
    pings: int

    def __post_init__(self) -> None:
        """Check."""
        if self.shape not in SHAPES:
            raise LocateError(f"pattern is {self.shape!r}; allowed: {', '.join(SHAPES)}")
        if not (self.radius > 0.0 and np.isfinite(self.radius)):
            raise LocateError(f"pattern: radius is {self.radius:g} m; it must be positive")
        if not 3 <= self.pings <= _MAX_PINGS:
            raise LocateError(f"pattern: pings is {self.pings}; it must be 3 to {_MAX_PINGS:,}")

    def points(self) -> Array:
        """North and east of the pings (n, 2) in order of time. [m]"""
        fraction = (np.arange(self.pings) + 0.5) / self.pings
        if self.shape == "circle":
            angle = 2.0 * np.pi * fraction
            unit = np.column_stack([np.cos(angle), np.sin(angle)])
        elif self.shape == "rose":
            angle = 2.0 * np.pi * fraction
            size = np.cos(0.5 * _PETALS * angle)
            unit = size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        elif self.shape == "line":
            unit = np.column_stack([2.0 * fraction - 1.0, 0.0 * fraction])
        elif self.shape == "cross":
            unit = _along_lines(fraction, 2, is_cross=True)
        else:
            unit = _along_lines(fraction, _LINES, is_cross=False)
        return np.asarray(self.radius * unit)


def _along_lines(fraction: Array, count: int, *, is_cross: bool) -> Array:
    """Points on two crossing lines or on parallel lines, sailed once in alternating directions."""
    which = np.minimum((fraction * count).astype(int), count - 1)
    along = 2.0 * (fraction * count - which) - 1.0
    along = np.where(which % 2 == 0, along, -along)
    if is_cross:
        first = np.column_stack([along, 0.0 * fraction])
        second = np.column_stack([0.0 * fraction, along])
        return np.where((which == 0)[:, None], first, second)
    return np.column_stack([along, 2.0 * which / (count - 1) - 1.0])


@dataclass(frozen=True, eq=False)
class SurveyPlan:
    """
    Expected standard deviations of a node over the radius of patterns.

    ``table`` has the columns ``pattern``, ``radius_m``, ``sigma_north_m``, ``sigma_east_m``,
    ``sigma_depth_m``, ``sigma_horizontal_m`` (square root of the sum of both variances), ``lost``
    (pings without a ray) and ``length_m`` (track).
    """

    table: pd.DataFrame
    options: PlanOptions

    @property
    def best(self) -> pd.DataFrame:
        """Row with the smallest 3D standard deviation of each pattern, best first."""
        return self._smallest(
            self.table["sigma_horizontal_m"] ** 2 + self.table["sigma_depth_m"] ** 2
        )

    @property
    def best_horizontal(self) -> pd.DataFrame:
        """Row with the smallest horizontal standard deviation of each pattern, best first."""
        return self._smallest(self.table["sigma_horizontal_m"])

    def _smallest(self, size: "pd.Series[float]") -> pd.DataFrame:
        rows = self.table.loc[size.groupby(self.table["pattern"]).idxmin()]
        return rows.loc[size[rows.index].sort_values().index].reset_index(drop=True)


def expected_survey(pattern: Pattern, options: PlanOptions) -> Survey:
    """Survey of a pattern around a node, without measured times."""
    points = pattern.points()
    n = len(points)
    position = np.column_stack([points, np.full(n, options.transducer_depth)])
    step = np.gradient(points, axis=0)
    attitude = np.column_stack([np.arctan2(step[:, 1], step[:, 0]), np.zeros(n), np.zeros(n)])
    node = Node(
        "node",
        (0.0, 0.0, options.depth),
        options.node_sigma,
        turn_around_sigma=options.turn_around_sigma,
    )
    return Survey(
        nodes=(node,),
        node=np.zeros(n, dtype=np.int64),
        time=options.ping_interval * np.arange(float(n)),
        travel_time=np.full(n, 1.0),
        transmit_position=position,
        receive_position=position,
        transmit_attitude=attitude,
        receive_attitude=attitude,
        lever=replace(options.lever, offset=(0.0, 0.0, 0.0)),
        platform_error=options.platform_error,
        source="plan",
    )


def expected_sigmas(pattern: Pattern, medium: Medium, options: PlanOptions) -> tuple[Array, int]:
    """Standard deviations of north, east and depth [m], and the number of pings without a ray."""
    survey = expected_survey(pattern, options)
    position = np.array([node.position for node in survey.nodes])
    legs = predict(survey, medium, position, np.zeros(3))
    if not legs.possible.any():
        return np.full(3, np.inf), len(survey)
    survey = survey.assign(travel_time=np.where(legs.possible, legs.travel_time, 1.0))
    speed = sound_speed_terms(survey, position, options.speed_model, options.speed_prior)
    unknowns = SurveyUnknowns(survey, speed)
    values = unknowns.prior_mean
    linear = Linearization(unknowns, values, legs, np.ones(len(survey)))
    products = linear.products(legs.possible, Correlation(), survey.platform_error, options.sigma)
    smooth = dict.fromkeys(unknowns.groups, options.speed_prior.scale / 10.0)
    fit = posterior(products, unknowns, values, smooth, sigma=options.sigma, steps=1)
    variance = np.diag(fit.covariance)[unknowns.slices["position"]]
    return np.sqrt(variance), int((~legs.possible).sum())


def plan_survey(
    medium: Medium,
    options: PlanOptions,
    radii: Array,
    *,
    shapes: tuple[Shape, ...] = SHAPES,
    pings: int = 100,
) -> SurveyPlan:
    """
    Compute expected standard deviations of a node for patterns with several radii.

    Parameters
    ----------
    medium : Medium
        Sound speed.
    options : PlanOptions
        Assumptions.
    radii : array_like, shape (n,)
        Radii. [m]
    shapes : tuple of str
        Patterns to compare.
    pings : int
        Number of pings per pattern.

    Returns
    -------
    SurveyPlan

    Raises
    ------
    LocateError
        If the profile ends above the node, or a number is impossible.
    """
    if options.depth > float(medium.depth[-1]) + 10.0:
        raise LocateError(
            f"profile: it ends at {medium.depth[-1]:g} m, above the node at {options.depth:g} m;"
            " extend it down to the node"
        )
    rows = []
    with threadpool_limits(limits=1, user_api="blas"):
        for shape in shapes:
            for radius in np.asarray(radii, dtype=float):
                pattern = Pattern(shape, float(radius), pings)
                (north, east, depth), n_lost = expected_sigmas(pattern, medium, options)
                points = pattern.points()
                rows.append(
                    {
                        "pattern": shape,
                        "radius_m": float(radius),
                        "sigma_north_m": north,
                        "sigma_east_m": east,
                        "sigma_horizontal_m": float(np.hypot(north, east)),
                        "sigma_depth_m": depth,
                        "lost": n_lost,
                        "length_m": float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
                    }
                )
    return SurveyPlan(pd.DataFrame(rows), options)
