"""
Search of a plan: all combinations of listed values, and differential evolution over continuous
ranges.
"""

import json
import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.plan.definition import DeploymentPlan, Design, FreeLine, FreeRange
from pymantaray.apps.plan.evaluate import DesignTask, KeyedPlan, Scores, evaluate_task
from pymantaray.apps.plan.results import PlanResults, loss_of
from pymantaray.errors import PlanError
from pymantaray.jobs.dask_pool import check_scheduler, open_pool
from pymantaray.jobs.pool import Pool, Queue, run_tasks
from pymantaray.jobs.progress import TaskProgress

if TYPE_CHECKING:
    from pymantaray.jobs.pool import Client

_DESIGNS_PER_WORKER = 4  # a fresh process takes as long to start as a few designs
_POPULATION = 10  # designs of a generation, at least
_STEPS = 1000  # values of a range are rounded to a power of ten below this share of it


def search_designs(
    plan: DeploymentPlan,
    *,
    client: "Client | str | None" = None,
    workers: int | None = None,
    progress: TaskProgress | None = None,
) -> PlanResults:
    """
    Evaluate the designs of a plan and find the best ones.

    Parameters
    ----------
    plan : DeploymentPlan
        From `load_plan`.
    client : distributed.Client or str, optional
        Dask client or scheduler address. Default: processes of this machine. Files of the study
        must have the same names for all workers.
    workers : int, optional
        Processes of this machine. Default: one per core, at most one for every four designs. The
        results do not depend on it.
    progress : callable, optional
        Called with the number of evaluated designs, the number of failed ones and the largest
        number to evaluate.

    Returns
    -------
    PlanResults
        Designs that fail have a status with the reason.

    Raises
    ------
    PlanError
        If all designs fail; the message has the reason of the first.
    JobError
        If the scheduler does not answer, or a worker has another version of the package.

    Notes
    -----
    Listed values are evaluated exhaustively. For each combination of them, differential evolution
    (SciPy, with the seed of the study) minimizes each objective over the continuous ranges. All
    designs that it evaluates are in the results.

    Examples
    --------
    Continues the example of `pymantaray.apps.plan`:

    >>> from pymantaray.apps.plan import search_designs
    >>> results = search_designs(plan, workers=1)
    >>> results.best, results.frame["lost_percent"].round(1).tolist()
    (0, [13.6, 45.5])
    """
    most = plan.size * (
        plan.section.evaluations * len(plan.section.objectives) if plan.ranges else 1
    )
    check_scheduler(client)
    if workers is None:
        workers = min(os.cpu_count() or 1, max(most // _DESIGNS_PER_WORKER, 1))
    alone = client is None and workers == 1
    with (
        Pool(lambda: evaluate_task) if alone else open_pool(evaluate_task, client, workers) as pool
    ):
        evaluations = _Evaluations(plan, pool, progress, most + 1)
        evaluations.scores([{}])
        if plan.ranges:
            for number in range(plan.size):
                _optimize(plan, plan.lists_at(number), evaluations)
        else:
            evaluations.scores([plan.lists_at(number) for number in range(plan.size)])
    base, *rest = evaluations.all
    failures = [next((one.failure for one in scores if one.failure), "") for _, scores in rest]
    if all(failures):
        raise PlanError(f"{plan.source}: all designs fail; the first one: {failures[0]}")
    return PlanResults(
        plan, [design for design, _ in rest], [scores for _, scores in rest], base[1]
    )


class _Evaluations:
    """Evaluated designs in the order of the search; each design is evaluated once."""

    def __init__(
        self, plan: DeploymentPlan, pool: Pool, progress: TaskProgress | None, most: int
    ) -> None:
        self._task = partial(DesignTask, KeyedPlan(plan.fingerprint, plan))
        self._pool = pool
        self._progress = progress
        self._most = most
        self._by_key: dict[str, tuple[Design, list[Scores]]] = {}

    @property
    def all(self) -> list[tuple[Design, list[Scores]]]:
        """Designs and their scores."""
        return list(self._by_key.values())

    def scores(self, designs: Sequence[Design]) -> list[list[Scores]]:
        """Scores of designs, each in all oceans."""
        keys = [json.dumps(design, sort_keys=True, default=str) for design in designs]
        new = {
            key: design
            for key, design in zip(keys, designs, strict=True)
            if key not in self._by_key
        }
        queue = _DesignQueue({key: self._task(design) for key, design in new.items()}, self._report)
        run_tasks(queue, self._pool)
        self._by_key |= {key: (design, queue.results[key]) for key, design in new.items()}
        return [self._by_key[key][1] for key in keys]

    def _report(self, results: dict[str, list[Scores]]) -> None:
        if self._progress is not None:
            every = [*results.values(), *(scores for _, scores in self._by_key.values())]
            failed = sum(any(one.failure for one in scores) for scores in every)
            self._progress(len(every) - failed, failed, max(self._most, len(every)))


class _DesignQueue(Queue):
    """Designs to evaluate."""

    def __init__(
        self, tasks: dict[str, DesignTask], report: Callable[[dict[str, list[Scores]]], None]
    ) -> None:
        super().__init__(tasks)
        self._tasks = tasks
        self._report = report
        self.results: dict[str, list[Scores]] = {}

    def task(self, key: str) -> Any:
        """Return the task of a design."""
        return self._tasks[key]

    def record_result(self, key: str, result: list[Scores]) -> None:
        """Record the scores of a design."""
        self.left -= 1
        self.results[key] = result
        self._report(self.results)

    def record_failure(self, key: str, line: str) -> None:
        """Raise the reason why a worker ended."""
        raise PlanError(f"design {key}: {line}")


def _optimize(plan: DeploymentPlan, listed: Design, evaluations: _Evaluations) -> None:
    """
    Minimize each objective over the ranges, at one combination of listed values.

    The search begins with a Latin hypercube and with the lower and the upper limits of all ranges,
    where a monotonic objective is best.
    """
    from scipy.optimize import differential_evolution
    from scipy.stats.qmc import LatinHypercube, scale

    count = len(plan.ranges)
    population = max(1, min(max(_POPULATION, 5 * count), plan.section.evaluations // 2) // count)
    size = max(5, population * count)
    generations = plan.section.evaluations // size - 1

    def losses(
        objective: str, points: NDArray[np.float64]
    ) -> Any:  # SciPy's types lack vectorized functions
        columns = [points] if points.ndim == 1 else points.T
        designs = [{**listed, **_rounded(plan.ranges, point)} for point in columns]
        ranked_by = plan.section.ranked_by
        values = [loss_of(objective, scores, ranked_by) for scores in evaluations.scores(designs)]
        return np.asarray(np.nan_to_num(np.array(values), nan=np.inf))

    bounds: Any = [(limits.low, limits.high) for limits in plan.ranges.values()]
    first = LatinHypercube(count, seed=np.random.default_rng(plan.base.study.seed)).random(size)
    first[0] = 0.0
    first[1] = 1.0
    first = scale(first, *zip(*bounds, strict=True))
    for objective in plan.section.objectives:
        differential_evolution(
            partial(losses, objective),
            bounds,
            maxiter=max(generations, 1),
            init=first,
            rng=np.random.default_rng(plan.base.study.seed),
            polish=False,
            updating="deferred",
            vectorized=True,
        )


def _rounded(ranges: dict[str, FreeRange | FreeLine], point: Any) -> dict[str, float]:
    """Values by key, rounded to a thousandth of their range or finer."""
    out: dict[str, float] = {}
    for (key, limits), x in zip(ranges.items(), point, strict=True):
        digits = -int(np.floor(np.log10((limits.high - limits.low) / _STEPS)))
        out |= limits.at(key, min(max(round(float(x), digits), limits.low), limits.high))
    return out
