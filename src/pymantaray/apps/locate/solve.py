"""Solver for node positions: outer steps with exact rays, and selection of the model."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.evidence import MIN_REDUNDANCY, Posterior, posterior
from pymantaray.apps.locate.graduated import graduated_change, robust_sigma
from pymantaray.apps.locate.linear import Linearization, Products
from pymantaray.apps.locate.noise import Correlation
from pymantaray.apps.locate.options import KINDS, Arrangement, Kind, LocateOptions
from pymantaray.apps.locate.sound_speed import sound_speed_terms
from pymantaray.apps.locate.starts import start_positions
from pymantaray.apps.locate.survey import Survey
from pymantaray.apps.locate.travel_times import Legs, extrapolate, predict, transducers
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.arrays import Array, Mask
from pymantaray.errors import LocateError
from pymantaray.ocean.modes import VerticalModes

_MAX_STEPS = 15  # full outer steps of one stage
_MAX_DAMPED = 60  # further steps, shorter after each reversal, if these do not converge
_MIN_DAMPING = 0.02
_RELATIVE = 1e-3  # change of a position, relative to its standard deviation
_RETRACE_DISTANCE = 0.3  # m; rays are not traced again for smaller changes
_CONVERGED = 1e-3  # m; the largest change of a node's position in an outer step
_ROUNDS = 2  # of the graduated start
_CHOICES = 2  # comparisons of models for other sets of used pings
_DEFAULT_SIGMA = 1e-3  # s; noise level if there are too few pings to estimate it
_MIN_GROSS = 1e-6  # s; smaller residuals are never gross errors
_CORRELATION_TIMES = (20.0, 60.0, 180.0, 600.0, 1800.0)  # s
_RATIOS = (0.3, 1.0, 3.0, 10.0)
_MEMORIES = (
    np.inf,
    1.0,
    0.25,
    0.0625,
    0.015625,
)  # of the sound speed, relative to the survey's duration
_SHARES = (0.0, 1.0)
_AMPLITUDES = (0.5, 0.71, 1.41, 2.0, 2.83)  # of the sound speed, relative to the most likely
_MAX_DIFFERENCE = 8.0  # of the ABIC, for candidates with other amplitudes
_CORRELATED = 3  # hyperparameters of correlated noise
_MIN_FOR_CORRELATION = 100  # pings; fewer cannot separate correlation from errors of the model


class Model(NamedTuple):
    """Model of sound speed and noise."""

    kind: Kind
    memory: float = np.inf
    """Memory of the sound speed's prior; infinite for an integrated random walk. [s]"""
    correlation: Correlation = Correlation()

    @property
    def splined(self) -> bool:
        """True if the sound speed varies over time."""
        return self.kind in ("time", "gradient")

    @property
    def hyperparameters(self) -> int:
        """Number of hyperparameters that were searched on a grid."""
        return int(np.isfinite(self.memory)) + _CORRELATED * (self.correlation.ratio > 0.0)


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
        speed = self.unknowns.speed
        return Model(speed.kind, speed.memory, self.correlation)

    def whitened_rows(self) -> Iterator[Array]:
        """Blocks of whitened rows of the used pings, with the residual in the last column."""
        platform = self.unknowns.survey.platform_error
        sigma = self.posterior.sigma
        return (
            block
            for block, _ in self.linear.whitened_rows(self.used, self.correlation, platform, sigma)
        )

    def position_sd(self, values: Array) -> Array:
        """Standard deviations of the positions (n_nodes, 3) at some values. [m]"""
        by_columns = self.unknowns.position_map(values)
        variance = np.einsum("kai,ij,kaj->ka", by_columns, self.posterior.covariance, by_columns)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def transducers(self) -> tuple[Array, Array]:
        """Positions of the transducer at transmission and reception, with its lever arm. [m]"""
        return transducers(self.unknowns.survey, self.unknowns.lever(self.values))

    @property
    def positions(self) -> Array:
        """Positions of the nodes (n_nodes, 3). [m]"""
        return self.unknowns.positions(self.values)


