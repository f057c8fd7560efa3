"""Solver for node positions with one model: a robust start, and outer steps with exact rays."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, get_args

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.evidence import (
    MIN_REDUNDANCY,
    MIN_SIGMA,
    Posterior,
    posterior,
    robust_sigma,
)
from pymantaray.apps.locate.linear import Linearization, Products
from pymantaray.apps.locate.noise import Correlation
from pymantaray.apps.locate.options import Arrangement, Earth, Kind, LocateOptions
from pymantaray.apps.locate.sound_speed import sound_speed_terms
from pymantaray.apps.locate.survey import PlatformError, Survey
from pymantaray.apps.locate.travel_times import (
    Legs,
    extrapolate,
    predict,
    transducers,
    with_curvature,
)
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.arrays import Array, Mask
from pymantaray.errors import LocateError
from pymantaray.estimation import LOSSES, Loss
from pymantaray.ocean.modes import VerticalModes

_MAX_STEPS = 15  # full outer steps of one stage
_MAX_DAMPED = 60  # further steps, shorter after each reversal, if these do not converge
_MIN_DAMPING = 0.02
_RELATIVE = 1e-3  # change of a position, relative to its standard deviation
_RETRACE_DISTANCE = 0.3  # m; rays are not traced again for smaller changes
_CONVERGED = 1e-3  # m; the largest change of a node's position in an outer step
_MAX_ROUNDS = 10  # of the graduated start
_SAME_START = 1.0  # m; the start ends if a round changes all positions by less
_SCALE_STEP = 1.5  # factor between successive scales of the loss
_MAX_SCALES = 60
_DEFAULT_SIGMA = 1e-3  # s; noise level if there are too few pings to estimate it
_MIN_GROSS = 1e-6  # s; smaller residuals are never gross errors
_CORRELATED = 3  # hyperparameters of correlated noise
_GRADIENTS = 3  # log of the prior odds against horizontal gradients, 20 to 1
WRONG_LEVER = 4  # log of the prior odds against a wrong lever arm or heading, 55 to 1


class Model(NamedTuple):
    """Model of sound speed and noise."""

    kind: Kind
    memory: float = np.inf
    """Memory of the sound speed's prior; infinite for an integrated random walk. [s]"""
    correlation: Correlation = Correlation()
    earth: Earth | None = None
    """Shape of the Earth, if both are possible."""
    lever_doubt: float = 0.0
    """Standard deviation of errors of a stated horizontal lever arm; 0 if it is right. [m]"""

    def of_kind(self, kind: Kind, lever_doubt: float) -> "Model":
        """Model of another kind with the same noise, and the same memory if it varies over time."""
        model = self._replace(kind=kind, lever_doubt=lever_doubt)
        return model if model.splined else model._replace(memory=np.inf)

    @property
    def splined(self) -> bool:
        """True if the sound speed varies over time."""
        return self.kind in ("time", "gradient")

    @property
    def hyperparameters(self) -> int:
        """Hyperparameters that were searched on a grid, and the penalty of unlikely terms."""
        return int(np.isfinite(self.memory)) + self.penalty

    @property
    def is_white(self) -> bool:
        """True without correlated noise."""
        return self.correlation.ratio == 0.0

    @property
    def penalty(self) -> int:
        """Penalty of the log evidence for correlated noise, gradients and a wrong lever arm."""
        of_noise = 0 if self.is_white else _CORRELATED
        of_gradients = _GRADIENTS if self.kind == "gradient" else 0
        return of_noise + of_gradients + (WRONG_LEVER if self.lever_doubt > 0.0 else 0)


@dataclass(frozen=True, eq=False)
class SurveySolution:
    """Converged values of the outer steps, and the linear system there."""

    unknowns: SurveyUnknowns
    values: Array
    posterior: Posterior
    correlation: Correlation
    legs: Legs
    linear: Linearization
    products: Products
    used: Mask
    settled: bool

    @property
    def model(self) -> Model:
        """Model of sound speed and noise."""
        unknowns = self.unknowns
        speed = unknowns.speed
        return Model(
            speed.kind, speed.memory, self.correlation, unknowns.earth, unknowns.lever_doubt
        )

    def whitened_rows(self) -> Iterator[Array]:
        """Blocks of whitened rows of the used pings, with the residual in the last column."""
        platform = self.unknowns.survey.platform_error
        sigma = self.posterior.sigma
        return (
            block
            for block, _ in self.linear.whitened_rows(self.used, self.correlation, platform, sigma)
        )

    def transducers(self) -> tuple[Array, Array]:
        """Positions of the transducer at transmission and reception, with its lever arm. [m]"""
        return transducers(self.unknowns.survey, self.unknowns.lever(self.values))

    @property
    def positions(self) -> Array:
        """Positions of the nodes (n_nodes, 3). [m]"""
        return self.unknowns.positions(self.values)


