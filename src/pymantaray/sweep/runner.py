"""Running a sweep: tasks that can be begun go to workers, who write what becomes of them."""

import logging
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.errors import JobError, SweepError
from pymantaray.installation import code_version
from pymantaray.jobs.pool import check_scheduler, open_pool, run_tasks
from pymantaray.jobs.progress import TaskCount, TaskProgress
from pymantaray.jobs.store import Store, failure_content, open_store
from pymantaray.sweep.definition import Sweep
from pymantaray.sweep.keys import POINT, STAGES
from pymantaray.sweep.plan import EARLIER, Plan, SweepQueue, plan_content, read_plan
from pymantaray.sweep.points import PLAN, SWEEP, SWEEP_ENTRIES, finished, point_name, stage_name
from pymantaray.sweep.results import SweepResults, open_sweep
from pymantaray.sweep.tasks import run_task

if TYPE_CHECKING:
    from pymantaray.jobs.pool import Client


_LOG = logging.getLogger("pymantaray.sweep")


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
    Do the points of a sweep that are not done yet.

    Parameters
    ----------
    sweep : Sweep
    out : str or pathlib.Path
        Folder of the results, or the URL of an object store: new, empty, or of an earlier sweep, whose points are not
        done again. With Dask every worker must see it under this name.
    client : distributed.Client or str, optional
        Dask's client, or its scheduler's address. By default processes of this machine work.
    workers : int, optional
        Processes of this machine, by default one a core. Results do not depend on it.
    keep_stages : bool
        Whether oceans, fleets and rays stay in the store.
    studies : bool
        Whether each point leaves the run folder of its study in ``studies``.
    retry_failed : bool
        Whether points that failed are done again.
    progress : callable, optional
        Called with the number of points that are done, the number that failed and the total.

    Returns
    -------
    SweepResults
        A point that failed is one of the results.

    Raises
    ------
    SweepError
        If a point is not a study.
    JobError
        If the folder holds something else, the scheduler is gone, or workers see another folder.
    WriteError
        If the store cannot be written.
    """
    check_scheduler(client)
    plan, store = Plan(sweep), open_store(out)
    if studies and store.folder is None:
        raise SweepError(f"{out}: studies need a folder")
    _prepare(store, plan)
    done, failed = finished(store, plan.points, discard=True)
    for key in failed if retry_failed else ():
        store.remove(point_name(key, failed=True))
    failed = set() if retry_failed else failed
    count = TaskCount(len(plan.points), progress, done=len(done), failed=len(failed))
    queue = _Points(plan, set(plan.points) - done - failed, keep_stages=keep_stages, studies=studies)
    queue.store, queue.count_of_points = store, count
    _clear_stages(store, plan, keep=True)  # what failed in another run is tried again
    if queue.left:
        with open_pool(partial(run_task, store.url), client, workers) as pool:
            run_tasks(queue, pool)
        there = {name.partition(".")[0] for name in store.names("points")}
        if missing := len(plan.points.keys() - there):
            raise JobError(
                f"{store.url}: {missing} points were done elsewhere; all workers must see this place"
            )
    _clear_stages(store, plan, keep=keep_stages)
    return open_sweep(out)


def _clear_stages(store: Store, plan: Plan, *, keep: bool) -> None:
    """Remove a sweep's stages and their failures; the failures alone, to keep the stages."""
    own = {names[stage] for names in plan.keys for stage in STAGES}
    for name in store.names("stages"):
        if name.partition(".")[0] in own and not (keep and name.endswith(".nc")):
            store.remove(f"stages/{name}")


def _prepare(store: Store, plan: Plan) -> None:
    """Have the store say what sweep it is of."""
    store.claim("sweep", SWEEP, SWEEP_ENTRIES)
    toml = plan.sweep.to_toml()
    _warn_of_other_code(store, plan)
    store.write(SWEEP, toml.encode())
    store.write(PLAN, plan_content(plan, toml))


def _warn_of_other_code(store: Store, plan: Plan) -> None:
    """Say which points of the latest run are not taken because other code computed them."""
    latest = read_plan(store.read(PLAN))
    if latest is None or latest.version == code_version():
        return
    there = {name.partition(".")[0] for name in store.names("points")}
    if others := len(there.intersection(latest.keys) - plan.points.keys()):
        _LOG.warning(
            "%s: %d points were computed by %s, this is pymantaray %s: they are computed again; the old files stay",
            store.url,
            others,
            latest.version if latest.version == EARLIER else f"pymantaray {latest.version}",
            code_version(),
        )


class _Points(SweepQueue):
    """Run the tasks of a sweep and record their outcomes."""

    store: Store
    count_of_points: TaskCount

    def record_result(self, key: str, line: str | None) -> None:
        """Count a point; remove stages that nobody needs any more."""
        if self.kind(key) == POINT:
            self.count_of_points.add(failed=line is not None)
        for stage in self.done(key):
            if not self.keeps_stages:
                self.store.remove(stage_name(stage))

    def record_failure(self, key: str, line: str) -> None:
        """Write down why a task failed whose worker could not."""
        name = point_name if self.kind(key) == POINT else stage_name
        self.store.write(name(key, failed=True), failure_content(SweepError(line)))
        self.record_result(key, line)
