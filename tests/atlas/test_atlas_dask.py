"""Atlases on Dask: the digits of this machine's processes, whatever becomes of workers and scheduler."""

import threading

import pytest
from dask_cluster import Cluster, client_here
from factories import wait_for

from pymantaray.atlas import Atlas, plan, run_atlas

pytest.importorskip("distributed")


def test_a_client_gives_the_same_bytes_as_processes_of_this_machine(ocean, file, links, tiles, tmp_path):
    lat, lon = ocean["lat"].values, ocean["lon"].values
    atlas = Atlas(file, links, window=(lat[10] - 1e-3, lat[11] + 1e-3, lon[10] - 1e-3, lon[13] + 1e-3))
    assert len(atlas.blocks) == 2
    with client_here(2) as client:
        by_dask = run_atlas(atlas, tmp_path / "dask.nc", client=client)
        assert client.status == "running"  # it is its owner's
    here = run_atlas(atlas, tmp_path / "here.nc", workers=1)
    assert by_dask.read_bytes() == here.read_bytes()


@pytest.mark.slow
def test_killed_workers_and_a_restarted_scheduler_lose_no_block(file, links, tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(plan, "_COLUMNS", 1)
    atlas, out, told = Atlas(file, links, every=4), tmp_path / "atlas.nc", []
    blocks = tmp_path / "atlas.nc.blocks" / "blocks"
    assert len(atlas.blocks) == 104
    with Cluster(tmp_path) as cluster:
        cluster.start()

        def mishaps():
            wait_for(lambda: len(list(blocks.glob("*.npz"))) >= 5)
            worker = cluster.workers.pop(0)
            worker.kill()  # in mid-task: each takes tenths of a second, one after the other
            worker.wait()
            cluster.add_worker()
            wait_for(lambda: len(list(blocks.glob("*.npz"))) >= 25)
            cluster.kill()
            cluster.start()

        thread = threading.Thread(target=mishaps)
        thread.start()
        run_atlas(atlas, out, client=cluster.address, progress=lambda *counts: told.append(counts))
        thread.join()
    assert "is gone; waiting for it" in caplog.text
    assert "is back; going on" in caplog.text
    assert told[-1] == (104, 0, 104)
    assert not blocks.exists()
    assert not list(tmp_path.rglob("*.part"))
    assert out.read_bytes() == run_atlas(atlas, tmp_path / "here.nc", workers=2).read_bytes()