class Solver:
    """
    Outer steps of one survey in one medium.

    If the shape of the Earth is unknown, this medium is flat, and ``on_sphere`` is the other one.
    """

    def __init__(
        self,
        survey: Survey,
        medium: Medium,
        options: LocateOptions,
        on_sphere: Medium | None = None,
    ) -> None:
        self.survey = survey
        self.medium = medium
        self.on_sphere = on_sphere
        self.options = options
        self._traced: tuple[Array, Array, Legs] | None = None
        stated_sigma = survey.sigma[np.isfinite(survey.sigma)]
        self.weight = np.ones(len(survey))
        if stated_sigma.size:
            self.weight = np.where(np.isfinite(survey.sigma), survey.sigma, np.median(stated_sigma))
            self.weight = self.weight / np.median(self.weight)

    @property
    def earths(self) -> tuple[Earth | None, ...]:
        """Possible shapes of the Earth; None for that of the medium."""
        return (None,) if self.on_sphere is None else get_args(Earth)

    def medium_of(self, model: Model) -> Medium:
        """Medium on the Earth of a model."""
        if self.on_sphere is None or model.earth != "sphere":
            return self.medium
        return self.on_sphere

    def unknowns(self, model: Model, position: Array) -> SurveyUnknowns:
        """
        Columns for a model.

        Gradients are relative to the middle of the positions.
        """
        options = self.options
        speed = sound_speed_terms(
            self.survey, position, model.kind, options.speed_prior, options.modes, model.memory
        )
        default: Arrangement = "free" if self.survey.rigid is None else "rigid"
        arrangement = options.arrangement or default
        return SurveyUnknowns(self.survey, speed, arrangement, model.earth, model.lever_doubt)

    def first_values(
        self, unknowns: SurveyUnknowns, position: Array, before: SurveySolution | None = None
    ) -> Array:
        """Initial values: these positions, and other values from a solution with another model."""
        values = unknowns.prior_mean
        slices = unknowns.slices
        if before is not None:
            n = slices["speed"].start
            columns = slice(0, slices["curvature"].start)
            values[columns] = before.values[columns]
            fraction = before.unknowns.speed.fraction(
                before.unknowns.speed_values(before.values)[0], len(self.survey)
            )
            if unknowns.speed.terms:  # the first column of the first term is constant
                spline = unknowns.speed.terms[0].spline
                values[n] = fraction[before.used].mean()
                values[n] *= 1.0 if spline is None else spline.unit[0]
        elif unknowns.arrangement == "free":
            values[slices["position"]] = position.ravel()
        else:
            translation = (position - unknowns.positions(values)).mean(axis=0)
            *_, rotation = values[slices["array"]]
            values[slices["array"]] = [*np.clip(translation, -1.0, 1.0), rotation]
        return values

    def step(
        self,
        unknowns: SurveyUnknowns,
        values: Array,
        correlation: Correlation,
        hyper: Mapping[str, float],
        sigma: float,
    ) -> SurveySolution:
        """Solve the linear system at some values, which the solution contains."""
        legs = self.legs(unknowns.positions(values), unknowns.lever(values), unknowns.speed.modes)
        linear = Linearization(unknowns, values, legs, self.weight)
        if not unknowns.prior_sd.any():
            raise LocateError(
                f"{self.survey.source}: there are no unknowns; give at least one node a positive"
                " standard deviation"
            )
        used = self.plausible(linear)
        if not used.any():
            raise LocateError(
                f"{self.survey.source}: the model explains no ping at the initial positions; check"
                " the positions of platform and nodes, and the profile"
            )
        # initial noise level from the residuals, or the stated level for few pings
        first = sigma
        n_free = np.count_nonzero(unknowns.prior_sd)
        n_free -= sum(columns.size for columns in unknowns.groups.values())
        if not first and used.sum() >= n_free + MIN_REDUNDANCY:
            first = robust_sigma(linear.residual[used] / self.weight[used])
        stated_sigma = self.survey.sigma[np.isfinite(self.survey.sigma)]
        first = first or (float(np.median(stated_sigma)) if stated_sigma.size else _DEFAULT_SIGMA)
        products = linear.products(used, correlation, self.survey.platform_error, first)
        fit = posterior(products, unknowns, values, hyper, sigma=first)
        return SurveySolution(
            unknowns, values, fit, correlation, legs, linear, products, used, settled=False
        )

    def legs(self, position: Array, lever: Array, modes: VerticalModes | None) -> Legs:
        """Travel times at positions; rays are traced only if the positions changed enough."""
        if self._traced is not None:
            traced_position, traced_lever, legs = self._traced
            change = position - traced_position
            lever_change = lever - traced_lever
            distance = max(float(np.abs(change).max()), float(np.abs(lever_change).max()))
            has_modes = legs.modes.shape[1] == (0 if modes is None else len(modes.modes))
            if distance < _RETRACE_DISTANCE and has_modes:
                return extrapolate(self.survey, legs, change, lever_change)
        new_legs = predict(self.survey, self.medium, position, lever, modes)
        if self.on_sphere is not None:
            new_legs = with_curvature(
                new_legs, predict(self.survey, self.on_sphere, position, lever)
            )
        self._traced = position, lever, new_legs
        return new_legs

    def plausible(self, linear: Linearization) -> Mask:
        """Pings with a ray whose residuals are not gross errors."""
        possible = linear.legs.possible & ~self.survey.flagged
        if not possible.any():
            return possible
        size = np.abs(linear.residual / self.weight)
        limit = max(self.options.gross * robust_sigma(size[possible]), _MIN_GROSS)
        return np.asarray(possible & (np.nan_to_num(size, nan=np.inf) <= limit))

    def start(self, unknowns: SurveyUnknowns, values: Array) -> Array:
        """
        Initial values that are accurate enough to identify gross errors.

        Each round of graduated non-convexity uses the rays of the positions of the previous one.
        """
        for _ in range(_MAX_ROUNDS):
            position = unknowns.positions(values)
            legs = self.legs(position, unknowns.lever(values), unknowns.speed.modes)
            possible = legs.possible & ~self.survey.flagged
            if not possible.any() or not unknowns.prior_sd.any():
                break
            linear = Linearization(unknowns, values, legs, self.weight)
            values = values + _graduated_change(linear, possible)
            if np.abs(unknowns.positions(values) - position).max() < _SAME_START:
                break
        return values

    def settle(
        self,
        unknowns: SurveyUnknowns,
        values: Array,
        correlation: Correlation,
        before: Posterior | None = None,
    ) -> SurveySolution:
        """
        Iterate outer steps until the positions converge.

        Full steps may oscillate, so later ones are shorter after each reversal. Positions converge
        when a full step changes none by 1 mm, or by a thousandth of its standard deviation.
        """
        hyper: Mapping[str, float] = {} if before is None else before.hyperparameters
        sigma = 0.0 if before is None else before.sigma
        used: Mask | None = None
        damping = 1.0
        last = np.zeros((len(self.survey.nodes), 3))
        for count in range(_MAX_STEPS + _MAX_DAMPED):
            solution = self.step(unknowns, values, correlation, hyper, sigma)
            step = solution.posterior.change
            move = unknowns.positions(values + step) - unknowns.positions(values)
            if count >= _MAX_STEPS:
                factor = 0.5 if np.sum(move * last) < 0.0 else 1.5
                damping = float(np.clip(factor * damping, _MIN_DAMPING, 1.0))
            last = move
            by_columns = unknowns.position_map(values)
            covariance = solution.posterior.covariance
            variance = np.einsum("kai,ij,kaj->ka", by_columns, covariance, by_columns)
            deviation = np.sqrt(np.maximum(variance, 0.0))
            tolerance = np.maximum(_CONVERGED, _RELATIVE * deviation)
            values = values + damping * step
            hyper = solution.posterior.hyperparameters
            same = used is not None and np.array_equal(used, solution.used)
            used = solution.used
            sigma = solution.posterior.sigma
            if (np.abs(move) < tolerance).all() and same:
                return replace(solution, values=values, settled=True)
        return replace(solution, values=values)


