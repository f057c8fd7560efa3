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
from pymantaray.apps.locate.options import KINDS, Earth, Kind, LocateOptions
from pymantaray.apps.locate.solve import WRONG_LEVER, Model, Solver, SurveySolution
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
# the sum differs with the kinds that are allowed, so the weights of the average are normalized;
# `Model.penalty` lowers that of gradients
_PROBABILITIES = {"known": 1.0, "scale": 0.35, "time": 0.6, "gradient": 0.6, "modes": 0.2}
_AMPLITUDES = (3e-5, 1e-4, 3e-4)  # rms of the drift of the sound speed, relative to it
_NOISE_STEPS = 4  # of the noise level beside a given amplitude
_LEVER_DOUBTS = (0.3, 2.0)  # m; standard deviations of a wrong lever arm
_HEADING_DOUBT = 0.05  # rad; a wrong heading turns the lever arm, if it is longer than 6 m
_LEVER_COST = 0.25  # relative growth of the variance if a small error of the lever arm counts
_LEVER_MARGIN = 2.0 * np.log(10.0)  # ABIC; a wrong lever arm of lower odds does not count
_MIN_FOR_LEVER = 50  # pings
_MIN_TURN = 0.02  # rad; on a steady heading, a lever arm is an offset of the nodes
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
        self._systems: dict[Model, _System] = {}
        self.candidates: dict[Model, Candidate] = {}
        self.doubts: tuple[float, ...] = (0.0,)

    @property
    def best(self) -> Candidate:
        """Allowed candidate with the lowest ABIC."""
        allowed = self._solver.options.kinds
        return min(
            (
                one
                for one in self.candidates.values()
                if one.model.kind in allowed and one.model.lever_doubt in self.doubts
            ),
            key=lambda candidate: candidate.abic,
        )

    def doubt_lever(self) -> bool:
        """Allow a wrong lever arm if it explains the pings better than all other models."""
        # a gradient may have taken the place of the lever arm: try all kinds
        stated = self.best.model
        allowed = self._solver.options.kinds
        doubts = lever_doubts(self._base.unknowns.survey)
        for kind in allowed:
            for doubt in doubts:
                self.add([Model(kind, lever_doubt=doubt), stated.of_kind(kind, doubt)])
        if _excess_of_lever(list(self.candidates.values()), allowed) >= 0.0:
            return False
        self.doubts = doubts
        return True

    def add(self, models: Sequence[Model]) -> None:
        """Compare further models, on all possible shapes of the Earth."""
        earths = self._solver.earths
        for model in [model._replace(earth=earth) for model in models for earth in earths]:
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
        unknowns, values, linear, known = self._system(
            model._replace(kind=rich, correlation=Correlation(), earth=self._solver.earths[0])
        )
        unknowns = replace(unknowns, earth=model.earth)
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
            steps=_NOISE_STEPS,
            is_fixed=True,
        )

    def _system(self, rich: Model) -> _System:
        """Linear system of a kind of model, made once."""
        if rich not in self._systems:
            base = self._base
            solver = self._solver
            unknowns = solver.unknowns(rich, base.positions)
            values = solver.first_values(unknowns, base.positions, base)
            legs = base.legs
            if unknowns.speed.modes is not None:
                lever = base.unknowns.lever(base.values)
                legs = solver.legs(base.positions, lever, unknowns.speed.modes)
            linear = Linearization(unknowns, values, legs, solver.weight)
            self._systems[rich] = _System(unknowns, values, linear, {})
        return self._systems[rich]


def _excess_of_lever(candidates: Sequence[Candidate], kinds: Sequence[Kind]) -> float:
    """
    ABIC of the best model with a wrong lever arm minus that of all models with the stated one.

    These contain models of the sound speed that are not allowed, so that a drift is not taken for a
    lever arm; but a known sound speed has a high evidence if the data cannot test it.
    """
    doubting = [
        one.abic for one in candidates if one.model.lever_doubt > 0.0 and one.model.kind in kinds
    ]
    others = [
        one.abic
        for one in candidates
        if one.model.lever_doubt == 0.0 and (one.model.kind != "known" or "known" in kinds)
    ]
    return min(doubting, default=np.inf) - min(others)


def lever_doubts(survey: Survey) -> tuple[float, ...]:
    """Standard deviations of small and large errors of the horizontal lever arm. [m]"""
    small, large = _LEVER_DOUBTS
    of_heading = _HEADING_DOUBT * float(np.hypot(*survey.lever.offset[:2]))
    return float(np.clip(of_heading, small, large)), large


