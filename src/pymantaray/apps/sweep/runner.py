"""Run of a sweep: workers compute stages and points and write their results to the store."""

import logging
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.apps.sweep.definition import Sweep
from pymantaray.apps.sweep.keys import (
    PLAN,
    POINT,
    STAGES,
    SWEEP,
    SWEEP_ENTRIES,
    finished,
    point_name,
    stage_name,
)
from pymantaray.apps.sweep.plan import SweepPlan, SweepQueue, plan_content, read_plan
from pymantaray.apps.sweep.results import SweepResults, open_sweep
from pymantaray.apps.sweep.tasks import run_task
from pymantaray.errors import JobError, SweepError
from pymantaray.installation import code_version
from pymantaray.jobs.dask_pool import check_scheduler, open_pool
from pymantaray.jobs.pool import run_tasks
from pymantaray.jobs.progress import TaskCount, TaskProgress
from pymantaray.jobs.store import Store, failure_content, open_store

if TYPE_CHECKING:
    from pymantaray.jobs.pool import Client


_LOG = logging.getLogger("pymantaray.apps.sweep")


def run_sweep(
    sweep: Sweep,
    out: str | Path,
    *,
    client: "Client | str | None" = None,
    workers: int | None = None,
    keep_stages: bool = False,
    studies: bool = False,
    retry_failed: bool = False,
    progress: TaskProgress | None = None,
) -> SweepResults:
    """
    Compute the missing points of a sweep.

    Parameters
    ----------
    sweep : Sweep
    out : str or pathlib.Path
        Folder of the results, or URL of an object store: new, empty, or of an earlier sweep, whose
        finished points are skipped. With Dask, every worker must have access to it under this name.
    client : distributed.Client or str, optional
        Dask client or scheduler address. Default: processes of this machine.
    workers : int, optional
        Number of processes of this machine. Default: one per core. Results do not depend on it.
    keep_stages : bool
        If True, oceans, fleets and rays stay in the store.
    studies : bool
        If True, the run folder of each point's study is written to ``studies``.
    retry_failed : bool
        If True, failed points are computed again.
    progress : callable, optional
        Called with the number of finished points, the number of failed points and the total.

    Returns
    -------
    SweepResults
        Results, including failed points.

    Raises
    ------
    SweepError
        If a point is not a valid study.
    JobError
        If the folder has other content, the scheduler does not answer, or workers have access to
        another folder.
    WriteError
        If the store cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.sweep`:

    >>> from pymantaray.apps.sweep import run_sweep
    >>> run_sweep(Sweep(study, seeds=[1]), "seeds", workers=1).table()["status"].tolist()
    ['done', 'done', 'done']
    """
    check_scheduler(client)
    plan = SweepPlan(sweep)
    store = open_store(out)
    if studies and store.folder is None:
        raise SweepError(f"{out}: run folders of studies cannot be written to a URL; give a folder")
    # write the definition and the plan of a sweep to its store
    store.claim("sweep", SWEEP, SWEEP_ENTRIES)
    toml = plan.sweep.to_toml()
    _warn_of_other_code(store, plan)
    store.write(SWEEP, toml.encode())
    store.write(PLAN, plan_content(plan, toml))
    done, failed = finished(store, plan.points, discard=True)
    for key in failed if retry_failed else ():
        store.remove(point_name(key, failed=True))
    failed = set() if retry_failed else failed
    count = TaskCount(len(plan.points), progress, done=len(done), failed=len(failed))
    queue = _Points(
        plan, set(plan.points) - done - failed, keep_stages=keep_stages, studies=studies
    )
    queue.store = store
    queue.count_of_points = count
    _clear_stages(store, plan, keep=True)  # stages that failed in another run are computed again
    if queue.left:
        with open_pool(partial(run_task, store.url), client, workers) as pool:
            run_tasks(queue, pool)
        there = {name.partition(".")[0] for name in store.names("points")}
        if missing := len(plan.points.keys() - there):
            raise JobError(
                f"{store.url}: workers wrote {missing} points to another place; all workers must"
                " have access to this one"
            )
    _clear_stages(store, plan, keep=keep_stages)
    return open_sweep(out)


def _clear_stages(store: Store, plan: SweepPlan, *, keep: bool) -> None:
    """Remove the failures of a sweep's stages and, unless ``keep``, the stages."""
    own = {names[stage] for names in plan.keys for stage in STAGES}
    for name in store.names("stages"):
        if name.partition(".")[0] in own and not (keep and name.endswith(".nc")):
            store.remove(f"stages/{name}")


def _warn_of_other_code(store: Store, plan: SweepPlan) -> None:
    """Log a warning about points of the latest run that other code computed, which are not used."""
    latest = read_plan(store.read(PLAN))
    if latest is None or latest.version == code_version():
        return
    there = {name.partition(".")[0] for name in store.names("points")}
    if others := len(there.intersection(latest.keys) - plan.points.keys()):
        _LOG.warning(
            "%s: %d points were computed by pymantaray %s, but this is pymantaray %s; they are"
            " computed again, and the old files stay",
            store.url,
            others,
            latest.version,
            code_version(),
        )


class _Points(SweepQueue):
    """Tasks of a sweep, whose results are recorded in the store."""

    store: Store
    count_of_points: TaskCount

    def record_result(self, key: str, line: str | None) -> None:
        """Count a point, and remove stages that no other task needs."""
        if self.kind(key) == POINT:
            self.count_of_points.add(failed=line is not None)
        for stage in self.done(key):
            if not self.keeps_stages:
                self.store.remove(stage_name(stage))

    def record_failure(self, key: str, line: str) -> None:
        """Store the error line of a task whose worker ended."""
        name = point_name if self.kind(key) == POINT else stage_name
        self.store.write(name(key, failed=True), failure_content(SweepError(line)))
        self.record_result(key, line)
