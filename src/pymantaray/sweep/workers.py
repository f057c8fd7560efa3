"""Who does the tasks: processes of this machine, or the workers of a Dask scheduler."""

import logging
import os
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Self

from pymantaray.errors import SweepError
from pymantaray.study.workers import WorkerEndedError, Workers
from pymantaray.sweep.tasks import Task, perform

if TYPE_CHECKING:
    from distributed import Client

_LOG = logging.getLogger("pymantaray.sweep")
_ATTEMPTS = 3  # at a task whose worker ends
_DASK_WINDOW = 4096  # tasks that the scheduler is given ahead
_ANSWER = 10.0  # within which a scheduler answers first [s]
_PATIENCE = 60.0  # for a scheduler that is gone to come back [s]


class SchedulerLostError(SweepError):
    """The scheduler does not answer; what it had been given is not done."""


class Crew:
    """Processes of this machine, one thread each, which end with this one."""

    def __init__(self, url: str, workers: int | None) -> None:
        count = workers or os.cpu_count() or 1
        self._workers = Workers(partial(_start, url), count)
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
        """Wait for the scheduler; raises `SweepError` where it does not come back."""


def crew_of(url: str, client: "Client | str | None", workers: int | None) -> Crew:
    """Workers for a store: of a Dask client or its scheduler's address, or processes of this machine."""
    return Crew(url, workers) if client is None else _Dask(url, client)


def _start(url: str) -> Callable[[Task], str | None]:
    return partial(perform, url)


class _Dask(Crew):
    """Workers of a Dask scheduler."""

    def __init__(self, url: str, client: "Client | str") -> None:
        try:
            import distributed
        except ImportError:
            raise SweepError("a scheduler needs Dask: pip install 'pymantaray[dask]'") from None
        self._dask: Any = distributed
        self._url, self._scheduler, self.window = url, client, _DASK_WINDOW
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
            return self._client.submit(perform, self._url, task, key=f"{task.kind}-{task.key}")
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
            with suppress(SweepError):
                self._client = self._connect(5.0)
                _LOG.warning("scheduler %s is back; going on", self._address)
                return
            time.sleep(1.0)
        raise SweepError(
            f"scheduler {self._address}: is gone; start it and run the same sweep again to go on"
        )

    def _connect(self, timeout: float) -> Any:
        address = self._scheduler if isinstance(self._scheduler, str) else self._address
        try:
            return self._dask.Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            cause = str(error).partition("\n")[0] or "no answer"
            raise SweepError(f"scheduler {address}: cannot be reached: {cause}") from None

    def _close(self) -> None:
        with suppress(Exception):
            self._client.close(timeout=2.0)
