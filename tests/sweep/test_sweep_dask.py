"""Sweeps on Dask: the same results as on this machine, whatever becomes of workers and scheduler."""

import os
import signal
import threading

import pytest
from dask_cluster import Cluster, client_here
from factories import wait_for
from refusals import refused

from pymantaray.errors import JobError
from pymantaray.jobs import pool
from pymantaray.sweep import run_sweep

pytest.importorskip("distributed")


def points_in(folder):
    return list((folder / "points").glob("*/*.json"))


def test_a_client_gives_the_same_digits_as_processes_of_this_machine(noises, summaries, tmp_path):
    sweep = noises(3)
    with client_here(2) as client:
        by_dask = run_sweep(sweep, tmp_path / "dask", client=client)
        assert client.status == "running"  # it is its owner's
    here = run_sweep(sweep, tmp_path / "here", workers=1)
    assert by_dask.status().done == 3
    assert summaries(by_dask) == summaries(here)


def test_a_scheduler_that_is_not_there_is_told_in_one_line(noises, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "_ANSWER", 1.0)
    address = "tcp://127.0.0.1:9"  # which no process is given by chance
    with pytest.raises(JobError, match=f"^scheduler {address}: cannot be reached: .*$"):
        run_sweep(noises(1), tmp_path / "out", client=address)


@pytest.mark.parametrize(
    "address", ["nonsense", "127.0.0.1", "tcp://host", "foo://host:1", "tcp://host:port", ""]
)
def test_what_is_no_address_is_refused_before_anything_is_written(noises, tmp_path, address):
    refused(
        JobError,
        "^scheduler .*: not an address; give tcp://HOST:PORT",
        run_sweep,
        noises(1),
        tmp_path / "out",
        client=address,
    )
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
def test_killed_workers_and_a_restarted_scheduler_lose_nothing(noises, summaries, tmp_path, caplog):
    sweep, out = noises(60), tmp_path / "out"
    with Cluster(tmp_path) as cluster:
        cluster.start()

        def mishaps():
            wait_for(lambda: len(points_in(out)) >= 5)
            worker = cluster.workers.pop(0)
            worker.kill()  # in mid-task: each takes tenths of a second, one after the other
            worker.wait()
            cluster.add_worker()
            wait_for(lambda: len(points_in(out)) >= 20)
            cluster.kill()
            cluster.start()

        thread = threading.Thread(target=mishaps)
        thread.start()
        results = run_sweep(sweep, out, client=cluster.address)
        thread.join()
    assert "is gone; waiting for it" in caplog.text
    assert "is back; going on" in caplog.text
    assert (results.status().done, results.status().failed) == (60, 0)
    assert not list(out.rglob("*.part"))
    assert summaries(results) == summaries(run_sweep(sweep, tmp_path / "here", workers=2))


@pytest.mark.slow
def test_a_scheduler_that_stays_away_ends_the_sweep_in_one_line_and_it_goes_on_elsewhere(
    noises, tmp_path, monkeypatch
):
    monkeypatch.setattr(pool, "_PATIENCE", 4.0)
    sweep, out = noises(30), tmp_path / "out"
    with Cluster(tmp_path) as cluster:
        cluster.start()

        def end():
            wait_for(lambda: len(points_in(out)) >= 3)
            os.kill(cluster.scheduler.pid, signal.SIGKILL)

        thread = threading.Thread(target=end)
        thread.start()
        with pytest.raises(JobError, match=r"is gone; start it and run the same sweep again to go on$"):
            run_sweep(sweep, out, client=cluster.address)
        thread.join()
    done = {path: path.stat().st_mtime_ns for path in points_in(out)}
    assert 3 <= len(done) < 30
    assert run_sweep(sweep, out, workers=1).status().done == 30
    assert all(path.stat().st_mtime_ns == time for path, time in done.items())  # none was done again
