"""Noise realizations, each solved under every condition and by every estimator."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import NamedTuple

from threadpoolctl import threadpool_limits

from pymantaray.estimation import (
    GraphSolver,
    Solution,
    collect_covariances,
    collect_estimates,
    fixed_epochs,
    solve_conditions,
)
from pymantaray.records import Estimates, PoseCovariances, SharedUnknowns
from pymantaray.study.estimators import EstimatorFactory
from pymantaray.study.store import Run
from pymantaray.study.true_unknowns import collect_unknowns
from pymantaray.study.workers import Workers


class Solved(NamedTuple):
    """What became of one realization."""

    solutions: dict[str, Solution]
    true_unknowns: dict[str, dict[str, float]]
    """For each solution with unknowns besides the poses: their true values by name."""


class Results(NamedTuple):
    """All realizations of a study, by condition."""

    estimates: Estimates
    covariances: PoseCovariances
    unknowns: SharedUnknowns | None


class RealizationSolver:
    """Solves realizations of a run; what they share is built once."""

    def __init__(self, run: Run) -> None:
        self._run, self._solver, self._factory = run, GraphSolver(), EstimatorFactory(run)

    def solve(self, realization: int) -> Solved:
        """Solve one realization under all conditions, then by all estimators, in the configured order.

        On one thread as workers do: the last digits of linear algebra depend on their number.
        """
        with threadpool_limits(limits=1, user_api="blas"):
            return self._solve(realization)

    def _solve(self, realization: int) -> Solved:
        config, truth, factory = self._run.config, self._run.truth, self._factory
        sections = config.estimators or ()
        solutions = solve_conditions(
            self._run.noisy_measurements(realization),
            config.study.conditions,
            (truth.position, truth.quaternion) if config.estimator.start == "truth" else None,
            estimators={section.name: factory.estimator(section, realization) for section in sections},
            solver=self._solver,
            covariance_samples=fixed_epochs(truth.time, config.estimator.covariance_interval_h * 3600.0),
        )
        joint = (s for s in sections if solutions[s.name].unknowns is not None)
        return Solved(solutions, {s.name: factory.true_unknowns(s, realization) for s in joint})


def solve_realizations(
    run: Run, workers: Workers | None, numbers: Sequence[int]
) -> Iterator[tuple[int, Solved]]:
    """Solve some realizations of a run, each with its number: by workers, who begin at once, or one by one as they are asked for."""
    if workers is None:
        solver = RealizationSolver(run)
        return ((number, solver.solve(number)) for number in numbers)
    futures = {workers.submit(number): number for number in numbers}
    return ((futures[future], future.result()) for future in as_completed(futures))


def start_solver(folder: Path) -> Callable[[int], Solved]:
    """What a worker does to solve realizations of the run in a folder."""
    return RealizationSolver(Run(folder)).solve


def collect_results(run: Run, solved: Sequence[Solved]) -> Results:
    """Put all realizations of a run into its records."""
    solutions = [one.solutions for one in solved]
    epochs = fixed_epochs(run.truth.time, run.config.estimator.covariance_interval_h * 3600.0)
    covariances = [{name: s.covariances for name, s in one.items()} for one in solutions]
    return Results(
        collect_estimates(run.measurements, solutions),
        collect_covariances(run.measurements, epochs, covariances),
        collect_unknowns(solutions, [one.true_unknowns for one in solved]),
    )
