"""
Worker processes with one thread each.

A process receives tasks through its standard input and returns results through its standard output.
It never imports the script that started it, so it works from a script, a notebook, standard input
and a daemonic process. It ends when its standard input ends, that is when its parent ends for any
reason. (Processes of loky outlive a killed parent, and an interrupted parent waits for them.)
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

from pymantaray.collection import collect_rarely
from pymantaray.errors import JobError
from pymantaray.installation import peak_memory_mib

# numerical libraries read these variables at start; more threads than cores are slower
_ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)
_SERVE = """
import pickle, sys
try:
    sys.path[:] = pickle.load(sys.stdin.buffer)
except EOFError:
    sys.exit()
from pymantaray.jobs.processes import serve
serve(sys.stdin.buffer)
"""
"""Program of a worker, which ends quietly if its parent ends first."""
_COMMAND = [sys.executable, "-P", "-c", _SERVE]


class WorkerEndedError(JobError):
    """A worker process ended before its task did."""


class Workers:
    """
    Processes that run messages through the function that ``start`` returns in each of them.

    They start and end with the block, and import the module of ``start`` at once. A process that
    ends early is replaced.

    Parameters
    ----------
    start : callable
        Function of a module, or `functools.partial` of one; `give` sets its arguments.
    count : int
        Number of processes.
    """

    largest_mib: ClassVar[float] = 0.0
    """Peak resident memory of any process of all `Workers` of this process. [MiB]"""
    _counting = threading.Lock()

    def __init__(self, start: Callable[..., Callable[[Any], Any]], count: int) -> None:
        self._start = start
        self._arguments = pickle.dumps(())
        self._count = count
        self._processes: list[subprocess.Popen[bytes]] = []
        self._idle: SimpleQueue[tuple[subprocess.Popen[bytes], bool]] = SimpleQueue()
        """With whether they have the arguments."""
        self._pool = ThreadPoolExecutor(count)
        self._lock = threading.Lock()
        self._has_ended = False
        self.peak_memory_mib = 0.0
        """Peak resident memory of any of these processes. [MiB]"""

    def __enter__(self) -> Self:
        """Start the processes."""
        try:
            for _ in range(self._count):
                self._idle.put((self._begin(), False))
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop all processes."""
        self._end()

    def give(self, *arguments: object) -> None:
        """Set the arguments of ``start`` before the first message; each process gets them once."""
        self._arguments = pickle.dumps(arguments)

    def submit(self, message: object) -> Future[Any]:
        """Send a message to the next idle process."""
        return self._pool.submit(self._ask, message)

    def call(self, message: object) -> Any:
        """
        Result of a message from the next idle process.

        It saves the change of threads if the caller only waits.
        """
        return self._ask(message)

    def _ask(self, message: object) -> Any:
        process, is_ready = self._idle.get()
        try:
            if not is_ready:
                _send(process, self._arguments)
                is_ready = True
            result, memory = _answer(process, message)
            with self._lock:
                self.peak_memory_mib = max(self.peak_memory_mib, memory)
            with Workers._counting:
                Workers.largest_mib = max(Workers.largest_mib, memory)
        except (KeyboardInterrupt, SystemExit):  # nobody would read the answer
            process.kill()
            process.wait()
            raise
        else:
            if isinstance(result, Exception):
                raise result
            return result
        finally:
            with self._lock:
                if process.poll() is not None and not self._has_ended:
                    self._processes.remove(process)
                    process.communicate()
                    process, is_ready = self._begin(), False
            self._idle.put((process, is_ready))

    def _begin(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            _COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # threadpoolctl sets the first variable when it is imported, in either process
            env={"KMP_DUPLICATE_LIB_OK": "True"} | os.environ | dict.fromkeys(_ONE_THREAD, "1"),
            process_group=0,  # only the parent receives Ctrl-C
        )
        self._processes.append(process)
        _send(process, sys.path)
        _send(process, pickle.dumps(self._start))
        return process

    def _end(self) -> None:
        with self._lock:
            self._has_ended = True
            for process in self._processes:
                process.kill()  # an idle process has no state
        self._pool.shutdown(cancel_futures=True)
        for process in self._processes:
            process.communicate()


def _send(process: subprocess.Popen[bytes], message: object) -> None:
    assert process.stdin is not None  # for the type checker
    try:
        pickle.dump(message, process.stdin)
        process.stdin.flush()
    except BrokenPipeError:
        pass  # the process ended; reading its answer gives the cause


def _answer(process: subprocess.Popen[bytes], message: object) -> tuple[object, float]:
    """Result of a message or error that the process raised, and the process's peak memory. [MiB]"""
    assert process.stdout is not None  # for the type checker
    _send(process, message)
    try:
        answer: tuple[object, float] = pickle.load(process.stdout)
    except (EOFError, pickle.UnpicklingError):
        code = process.wait()
        how = f"with code {code}"
        if code < 0:
            how = f"by {signal.Signals(-code).name}, maybe out of memory"
        raise WorkerEndedError(f"a worker process ended early, {how}; use fewer workers") from None
    return answer


def serve(requests: BinaryIO) -> NoReturn:
    """Main loop of a process of `Workers`, with its standard input."""
    collect_rarely()
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # printed text must not mix with the results
    # the parent has logged warnings already
    logging.getLogger("pymantaray").setLevel(logging.ERROR)
    messages = SimpleQueue[object]()
    content: bytes = pickle.load(requests)
    start: Callable[..., Callable[[object], object]]
    try:
        start = pickle.loads(content)
    except Exception as error:  # noqa: BLE001  raised with the first task
        start = partial(_refuse, error)

    def listen() -> None:
        try:
            while True:
                messages.put(pickle.load(requests))
        finally:
            os._exit(0)  # the parent has ended; nobody needs the current result

    threading.Thread(target=listen, daemon=True).start()
    try:
        _work(start, messages, results)
    finally:  # otherwise the listening thread and the parent would wait for each other
        traceback.print_exc()
        os._exit(1)


def _refuse(error: Exception, *_: object) -> NoReturn:
    raise error


def _work(
    start: Callable[..., Callable[[object], object]],
    messages: SimpleQueue[object],
    results: BinaryIO,
) -> NoReturn:
    task = None
    arguments: Any = messages.get()
    while True:
        message = messages.get()
        try:
            if task is None:
                task = start(*pickle.loads(arguments))
                arguments = None  # they may be large
            result = pickle.dumps((task(message), peak_memory_mib()))
        except Exception as error:  # noqa: BLE001  raised again in the parent
            error.add_note(traceback.format_exc())
            result = pickle.dumps((error, peak_memory_mib()))
        results.write(result)
        results.flush()
