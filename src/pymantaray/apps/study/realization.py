"""Realizations of noise, each solved under every condition by every estimator."""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

from threadpoolctl import threadpool_limits

from pymantaray.apps.study.noise import NoiseSource
from pymantaray.arrays import Indices
from pymantaray.errors import JobError
from pymantaray.estimation import (
    Estimator,
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
from pymantaray.records import (
    Estimates,
    PoseCovariances,
    SharedUnknowns,
    SolveStatus,
    nested,
)

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run
    from pymantaray.config.door.estimators import EstimatorFactory

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


class SolverInputs(NamedTuple):
    """All that realizations are solved from, unless their estimators have range models."""

    noise: NoiseSource
    epochs: Indices
    """Samples at which covariances are computed."""
    estimators: dict[str, Estimator | None]
    """By condition; None for one that `EstimatorFactory` builds, from the run."""

    @classmethod
    def of(cls, run: "Run") -> Self:
        """Inputs of a run."""
        from pymantaray.config.door.estimators import EstimatorFactory

        factory = EstimatorFactory(run)
        return cls(
            run.noise,
            fixed_epochs(run.truth.time, run.study.covariance_interval),
            {c.name: factory.without_model(c.name) for c in run.study.conditions},
        )


class RealizationSolver:
    """Solves realizations of a run; parts that they share are built once."""

    def __init__(self, inputs: SolverInputs, run: "Callable[[], Run]") -> None:
        self._inputs, self._open, self._solver = inputs, run, GraphSolver()

    @classmethod
    def of(cls, run: "Run") -> Self:
        """Solver of a run in this process."""
        return cls(SolverInputs.of(run), lambda: run)

    def solve(self, realization: int) -> RealizationResult:
        """
        Solve one realization under all conditions, in the configured order.

        It uses one thread, because the last digits of linear algebra depend on the number of
        threads.
        """
        inputs = self._inputs
        with threadpool_limits(limits=1, user_api="blas"):
            solutions = solve_conditions(
                inputs.noise.noisy(realization),
                {
                    name: estimator or self._factory.estimator(name, realization)
                    for name, estimator in inputs.estimators.items()
                },
                solver=self._solver,
                covariance_samples=inputs.epochs,
            )
            joint = [name for name, solution in solutions.items() if solution.unknowns is not None]
            return RealizationResult(
                solutions, {name: self._true_unknowns(name, realization) for name in joint}
            )

    def _true_unknowns(self, condition: str, realization: int) -> dict[str, float]:
        from pymantaray.apps.study.true_unknowns import true_unknowns

        one = next(one for one in self._run.study.conditions if one.name == condition)
        return true_unknowns(self._run, self._factory, one, realization)

    @cached_property
    def _run(self) -> "Run":
        """Opened for estimators with range models only: it imports and reads much more."""
        return self._open()

    @cached_property
    def _factory(self) -> "EstimatorFactory":
        from pymantaray.config.door.estimators import EstimatorFactory

        return EstimatorFactory(self._run)


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


def start_solver(inputs: SolverInputs, folder: Path) -> Callable[[int], RealizationResult]:
    """Return the function with which a worker solves realizations of the run in a folder."""
    return RealizationSolver(inputs, partial(_open, folder)).solve


def _open(folder: Path) -> "Run":
    from pymantaray.apps.study.store import Run

    return Run(folder)


def collect_results(run: "Run", solved: Sequence[RealizationResult]) -> StudyEstimates:
    """Collect the solutions of all realizations of a run in its records."""
    from pymantaray.apps.study.true_unknowns import collect_unknowns

    solutions = [one.solutions for one in solved]
    epochs = fixed_epochs(run.truth.time, run.study.covariance_interval)
    covariances = [{name: s.covariances for name, s in one.items()} for one in solutions]
    return StudyEstimates(
        collect_estimates(run.measurements, solutions),
        collect_covariances(run.measurements, epochs, covariances),
        collect_unknowns(solutions, [one.true_unknowns for one in solved]),
    )
