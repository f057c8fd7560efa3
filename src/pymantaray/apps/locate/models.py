"""Models of sound speed and noise: their evidence, the choice of one, and the average of all."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.evidence import Posterior, posterior
from pymantaray.apps.locate.linear import Linearization, Products
from pymantaray.apps.locate.noise import Correlation
from pymantaray.apps.locate.options import KINDS, Kind, LocateOptions
from pymantaray.apps.locate.solve import Model, Solver, SurveySolution
from pymantaray.apps.locate.survey import Survey
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.arrays import Array

_CHOICES = 2  # comparisons of models for other sets of used pings
# parameters of correlated noise
_NOISES = {
    "memory": (20.0, 60.0, 180.0, 600.0, 1800.0),
    "ratio": (0.3, 1.0, 3.0, 10.0),
    "shared": (0.0, 1.0),
}
# memories of the sound speed, relative to the survey's duration
_MEMORIES = (np.inf, 1.0, 0.25, 0.0625, 0.015625)
# prior of the models: relative probability of each kind, divided among its memories and amplitudes;
# the sum differs with the kinds that are allowed, so the weights of the average are normalized
_PROBABILITIES = {"known": 1.0, "scale": 0.2, "time": 0.75, "gradient": 0.05, "modes": 0.2}
_AMPLITUDES = (1e-5, 3e-5, 1e-4, 3e-4)  # rms of the drift of the sound speed, relative to it
_MIN_FOR_CORRELATION = 100  # pings; fewer cannot separate correlation from errors of the model


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    Model of sound speed and noise with its posterior.

    ``others`` are posteriors with all amplitudes of the drift of the sound speed, instead of the
    most likely one of ``fit``.
    """

    model: Model
    fit: Posterior
    others: tuple[Posterior, ...] = ()

    @property
    def abic(self) -> float:
        """ABIC including the hyperparameters that were searched on a grid."""
        return self.fit.abic + 2.0 * self.model.hyperparameters


class _System(NamedTuple):
    """Linear system of the richest model, of whose columns simpler models use a part."""

    unknowns: SurveyUnknowns
    values: Array
    linear: Linearization
    products: dict[Correlation, Products]


class _Comparison:
    """Candidates and their evidence at one linearization."""

    def __init__(self, solver: Solver, base: SurveySolution) -> None:
        self._solver = solver
        self._base = base
        self._systems: dict[tuple[Kind, float], _System] = {}
        self.candidates: dict[Model, Candidate] = {}

    @property
    def best(self) -> Candidate:
        """Allowed candidate with the lowest ABIC."""
        allowed = self._solver.options.kinds
        choice = [one for one in self.candidates.values() if one.model.kind in allowed]
        return min(choice, key=lambda candidate: candidate.abic)

    def add(self, models: Sequence[Model]) -> None:
        """Compare further models."""
        for model in models:
            if model not in self.candidates:
                fit = self._fit(model)
                sizes = _AMPLITUDES if model.splined else ()
                others = tuple(self._fit(model, fit, size) for size in sizes)
                self.candidates[model] = Candidate(model, fit, others)

    def memories(self, now: Model) -> list[Model]:
        """Models with other memories of the sound speed."""
        if not now.splined:
            return []
        time = self._solver.survey.time
        span = max(float(time[-1] - time[0]), 1.0)
        return [now._replace(memory=fraction * span) for fraction in _MEMORIES]

    def _fit(
        self, model: Model, selected: Posterior | None = None, amplitude: float = 0.0
    ) -> Posterior:
        """Posterior and evidence of a model; of a selected one with an amplitude of its drift."""
        # simpler models use a part of the columns of a richer one
        rich: Kind = model.kind if model.kind in ("gradient", "modes") else "time"
        unknowns, values, linear, known = self._system(rich, model.memory)
        without = np.empty(0, dtype=np.int64)
        if model.kind != rich:
            speed = unknowns.slices["speed"]
            used = {"known": 0, "scale": 1}.get(model.kind, speed.stop)
            without = np.arange(speed.start + used, speed.stop)
        sigma = self._base.posterior.sigma
        correlation = model.correlation
        if correlation not in known:
            # keep the products of white noise, which several kinds need, and the latest others
            white = {key: value for key, value in known.items() if key.ratio == 0.0}
            platform = self._solver.survey.platform_error
            latest = linear.products(self._base.used, correlation, platform, sigma)
            known.clear()
            known.update({correlation: latest} | white)
        if selected is None:
            first = sigma / np.sqrt(correlation.variance)
            return posterior(known[correlation], unknowns, values, {}, sigma=first, without=without)
        hyper = {**selected.hyperparameters, "time": amplitude}
        return posterior(
            known[correlation],
            unknowns,
            values,
            hyper,
            sigma=selected.sigma,
            without=without,
            steps=1,
        )

    def _system(self, rich: Kind, memory: float) -> _System:
        """Linear system of a kind of model, made once."""
        if (rich, memory) not in self._systems:
            base = self._base
            solver = self._solver
            unknowns = solver.unknowns(rich, base.positions, memory)
            values = solver.first_values(unknowns, base.positions, base)
            legs = base.legs
            if unknowns.speed.modes is not None:
                lever = base.unknowns.lever(base.values)
                legs = solver.legs(base.positions, lever, unknowns.speed.modes)
            linear = Linearization(unknowns, values, legs, solver.weight)
            self._systems[rich, memory] = _System(unknowns, values, linear, {})
        return self._systems[rich, memory]


