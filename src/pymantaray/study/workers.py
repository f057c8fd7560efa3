"""
Numbered tasks in parallel: fresh processes, one thread each, results in order whoever was first.

Numbers go to a process through its standard input, results come back through its standard output. A process
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
from concurrent.futures import ThreadPoolExecutor, as_completed
from queue import SimpleQueue
from typing import BinaryIO, NoReturn, TypeVar, cast

from pymantaray.errors import StudyError

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
    " from pymantaray.study.workers import serve; serve()"
)
T = TypeVar("T")


def in_processes(
    start: Callable[[], Callable[[int], T]], count: int, workers: int, done: Callable[[int], None]
) -> list[T]:
    """Do numbered tasks in fresh processes, each by what ``start`` makes there; if one raises, all are stopped."""
    processes: list[subprocess.Popen[bytes]] = []
    idle: SimpleQueue[subprocess.Popen[bytes]] = SimpleQueue()

    def ask(number: int) -> T:
        process = idle.get()
        try:
            return cast("T", _answer(process, number))
        finally:
            idle.put(process)

    pool, results = ThreadPoolExecutor(workers), dict[int, T]()
    try:
        for _ in range(workers):
            processes.append(_start_process())
            _tell(processes[-1], sys.path)
            _tell(processes[-1], start)
            idle.put(processes[-1])
        futures = {pool.submit(ask, number): number for number in range(count)}
        for future in as_completed(futures):
            results[futures[future]] = future.result()
            done(len(results))
    finally:
        for process in processes:
            process.kill()  # one that is idle holds nothing
        pool.shutdown(cancel_futures=True)
        for process in processes:
            process.communicate()
    return [results[number] for number in range(count)]


def _start_process() -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-c", _SERVE],
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


def _answer(process: "subprocess.Popen[bytes]", number: int) -> object:
    assert process.stdout is not None  # for the type checker
    _tell(process, number)
    try:
        result = pickle.load(process.stdout)
    except (EOFError, pickle.UnpicklingError):
        code = process.wait()
        how = f"by {signal.Signals(-code).name}, perhaps out of memory" if code < 0 else f"with code {code}"
        raise StudyError(f"a worker process ended early, {how}; try fewer workers") from None
    if isinstance(result, Exception):
        raise result
    return result


def serve() -> NoReturn:
    """Work as a process of `in_processes`."""
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed here must not get among the results
    logging.getLogger("pymantaray").setLevel(logging.ERROR)  # who asked has warned already
    requests, numbers = sys.stdin.buffer, SimpleQueue[int]()
    start: Callable[[], Callable[[int], object]] = pickle.load(requests)

    def listen() -> None:
        try:
            while True:
                numbers.put(pickle.load(requests))
        finally:
            os._exit(0)  # whoever asked has ended; what is being worked at is for nobody

    threading.Thread(target=listen, daemon=True).start()
    try:
        _work(start, numbers, results)
    finally:  # whatever ends it: the thread that listens would wait for who waits for this
        traceback.print_exc()
        os._exit(1)


def _work(
    start: Callable[[], Callable[[int], object]], numbers: SimpleQueue[int], results: BinaryIO
) -> NoReturn:
    task = None
    while True:
        number = numbers.get()
        try:
            task = task or start()
            result = pickle.dumps(task(number))
        except Exception as error:  # noqa: BLE001  raised again where it was asked for
            error.add_note(traceback.format_exc())
            result = pickle.dumps(error)
        results.write(result)
        results.flush()
