"""A job of small tasks: squares of numbers, each written into a store after a while."""

import hashlib
import json
import os
import signal
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from pymantaray.installation import code_version
from pymantaray.jobs.dask_pool import open_pool
from pymantaray.jobs.pool import Queue, run_in_store, run_tasks
from pymantaray.jobs.store import failure_content, open_store


@dataclass(frozen=True)
class Square:
    """
    A number to be squared; a process that is given one of the deadly ones is killed, at most so
    many times.
    """

    number: int
    seconds: float = 0.0
    size: int = 0
    deaths: int = 0
    kind: str = "square"
    version: str = field(default_factory=code_version)

    @property
    def key(self):
        return hashlib.sha256(str(self.number).encode()).hexdigest()


def name_of(key, *, failed=False):
    return f"squares/{key}{'.failed' if failed else ''}.json"


def compute(store, task):
    if store.has(name_of(task.key)):
        return
    marks = [name for name in store.names("marks") if name.startswith(f"{task.number}-")]
    time.sleep(task.seconds)
    if len(marks) < task.deaths:
        store.write(f"marks/{task.number}-{len(marks)}", b"")
        os.kill(os.getpid(), signal.SIGKILL)
    if task.number < 0:
        raise ValueError(f"{task.number} is negative")
    content = {"square": task.number**2, "padding": " " * task.size}
    store.write(name_of(task.key), json.dumps(content).encode())


def run_square(url, task):
    return run_in_store(url, task, compute, name_of(task.key, failed=True))


class Squares(Queue):
    def __init__(self, store, tasks):
        self.tasks = {task.key: task for task in tasks}
        super().__init__(key for key in self.tasks if not store.has(name_of(key)))
        self.store, self.lines = store, {}

    def task(self, key):
        return self.tasks[key]

    def record_result(self, key, result):
        self.left -= 1
        self.lines[self.tasks[key].number] = result

    def record_failure(self, key, line):
        self.store.write(name_of(key, failed=True), failure_content(RuntimeError(line)))
        self.record_result(key, line)


def run_squares(tasks, out, *, client=None, workers=1):
    """
    Do the tasks that are not done; the line by which each that was begun failed, or None, by its
    number.
    """
    store = open_store(out)
    store.claim("job", "job.txt", {"job.txt", "squares", "marks"})
    store.write("job.txt", b"squares")
    queue = Squares(store, tasks)
    if queue.left:
        with open_pool(partial(run_square, store.url), client, workers) as pool:
            run_tasks(queue, pool)
    return queue.lines


def squares_in(out):
    """Contents of the squares that are done, by file."""
    return {path.name: path.read_bytes() for path in Path(out).glob("squares/*.json")}


if __name__ == "__main__":
    import stub_tasks  # workers import the functions of a module, not those of a script

    count, seconds, out = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
    stub_tasks.run_squares([stub_tasks.Square(n, seconds) for n in range(count)], out, workers=2)