class Solver:
    """Outer steps of one survey in one medium."""

    def __init__(self, survey: Survey, medium: Medium, options: LocateOptions) -> None:
        self.survey = survey
        self.medium = medium
        self.options = options
        self._traced: tuple[Array, Array, Legs] | None = None
        stated_sigma = survey.sigma[np.isfinite(survey.sigma)]
        self.weight = np.ones(len(survey))
        if stated_sigma.size:
            self.weight = np.where(np.isfinite(survey.sigma), survey.sigma, np.median(stated_sigma))
            self.weight = self.weight / np.median(self.weight)

    def unknowns(self, kind: Kind, position: Array, memory: float = np.inf) -> SurveyUnknowns:
        """
        Columns for a model of the sound speed.

        Gradients are relative to the middle of the positions.
        """
        options = self.options
        speed = sound_speed_terms(
            self.survey, position, kind, options.speed_prior, options.modes, memory
        )
        default: Arrangement = "free" if self.survey.rigid is None else "rigid"
        return SurveyUnknowns(self.survey, speed, options.arrangement or default)

    def first_values(
        self, unknowns: SurveyUnknowns, position: Array, before: SurveySolution | None = None
    ) -> Array:
        """Initial values: these positions, and other values from a solution with another model."""
        values = unknowns.prior_mean
        slices = unknowns.slices
        if before is not None:
            n = slices["speed"].start
            values[:n] = before.values[:n]
            fraction = before.unknowns.speed.fraction(
                before.unknowns.speed_values(before.values)[0], len(self.survey)
            )
            values[slices["speed"]] = _constant(unknowns, float(fraction[before.used].mean()))
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
        first = sigma or self._first_sigma(linear, used)
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
        self._traced = position, lever, new_legs
        return new_legs

    def _first_sigma(self, linear: Linearization, used: Mask) -> float:
        """Initial noise level from the residuals, or the stated level for few pings."""
        unknowns = linear.unknowns
        n_scaled = sum(columns.size for columns in unknowns.groups.values())
        if used.sum() >= np.count_nonzero(unknowns.prior_sd) - n_scaled + MIN_REDUNDANCY:
            return robust_sigma(linear.residual[used] / self.weight[used])
        stated_sigma = self.survey.sigma[np.isfinite(self.survey.sigma)]
        return float(np.median(stated_sigma)) if stated_sigma.size else _DEFAULT_SIGMA

    def plausible(self, linear: Linearization) -> Mask:
        """Pings with a ray whose residuals are not gross errors."""
        possible = linear.legs.possible & ~self.survey.flagged
        if not possible.any():
            return possible
        size = np.abs(linear.residual / self.weight)
        limit = max(self.options.gross * robust_sigma(size[possible]), _MIN_GROSS)
        return np.asarray(possible & (np.nan_to_num(size, nan=np.inf) <= limit))

    def start(self, unknowns: SurveyUnknowns, values: Array) -> Array:
        """Initial values that are accurate enough to identify gross errors."""
        for _ in range(_ROUNDS):
            legs = self.legs(
                unknowns.positions(values), unknowns.lever(values), unknowns.speed.modes
            )
            linear = Linearization(unknowns, values, legs, self.weight)
            possible = legs.possible & ~self.survey.flagged
            if not possible.any() or not unknowns.prior_sd.any():
                return values
            values = values + graduated_change(linear, possible)
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
            deviation = solution.position_sd(values)
            tolerance = np.maximum(_CONVERGED, _RELATIVE * deviation)
            values = values + damping * step
            hyper = solution.posterior.hyperparameters
            same = used is not None and np.array_equal(used, solution.used)
            used = solution.used
            sigma = solution.posterior.sigma
            if (np.abs(move) < tolerance).all() and same:
                return replace(solution, values=values, settled=True)
        return replace(solution, values=values)


def _constant(unknowns: SurveyUnknowns, fraction: float) -> Array:
    """Coefficients of the sound speed for a constant fraction."""
    speed = unknowns.speed
    out = np.zeros(speed.size)
    if speed.terms:
        first = speed.terms[0]
        out[0] = fraction * (1.0 if first.spline is None else first.spline.unit[0])
    return out


class Candidate(Mapping[str, Any]):
    """
    Model of sound speed and noise with its evidence, as a row of a table.

    ``others`` are posteriors with other amplitudes of the sound speed than that of `fit`.
    """

    def __init__(self, model: Model, fit: Posterior, others: tuple[Posterior, ...] = ()) -> None:
        self.model = model
        self.fit = fit
        self.others = others
        correlation = model.correlation
        white = correlation.ratio == 0.0
        self._row: dict[str, Any] = {
            "sound_speed": model.kind,
            "sound_speed_memory_s": model.memory if model.splined else np.nan,
            "correlation_ratio": correlation.ratio,
            "correlation_time_s": np.nan if white else correlation.memory,
            "correlation_shared": np.nan if white else correlation.shared,
            "abic": fit.abic + 2.0 * model.hyperparameters,
            "log_evidence": fit.log_evidence,
            "sigma_s": fit.sigma,
            "effective_parameters": fit.effective,
            **{
                f"{name.replace(' ', '_')}_smoothness": fit.hyperparameters.get(name, np.nan)
                for name in ("time", "platform gradient", "node gradient")
            },
        }

    def __getitem__(self, key: str) -> Any:
        """Value of a column."""
        return self._row[key]

    def __iter__(self) -> Any:
        """Names of the columns."""
        return iter(self._row)

    def __len__(self) -> int:
        """Number of columns."""
        return len(self._row)

    @property
    def abic(self) -> float:
        """ABIC including the hyperparameters that were searched on a grid."""
        return float(self._row["abic"])


