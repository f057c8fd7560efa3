"""Pools that do tasks: processes of this machine, the workers of a Dask scheduler, or this process; and the queue that feeds them."""

import json
import logging
import os
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from pymantaray.errors import JobError, WriteError
from pymantaray.installation import code_version
from pymantaray.jobs.processes import WorkerEndedError, Workers
from pymantaray.jobs.store import Store, failure_content, open_store

if TYPE_CHECKING:
    from distributed import Client as Client  # noqa: PLC0414  a type for those who pass one on

_LOG = logging.getLogger("pymantaray.jobs")
_ATTEMPTS = 3  # at a task whose worker ends
_DASK_WINDOW = 4096  # tasks that the scheduler is given ahead
_ANSWER = 10.0  # within which a scheduler answers first [s]
_PATIENCE = 60.0  # for a scheduler that is gone to come back [s]
_ALONE = threading.Lock()  # threads of one worker take turns: the numerical libraries are not made for more
_ADDRESS = re.compile(r"((tcp|tls|ucx|ucxx|ws|wss)://)?(\[[0-9a-fA-F:.]+\]|[^\s/:]+):\d{1,5}|inproc://\S+")
_LOOK = 5.0  # between looks at whether the scheduler is there [s]


class StoreTask(Protocol):
    """A task whose result goes into a store; it can be sent to a worker."""

    @property
    def kind(self) -> str:
        """What sort of task it is."""

    @property
    def key(self) -> str:
        """Hash of everything that its result depends on."""

    @property
    def version(self) -> str:
        """Version of the code that issued it."""


TaskT = TypeVar("TaskT", bound=StoreTask)
Work = Callable[[Any], Any]
"""Do a task and return its result."""


def run_in_store(
    url: str, task: TaskT, compute: Callable[[Store, TaskT], None], failed_name: str | None
) -> str | None:
    """Run a task that writes its result into a store; return the error line of one that failed, which is also written under a name."""
    with _ALONE:
        if task.version != code_version():
            raise JobError(
                f"this worker has pymantaray {code_version()}, the task {task.version}: install the same"
            )
        store = open_store(url)
        try:
            compute(store, task)
        except WriteError:
            raise
        except Exception as error:  # noqa: BLE001  a task that fails is a result
            content = failure_content(error)
            if failed_name is not None:
                store.write(failed_name, content)
            line: str = json.loads(content)["error"]
            return line
    return None


class Queue:
    """Tasks that are still to be done, by their keys; a subclass says what each task is and what becomes of its result."""

    def __init__(self, keys: Iterable[str]) -> None:
        self._ready = [*keys][::-1]
        self.left = len(self._ready)
        """Number of tasks that have not ended."""

    def next(self) -> str | None:
        """Key of a task that can start; None if no other can start now."""
        return self._ready.pop() if self._ready else None

    def again(self, key: str) -> None:
        """Take back a task that was issued and not done."""
        self._ready.append(key)

    def task(self, key: str) -> Any:
        """Return what is sent to a worker."""
        raise NotImplementedError

    def ended(self, key: str, result: Any) -> None:
        """Record the result of a task."""
        raise NotImplementedError

    def lost(self, key: str, line: str) -> None:
        """Record why a task failed whose worker could not do so."""
        raise NotImplementedError


class SchedulerLostError(JobError):
    """The scheduler does not answer; what it had been given is not done."""


class Pool:
    """Workers in this process: each task is done when it is submitted."""

    window = 1
    """Number of tasks that are issued at a time."""
    peak_memory_mib = 0.0
    """Largest memory of any worker process."""

    def __init__(self, start: Callable[[], Work]) -> None:
        self._start = start
        self._work: Work | None = None

    def __enter__(self) -> Self:
        """Start the workers."""
        return self

    def __exit__(self, *error: object) -> None:
        """Stop the workers, busy or not."""

    def submit(self, task: Any) -> Any:
        """Issue a task; return its future."""
        self._work = self._work or self._start()
        future: Future[Any] = Future()
        try:
            future.set_result(self._work(task))
        except Exception as error:  # noqa: BLE001  raised again where the result is asked for
            future.set_exception(error)
        return future

    def lost(self, key: str, error: BaseException) -> str | None:  # noqa: ARG002
        """Return why a task failed whose worker was lost, an empty text if it is to be tried again; None for any other error."""
        return None

    def look(self) -> None:
        """Raise `SchedulerLostError` if no result of what was issued will come."""

    def reconnect(self) -> None:
        """Wait for the scheduler; raise `JobError` if it does not come back."""


class ProcessPool(Pool):
    """Processes of this machine, one thread each, which end with this one."""

    def __init__(self, start: Callable[[], Work], count: int) -> None:
        super().__init__(start)
        self._workers = Workers(start, count)
        self._attempts: Counter[str] = Counter()
        self.window = 2 * count

    @property
    def peak_memory_mib(self) -> float:  # type: ignore[override]
        """Largest memory of any worker process."""
        return self._workers.peak_memory_mib

    def __enter__(self) -> Self:
        self._workers.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._workers.__exit__(*error)

    def submit(self, task: Any) -> Any:
        """Issue a task; return its future."""
        return self._workers.submit(task)

    def lost(self, key: str, error: BaseException) -> str | None:
        """Return an empty text if a task is to be tried again whose worker ended, why it failed after the last attempt."""
        if not isinstance(error, WorkerEndedError):
            return None
        self._attempts[key] += 1
        return "" if self._attempts[key] < _ATTEMPTS else f"{error} ({_ATTEMPTS} attempts)"