def _lever_priors(
    candidates: Sequence[Candidate], kinds: Sequence[Kind], solution: SurveySolution
) -> dict[float, float]:
    """
    Log of the prior odds of each standard deviation of the lever arm whose models count.

    Models with a wrong lever arm count if the pings nearly ask for it. Small errors always count,
    unless the lever arm is exact or another model of the sound speed is better, with the
    probability of at most 1/2 that lets the standard deviations grow by 10 % or so. With a larger
    one, the prior would widen a survey that says nothing of the lever arm.
    """
    doubts = {one.model.lever_doubt for one in candidates} - {0.0}
    odds = {0.0: 0.0}
    if _excess_of_lever(candidates, kinds) < _LEVER_MARGIN:
        odds |= dict.fromkeys(doubts, -WRONG_LEVER - np.log(len(doubts)))
    stated = [
        one
        for one in candidates
        if one.model.lever_doubt == 0.0 and (one.model.kind != "known" or "known" in kinds)
    ]
    best = min(stated, key=lambda candidate: candidate.abic)
    survey = solution.unknowns.survey
    small = lever_doubts(survey)[0]
    doubting = best.model._replace(lever_doubt=small)
    of_small = [one for one in candidates if one.model == doubting]
    if of_small and best.model.kind in kinds and not survey.lever.exact:
        by_position = _by_position(solution)
        known, free = (_variances(by_position, one.fit) for one in (best, *of_small))
        is_unknown = known > 0.0
        growth = float(np.max(free[is_unknown] / known[is_unknown] - 1.0, initial=0.0))
        probability = _LEVER_COST / max(growth, 2.0 * _LEVER_COST)
        least = np.log(probability / (1.0 - probability))
        odds[small] = max(odds.get(small, -np.inf), least)
    return odds


def _by_position(solution: SurveySolution) -> Array:
    """Derivative of all positions by the columns of positions and array (3 n_nodes, n)."""
    unknowns = solution.unknowns
    by_columns = unknowns.position_map(solution.values).reshape(-1, unknowns.size)
    return by_columns[:, : unknowns.slices["array"].stop]


def _variances(by_position: Array, fit: Posterior) -> Array:
    """Variances of all positions (3 n_nodes,). [m²]"""
    columns = by_position.shape[1]
    spread = by_position @ fit.covariance[:columns, :columns]
    return np.asarray(np.sum(spread * by_position, axis=1))


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
    comparison = _Comparison(solver, base)
    _search(comparison, solver, base)
    if _may_have_wrong_lever(base) and comparison.doubt_lever():
        _search(comparison, solver, base)
    return comparison.best, list(comparison.candidates.values())


def _search(comparison: _Comparison, solver: Solver, base: SurveySolution) -> None:
    """Compare all kinds of models, then other memories and noises about the best one."""
    allowed = solver.options.kinds
    doubts = comparison.doubts
    plain_kinds = [kind for kind in KINDS if kind != "modes"]
    kinds = KINDS if "modes" in allowed else plain_kinds
    comparison.add([Model(kind, lever_doubt=doubt) for kind in kinds for doubt in doubts])
    if "time" in allowed:
        for doubt in doubts:
            comparison.add(comparison.memories(Model("time", lever_doubt=doubt)))
    # search the grid about the best, one parameter after the other
    parameters = ["sound speed"]
    if solver.options.correlation == "auto" and int(base.used.sum()) >= _MIN_FOR_CORRELATION:
        several = ["shared"] if len(base.unknowns.survey.nodes) > 1 else []
        parameters = ["memory", "ratio", "sound speed", *several, "memory", "ratio"]
    for name in parameters:
        now = comparison.best.model
        comparison.add(comparison.memories(now) if name == "sound speed" else _noises(now, name))
    # correlated noise or a memory may make another kind the best
    best = comparison.best.model
    simplest = Model(best.kind, earth=best.earth, lever_doubt=best.lever_doubt)
    if best.kind != "modes" and best != simplest:
        comparison.add([best.of_kind(kind, best.lever_doubt) for kind in plain_kinds])
        comparison.add(comparison.memories(comparison.best.model))


def _may_have_wrong_lever(base: SurveySolution) -> bool:
    """True if pings on several headings can test a horizontal lever arm that is known."""
    survey = base.unknowns.survey
    pings = base.used & ~survey.between_nodes
    heading = survey.transmit_attitude[pings, 0]
    is_known = not any(survey.lever.sigma[:2])
    return is_known and heading.size >= _MIN_FOR_LEVER and bool(np.ptp(heading) > _MIN_TURN)


