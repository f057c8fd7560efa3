"""
Pool of the workers of a Dask scheduler, which receive short tasks in batches.

A message of Dask costs several milliseconds of CPU. The pool measures tasks of each kind and sends
as many at a time as take half a second. Before it has measured a kind it sends single tasks, a
limited number of them.

If a worker ends, Dask blames all tasks that it had assigned to this worker, including those that
had not started. So a task fails only after workers ended while no other task was with the
scheduler: the pool sends blamed tasks again one at a time, after all others.
"""

import hashlib
import logging
import os
import re
import statistics
import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Sequence
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from pymantaray.errors import JobError, optional_package
from pymantaray.jobs.pool import Pool, ProcessPool, SchedulerLostError, StoreTask, TaskFunction

if TYPE_CHECKING:
    from distributed import Client

_LOG = logging.getLogger("pymantaray.jobs")
_ADDRESS = re.compile(
    r"((tcp|tls|ucx|ucxx|ws|wss)://)?(\[[0-9a-fA-F:.]+\]|[^\s/:]+):\d{1,5}|inproc://\S+"
)
_WINDOW = 4096  # tasks in the queue of the scheduler
_CONNECT_TIMEOUT = 10.0  # for the first answer of a scheduler [s]
_RECONNECT_TIMEOUT = 60.0  # for a lost scheduler [s]
_BATCH_SECONDS = 0.5  # of a batch of short tasks
_MAX_BATCH = 64  # tasks
_FIRST_TASKS = 64  # tasks of a kind with the scheduler before the kind is measured
_MEASURED = 8  # batches after which a kind is measured
_BATCHES_PER_THREAD = 2  # at least, so that all threads of the workers are busy


class _BlamedError(Exception):
    """Workers ended with this task and maybe with others; it is issued again and runs alone."""


class _Submission(NamedTuple):
    """Task and the future of its result."""

    task: StoreTask
    future: Future[Any]


def run_batch(work: TaskFunction, tasks: Sequence[StoreTask]) -> tuple[float, list[Any]]:
    """Run tasks in a worker; return the mean time of a task [s] and the results."""
    begin = time.perf_counter()
    results = [work(task) for task in tasks]
    return (time.perf_counter() - begin) / len(tasks), results


