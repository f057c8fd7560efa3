"""
Evaluate one design without realizations, as a worker does: lost links, and the bound and the bias
of positions at the pings.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pymantaray.apps.plan.definition import CostSection, DeploymentPlan, Design
from pymantaray.apps.plan.waters import Missions
from pymantaray.apps.study.store import Run
from pymantaray.arrays import Array
from pymantaray.config.door.estimators import EstimatorFactory
from pymantaray.config.door.study import Study
from pymantaray.errors import MantaRayError, PlanError
from pymantaray.estimation import GraphSolver, solve_conditions
from pymantaray.evaluation import error_bound
from pymantaray.evaluation.bound import ping_samples, submerged_at
from pymantaray.geometry import stream
from pymantaray.geometry.spread import root_mean
from pymantaray.installation import code_version
from pymantaray.jobs.keys import digest
from pymantaray.jobs.pool import one_task
from pymantaray.records import Measurements
from pymantaray.records.status import ARRIVES
from pymantaray.sensing.detection import mark_unheard

_DRAWS = 200  # of each position error, for the 95 % quantile
_BIAS_DIGITS = 6  # decimals of a bias in metres; the convergence of the solver limits smaller ones
_DETECTED = 0.5  # links with a smaller probability of detection carry no information


class Scores(NamedTuple):
    """Scores of a design in one ocean; NaN if the design fails."""

    error_m: float = np.nan
    """95 % quantile of the position errors of vehicles under water at the pings."""
    rmse_m: float = np.nan
    bound_rmse_m: float = np.nan
    """Part of ``rmse_m`` that noise causes."""
    bias_rmse_m: float = np.nan
    """Part of ``rmse_m`` that the assumed water causes."""
    lost_percent: float = np.nan
    """Expected share of range attempts without a range."""
    heard_by_two_percent: float = np.nan
    """Share of pings that at least two receivers hear."""
    cost: float = np.nan
    failure: str = ""
    """Reason why the design failed."""


class Errors(NamedTuple):
    """Expected errors of positions at some times, and the vehicles that count."""

    time: Array
    """Times, shape (n,). [s]"""
    bias: Array
    """Errors that the assumed water causes, shape (n, n_vehicles, 3). [m]"""
    covariance: Array
    """Posterior bound along the true trajectories, shape (n, n_vehicles, 3, 3). [m²]"""
    counts: NDArray[np.bool_]
    """True for vehicles under water that the plan asks for, shape (n, n_vehicles)."""


class DesignEvaluator:
    """
    Evaluates designs of a plan; waters, trajectories and links of earlier designs stay in memory.
    """

    def __init__(self, plan: DeploymentPlan) -> None:
        self._plan, self._solver = plan, GraphSolver()
        self.missions = Missions(plan)
        """Missions of the designs, with the solved links."""

    def __call__(self, design: Design) -> list[Scores]:
        """Scores of a design in each water. On one thread, as all workers."""
        with threadpool_limits(limits=1, user_api="blas"):
            return [self._scores(design, *water) for water in self._plan.waters]

    def _scores(self, design: Design, ocean: int, member: int | None) -> Scores:
        plan = self._plan.section
        try:
            run, errors = self.evaluate(design, ocean, member)
        except MantaRayError as error:
            return Scores(failure=str(error).partition("\n")[0])
        bias = errors.bias[errors.counts]
        covariance = errors.covariance[errors.counts]
        noise = np.einsum("kii->k", covariance)
        shift = np.sum(bias**2, axis=-1)
        lost, heard = link_scores(run, plan.lost_of)
        return Scores(
            error_m=error_quantile(bias, covariance),
            rmse_m=root_mean(noise + shift),
            bound_rmse_m=root_mean(noise),
            bias_rmse_m=round(root_mean(shift), _BIAS_DIGITS),
            lost_percent=lost,
            heard_by_two_percent=heard,
            cost=cost_of(run.study, run.measurements, plan.costs, self._plan.condition),
            failure=""
            if errors.counts.any()
            else "no vehicle is under water at the pings or times that count",
        )

    def evaluate(self, design: Design, ocean: int, member: int | None) -> tuple[Run, Errors]:
        """
        Mission of a design in one water, and its expected errors.

        The covariance is the posterior bound along the true trajectories. The bias is the error of
        the estimate from measurements without noise: that of the assumed water alone.
        """
        plan = self._plan.section
        run, drawn = self.missions.run(design, ocean, member)
        condition = next(c for c in run.study.conditions if c.name == self._plan.condition)
        measurements = expected_measurements(run)
        if plan.error_at_h is None:
            samples = ping_samples(run.measurements)
        else:
            apart = np.abs(run.truth.time - 3600.0 * np.array(plan.error_at_h)[:, None])
            samples = np.unique(apart.argmin(axis=1))
        joint = error_bound(run.truth, measurements, condition.standard_equivalent, samples=samples)
        estimator = EstimatorFactory(run, drawn).estimator(condition.name, 0)
        solution = solve_conditions(measurements, {"bias": estimator}, solver=self._solver)["bias"]
        if not solution.status.usable:
            raise PlanError(
                f"condition {condition.name}: the estimate without noise ends with"
                f" {solution.status.name}"
            )
        bias = (solution.position - run.truth.position)[:, samples].swapaxes(0, 1)
        counts = submerged_at(run.truth, measurements, samples)
        if plan.error_of is not None:
            counts = counts & (run.truth.name == plan.error_of)
        return run, Errors(run.truth.time[samples], bias, np.einsum("eaiaj->eaij", joint), counts)


def expected_measurements(run: Run) -> Measurements:
    """Measurements without noise; links that are probably not detected are UNHEARD."""
    m = run.measurements
    if run.hearing is None:
        return m
    return mark_unheard(
        m, np.isin(m.range_status, ARRIVES) & (detection_probability(run) < _DETECTED)
    )


def error_quantile(bias: Array, covariance: Array) -> float:
    """
    Size that 95 % of position errors with these means and covariances do not exceed, over all.

    From draws with a fixed seed, so designs with equal errors have equal quantiles. NaN without
    errors.
    """
    if not len(bias):
        return np.nan
    value, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    normal = stream(0, 0, "plan", "position errors").standard_normal((_DRAWS, *bias.shape))
    errors = bias + np.einsum("kij,nkj->nki", root, normal)
    return float(np.quantile(np.linalg.norm(errors, axis=-1), 0.95))


def link_scores(run: Run, name: str | None) -> tuple[float, float]:
    """
    Expected share of lost attempts, of one participant or of all, and of pings that two or more
    receivers hear. [%]
    """
    m = run.measurements
    probability = detection_probability(run)
    use = np.ones(probability.size, dtype=bool)
    if name is not None:
        number = [*m.name.tolist(), *m.landmark_name.tolist()].index(name)
        use = (m.range_transmitter == number) | (m.range_receiver == number)
    lost = 100.0 * float(1.0 - probability[use].mean()) if use.any() else np.nan
    ping, sent = _pings(m)
    receivers = np.bincount(ping, probability >= _DETECTED, minlength=sent)
    return lost, 100.0 * float(np.mean(receivers >= 2)) if sent else np.nan


def cost_of(study: Study, m: Measurements, costs: CostSection, condition: str) -> float:
    """Cost of stations, landmarks, transmissions, and the cast that a condition assumes."""
    stations = sum(vehicle.behaviour.role == "station" for vehicle in study.fleet.vehicles)
    return (
        costs.station * stations
        + costs.landmark * len(study.ranging.landmarks)
        + costs.ping * _pings(m)[1]
        + costs.cast * sum(c.needs_cast for c in study.conditions if c.name == condition)
    )


def _pings(m: Measurements) -> tuple[NDArray[np.intp], int]:
    """Transmission of each range attempt, and the number of transmissions."""
    both = np.stack([m.range_sample, m.range_transmitter])
    distinct, ping = np.unique(both, axis=1, return_inverse=True)
    return ping.reshape(-1), distinct.shape[1]


def detection_probability(run: Run) -> Array:
    """Probability of each range attempt to give a range."""
    arrives = np.isin(run.measurements.range_status, ARRIVES)
    return np.where(arrives, 1.0 if run.hearing is None else run.hearing.probability, 0.0)


@dataclass(frozen=True)
class KeyedPlan:
    """A plan, which is the same as others with its fingerprint."""

    key: str
    plan: DeploymentPlan = field(compare=False)


@dataclass(frozen=True)
class DesignTask:
    """Design to evaluate, with all data for it."""

    plan: KeyedPlan
    design: Design
    version: str = field(default_factory=code_version)
    kind: ClassVar[str] = "design"

    @property
    def key(self) -> str:
        """Key of the design in its plan."""
        return digest(self.kind, [self.plan.key, self.design], {})


def evaluate_task(task: DesignTask) -> list[Scores]:
    """
    Scores of a design in each water; waters and links of earlier designs of the same plan are used
    again.
    """
    with one_task(task.version):
        return evaluator_of(task.plan)(task.design)


@lru_cache(maxsize=1)
def evaluator_of(plan: KeyedPlan) -> DesignEvaluator:
    """Evaluator of the latest plan of this process."""
    return DesignEvaluator(plan.plan)
