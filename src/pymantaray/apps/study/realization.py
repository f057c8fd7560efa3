"""Realizations of noise, each solved under every condition by every estimator."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from pymantaray.apps.study.store import Run
from pymantaray.apps.study.true_unknowns import collect_unknowns, true_unknowns
from pymantaray.config.build.estimators import EstimatorFactory
from pymantaray.errors import JobError, RecordError
from pymantaray.estimation import (
    GraphSolution,
    GraphSolver,
    UnknownsEstimate,
    collect_covariances,
    collect_estimates,
    fixed_epochs,
    solve_conditions,
)
from pymantaray.estimation.solvers.covariance import EpochCovariances
from pymantaray.jobs.pool import Queue
from pymantaray.records import Estimates, PoseCovariances, SharedUnknowns, SolveStatus
from pymantaray.records.writing import netcdf_content, netcdf_groups


class RealizationResult(NamedTuple):
    """Solutions of one realization."""

    solutions: dict[str, GraphSolution]
    true_unknowns: dict[str, dict[str, float]]
    """True values by name for each solution with unknowns other than poses."""

    def to_bytes(self) -> bytes:
        """Content of a NetCDF file with one group per solution; numbers have all digits."""
        groups = {"about": xr.Dataset(attrs={"conditions": json.dumps(list(self.solutions))})}
        for k, (name, solution) in enumerate(self.solutions.items()):
            arrays: dict[str, Any] = {}
            numbers: dict[str, Any] = {"true_unknowns": self.true_unknowns.get(name)}
            _take_apart(solution, "", arrays, numbers)
            variables = {n: ([f"{n}_{i}" for i in range(a.ndim)], a) for n, a in arrays.items()}
            groups[f"solution_{k}"] = xr.Dataset(variables, attrs={"numbers": json.dumps(numbers)})
        return netcdf_content(groups)

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """
        Result from the content that `to_bytes` returned; raises `RecordError` if it is damaged.
        """
        groups = netcdf_groups(content)
        solutions = {}
        truths = {}
        try:
            for k, name in enumerate(json.loads(groups["about"].attrs["conditions"])):
                group = groups[f"solution_{k}"]
                numbers = json.loads(group.attrs["numbers"])
                values = {str(n): v.values for n, v in group.variables.items()} | numbers
                covariances, unknowns = (
                    _section(values, f"{n}_") for n in ("covariances", "unknowns")
                )
                values["status"] = SolveStatus(values["status"])
                values["covariances"] = EpochCovariances(**covariances) if covariances else None
                values["unknowns"] = UnknownsEstimate(**unknowns) if unknowns else None
                solutions[name] = GraphSolution(
                    **{field.name: values[field.name] for field in fields(GraphSolution)}
                )
                if numbers["true_unknowns"] is not None:
                    truths[name] = numbers["true_unknowns"]
        except (KeyError, TypeError, ValueError) as error:
            raise RecordError(f"not a solved realization: {type(error).__name__} {error}") from None
        return cls(solutions, truths)


def _take_apart(value: Any, name: str, arrays: dict[str, Any], numbers: dict[str, Any]) -> None:
    """
    Sort the fields of a solution into arrays and JSON values; fields of a nested part are prefixed
    with its name.
    """
    if isinstance(value, np.ndarray):
        arrays[name] = value
    elif is_dataclass(value) or hasattr(value, "_fields"):
        for field in (
            value._fields if hasattr(value, "_fields") else [f.name for f in fields(value)]
        ):
            _take_apart(getattr(value, field), f"{name}_{field}".lstrip("_"), arrays, numbers)
    else:
        numbers[name] = value.item() if isinstance(value, np.generic) else value


def _section(values: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    return {
        name.removeprefix(prefix): tuple(value) if isinstance(value, list) else value
        for name, value in values.items()
        if name.startswith(prefix)
    }


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
