"""A real Dask scheduler and its workers on loopback, to be killed and started again."""

import os
import socket
import subprocess
import sys


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def client_here(threads):
    """
    A client of a worker in this process, which works however little memory the machine has left.
    """
    from distributed import Client

    return Client(
        processes=False,
        n_workers=1,
        threads_per_worker=threads,
        # with None the scheduler takes 8787, which others may have
        dashboard_address="127.0.0.1:0",
        memory_limit=0,
    )


class Cluster:
    """A scheduler and two workers on loopback, each a process of its own."""

    def __init__(self, folder):
        self.port, self.folder, self.log = free_port(), folder, (folder / "log").open("a")
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler, self.workers = None, []

    def start(self, workers=2):
        self.scheduler = self.dask("scheduler", "--host", "127.0.0.1", "--port", str(self.port))
        while len(self.workers) < workers:
            self.add_worker()

    def add_worker(self):
        options = ("--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder))
        self.workers.append(self.dask("worker", self.address, *options))

    def dask(self, *words):
        command = [sys.executable, "-m", "dask", *words, "--no-dashboard"]
        return subprocess.Popen(
            command, stderr=self.log, env=os.environ | {"NUMBA_NUM_THREADS": "1"}
        )

    def kill(self):
        for process in [*self.workers, self.scheduler]:
            process.kill()
            process.wait()
        self.workers.clear()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()
        self.log.close()
