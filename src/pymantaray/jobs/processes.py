"""
Tasks in parallel: fresh processes, one thread each.

Tasks go to a process through its standard input, results come back through its standard output. A process
never imports the script that started it, so that this works from anywhere: a script, a notebook, standard
input, a daemonic process. It ends when its standard input does, which is when the process that started it
ends, however that comes about. (loky's outlive a parent that is killed, and one that is interrupted waits
for them.)
"""

import logging
import os
import pickle
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from queue import SimpleQueue
from typing import Any, BinaryIO, ClassVar, NoReturn, Self

from pymantaray.errors import JobError
from pymantaray.installation import peak_memory_mib

# read by the numerical libraries when a process starts; more threads than cores only slow it down
_ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)
_SERVE = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer);"
    " from pymantaray.jobs.processes import serve; serve()"
)


class WorkerEndedError(JobError):
    """A worker process ended before its task did."""


class Workers:
    """
    Processes that work at what is submitted, each by what ``start`` makes there.

    They are started with the block, import what ``start`` needs, and end with it; one that ends before is replaced.
    """

    largest_mib: ClassVar[float] = 0.0
    """Largest resident memory so far of any process of any `Workers` that this process has started. [MiB]"""
    _counting = threading.Lock()

    def __init__(self, start: Callable[[], Callable[[Any], Any]], count: int) -> None:
        self._start, self._count = start, count
        self._processes: list[subprocess.Popen[bytes]] = []
        self._idle: SimpleQueue[subprocess.Popen[bytes]] = SimpleQueue()
        self._pool, self._lock, self._over = ThreadPoolExecutor(count), threading.Lock(), False
        self.peak_memory_mib = 0.0
        """Largest resident memory of any of them so far."""

    def __enter__(self) -> Self:
        """Start the processes."""
        try:
            for _ in range(self._count):
                self._idle.put(self._begin())
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop them, whatever they are at."""
        self._end()

    def submit(self, message: object) -> Future[Any]:
        """Have the next idle process work at a message."""
        return self._pool.submit(self._ask, message)

    def _ask(self, message: object) -> Any:
        process = self._idle.get()
        try:
            result, memory = _answer(process, message)
            with self._lock:
                self.peak_memory_mib = max(self.peak_memory_mib, memory)
            with Workers._counting:
                Workers.largest_mib = max(Workers.largest_mib, memory)
            if isinstance(result, Exception):
                raise result
            return result
        finally:
            with self._lock:
                if process.poll() is not None and not self._over:
                    self._processes.remove(process)
                    process.communicate()
                    process = self._begin()
            self._idle.put(process)

    def _begin(self) -> "subprocess.Popen[bytes]":
        process = _start_process()
        self._processes.append(process)
        _tell(process, sys.path)
        _tell(process, pickle.dumps(self._start))
        return process

    def _end(self) -> None:
        with self._lock:
            self._over = True
            for process in self._processes:
                process.kill()  # one that is idle holds nothing
        self._pool.shutdown(cancel_futures=True)
        for process in self._processes:
            process.communicate()


def _start_process() -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _SERVE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | dict.fromkeys(_ONE_THREAD, "1"),
        process_group=0,  # Ctrl-C is left to this process
    )


def _tell(process: "subprocess.Popen[bytes]", message: object) -> None:
    assert process.stdin is not None  # for the type checker
    try:
        pickle.dump(message, process.stdin)
        process.stdin.flush()
    except BrokenPipeError:
        pass  # it ended; reading its answer tells how


def _answer(process: "subprocess.Popen[bytes]", message: object) -> tuple[object, float]:
    """What a process makes of a message, or the error that it raises, and its peak memory. [MiB]"""
    assert process.stdout is not None  # for the type checker
    _tell(process, message)
    try:
        answer: tuple[object, float] = pickle.load(process.stdout)
    except (EOFError, pickle.UnpicklingError):
        code = process.wait()
        how = f"by {signal.Signals(-code).name}, perhaps out of memory" if code < 0 else f"with code {code}"
        raise WorkerEndedError(f"a worker process ended early, {how}; try fewer workers") from None
    return answer


def serve() -> NoReturn:
    """Work as a process of `Workers`."""
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed here must not get among the results
    logging.getLogger("pymantaray").setLevel(logging.ERROR)  # who asked has warned already
    requests, messages = sys.stdin.buffer, SimpleQueue[object]()
    content: bytes = pickle.load(requests)
    start: Callable[[], Callable[[object], object]]
    try:
        start = pickle.loads(content)
    except Exception as error:  # noqa: BLE001  what cannot be imported is told where the first task was issued
        start = partial(_refuse, error)

    def listen() -> None:
        try:
            while True:
                messages.put(pickle.load(requests))
        finally:
            os._exit(0)  # whoever asked has ended; what is being worked at is for nobody

    threading.Thread(target=listen, daemon=True).start()
    try:
        _work(start, messages, results)
    finally:  # whatever ends it: the thread that listens would wait for who waits for this
        traceback.print_exc()
        os._exit(1)


def _refuse(error: Exception) -> NoReturn:
    raise error


def _work(
    start: Callable[[], Callable[[object], object]], messages: SimpleQueue[object], results: BinaryIO
) -> NoReturn:
    task = None
    while True:
        message = messages.get()
        try:
            task = task or start()
            result = pickle.dumps((task(message), peak_memory_mib()))
        except Exception as error:  # noqa: BLE001  raised again where it was asked for
            error.add_note(traceback.format_exc())
            result = pickle.dumps((error, peak_memory_mib()))
        results.write(result)
        results.flush()
