"""Running a sweep: tasks that can be begun go to workers, who write what becomes of them."""

from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from pymantaray.errors import SweepError
from pymantaray.sweep.definition import Sweep
from pymantaray.sweep.keys import POINT, STAGES
from pymantaray.sweep.plan import Plan, Queue, Told, plan_content
from pymantaray.sweep.results import SweepResults, open_sweep
from pymantaray.sweep.stages import failure_content
from pymantaray.sweep.store import (
    PLAN,
    SWEEP,
    Store,
    finished,
    open_store,
    point_name,
    stage_name,
)
from pymantaray.sweep.workers import Crew, SchedulerLostError, crew_of

if TYPE_CHECKING:
    from distributed import Client

_LOOK = 5.0  # between looks at whether the scheduler is there [s]


def run_sweep(
    sweep: Sweep,
    out: str | Path,
    *,
    client: "Client | str | None" = None,
    workers: int | None = None,
    keep_stages: bool = False,
    studies: bool = False,
    retry_failed: bool = False,
    progress: Told | None = None,
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
        Told how many points are done, how many have failed, and how many there are.

    Returns
    -------
    SweepResults
        A point that failed is one of the results.

    Raises
    ------
    SweepError
        If a point is not a study, the folder holds something else, the scheduler is gone, or workers see another folder.
    WriteError
        If the store cannot be written.
    """
    plan, store = Plan(sweep), open_store(out)
    if studies and store.folder is None:
        raise SweepError(f"{out}: studies need a folder")
    _prepare(store, plan)
    done, failed = finished(store, plan.points)
    for key in failed if retry_failed else ():
        store.remove(point_name(key, failed=True))
    failed = set() if retry_failed else failed
    told = _Told(plan, done, failed, progress)
    queue = Queue(plan, set(plan.points) - done - failed, keep_stages=keep_stages, studies=studies)
    _clear_stages(store, plan, keep=True)  # what failed in another run is tried again
    if queue.left:
        with crew_of(store.url, client, workers) as crew:
            _work(queue, crew, store, told, keep_stages=keep_stages)
        if missing := len(plan.points) - sum(map(len, finished(store, plan.points))):
            raise SweepError(
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


class _Told:
    """Counts points."""

    def __init__(self, plan: Plan, done: set[str], failed: set[str], progress: Told | None) -> None:
        self._done, self._failed = len(done), len(failed)
        self._total, self._progress = len(plan.points), progress
        self.add(0, 0)

    def add(self, done: int, failed: int) -> None:
        self._done, self._failed = self._done + done, self._failed + failed
        if self._progress is not None:
            self._progress(self._done, self._failed, self._total)


def _prepare(store: Store, plan: Plan) -> None:
    """Have the store say what sweep it is of."""
    store.claim()
    toml = plan.sweep.to_toml()
    store.write(SWEEP, toml.encode())
    store.write(PLAN, plan_content(plan, toml))


def _work(queue: Queue, crew: Crew, store: Store, told: _Told, *, keep_stages: bool) -> None:
    outcomes: SimpleQueue[Any] = SimpleQueue()
    running: dict[Any, str] = {}
    while queue.left:
        try:
            while len(running) < crew.window and (key := queue.next()) is not None:
                running[_submit(queue, crew, key, outcomes)] = key
            try:
                future = outcomes.get(timeout=_LOOK)
            except Empty:
                crew.look()
                continue
            if future not in running:  # of a scheduler that was lost
                continue
            key = running[future]
            line = _outcome(queue, crew, store, key, future)
            del running[future]
        except SchedulerLostError:
            for key in running.values():
                queue.again(key)
            running.clear()
            crew.reconnect()
            continue
        if line == "":
            queue.again(key)
            continue
        if queue.kind(key) == POINT:
            told.add(line is None, line is not None)
        for stage in queue.done(key):
            if not keep_stages:
                store.remove(stage_name(stage))


def _submit(queue: Queue, crew: Crew, key: str, outcomes: "SimpleQueue[Any]") -> Any:
    try:
        future = crew.submit(queue.task(key))
    except SchedulerLostError:
        queue.again(key)
        raise
    future.add_done_callback(outcomes.put)
    return future


def _outcome(queue: Queue, crew: Crew, store: Store, key: str, future: Any) -> str | None:
    """Line by which a task failed, empty if it is to be done again, None if it is done."""
    try:
        line: str | None = future.result()
    except Exception as error:
        why = crew.lost(key, error)
        if why is None:
            raise
        if why:
            name = point_name if queue.kind(key) == POINT else stage_name
            store.write(name(key, failed=True), failure_content(SweepError(why)))
        return why
    return line
