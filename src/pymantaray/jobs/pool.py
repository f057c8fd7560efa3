"""Pools of workers, the queue of tasks, and the loop that runs it."""

import json
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from pymantaray.errors import JobError, WriteError
from pymantaray.installation import PACKAGES, code_version
from pymantaray.jobs.processes import WorkerEndedError, Workers
from pymantaray.jobs.store import Store, failure_content, open_store

if TYPE_CHECKING:
    from distributed import Client as Client  # noqa: PLC0414  a type for callers

_ATTEMPTS = 3  # per task if its worker ends
# one task at a time per worker: numerical libraries are not thread-safe
_EXECUTION_LOCK = threading.Lock()
_CHECK_INTERVAL = 5.0  # between checks of the scheduler [s]
_NO_STEP = object()


class StoreTask(Protocol):
    """A picklable task whose result goes into a store."""

    @property
    def kind(self) -> str:
        """Kind of task."""

    @property
    def key(self) -> str:
        """Hash of everything that the result depends on."""

    @property
    def version(self) -> str:
        """Version of the code that issued the task."""


TaskT = TypeVar("TaskT", bound=StoreTask)
TaskFunction = Callable[[Any], Any]
"""Function that runs a task and returns its result."""


@contextmanager
def one_task(version: str) -> Iterator[None]:
    """
    Context of a task in a worker, one at a time.

    Raise `JobError` if another version of the code issued the task.
    """
    with _EXECUTION_LOCK:
        if version != code_version():
            raise JobError(
                f"this worker has pymantaray {code_version()}, but the task needs {version};"
                f" install the same versions of it, of Python and of {', '.join(PACKAGES)}"
            )
        yield


def run_in_store(
    url: str, task: TaskT, compute: Callable[[Store, TaskT], None], failed_name: str | None
) -> str | None:
    """Run a task that writes into a store; if it fails, write and return the error line."""
    with one_task(task.version):
        store = open_store(url)
        try:
            compute(store, task)
        except WriteError:
            raise
        except Exception as error:  # noqa: BLE001  a failed task is a result
            content = failure_content(error)
            if failed_name is not None:
                store.write(failed_name, content)
            line: str = json.loads(content)["error"]
            return line
    return None


class Queue:
    """Unfinished tasks by key; subclasses define the tasks and process their results."""

    def __init__(self, keys: Iterable[str]) -> None:
        self._ready = [*keys][::-1]
        self.left = len(self._ready)
        """Number of unfinished tasks."""

    def next(self) -> str | None:
        """Key of the next task that can start; None if no task can start now."""
        return self._ready.pop() if self._ready else None

    def requeue(self, key: str) -> None:
        """Return an issued task to the queue."""
        self._ready.append(key)

    def task(self, key: str) -> Any:
        """Task to send to a worker."""
        raise NotImplementedError

    def record_result(self, key: str, result: Any) -> None:
        """Record the result of a task."""
        raise NotImplementedError

    def record_failure(self, key: str, line: str) -> None:
        """Record the failure of a task whose worker ended."""
        raise NotImplementedError


class SchedulerLostError(JobError):
    """The scheduler does not answer, and its tasks are not finished."""


class Pool:
    """Pool of this process, which runs each task when it is submitted."""

    window = 1
    """Number of simultaneously issued tasks."""
    peak_memory_mib = 0.0
    """Peak memory of any worker process."""

    def __init__(self, start: Callable[..., TaskFunction]) -> None:
        self._start = start
        self._arguments: tuple[object, ...] = ()
        self._work: TaskFunction | None = None

    def __enter__(self) -> Self:
        """Start the workers."""
        return self

    def __exit__(self, *error: object) -> None:
        """Stop all workers."""

    def give(self, *arguments: object) -> None:
        """Set the arguments of the workers' start function, before the first task."""
        self._arguments = arguments

    def submit(self, task: Any) -> Any:
        """Issue a task; return its future."""
        self._work = self._work or self._start(*self._arguments)
        future: Future[Any] = Future()
        try:
            future.set_result(self._work(task))
        except Exception as error:  # noqa: BLE001  raised again with the result
            future.set_exception(error)
        return future

    def flush(self) -> None:
        """Send issued tasks that still wait in this process."""

    def worker_failure(self, key: str, error: BaseException) -> str | None:  # noqa: ARG002
        """
        Failure of a task whose worker ended.

        Empty for another attempt; None for any other error.
        """
        return None

    def check(self) -> None:
        """Raise `SchedulerLostError` if issued tasks will have no result."""

    def reconnect(self) -> None:
        """Wait for the scheduler; raise `JobError` if it does not come back."""