# matrices are small: threads would wait for each other
@threadpool_limits.wrap(limits=1, user_api="blas")  # type: ignore[untyped-decorator]
def solve(
    survey: Survey,
    medium: Medium,
    options: LocateOptions,
    start: Mapping[int, Array] | None = None,
    on_sphere: Medium | None = None,
) -> tuple[SurveySolution, list[Candidate], Solver]:
    """
    Solve a survey sorted by time; return the solution, the candidate models and the solver.

    ``start`` has positions by node that replace the priors as initial values. ``on_sphere`` is the
    same water on a sphere, if the shape of the Earth is unknown.
    """
    solver = Solver(survey, medium, options, on_sphere)
    position = np.array([node.position for node in survey.nodes])
    for node, node_position in (start or {}).items():
        position[node] = node_position
    simple: Kind = "known" if options.speed_model == "known" else "scale"
    unknowns = solver.unknowns(Model(simple, earth=solver.earths[0]), position)
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
    unknowns = solver.unknowns(model, base.positions)
    values = solver.first_values(unknowns, base.positions, base)
    return solver.settle(unknowns, values, model.correlation, selected.fit)


def candidate_table(
    candidates: list[Candidate], kinds: tuple[Kind, ...], solution: SurveySolution
) -> pd.DataFrame:
    """Table of candidates in order of ABIC, with use and the difference from the best."""
    ordered = sorted(candidates, key=lambda candidate: candidate.abic)
    rows = []
    unsure = {
        "earth": len({one.model.earth for one in ordered}) > 1,
        "lever_doubt": len({one.model.lever_doubt for one in ordered}) > 1,
    }
    odds = _lever_priors(ordered, kinds, solution)
    for candidate in ordered:
        model = candidate.model
        noise = model.correlation
        smoothness = candidate.fit.hyperparameters
        rows.append(
            {
                "chosen": model == solution.model,
                "allowed": model.kind in kinds and model.lever_doubt in odds,
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
            | {name: getattr(model, name) for name, is_unsure in unsure.items() if is_unsure}
        )
    return pd.DataFrame(rows)


class Average(NamedTuple):
    """Mean of all positions over the models, relative to the chosen one."""

    shift: Array
    """Mean minus the positions of the chosen model (n_nodes, 3). [m]"""
    spread: Array
    """Covariance that the choice of the model adds (3 n_nodes, 3 n_nodes). [m²]"""
    earths: Mapping[Earth, float]
    """Probability of each possible shape of the Earth; empty if it is known."""
    deeper: float = 0.0
    """Largest change of a depth between the best models on a plane and on a sphere. [m]"""


def average_of_models(
    candidates: Sequence[Candidate], kinds: Sequence[Kind], solution: SurveySolution
) -> Average:
    """
    Average the positions over the allowed models by their evidence and a prior of the models.

    Each model has the same probability as others of its kind, of its shape of the Earth, and with
    white or correlated noise, as has each amplitude of the drift. Other smoothness is that of
    maximum evidence, for which ABIC's penalty is subtracted. The covariance is that of the
    mixture about its mean; the spread is its excess over the chosen model's covariance, at least 0
    in all directions.
    """
    by_position = _by_position(solution)
    n_columns = by_position.shape[1]
    odds = _lever_priors(candidates, kinds, solution)
    allowed = [
        one for one in candidates if one.model.kind in kinds and one.model.lever_doubt in odds
    ]
    chosen = next(candidate for candidate in allowed if candidate.model == solution.model)
    fits = [(one.model, fit) for one in allowed for fit in one.others or (one.fit,)]
    count = Counter(_group(model) for model, _ in fits)
    weight = np.array(
        [
            fit.log_evidence
            - model.penalty
            + (odds[model.lever_doubt] + WRONG_LEVER if model.lever_doubt else 0.0)
            - sum(name != "time" for name in fit.hyperparameters)
            + np.log(_PROBABILITIES[model.kind] / count[_group(model)])
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
    spread = np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
    earths, deeper = _earths(allowed, weight, by_position)
    return Average(shift.reshape(-1, 3), spread, earths, deeper)


def _earths(
    allowed: Sequence[Candidate], weight: Array, by_position: Array
) -> tuple[dict[Earth, float], float]:
    """
    Probability of each possible shape of the Earth, and the depth on the last minus on the first.

    ``weight`` is that of each candidate with each amplitude of its drift.
    """
    shapes = [one.model.earth for one in allowed for _ in one.others or (one.fit,)]
    earths: dict[Earth, float] = {}
    depths = []
    for earth in dict.fromkeys(shapes):
        if earth is None:
            return {}, 0.0
        earths[earth] = float(weight[[shape == earth for shape in shapes]].sum())
        of_earth = [candidate for candidate in allowed if candidate.model.earth == earth]
        best = min(of_earth, key=lambda candidate: candidate.abic)
        depths.append((by_position @ best.fit.change[: by_position.shape[1]])[2::3])
    change = depths[-1] - depths[0]
    return earths, float(change[np.argmax(np.abs(change))])


def _group(model: Model) -> Model:
    """Model with what has its own probability; others of the group share it."""
    return Model(
        model.kind,
        correlation=Correlation(ratio=float(not model.is_white)),
        earth=model.earth,
        lever_doubt=model.lever_doubt,
    )
