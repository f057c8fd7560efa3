"""Who does the tasks: processes of this machine, or the workers of a Dask scheduler; and how tasks are given out to them."""

import json
import logging
import os
import re
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import CancelledError
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


class Task(Protocol):
    """Something to be done, which can be sent to a worker."""

    @property
    def kind(self) -> str:
        """What sort of task it is."""

    @property
    def key(self) -> str:
        """Its name: the hash of all that its result depends on."""

    @property
    def version(self) -> str:
        """Of the package that gave it out."""


TaskT = TypeVar("TaskT", bound=Task)
Work = Callable[[Any], str | None]
"""Does a task unless it is done, and writes what becomes of it; gives the line by which it failed, None if it did not."""


def attempt(url: str, task: TaskT, do: Callable[[Store, TaskT], None], failed_name: str | None) -> str | None:
    """Do a task whose result goes into a store; the line by which it failed, which is also left there under a name."""
    with _ALONE:
        if task.version != code_version():
            raise JobError(
                f"this worker has pymantaray {code_version()}, the task {task.version}: install the same"
            )
        store = open_store(url)
        try:
            do(store, task)
        except WriteError:
            raise
        except Exception as error:  # noqa: BLE001  a task that fails is a result
            content = failure_content(error)
            if failed_name is not None:
                store.write(failed_name, content)
            line: str = json.loads(content)["error"]
            return line
    return None


class Queue(Protocol):
    """Tasks that are still to be done."""

    left: int
    """How many."""

    def next(self) -> str | None:
        """Key of a task that can be begun; None if all that can be are."""

    def again(self, key: str) -> None:
        """Take back a task that was given out and not done."""

    def task(self, key: str) -> Task:
        """All that it takes to do a task."""

    def ended(self, key: str, line: str | None) -> None:
        """Note that a task is done, or the line by which it failed."""

    def lost(self, key: str, line: str) -> None:
        """Write down why a task failed whose worker could not."""


class SchedulerLostError(JobError):
    """The scheduler does not answer; what it had been given is not done."""


class Crew:
    """Processes of this machine, one thread each, which end with this one."""

    def __init__(self, work: Work, workers: int | None) -> None:
        count = workers or os.cpu_count() or 1
        self._workers = Workers(partial(_start, work), count)
        self._attempts: Counter[str] = Counter()
        self.window = 2 * count
        """Tasks that are given out at a time."""

    def __enter__(self) -> Self:
        """Begin."""
        self._workers.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        """End, whatever they are at."""
        self._workers.__exit__(*error)

    def submit(self, task: Task) -> Any:
        """Give a task out: its future."""
        return self._workers.submit(task)

    def lost(self, key: str, error: BaseException) -> str | None:
        """Why a task failed whose worker was lost, empty if it is to be done again; None for any other error."""
        if not isinstance(error, WorkerEndedError):
            return None
        self._attempts[key] += 1
        return "" if self._attempts[key] < _ATTEMPTS else f"{error} ({_ATTEMPTS} attempts)"

    def look(self) -> None:
        """Raise `SchedulerLostError` if nothing more will come of what was given out."""

    def reconnect(self) -> None:
        """Wait for the scheduler; raises `JobError` where it does not come back."""


def check_scheduler(client: "Client | str | None") -> None:
    """Refuse what is no address of a scheduler, before any work."""
    if isinstance(client, str) and not _ADDRESS.fullmatch(client):
        raise JobError(
            f"scheduler {client}: not an address; give tcp://HOST:PORT, as the scheduler prints it"
        )


def crew_of(work: Work, client: "Client | str | None", workers: int | None) -> Crew:
    """Workers: of a Dask client or its scheduler's address, or processes of this machine."""
    return Crew(work, workers) if client is None else _Dask(work, client)


def _start(work: Work) -> Work:
    return work


def do_all(queue: Queue, crew: Crew) -> None:
    """Give tasks out as they can be begun, until none is left; one whose worker ends is given out again."""
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
            line = _outcome(queue, crew, key, future)
            del running[future]
        except SchedulerLostError:
            for key in running.values():
                queue.again(key)
            running.clear()
            crew.reconnect()
            continue
        if line == "":
            queue.again(key)
        else:
            queue.ended(key, line)


def _submit(queue: Queue, crew: Crew, key: str, outcomes: "SimpleQueue[Any]") -> Any:
    try:
        future = crew.submit(queue.task(key))
    except SchedulerLostError:
        queue.again(key)
        raise
    future.add_done_callback(outcomes.put)
    return future


def _outcome(queue: Queue, crew: Crew, key: str, future: Any) -> str | None:
    """Line by which a task failed, empty if it is to be done again, None if it is done."""
    try:
        line: str | None = future.result()
    except Exception as error:
        why = crew.lost(key, error)
        if why is None:
            raise
        if why:
            queue.lost(key, why)
        return why
    return line


class _Dask(Crew):
    """Workers of a Dask scheduler."""

    def __init__(self, work: Work, client: "Client | str") -> None:
        try:
            import distributed
        except ImportError:
            raise JobError("a scheduler needs Dask: pip install 'pymantaray[dask]'") from None
        self._dask: Any = distributed
        self._work, self._scheduler, self.window = work, client, _DASK_WINDOW
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

    def submit(self, task: Task) -> Any:
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
        raise JobError(f"scheduler {self._address}: is gone; start it and run the same sweep again to go on")

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