def _noises(now: Model, name: str) -> list[Model]:
    """Models with other values of a parameter of correlated noise."""
    noise = now.correlation
    if noise.ratio == 0.0:
        if name != "memory":  # white noise has the highest evidence
            return []
        noise = replace(noise, ratio=1.0)
    values = _NOISES[name]
    return [now._replace(correlation=replace(noise, **{name: value})) for value in values]


def choose(solver: Solver, base: SurveySolution) -> tuple[Candidate, list[Candidate]]:
    """Allowed candidate with the lowest ABIC, and all compared candidates."""
    allowed = solver.options.kinds
    comparison = _Comparison(solver, base)
    plain_kinds = [kind for kind in KINDS if kind != "modes"]
    comparison.add([Model(kind) for kind in (KINDS if "modes" in allowed else plain_kinds)])
    if "time" in allowed:
        comparison.add(comparison.memories(Model("time")))
    # search the grid about the best, one parameter after the other
    parameters = ["sound speed"]
    if solver.options.correlation == "auto" and int(base.used.sum()) >= _MIN_FOR_CORRELATION:
        parameters = ["memory", "ratio", "sound speed", "shared", "memory", "ratio"]
    for name in parameters:
        now = comparison.best.model
        comparison.add(comparison.memories(now) if name == "sound speed" else _noises(now, name))
    # correlated noise or a memory may make another kind the best
    best = comparison.best.model
    if best.kind != "modes" and best != Model(best.kind):
        for kind in plain_kinds:
            memory = best.memory if kind in ("time", "gradient") else np.inf
            comparison.add([best._replace(kind=kind, memory=memory)])
        comparison.add(comparison.memories(comparison.best.model))
    return comparison.best, list(comparison.candidates.values())


# matrices are small: threads would wait for each other
@threadpool_limits.wrap(limits=1, user_api="blas")  # type: ignore[untyped-decorator]
def solve(
    survey: Survey,
    medium: Medium,
    options: LocateOptions,
    start: Mapping[int, Array] | None = None,
) -> tuple[SurveySolution, list[Candidate], Solver]:
    """
    Solve a survey sorted by time; return the solution, the candidate models and the solver.

    ``start`` has positions by node that replace the priors as initial values.
    """
    solver = Solver(survey, medium, options)
    position = np.array([node.position for node in survey.nodes])
    for node, node_position in (start or {}).items():
        position[node] = node_position
    simple: Kind = "known" if options.speed_model == "known" else "scale"
    unknowns = solver.unknowns(simple, position)
    values = solver.start(unknowns, solver.first_values(unknowns, position))
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
    rows = []
    for candidate in ordered:
        model = candidate.model
        noise = model.correlation
        smoothness = candidate.fit.hyperparameters
        rows.append(
            {
                "chosen": model == solution.model,
                "allowed": model.kind in kinds,
                "sound_speed": model.kind,
                "sound_speed_memory_s": model.memory if model.splined else np.nan,
                "correlation_ratio": noise.ratio,
                "correlation_time_s": np.nan if model.is_white else noise.memory,
                "correlation_shared": np.nan if model.is_white else noise.shared,
                "abic_difference": candidate.abic - ordered[0].abic,
                "abic": candidate.abic,
                "log_evidence": candidate.fit.log_evidence,
                "sigma_s": candidate.fit.sigma,
                "effective_parameters": candidate.fit.effective,
                "time_smoothness": smoothness.get("time", np.nan),
                "platform_gradient_smoothness": smoothness.get("platform gradient", np.nan),
                "node_gradient_smoothness": smoothness.get("node gradient", np.nan),
            }
        )
    return pd.DataFrame(rows)


class Average(NamedTuple):
    """Mean of all positions over the models, relative to the chosen one."""

    shift: Array
    """Mean minus the positions of the chosen model (n_nodes, 3). [m]"""
    spread: Array
    """Covariance that the choice of the model adds (3 n_nodes, 3 n_nodes). [m²]"""


def average_of_models(
    candidates: Sequence[Candidate], kinds: Sequence[Kind], solution: SurveySolution
) -> Average:
    """
    Average the positions over the allowed models by their evidence and a prior of the models.

    Each model has the same probability as others of its kind and with white or correlated noise,
    as has each amplitude of the drift. The covariance is that of the mixture about its mean; the
    spread is its excess over the chosen model's covariance, at least 0 in all directions.
    """
    unknowns = solution.unknowns
    n_columns = unknowns.slices["array"].stop
    by_position = unknowns.position_map(solution.values).reshape(-1, unknowns.size)[:, :n_columns]
    allowed = [candidate for candidate in candidates if candidate.model.kind in kinds]
    chosen = next(candidate for candidate in allowed if candidate.model == solution.model)
    fits = [(one.model, fit) for one in allowed for fit in one.others or (one.fit,)]
    count = Counter((model.kind, model.is_white) for model, _ in fits)
    weight = np.array(
        [
            fit.log_evidence
            - model.hyperparameters_of_noise
            + np.log(_PROBABILITIES[model.kind] / count[model.kind, model.is_white])
            for model, fit in fits
        ]
    )
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    # mean and covariance of the mixture, relative to the chosen model
    steps = np.array([fit.change[:n_columns] - chosen.fit.change[:n_columns] for _, fit in fits])
    shift = by_position @ (weight @ steps)
    excess = -by_position @ chosen.fit.covariance[:n_columns, :n_columns] @ by_position.T
    for (_, fit), probability, step in zip(fits, weight, steps, strict=True):
        difference = by_position @ step - shift
        covariance = by_position @ fit.covariance[:n_columns, :n_columns] @ by_position.T
        excess += probability * (covariance + np.outer(difference, difference))
    values, vectors = np.linalg.eigh(excess)
    spread = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return Average(shift.reshape(-1, 3), np.asarray(spread))
