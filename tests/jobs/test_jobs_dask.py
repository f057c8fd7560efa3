"""Jobs on Dask: the same results as on this machine, whatever becomes of workers and scheduler."""

import os
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
import stub_tasks
from dask_cluster import Cluster, client_here
from factories import wait_for
from refusals import refused
from stub_tasks import Square, run_squares, squares_in

from pymantaray.errors import JobError
from pymantaray.jobs import dask_pool, store
from pymantaray.jobs.dask_pool import check_scheduler

pytest.importorskip("distributed")


def tasks(count, seconds=0.05):
    return [Square(n, seconds) for n in range(count)]


@contextmanager
def dead_workers_replaced(cluster):
    """As the nannies of Dask do, and batch systems."""
    over = threading.Event()

    def replace_workers():
        while not over.wait(0.2):
            dead = [worker for worker in cluster.workers if worker.poll() is not None]
            cluster.workers[:] = [worker for worker in cluster.workers if worker not in dead]
            for _ in dead:
                cluster.add_worker()

    thread = threading.Thread(target=replace_workers)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Scheduler and two workers, which can import the stub tasks."""
    monkeypatch.setenv(
        "PYTHONPATH",
        os.pathsep.join([str(Path(stub_tasks.__file__).parent), os.environ.get("PYTHONPATH", "")]),
    )
    with Cluster(tmp_path) as cluster:
        cluster.start()
        yield cluster


def test_a_client_gives_the_same_results_as_processes_of_this_machine(tmp_path):
    with client_here(2) as client:
        assert run_squares(tasks(5), tmp_path / "dask", client=client) == dict.fromkeys(range(5))
        assert client.status == "running"  # it is its owner's
    run_squares(tasks(5), tmp_path / "here")
    assert squares_in(tmp_path / "dask") == squares_in(tmp_path / "here")


@pytest.mark.parametrize(("seconds", "few"), [(1e9, True), (0.0, False)])
def test_short_tasks_are_sent_in_batches_and_long_ones_alone(tmp_path, monkeypatch, seconds, few):
    monkeypatch.setattr(dask_pool, "_BATCH_SECONDS", seconds)
    sizes, send = [], dask_pool.DaskPool._send

    def count(self, kind, batch):
        sizes.append(len(batch))
        send(self, kind, batch)

    monkeypatch.setattr(dask_pool.DaskPool, "_send", count)
    with client_here(2) as client:
        lines = run_squares(tasks(100, 0.0), tmp_path / "dask", client=client)
    assert lines == dict.fromkeys(range(100))
    assert len(squares_in(tmp_path / "dask")) == sum(sizes) == 100
    assert (len(sizes) < 75) == few
    assert max(sizes) <= 64


@pytest.mark.parametrize(
    "address", ["nonsense", "127.0.0.1", "tcp://host", "foo://host:1", "tcp://host:port", ""]
)
def test_text_that_is_no_address_is_refused(address):
    refused(
        JobError, "^scheduler .*: not an address; give tcp://HOST:PORT", check_scheduler, address
    )


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1:8786", "10.0.0.1:8786", "tls://[::1]:8786", "inproc://10.0.0.1/8/1"],
)
def test_addresses_that_a_scheduler_prints_are_taken(address):
    check_scheduler(address)


def test_a_scheduler_that_does_not_answer_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_pool, "_CONNECT_TIMEOUT", 1.0)
    address = "tcp://127.0.0.1:9"  # which no process is given by chance
    line = f"^scheduler {address}: cannot be reached: .*$"
    refused(JobError, line, run_squares, tasks(1), tmp_path / "out", client=address)


@pytest.mark.slow
def test_killed_workers_and_a_restarted_scheduler_lose_nothing(
    cluster, tmp_path, caplog, monkeypatch
):
    out = tmp_path / "out"

    def mishaps():
        wait_for(lambda: len(squares_in(out)) >= 5)
        worker = cluster.workers.pop(0)
        worker.kill()
        worker.wait()
        cluster.add_worker()
        wait_for(lambda: len(squares_in(out)) >= 20)
        cluster.kill()
        cluster.start()

    thread = threading.Thread(target=mishaps)
    thread.start()
    lines = run_squares(tasks(100, 0.2), out, client=cluster.address)
    thread.join()
    assert set(lines.values()) == {None}
    assert "does not answer; waiting for it" in caplog.text
    assert "answers again; continuing" in caplog.text
    run_squares(tasks(100, 0.0), tmp_path / "here", workers=2)
    assert squares_in(out) == squares_in(tmp_path / "here")
    # a worker that was killed while it wrote a file leaves one, which a later run removes
    monkeypatch.setattr(store, "_STALE_AGE", -1.0)
    run_squares(tasks(100, 0.0), out)
    assert not list(out.rglob("*.part"))


@pytest.mark.slow
def test_a_task_that_kills_its_worker_fails_alone(cluster, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(dask_pool, "_BATCH_SECONDS", 1e9)
    deadly = Square(90, deaths=1000)
    every = [deadly if n == deadly.number else Square(n) for n in range(150)]
    with dead_workers_replaced(cluster):
        lines = run_squares(every, tmp_path / "out", client=cluster.address)
    assert {n for n, line in lines.items() if line} == {deadly.number}
    assert lines[deadly.number].startswith("a worker ended early")
    assert "run again alone, after all others" in caplog.text


@pytest.mark.slow
def test_a_task_is_not_blamed_for_workers_that_others_kill(cluster, tmp_path):
    spare = cluster.workers.pop()
    spare.kill()
    spare.wait()
    two = [
        Square(n, seconds=0.3, deaths=3) for n in range(2)
    ]  # each kills fewer workers than a task may
    with dead_workers_replaced(cluster):
        assert run_squares(two, tmp_path / "out", client=cluster.address) == {0: None, 1: None}
    assert len(list((tmp_path / "out/marks").iterdir())) == 6


@pytest.mark.slow
def test_a_lost_scheduler_is_one_line_and_the_job_resumes_elsewhere(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(dask_pool, "_RECONNECT_TIMEOUT", 4.0)
    out = tmp_path / "out"

    def end():
        wait_for(lambda: len(squares_in(out)) >= 3)
        os.kill(cluster.scheduler.pid, signal.SIGKILL)

    thread = threading.Thread(target=end)
    thread.start()
    with pytest.raises(
        JobError, match=r"no answer; start it and run the same job again to resume$"
    ):
        run_squares(tasks(60, 0.2), out, client=cluster.address)
    thread.join()
    before = squares_in(out)
    assert 3 <= len(before) < 60
    run_squares(tasks(60, 0.0), out)
    after = squares_in(out)
    assert len(after) == 60
    assert {name: after[name] for name in before} == before