def choose(solver: Solver, base: SurveySolution) -> tuple[Candidate, list[Candidate]]:
    """Allowed candidate with the lowest ABIC, and all compared candidates."""
    allowed = solver.options.kinds
    comparison = _Comparison(solver, base)
    plain_kinds = [kind for kind in KINDS if kind != "modes"]
    for kind in KINDS if "modes" in allowed else plain_kinds:
        comparison.add(Model(kind))
    if "time" in allowed:
        for model in comparison.memories(Model("time")):
            comparison.add(model)
    # search the grid about the best, one parameter after the other
    searches = [comparison.memories]
    if solver.options.correlation == "auto" and int(base.used.sum()) >= _MIN_FOR_CORRELATION:
        searches = [_times, _ratios, comparison.memories, _shares, _times, _ratios]
    for search in searches:
        for model in search(comparison.best.model):
            comparison.add(model)
    # correlated noise or a memory may make another kind the best
    best = comparison.best.model
    if best.kind != "modes" and best != Model(best.kind):
        for kind in plain_kinds:
            memory = best.memory if kind in ("time", "gradient") else np.inf
            comparison.add(best._replace(kind=kind, memory=memory))
        for model in comparison.memories(comparison.best.model):
            comparison.add(model)
    comparison.vary_amplitudes()
    return comparison.best, comparison.candidates


def _times(now: Model) -> list[Model]:
    ratio = now.correlation.ratio or 1.0
    return _correlated(now, [{"ratio": ratio, "memory": time} for time in _CORRELATION_TIMES])


def _ratios(now: Model) -> list[Model]:
    if now.correlation.ratio == 0.0:  # white noise has the highest evidence
        return []
    return _correlated(now, [{"ratio": ratio} for ratio in _RATIOS])


def _shares(now: Model) -> list[Model]:
    if now.correlation.ratio == 0.0:
        return []
    return _correlated(now, [{"shared": share} for share in _SHARES])


def _correlated(now: Model, changes: list[dict[str, float]]) -> list[Model]:
    return [now._replace(correlation=replace(now.correlation, **change)) for change in changes]


class _Comparison:
    """Candidates and their evidence at one linearization."""

    def __init__(self, solver: Solver, base: SurveySolution) -> None:
        self._solver = solver
        self._base = base
        self._tables: dict[tuple[Kind, float], _Evidence] = {}
        self._candidates: dict[Model, Candidate] = {}

    @property
    def candidates(self) -> list[Candidate]:
        """All candidates, in the order of their comparison."""
        return list(self._candidates.values())

    @property
    def best(self) -> Candidate:
        """Allowed candidate with the lowest ABIC."""
        allowed = self._solver.options.kinds
        choice = [candidate for candidate in self.candidates if candidate.model.kind in allowed]
        return min(choice, key=lambda candidate: candidate.abic)

    def memories(self, now: Model) -> list[Model]:
        """Models with other memories of the sound speed."""
        if not now.splined:
            return []
        time = self._solver.survey.time
        span = max(float(time[-1] - time[0]), 1.0)
        return [now._replace(memory=fraction * span) for fraction in _MEMORIES]

    def vary_amplitudes(self) -> None:
        """Add posteriors with other amplitudes of the sound speed to probable candidates."""
        limit = self.best.abic + _MAX_DIFFERENCE
        for model, candidate in self._candidates.items():
            if model.splined and candidate.abic <= limit:
                table = self._table(model)
                others = tuple(table.fit(model, candidate.fit, factor) for factor in _AMPLITUDES)
                self._candidates[model] = Candidate(model, candidate.fit, others)

    def add(self, model: Model) -> None:
        """Compare a model."""
        if model not in self._candidates:
            self._candidates[model] = Candidate(model, self._table(model).fit(model))

    def _table(self, model: Model) -> "_Evidence":
        # simpler models use a part of the columns of a richer one
        rich: Kind = model.kind if model.kind in ("gradient", "modes") else "time"
        key = (rich, model.memory)
        if key not in self._tables:
            self._tables[key] = _Evidence(self._solver, self._base, *key)
        return self._tables[key]


