"""
What a sweep costs beside its studies, what sharing saves, how it scales.

    python benchmarks/bench_sweep.py [overhead] [sharing] [scaling] [dask]

CPU seconds count, of this process and its workers; wall times only where they are named.
"""

import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from pymantaray.apps.sweep import Sweep, open_sweep, run_sweep, tasks
from pymantaray.config import load_study, parse_study
from pymantaray.jobs import dask_pool
from pymantaray.jobs.pool import TaskFunction

POINTS = 10_000


def cpu() -> tuple[float, float]:
    """CPU seconds of this process, and of workers that have ended."""
    own, others = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime, others.ru_utime + others.ru_stime


def resident_mib() -> float:
    """Memory of this process now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


@contextmanager
def folder():
    """A new folder, gone afterwards."""
    path = Path(tempfile.mkdtemp(prefix="bench-sweep-"))
    try:
        yield path
    finally:
        shutil.rmtree(path)


def small(realizations=1):
    """Quick, for four hours in a small window."""
    tree = load_study("quick").model_dump(exclude_none=True)
    tree["study"] |= {"realizations": realizations}
    tree["conditions"] = ["odometry", "straight"]
    tree["mission"] |= {"duration_h": 4.0, "ping_interval_h": 1.0}
    tree["ocean"] |= {"half_extent_north": 15_000.0, "half_extent_east": 15_000.0}
    return parse_study(tree)


def noises(config, count):
    """Sweep of points that share all but the noise."""
    return Sweep(config, cross={"noise.range_sigma": [1.0 + 1e-4 * k for k in range(count)]})


def start_for_nothing(work: TaskFunction) -> TaskFunction:
    """A worker whose points take no time: the first one's summary stands for all."""
    solve, first = tasks._solve, {}

    def once(task, stages, store):
        if not first:
            first.update(solve(task, stages, store))
        return first | {"key": task.key}

    tasks._solve = once
    return work


def overhead() -> None:
    """Of points whose study takes no time: everything but the study."""
    dask_pool._start = start_for_nothing
    config, memory = small(), {}
    with folder() as out:
        before = cpu()
        run_sweep(noises(config, 1), out / "first", workers=1)
        first = [b - a for a, b in zip(before, cpu(), strict=True)]
        begun, before = time.perf_counter(), cpu()

        def look(done: int, _failed: int, _total: int) -> None:
            if done % 1000 == 0:
                memory[done] = resident_mib()

        run_sweep(noises(config, POINTS), out / "many", workers=1, progress=look)
        wall = time.perf_counter() - begun
        own, others = (b - a - f for a, b, f in zip(before, cpu(), first, strict=True))
        print(f"{POINTS} points that take no time, one worker: {wall:.1f} s of wall time")
        print(
            f"  CPU a point: {1e3 * own / POINTS:.2f} ms in the parent,"
            f" {1e3 * others / POINTS:.2f} ms in the worker"
        )
        listed = ", ".join(f"{done}: {mib:.0f}" for done, mib in sorted(memory.items()))
        print(f"  memory of the parent by points done [MiB]: {listed}")
        files = [file for file in (out / "many").rglob("*") if file.is_file()]
        size = sum(file.stat().st_size for file in files)
        blocks = sum(512 * file.stat().st_blocks for file in files)
        print(f"  store: {len(files)} files, {size / 1e6:.1f} MB, {blocks / 1e6:.1f} MB on disk")
        for what, call in (
            ("status", lambda: open_sweep(out / "many").status()),
            ("table", lambda: open_sweep(out / "many").table()),
            ("run again, nothing to do", lambda: run_sweep(noises(config, POINTS), out / "many")),
        ):
            begun, before = time.perf_counter(), cpu()
            call()
            print(
                f"  {what}: {cpu()[0] - before[0]:.2f} s of CPU, {time.perf_counter() - begun:.2f}"
                " s of wall time"
            )


def sharing() -> None:
    """Quick with ten noises: a sweep of one point ten times, against one of ten."""
    config, code = load_study("quick"), "import pymantaray.apps.sweep.tasks"
    with folder() as out:
        begin = sum(cpu())
        subprocess.run([sys.executable, "-c", code], check=True)
        start = sum(cpu()) - begin
        run_sweep(noises(config, 1), out / "one", workers=1)
        one = sum(cpu()) - begin - 2.0 * start
        run_sweep(noises(config, 10), out / "ten", workers=1)
        ten = sum(cpu()) - begin - one - 3.0 * start
    print(
        f"quick, CPU without the start of a worker ({start:.1f} s): one point {one:.2f} s, ten"
        f" noises {ten:.2f} s"
    )
    print(f"  ten times one {10.0 * one:.1f} s: {100.0 * (1.0 - ten / (10.0 * one)):.0f} % saved")
    print(
        f"  largest worker: {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024:.0f} MiB"
    )


def scaling(points: int = 450) -> None:
    """The same sweep on one and two workers; their CPU decides on a machine that is not idle."""
    config, used, took = small(realizations=5), {}, {}
    for count in (1, 2, 1, 2):
        with folder() as out:
            begun, before = time.perf_counter(), sum(cpu())
            run_sweep(noises(config, points), out / "out", workers=count)
            wall, used[count] = time.perf_counter() - begun, sum(cpu()) - before
        took[count] = min(wall, took.get(count, wall))
        print(
            f"{count} workers: {wall:.1f} s of wall time, {used[count]:.1f} s of CPU, load"
            f" {os.getloadavg()[0]:.1f}"
        )
    print(
        f"  CPU of one by CPU of two workers: {used[1] / used[2]:.2f}, the efficiency where both"
        " are busy"
    )
    print(f"  efficiency by wall time, where nothing else runs: {took[1] / took[2] / 2.0:.2f}")


def dask() -> None:
    """
    Of points whose study takes no time, by a scheduler and a worker in this process: what each of a
    thousand more takes.
    """
    from distributed import Client

    config, took = small(), {100: [], 1100: []}
    with (
        folder() as out,
        Client(
            processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None
        ) as client,
    ):
        run_sweep(noises(config, 2), out / "first", client=client)
        solve, tasks._solve = (
            tasks._solve,
            lambda task, *_: {"key": task.key, "conditions": {}, "links": {}},
        )
        for repeat in range(3):
            for count, seconds in took.items():
                before = cpu()[0]
                run_sweep(noises(config, count), out / f"{repeat}-{count}", client=client)
                seconds.append(cpu()[0] - before)
        tasks._solve = solve
    few, many = (statistics.median(seconds) for seconds in took.values())
    print(
        f"Dask: {many - few:.2f} ms of CPU a point: plan, client, scheduler, worker and store;"
        f" load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    import bench_sweep

    for name in sys.argv[1:] or ("overhead", "sharing", "scaling", "dask"):
        getattr(bench_sweep, name)()