class DaskPool(Pool):
    """Pool of a Dask scheduler's workers."""

    window = _WINDOW

    def __init__(self, work: TaskFunction, client: "Client | str") -> None:
        super().__init__(lambda: work)
        with optional_package(JobError, "scheduler", "Dask", "dask"):
            import distributed
        self._dask: Any = distributed
        self._work = work
        self._scheduler = client
        self._client: Any = None
        self._threads = 0
        self._has_workers = True
        self._unsent: dict[str, list[_Submission]] = {}
        """Tasks by kind that are not sent yet."""
        self._batches: dict[Any, list[_Submission]] = {}
        """Tasks of each future of Dask."""
        self._number_sent: Counter[str] = Counter()
        """Tasks of each kind with the scheduler."""
        self._seconds: defaultdict[str, deque[float]] = defaultdict(
            lambda: deque(maxlen=2 * _MEASURED)
        )
        """Mean times of a task in the latest batches of each kind."""
        self._first_tasks = _FIRST_TASKS
        self._blamed_keys: set[str] = set()
        """Keys of tasks with which workers ended."""
        self._suspects: deque[_Submission] = deque()
        """Blamed tasks that are not sent yet."""
        self._lone_task: _Submission | None = None
        """Blamed task with the scheduler; no other task is."""
        self._lock = threading.Lock()  # results arrive in a thread of Dask

    def __enter__(self) -> Self:
        """Connect to the scheduler."""
        if isinstance(self._scheduler, str):  # replaces Dask's log of many lines by one line
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
            self._client = self._connect(_CONNECT_TIMEOUT)
        else:
            self._client = self._scheduler
        self._address = self._client.scheduler.address
        with suppress(OSError):  # `check` asks again
            self._threads = sum(self._client.nthreads().values())
        return self

    def __exit__(self, *error: object) -> None:
        """Cancel unfinished tasks, and close the client if it is the pool's own."""
        self._forget()
        if self._client is not self._scheduler:
            self._close()

    def submit(self, task: StoreTask) -> Any:
        """Issue a task, which `flush` sends; return its future."""
        submission = _Submission(task, Future())
        with self._lock:
            if task.key in self._blamed_keys:
                self._suspects.append(submission)
            else:
                self._unsent.setdefault(task.kind, []).append(submission)
        return submission.future

    def flush(self) -> None:
        """Send issued tasks, short ones in batches, and blamed ones if no other is left."""
        if self._lone_task is not None:
            return
        for kind in list(self._unsent):
            while batch := self._next_batch(kind):
                self._send(kind, batch)
        with self._lock:
            if self._batches or not self._suspects:
                return
            self._lone_task = self._suspects.popleft()
            self._number_sent[self._lone_task.task.kind] += 1
        self._send(f"{self._lone_task.task.kind}-alone", [self._lone_task])

    def _next_batch(self, kind: str) -> list[_Submission]:
        """Tasks to send together; none if the scheduler has enough tasks of this kind."""
        with self._lock:
            unsent = self._unsent[kind]
            n_sent = self._number_sent[kind]
            if len(self._seconds[kind]) < _MEASURED:  # the time of a task is not known yet
                size = 1 if n_sent < self._first_tasks else 0
            else:
                typical = statistics.median(self._seconds[kind])
                share = (n_sent + len(unsent)) // (_BATCHES_PER_THREAD * max(self._threads, 1))
                size = max(min(int(_BATCH_SECONDS / max(typical, 1e-6)), _MAX_BATCH, share), 1)
            batch = unsent[:size]
            self._unsent[kind] = unsent[size:]
            self._number_sent[kind] += len(batch)
        return batch

    def _send(self, prefix: str, batch: list[_Submission]) -> None:
        """Send tasks to the scheduler, with a prefix of the name that Dask shows."""
        tasks = [submission.task for submission in batch]
        name = tasks[0].key
        if len(tasks) > 1:
            name = hashlib.sha256("".join(task.key for task in tasks).encode()).hexdigest()
        try:
            future = self._client.submit(run_batch, self._work, tasks, key=f"{prefix}-{name}")
        except (OSError, RuntimeError, ValueError) as error:  # the client is closed
            self.check()
            raise SchedulerLostError(str(error)) from None
        with self._lock:
            self._batches[future] = batch
        future.add_done_callback(self._receive)

    def _receive(self, future: Any) -> None:
        """Pass the results of a batch to the futures of its tasks."""
        with self._lock:
            batch = self._batches.pop(future, None)
        if batch is None:  # of a lost scheduler, or after the end
            return
        error: BaseException | None = None
        results: list[Any] = []
        try:
            seconds, results = future.result()
        except BaseException as cause:  # noqa: BLE001  raised again in the main thread
            error = cause
        kind = batch[0].task.kind
        is_alone = batch[0] is self._lone_task
        with self._lock:
            self._number_sent[kind] -= len(batch)
            if is_alone:
                self._lone_task = None
            if error is None:
                self._seconds[kind].append(seconds)
            elif isinstance(error, self._dask.KilledWorker) and not is_alone:
                self._blamed_keys.update(submission.task.key for submission in batch)
                _LOG.warning(
                    "workers ended %d times during the same tasks (%d, %s); these run again alone,"
                    " after all others",
                    error.allowed_failures + 1,
                    len(batch),
                    kind,
                )
                error = _BlamedError()
        if error is not None:
            for submission in batch:
                submission.future.set_exception(error)
            return
        for submission, result in zip(batch, results, strict=True):
            submission.future.set_result(result)

    def worker_failure(self, key: str, error: BaseException) -> str | None:
        """
        Failure of a task whose worker ended.

        Empty for another attempt; None for any other error.
        """
        if isinstance(error, _BlamedError):
            return ""
        if isinstance(error, self._dask.KilledWorker):
            times = error.allowed_failures + 1
            return f"a worker ended early {times} times on {key[:8]} alone; it may be out of memory"
        if isinstance(
            error, (CancelledError, self._dask.CancelledError, self._dask.comm.CommClosedError)
        ):
            raise SchedulerLostError(str(error))
        return None

    def check(self) -> None:
        """
        Raise `SchedulerLostError` if the scheduler is lost.

        The loop calls it if no task ends for some seconds.
        """
        if self._client.status != "running":
            raise SchedulerLostError(f"scheduler {self._address}: {self._client.status}")
        threads = sum(self._client.nthreads().values())
        if not threads and self._has_workers:
            _LOG.warning("scheduler %s has no workers; waiting for workers", self._address)
        self._threads = threads
        self._has_workers = threads > 0
        # tasks are long, and workers may be many
        self._first_tasks = min(4 * self._first_tasks, _WINDOW)

    def reconnect(self) -> None:
        """Wait for the scheduler; raise `JobError` if it does not come back."""
        _LOG.warning("scheduler %s does not answer; waiting for it", self._address)
        self._forget()
        until = time.monotonic() + _RECONNECT_TIMEOUT
        while time.monotonic() < until:
            if self._client is not self._scheduler:
                self._close()
            with suppress(JobError):
                self._client = self._connect(5.0)
                _LOG.warning("scheduler %s answers again; continuing", self._address)
                return
            time.sleep(1.0)
        raise JobError(
            f"scheduler {self._address}: no answer; start it and run the same job again to resume"
        )

    def _forget(self) -> None:
        """Drop all issued tasks; Dask cancels tasks whose futures are gone."""
        with self._lock:
            self._batches.clear()
            self._unsent.clear()
            self._suspects.clear()
            self._lone_task = None
            self._number_sent.clear()

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


def check_scheduler(client: "Client | str | None") -> None:
    """Raise an error if text is not the address of a scheduler."""
    if isinstance(client, str) and not _ADDRESS.fullmatch(client):
        raise JobError(
            f"scheduler {client}: not an address; give tcp://HOST:PORT, as printed by the scheduler"
        )


def open_pool(work: TaskFunction, client: "Client | str | None", workers: int | None) -> Pool:
    """
    Pool of a Dask client or address, or of processes of this machine, by default one per core.
    """
    if client is None:
        return ProcessPool(partial(_start, work), workers or os.cpu_count() or 1)
    return DaskPool(work, client)


def _start(work: TaskFunction) -> TaskFunction:
    return work