class _Evidence:
    """
    Evidence of models at one linearization.

    Simpler models use a part of the columns of the richest model.
    """

    def __init__(self, solver: Solver, base: SurveySolution, rich: Kind, memory: float) -> None:
        self._solver = solver
        self._base = base
        self._unknowns = solver.unknowns(rich, base.positions, memory)
        self._values = solver.first_values(self._unknowns, base.positions, base)
        legs = base.legs
        if self._unknowns.speed.modes is not None:
            lever = base.unknowns.lever(base.values)
            legs = solver.legs(base.positions, lever, self._unknowns.speed.modes)
        self._linear = Linearization(self._unknowns, self._values, legs, solver.weight)
        self._products: dict[Correlation, Products] = {}

    def fit(
        self, model: Model, selected: Posterior | None = None, factor: float = 1.0
    ) -> Posterior:
        """Posterior and evidence of a model, or with a factor of the selected smoothness."""
        correlation = model.correlation
        sigma = self._base.posterior.sigma
        if correlation not in self._products:
            # keep the products of white noise, which several kinds need, and the latest others
            white = {key: value for key, value in self._products.items() if key.ratio == 0.0}
            products = self._linear.products(
                self._base.used, correlation, self._solver.survey.platform_error, sigma
            )
            self._products = {correlation: products} | white
        products = self._products[correlation]
        without = self._fixed_columns(model.kind)
        if selected is None:
            first = sigma / np.sqrt(correlation.variance)
            return posterior(
                products, self._unknowns, self._values, {}, sigma=first, without=without
            )
        hyper = {name: factor * value for name, value in selected.hyperparameters.items()}
        return posterior(
            products,
            self._unknowns,
            self._values,
            hyper,
            sigma=selected.sigma,
            without=without,
            steps=1,
        )

    def _fixed_columns(self, kind: Kind) -> NDArray[np.int64]:
        """Columns of the sound speed that a simpler model does not use."""
        speed_columns = self._unknowns.slices["speed"]
        speed = self._unknowns.speed
        if kind in (speed.kind, "modes"):
            return np.empty(0, dtype=np.int64)
        n_columns = {"known": 0, "scale": 1}
        return np.arange(speed_columns.start + n_columns[kind], speed_columns.stop)


def solve(
    survey: Survey,
    medium: Medium,
    options: LocateOptions,
    start: Mapping[int, Array] | None = None,
) -> tuple[SurveySolution, list[Candidate], Solver]:
    """
    Solve a survey sorted by time; return the solution, the candidate models and the solver.

    ``start`` has positions by node that replace those from straight ranges.
    """
    # matrices are small: threads would wait for each other
    with threadpool_limits(limits=1, user_api="blas"):
        return _solve(survey, medium, options, start or {})


def _solve(
    survey: Survey, medium: Medium, options: LocateOptions, starts: Mapping[int, Array]
) -> tuple[SurveySolution, list[Candidate], Solver]:
    solver = Solver(survey, medium, options)
    start = start_positions(survey, medium)
    for node, position in starts.items():
        start[node] = position
    simple: Kind = "known" if options.speed_model == "known" else "scale"
    unknowns = solver.unknowns(simple, start)
    values = solver.start(unknowns, solver.first_values(unknowns, start))
    base = solver.settle(unknowns, values, Correlation())
    selected, candidates = choose(solver, base)
    for _ in range(_CHOICES):
        solution = _settle(solver, base, selected)
        if np.array_equal(solution.used, base.used):
            break
        # the evidence is that of the used pings: compare the models again if these change
        base = solution
        selected, candidates = choose(solver, base)
        if selected.model == solution.model:
            break
    else:
        solution = _settle(solver, base, selected)
    return solution, candidates, solver


def _settle(solver: Solver, base: SurveySolution, selected: Candidate) -> SurveySolution:
    """Solution with the model of a candidate, from that with another model."""
    model = selected.model
    unknowns = solver.unknowns(model.kind, base.positions, model.memory)
    values = solver.first_values(unknowns, base.positions, base)
    return solver.settle(unknowns, values, model.correlation, selected.fit)


def candidate_table(
    candidates: list[Candidate], kinds: tuple[Kind, ...], solution: SurveySolution
) -> pd.DataFrame:
    """Table of candidates in order of ABIC, with use and the difference from the best."""
    ordered = sorted(candidates, key=lambda candidate: candidate.abic)
    table = pd.DataFrame([dict(candidate) for candidate in ordered])
    table.insert(0, "chosen", [candidate.model == solution.model for candidate in ordered])
    table.insert(1, "allowed", [candidate.model.kind in kinds for candidate in ordered])
    table.insert(7, "abic_difference", table["abic"] - table["abic"].min())
    return table
