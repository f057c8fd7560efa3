"""Names of the files of trajectories."""

from types import SimpleNamespace

import numpy as np
import pytest
from factories import trajectories
from refusals import refused

from pymantaray.apps.export import run_files
from pymantaray.errors import ExchangeError
from pymantaray.exchange.recording import FleetPoses, Recording
from pymantaray.exchange.vtk import write_fleet


def folder_of(form, condition, vehicles, folder, monkeypatch):
    """Names of the files of the true poses and of one condition."""
    truth = trajectories(np.arange(12.0).reshape(2, 2, 3), names=vehicles)
    estimate = FleetPoses(truth.position + 1.0, truth.quaternion)
    recording = Recording("r", truth, {condition: estimate}, None, np.empty((0, 3)))
    monkeypatch.setattr(run_files, "record", lambda _run, _realization: recording)
    write = {
        "tum": lambda: run_files._tum(SimpleNamespace(truth=truth), 0, folder),
        "kitti": lambda: run_files._kitti(SimpleNamespace(truth=truth), 0, folder),
        "vtk": lambda: write_fleet(recording, folder),
    }
    write[form]()
    return sorted(path.stem for path in folder.iterdir())


@pytest.mark.parametrize("form", ["tum", "kitti", "vtk"])
def test_two_trajectories_never_have_one_file(tmp_path, monkeypatch, form):
    if form == "vtk":
        pytest.importorskip("meshio")
    (folder := tmp_path / "plain").mkdir()
    times = ["times-A", "times-B"] if form == "kitti" else []
    assert folder_of(form, "c", ("A", "B"), folder, monkeypatch) == [
        *("c-A", "c-B"),
        *times,
        *("truth-A", "truth-B"),
    ]
    for k, (condition, vehicles) in enumerate(
        [("truth-all", ("A", "all-A"))] + [("times", ("A", "B"))] * (form == "kitti")
    ):
        (folder := tmp_path / str(k)).mkdir()
        refused(
            ExchangeError,
            f"two trajectories have this file name; rename vehicle .* or condition {condition}",
            *(folder_of, form, condition, vehicles, folder, monkeypatch),
        )
