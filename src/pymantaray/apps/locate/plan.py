"""Plans of surveys: expected standard deviations and hours for patterns of pings."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.evidence import posterior
from pymantaray.apps.locate.linear import Linearization
from pymantaray.apps.locate.noise import Correlation
from pymantaray.apps.locate.options import CRITERIA, Criterion, PlanOptions
from pymantaray.apps.locate.ping_pattern import SHAPES, Pattern, Shape
from pymantaray.apps.locate.sound_speed import sound_speed_terms
from pymantaray.apps.locate.survey import Node, Survey
from pymantaray.apps.locate.travel_times import predict
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.arrays import Array
from pymantaray.errors import LocateError

Progress = Callable[[int, int], None]
_RADII = 0.1, 3.0, 16  # first and last over the depth, and count, of the default search
_FACTOR = 1.25  # between radii, also beyond these
_LIMITS = 0.02, 10.0  # of the search, over the depth


@dataclass(frozen=True, eq=False)
class SurveyPlan:
    """
    Expected standard deviations of a node over the radius of patterns.

    ``table`` has the columns ``pattern``, ``radius_m``, ``sigma_north_m``, ``sigma_east_m``,
    ``sigma_depth_m``, ``sigma_horizontal_m`` and ``sigma_position_m`` (square roots of the sums of
    two and three variances), ``sigma_volume_m`` (sixth root of the determinant of the covariance),
    ``lost`` (pings without a ray), ``length_m`` (track), ``hours`` (at the ship's speed, with
    turns), ``hours_to_1_m`` (of repetitions until ``sigma_position_m`` is 1 m), and ``at_edge``
    (``smallest`` or ``greatest`` for the first and the last radius of a pattern).

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.locate import PlanOptions, plan_survey
    >>> water = Medium.from_profile([0.0, 1500.0], [1500.0, 1510.0], bottom_depth=1500.0)
    >>> options = PlanOptions(depth=1300.0)
    >>> plan = plan_survey(water, options, np.array([1000.0]), shapes=("cross",), pings=20)
    >>> plan.options.depth
    1300.0
    """

    table: pd.DataFrame
    options: PlanOptions

    @property
    def best(self) -> pd.DataFrame:
        """Best row of each pattern by the criterion of the options, best first."""
        return self.best_by(self.options.criterion)

    def best_by(self, criterion: Criterion) -> pd.DataFrame:
        """
        Select the best row of each pattern, best first.

        Parameters
        ----------
        criterion : {"position", "horizontal", "depth", "volume", "hours"}
            As in `PlanOptions`.

        Returns
        -------
        pandas.DataFrame
        """
        column, _ = CRITERIA[criterion]
        size = self.table[column]
        rows = self.table.loc[size.groupby(self.table["pattern"]).idxmin()]
        return rows.loc[size[rows.index].sort_values().index].reset_index(drop=True)


def expected_survey(pattern: Pattern, options: PlanOptions) -> Survey:
    """Survey of a pattern around a node, without measured times."""
    points = pattern.points()
    n = len(points)
    position = np.column_stack([points, np.full(n, options.transducer_depth)])
    step = np.gradient(points, axis=0)
    attitude = np.column_stack([np.arctan2(step[:, 1], step[:, 0]), np.zeros((n, 2))])
    node = Node(
        "node",
        (0.0, 0.0, options.depth),
        options.node_sigma,
        turn_around_sigma=options.turn_around_sigma,
    )
    _, duration = _track(pattern, options)
    return Survey(
        nodes=(node,),
        node=np.zeros(n, dtype=np.int64),
        time=duration / n * np.arange(float(n)),
        travel_time=np.full(n, 1.0),
        transmit_position=position,
        receive_position=position,
        transmit_attitude=attitude,
        receive_attitude=attitude,
        lever=replace(options.lever, offset=(0.0, 0.0, 0.0)),
        platform_error=options.platform_error,
        source="plan",
    )


def _track(pattern: Pattern, options: PlanOptions) -> tuple[float, float]:
    """Length of a pattern [m], and its duration at the ship's speed with its turns. [s]"""
    length = float(np.linalg.norm(np.diff(pattern.points(), axis=0), axis=1).sum())
    return length, length / options.ship_speed + pattern.turns * options.turn_time


