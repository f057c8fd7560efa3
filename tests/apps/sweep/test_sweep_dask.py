"""Sweeps on Dask: the same results as on this machine."""

import pytest
from dask_cluster import client_here
from factories import pool_here

from pymantaray.apps.sweep import run_sweep

pytest.importorskip("distributed")


@pytest.mark.slow
def test_a_client_gives_the_same_digits_as_this_process(noises, summaries, monkeypatch, tmp_path):
    sweep = noises(3)
    with client_here(2) as client:
        by_dask = run_sweep(sweep, tmp_path / "dask", client=client)
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", pool_here)
    here = run_sweep(sweep, tmp_path / "here")
    assert by_dask.status().done == 3
    assert summaries(by_dask) == summaries(here)