def _graduated_change(linear: Linearization, possible: Mask) -> Array:
    """
    Minimize a Geman-McClure loss of the residuals, with priors; return the change of columns.

    The scale of the loss decreases from the largest residual to 3.8 robust standard deviations. The
    first steps therefore use all pings, and a consistent group of pings does not count as gross
    errors before the model has changed.
    """
    unknowns = linear.unknowns
    sd = unknowns.prior_sd
    active = np.flatnonzero(sd > 0.0)
    offset = ((unknowns.prior_mean - linear.values) / np.where(sd > 0.0, sd, 1.0))[active]
    blocks = linear.whitened_rows(possible, Correlation(), PlatformError(), 1.0)
    rows = np.concatenate([block for block, _ in blocks])
    design = rows[:, active] * sd[active]
    residual = rows[:, -1]
    efficient = LOSSES["geman-mcclure"].scale
    current: Array = np.asarray(residual)
    z: Array = np.zeros(active.size)
    scale = max(float(np.abs(current).max()), MIN_SIGMA)
    for _ in range(_MAX_SCALES):
        sigma = robust_sigma(current)
        weight = Loss("geman-mcclure", scale).weight(current) / sigma**2
        normal = design.T @ (design * weight[:, None]) + np.eye(active.size)
        z = np.asarray(
            np.linalg.solve(normal, design.T @ (weight * residual) + offset), dtype=float
        )
        current = np.asarray(residual - design @ z, dtype=float)
        goal = efficient * robust_sigma(current)
        if scale <= goal:
            break
        scale = max(scale / _SCALE_STEP, goal)
    change = np.zeros(unknowns.size)
    change[active] = sd[active] * z
    return change
