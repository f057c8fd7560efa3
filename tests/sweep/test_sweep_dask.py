"""Sweeps on Dask: the same results as on this machine."""

import pytest
from dask_cluster import client_here

from pymantaray.sweep import run_sweep

pytest.importorskip("distributed")


def test_a_client_gives_the_same_digits_as_processes_of_this_machine(noises, summaries, tmp_path):
    sweep = noises(3)
    with client_here(2) as client:
        by_dask = run_sweep(sweep, tmp_path / "dask", client=client)
        assert client.status == "running"  # it is its owner's
    here = run_sweep(sweep, tmp_path / "here", workers=1)
    assert by_dask.status().done == 3
    assert summaries(by_dask) == summaries(here)
