"""Realizations in parallel: fresh processes, one thread each, results in order whoever was first."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from pymantaray.errors import StudyError
from pymantaray.study.realization import RealizationSolver, Solved
from pymantaray.study.store import Run

# read by the numerical libraries when a process starts; more threads than cores only slow it down
_ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)

_solver: RealizationSolver | None = None  # of this worker process
T = TypeVar("T")


def solve_realizations(run: Run, workers: int, done: Callable[[int], None]) -> list[Solved]:
    """
    Solve all realizations of a study.

    Parameters
    ----------
    run : Run
        Its configuration, truth and noise-free measurements are on disk, where each process reads them.
    workers : int
        Number of processes; with 1 all is done in this one.
    done : callable
        Told how many realizations are done.

    Returns
    -------
    list of Solved
        By realization; it does not depend on the number of workers.

    Raises
    ------
    StudyError
        If a worker process ends before its time.
    """
    count = run.config.study.realizations
    if workers == 1:
        solver = RealizationSolver(run)
        results = []
        for realization in range(count):
            results.append(solver.solve(realization))
            done(realization + 1)
        return results

    return in_processes(_solve, count, workers, _start_worker, run.path, done)


def in_processes(
    task: Callable[[int], T],
    count: int,
    workers: int,
    start: Callable[[Path], None],
    folder: Path,
    done: Callable[[int], None],
) -> list[T]:
    """
    Do numbered tasks in fresh processes.

    Parameters
    ----------
    task : callable
        Takes a number from 0; a function of a module.
    count, workers : int
        Of tasks and of processes.
    start : callable
        Called once in each process, with ``folder``.
    folder : pathlib.Path
    done : callable
        Told how many tasks are done.

    Returns
    -------
    list
        By number. If a task raises, or this process is interrupted, the others are stopped where they are.

    Raises
    ------
    StudyError
        If a process ends before its time.
    """
    context, others = multiprocessing.get_context("spawn"), multiprocessing.active_children()
    with ProcessPoolExecutor(workers, context, start, (folder,)) as pool:
        with _fit_for_workers():  # submitting starts the processes
            futures = {pool.submit(task, number): number for number in range(count)}
        found: dict[int, T] = {}
        try:
            for future in as_completed(futures):
                found[futures[future]] = future.result()
                done(len(found))
        except BrokenProcessPool:
            raise StudyError(
                "a worker process ended early: out of memory, or a script that calls run_study without"
                ' if __name__ == "__main__":; try fewer workers'
            ) from None
        except BaseException:
            # the pool would do all that is left: its own end takes back a cancellation that is not carried out yet
            for process in multiprocessing.active_children():
                if process not in others:
                    process.terminate()
            raise
    return [found[number] for number in range(count)]


def refuse_unguarded_scripts() -> None:
    """
    Refuse to go on in a worker that is still importing the script that started it.

    Raises
    ------
    StudyError
        If so: the script calls `run_study` without a guard, and each worker would do so again.
    """
    # while a spawned process imports its parent's script, that is named __mp_main__ and not yet __main__
    script = sys.modules.get("__mp_main__")
    named_so = getattr(script, "__name__", None) == "__mp_main__"
    if named_so and sys.modules.get("__main__") is not script:
        raise StudyError(
            "run_study was called by a worker process that imports the script; put the call under"
            ' if __name__ == "__main__": or use workers=1'
        )


def _start_worker(folder: Path) -> None:
    global _solver  # a pool's initializer has no other place to leave its result
    _solver = RealizationSolver(Run(folder))


def _solve(realization: int) -> Solved:
    if _solver is None:
        raise AssertionError("worker was not started")
    return _solver.solve(realization)


@contextmanager
def _fit_for_workers() -> Iterator[None]:
    """Surroundings that new processes inherit: one thread each, and Ctrl-C left to the parent."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    in_main_thread = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if in_main_thread else None
    try:
        yield
    finally:
        if in_main_thread:
            signal.signal(signal.SIGINT, handler or signal.SIG_DFL)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