def expected_covariance(
    pattern: Pattern, medium: Medium, options: PlanOptions
) -> tuple[Array, int]:
    """
    Compute the covariance that a pattern is expected to give.

    Parameters
    ----------
    pattern : Pattern
        Pings.
    medium : Medium
        Sound speed.
    options : PlanOptions
        Assumptions.

    Returns
    -------
    covariance : ndarray, shape (3, 3)
        Of north, east and depth; infinite on the diagonal if no ping has a ray. [m2]
    lost : int
        Number of pings without a ray.
    """
    survey = expected_survey(pattern, options)
    position = np.array([node.position for node in survey.nodes])
    legs = predict(survey, medium, position, np.zeros(3))
    if not legs.possible.any():
        return np.diag(np.full(3, np.inf)), len(survey)
    survey = survey.assign(travel_time=np.where(legs.possible, legs.travel_time, 1.0))
    speed = sound_speed_terms(survey, position, options.speed_model, options.speed_prior)
    unknowns = SurveyUnknowns(survey, speed)
    values = unknowns.prior_mean
    linear = Linearization(unknowns, values, legs, np.ones(len(survey)))
    products = linear.products(legs.possible, Correlation(), survey.platform_error, options.sigma)
    smooth = dict.fromkeys(unknowns.groups, options.speed_prior.scale / 10.0)
    fit = posterior(products, unknowns, values, smooth, sigma=options.sigma, steps=1)
    columns = unknowns.slices["position"]
    return fit.covariance[columns, columns], int((~legs.possible).sum())


def plan_survey(
    medium: Medium,
    options: PlanOptions,
    radii: Array | None = None,
    *,
    shapes: tuple[Shape, ...] = SHAPES,
    pings: int = 100,
    progress: Progress | None = None,
) -> SurveyPlan:
    """
    Compute expected standard deviations of a node for patterns with several radii.

    Parameters
    ----------
    medium : Medium
        Sound speed.
    options : PlanOptions
        Assumptions, and the criterion of the best radius.
    radii : array_like, shape (n,), optional
        Radii. [m] Default: 16 radii from 0.1 to 3 times the depth of the node, and further ones
        until the best radius is not at an edge, from 0.02 to 10 times the depth at most.
    shapes : tuple of str
        Patterns to compare.
    pings : int
        Number of pings per pattern.
    progress : callable, optional
        Called with the number of finished patterns and that of all.

    Returns
    -------
    SurveyPlan

    Raises
    ------
    LocateError
        If the profile ends above the node, or a number is impossible.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.locate import PlanOptions, plan_survey
    >>> water = Medium.from_profile([0.0, 1500.0], [1500.0, 1510.0], bottom_depth=1500.0)
    >>> options = PlanOptions(depth=1300.0, sigma=1e-4)
    >>> plan = plan_survey(water, options, np.array([1000.0]), shapes=("circle", "rose"), pings=20)
    >>> plan.table["pattern"].unique().tolist()
    ['circle', 'rose']
    """
    if options.depth > float(medium.depth[-1]) + 10.0:
        raise LocateError(
            f"profile: it ends at {medium.depth[-1]:g} m, above the node at {options.depth:g} m;"
            " extend it down to the node"
        )
    rows: list[dict[str, Any]] = []
    with threadpool_limits(limits=1, user_api="blas"):
        for count, shape in enumerate(shapes, 1):

            def row_at(radius: float, shape: Shape = shape) -> dict[str, Any]:
                return _row(Pattern(shape, radius, pings), medium, options)

            if radii is None:
                of_shape = _search(row_at, options)
            else:
                of_shape = [row_at(float(radius)) for radius in np.sort(np.asarray(radii))]
            edges = {0: "smallest", len(of_shape) - 1: "greatest"}
            rows += [row | {"at_edge": edges.get(i, "")} for i, row in enumerate(of_shape)]
            if progress is not None:
                progress(count, len(shapes))
    return SurveyPlan(pd.DataFrame(rows), options)


def _search(
    row_at: Callable[[float], dict[str, Any]], options: PlanOptions
) -> list[dict[str, Any]]:
    """Rows over the radius; beyond the first and the last while these are the best."""
    column, _ = CRITERIA[options.criterion]
    rows = [row_at(options.depth * float(over_depth)) for over_depth in np.geomspace(*_RADII)]
    first, last = (options.depth * limit for limit in _LIMITS)

    def best() -> int:
        return int(np.argmin([row[column] for row in rows]))

    while best() == len(rows) - 1 and (radius := rows[-1]["radius_m"] * _FACTOR) <= last:
        rows.append(row_at(radius))
    while best() == 0 and (radius := rows[0]["radius_m"] / _FACTOR) >= first:
        rows.insert(0, row_at(radius))
    return rows


def _row(pattern: Pattern, medium: Medium, options: PlanOptions) -> dict[str, Any]:
    """Row of the table for one pattern."""
    covariance, lost = expected_covariance(pattern, medium, options)
    north, east, depth = np.sqrt(np.diag(covariance))
    position = float(np.sqrt(np.trace(covariance)))
    has_ray = lost < pattern.pings
    length, duration = _track(pattern, options)
    hours = duration / 3600.0
    return {
        "pattern": pattern.shape,
        "radius_m": pattern.radius,
        "sigma_north_m": north,
        "sigma_east_m": east,
        "sigma_horizontal_m": float(np.hypot(north, east)),
        "sigma_depth_m": depth,
        "sigma_position_m": position,
        "sigma_volume_m": float(np.linalg.det(covariance) ** (1 / 6)) if has_ray else np.inf,
        "lost": lost,
        "length_m": length,
        "hours": hours,
        "hours_to_1_m": hours * position**2,
    }
