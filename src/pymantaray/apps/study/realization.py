"""Realizations of noise, each solved under every condition by every estimator."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple, Self

from threadpoolctl import threadpool_limits

from pymantaray.apps.study.store import Run
from pymantaray.apps.study.true_unknowns import collect_unknowns, true_unknowns
from pymantaray.config.build.estimators import EstimatorFactory
from pymantaray.errors import JobError
from pymantaray.estimation import (
    GraphSolution,
    GraphSolver,
    GraphValues,
    UnknownsEstimate,
    collect_covariances,
    collect_estimates,
    fixed_epochs,
    solve_conditions,
)
from pymantaray.estimation.solvers.covariance import EpochCovariances
from pymantaray.jobs.pool import Queue
from pymantaray.records import Estimates, PoseCovariances, SharedUnknowns, SolveStatus, nested

_PARTS = GraphSolution, EpochCovariances, UnknownsEstimate, GraphValues, SolveStatus


class RealizationResult(NamedTuple):
    """Solutions of one realization."""

    solutions: dict[str, GraphSolution]
    true_unknowns: dict[str, dict[str, float]]
    """True values by name for each solution with unknowns other than poses."""

    def to_bytes(self) -> bytes:
        """Content of a NetCDF file; numbers have all digits."""
        return nested.to_bytes(self)

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """
        Result from the content that `to_bytes` returned; raises `RecordError` if it is damaged.
        """
        result: Self = nested.from_bytes(content, cls, *_PARTS)
        return result


class StudyEstimates(NamedTuple):
    """Estimates of all realizations, by condition."""

    estimates: Estimates
    covariances: PoseCovariances
    unknowns: SharedUnknowns | None


class RealizationSolver:
    """Solves realizations of a run; parts that they share are built once."""

    def __init__(self, run: Run) -> None:
        self._run, self._solver, self._factory = run, GraphSolver(), EstimatorFactory(run)

    def solve(self, realization: int) -> RealizationResult:
        """
        Solve one realization under all conditions, in the configured order.

        It uses one thread, because the last digits of linear algebra depend on the number of
        threads.
        """
        with threadpool_limits(limits=1, user_api="blas"):
            return self._solve(realization)

    def _solve(self, realization: int) -> RealizationResult:
        study = self._run.study
        truth = self._run.truth
        factory = self._factory
        solutions = solve_conditions(
            self._run.noisy_measurements(realization),
            {c.name: factory.estimator(c.name, realization) for c in study.conditions},
            solver=self._solver,
            covariance_samples=fixed_epochs(truth.time, study.covariance_interval),
        )
        joint = (c for c in study.conditions if solutions[c.name].unknowns is not None)
        return RealizationResult(
            solutions, {c.name: true_unknowns(self._run, factory, c, realization) for c in joint}
        )


class RealizationQueue(Queue):
    """Unsolved realizations of a study; their keys are their numbers."""

    def __init__(
        self, numbers: Iterable[int], ended: Callable[[int, RealizationResult], None]
    ) -> None:
        super().__init__(map(str, numbers))
        self._ended = ended

    def task(self, key: str) -> int:
        """Number of a realization."""
        return int(key)

    def record_result(self, key: str, result: RealizationResult) -> None:
        """Record a solved realization."""
        self.left -= 1
        self._ended(int(key), result)

    def record_failure(self, key: str, line: str) -> None:
        """Raise an error with the reason why a realization could not be solved."""
        raise JobError(f"realization {key}: {line}")


def start_solver(folder: Path) -> Callable[[int], RealizationResult]:
    """Return the function with which a worker solves realizations of the run in a folder."""
    return RealizationSolver(Run(folder)).solve


def collect_results(run: Run, solved: Sequence[RealizationResult]) -> StudyEstimates:
    """Collect the solutions of all realizations of a run in its records."""
    solutions = [one.solutions for one in solved]
    epochs = fixed_epochs(run.truth.time, run.study.covariance_interval)
    covariances = [{name: s.covariances for name, s in one.items()} for one in solutions]
    return StudyEstimates(
        collect_estimates(run.measurements, solutions),
        collect_covariances(run.measurements, epochs, covariances),
        collect_unknowns(solutions, [one.true_unknowns for one in solved]),
    )