def check_scheduler(client: "Client | str | None") -> None:
    """Refuse text that is not the address of a scheduler."""
    if isinstance(client, str) and not _ADDRESS.fullmatch(client):
        raise JobError(
            f"scheduler {client}: not an address; give tcp://HOST:PORT, as the scheduler prints it"
        )


def open_pool(work: Work, client: "Client | str | None", workers: int | None) -> Pool:
    """Pool of a Dask client or its scheduler's address, or of processes of this machine, one a core by default."""
    if client is None:
        return ProcessPool(partial(_start, work), workers or os.cpu_count() or 1)
    return _DaskPool(work, client)


def _start(work: Work) -> Work:
    return work


def run_tasks(queue: Queue, pool: Pool, *, meanwhile: Callable[[], None] | None = None) -> None:
    """
    Issue tasks as they can start, until none is left; a task whose worker ends is issued again.

    ``meanwhile`` is called once, after the first tasks were issued.
    """
    outcomes: SimpleQueue[Any] = SimpleQueue()
    running: dict[Any, str] = {}
    while queue.left:
        try:
            while len(running) < pool.window and (key := queue.next()) is not None:
                running[_submit(queue, pool, key, outcomes)] = key
            if meanwhile is not None:
                meanwhile()
                meanwhile = None
            try:
                future = outcomes.get(timeout=_LOOK)
            except Empty:
                pool.look()
                continue
            if future in running:  # others are of a scheduler that was lost
                _take(queue, pool, running[future], future)
                del running[future]
        except SchedulerLostError:
            for key in running.values():
                queue.again(key)
            running.clear()
            pool.reconnect()


def _submit(queue: Queue, pool: Pool, key: str, outcomes: "SimpleQueue[Any]") -> Any:
    try:
        future = pool.submit(queue.task(key))
    except SchedulerLostError:
        queue.again(key)
        raise
    future.add_done_callback(outcomes.put)
    return future


def _take(queue: Queue, pool: Pool, key: str, future: Any) -> None:
    """Give the result of a task to its queue, or the task again where its worker was lost."""
    try:
        result = future.result()
    except Exception as error:
        why = pool.lost(key, error)
        if why is None:
            raise
        if why:
            queue.lost(key, why)
        else:
            queue.again(key)
        return
    queue.ended(key, result)


class _DaskPool(Pool):
    """Workers of a Dask scheduler."""

    window = _DASK_WINDOW

    def __init__(self, work: Work, client: "Client | str") -> None:
        super().__init__(partial(_start, work))
        try:
            import distributed
        except ImportError:
            raise JobError("a scheduler needs Dask: pip install 'pymantaray[dask]'") from None
        self._dask: Any = distributed
        self._work, self._scheduler = work, client
        self._client: Any = None
        self._has_workers = True

    def __enter__(self) -> Self:
        if isinstance(self._scheduler, str):  # what it would say in many lines is said here in one
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        self._client = self._connect(_ANSWER) if isinstance(self._scheduler, str) else self._scheduler
        self._address = self._client.scheduler.address
        return self

    def __exit__(self, *error: object) -> None:
        if self._client is not self._scheduler:
            self._close()

    def submit(self, task: StoreTask) -> Any:
        try:
            return self._client.submit(self._work, task, key=f"{task.kind}-{task.key}")
        except (OSError, RuntimeError, ValueError) as error:  # a client that is closed
            self.look()
            raise SchedulerLostError(str(error)) from None

    def lost(self, key: str, error: BaseException) -> str | None:
        if isinstance(error, self._dask.KilledWorker):
            return f"a worker ended early, {error.allowed_failures + 1} times at {key[:8]}; perhaps out of memory"
        if isinstance(error, (CancelledError, self._dask.CancelledError, self._dask.comm.CommClosedError)):
            raise SchedulerLostError(str(error))
        return None

    def look(self) -> None:
        if self._client.status != "running":
            raise SchedulerLostError(f"scheduler {self._address}: {self._client.status}")
        if bool(self._client.nthreads()) != self._has_workers:
            self._has_workers = not self._has_workers
            if not self._has_workers:
                _LOG.warning("scheduler %s has no workers; waiting for some", self._address)

    def reconnect(self) -> None:
        _LOG.warning("scheduler %s is gone; waiting for it", self._address)
        until = time.monotonic() + _PATIENCE
        while time.monotonic() < until:
            if self._client is not self._scheduler:
                self._close()
            with suppress(JobError):
                self._client = self._connect(5.0)
                _LOG.warning("scheduler %s is back; going on", self._address)
                return
            time.sleep(1.0)
        raise JobError(f"scheduler {self._address}: is gone; start it and run the same job again to resume")

    def _connect(self, timeout: float) -> Any:
        address = self._scheduler if isinstance(self._scheduler, str) else self._address
        try:
            return self._dask.Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            cause = str(error).partition("\n")[0] or "no answer"
            raise JobError(f"scheduler {address}: cannot be reached: {cause}") from None

    def _close(self) -> None:
        with suppress(Exception):
            self._client.close(timeout=2.0)