class ProcessPool(Pool):
    """Pool of processes of this machine with one thread each, which end with this process."""

    def __init__(self, start: Callable[..., TaskFunction], count: int) -> None:
        super().__init__(start)
        self._workers = Workers(start, count)
        self._attempts: Counter[str] = Counter()
        self.window = 2 * count

    @property
    def peak_memory_mib(self) -> float:  # type: ignore[override]
        """Peak memory of any worker process."""
        return self._workers.peak_memory_mib

    def __enter__(self) -> Self:
        self._workers.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._workers.__exit__(*error)

    def give(self, *arguments: object) -> None:
        """Set the arguments of the workers' start function, before the first task."""
        self._workers.give(*arguments)

    def submit(self, task: Any) -> Any:
        """Issue a task; return its future."""
        return self._workers.submit(task)

    def worker_failure(self, key: str, error: BaseException) -> str | None:
        """
        Failure of a task whose worker ended.

        Empty for another attempt; None for any other error.
        """
        if not isinstance(error, WorkerEndedError):
            return None
        self._attempts[key] += 1
        return "" if self._attempts[key] < _ATTEMPTS else f"{error} ({_ATTEMPTS} attempts)"


def run_tasks(queue: Queue, pool: Pool, *, meanwhile: Iterable[object] = ()) -> None:
    """
    Run all tasks of a queue in a pool; a task whose worker ends is issued again.

    ``meanwhile`` has steps of other work of this process. One is taken after the first tasks are
    issued, and then one between results until all tasks are finished.
    """
    outcomes: SimpleQueue[Any] = SimpleQueue()
    running: dict[Any, str] = {}
    steps = iter(meanwhile)
    while queue.left:
        try:
            while len(running) < pool.window and (key := queue.next()) is not None:
                running[_submit(queue, pool, key, outcomes)] = key
            pool.flush()
            is_idle = next(steps, _NO_STEP) is _NO_STEP
            for future in _finished_futures(outcomes, pool, wait=is_idle):
                if future in running:  # others belong to a lost scheduler
                    _record(queue, pool, running[future], future)
                    del running[future]
        except SchedulerLostError:
            for key in running.values():
                queue.requeue(key)
            running.clear()
            pool.reconnect()


def _finished_futures(outcomes: "SimpleQueue[Any]", pool: Pool, *, wait: bool) -> list[Any]:
    """
    Finished futures, on request after waiting for the first; none if the pool was checked
    meanwhile.
    """
    futures = []
    if wait:
        try:
            futures.append(outcomes.get(timeout=_CHECK_INTERVAL))
        except Empty:
            pool.check()
    with suppress(Empty):
        while True:
            futures.append(outcomes.get_nowait())
    return futures


def _submit(queue: Queue, pool: Pool, key: str, outcomes: "SimpleQueue[Any]") -> Any:
    try:
        future = pool.submit(queue.task(key))
    except SchedulerLostError:
        queue.requeue(key)
        raise
    future.add_done_callback(outcomes.put)
    return future


def _record(queue: Queue, pool: Pool, key: str, future: Any) -> None:
    """Record the result of a task, or requeue it if its worker ended."""
    try:
        result = future.result()
    except Exception as error:
        why = pool.worker_failure(key, error)
        if why is None:
            raise
        if why:
            queue.record_failure(key, why)
        else:
            queue.requeue(key)
        return
    queue.record_result(key, result)
