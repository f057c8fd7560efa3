"""Atlases on Dask: the digits of this process."""

import pytest
from dask_cluster import client_here
from factories import pool_here

from pymantaray.apps.atlas import Atlas, run_atlas

pytest.importorskip("distributed")


def test_a_client_gives_the_same_bytes_as_this_process(
    ocean, file, links, tiles, monkeypatch, tmp_path
):
    lat, lon = ocean["lat"].values, ocean["lon"].values
    atlas = Atlas(
        file, links, window=(lat[10] - 1e-3, lat[11] + 1e-3, lon[10] - 1e-3, lon[13] + 1e-3)
    )
    assert len(atlas.blocks) == 2
    with client_here(2) as client:
        by_dask = run_atlas(atlas, tmp_path / "dask.nc", client=client)
        assert client.status == "running"  # it is its owner's
    monkeypatch.setattr("pymantaray.apps.atlas.runner.open_pool", pool_here)
    here = run_atlas(atlas, tmp_path / "here.nc")
    assert by_dask.read_bytes() == here.read_bytes()
