"""
The examples run for somebody who has nothing but them; the Gulf Stream's in HYCOM's real files too.
"""

import runpy
from pathlib import Path

import numpy as np
import pytest

from pymantaray.apps.study import run_study
from pymantaray.config import load_study
from pymantaray.records import RayStatus, SolveStatus

EXAMPLES = Path(__file__).parents[3] / "examples"
HYCOM = EXAMPLES.parents[1] / "shared" / "data" / "hycom"


@pytest.mark.slow
@pytest.mark.parametrize("real", [False, True])
def test_gulf_stream_runs(tmp_path, monkeypatch, real):
    text = (EXAMPLES / "gulf_stream.toml").read_text(encoding="utf-8")
    if real:
        files = [
            str(HYCOM / f"hycom_glby_930_2019030712_t003_{kind}.nc") for kind in ("ts3z", "uv3z")
        ]
        if not HYCOM.is_dir():
            pytest.skip(f"real HYCOM files are not at {HYCOM}")
        text = text.replace('source = "gulf_stream.nc"', f"source = {files}")
    else:
        monkeypatch.setattr("sys.argv", ["gulf_stream.py", str(tmp_path / "gulf_stream.nc")])
        runpy.run_path(str(EXAMPLES / "gulf_stream.py"), run_name="__main__")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    config = load_study(tmp_path / "study.toml", realizations=1)
    run = run_study(config, tmp_path / "run", workers=1)
    assert run.synthetic is run.manifest["ocean"]["synthetic"] is not real
    assert run.region.loc["synthetic"].item() == ("no" if real else "yes")
    assert set(run.manifest["ocean"]["sha256"]) == set(config.ocean.files)
    assert run.manifest["outcome"]["stopped_vehicles"] == {}
    right = run.estimates.condition != "refracted"
    assert (run.estimates.solve_status[right] == SolveStatus.OK).all()
    heard = run.measurements.range_status == RayStatus.OK
    bending = (run.ranging_truth.travel_time - run.ranging_truth.chord_travel_time)[heard]
    assert bending.max() < 1e-6  # Fermat, s
    floats = run.truth.role == "float"
    drift = np.linalg.norm(
        run.truth.position[floats, -1, :2] - run.truth.position[floats, 0, :2], axis=-1
    )
    assert (
        drift.max() < 1.6 * 24 * 3600
    )  # the strongest current of the window [m/s] for the whole mission


@pytest.mark.slow
def test_python_example_prints_every_condition(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "run_study.py"), run_name="__main__")
    printed = capsys.readouterr().out
    for condition in [c.name for c in load_study("quick").conditions]:
        assert f"{condition} " in printed


@pytest.mark.slow
def test_own_trajectories_have_the_same_travel_times_by_three_roads(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["own_trajectories.py", str(tmp_path / "own")])
    runpy.run_path(str(EXAMPLES / "own_trajectories.py"), run_name="__main__")
    with pytest.raises(SystemExit, match="own: is already there; give a new folder"):
        runpy.run_path(str(EXAMPLES / "own_trajectories.py"), run_name="__main__")
    printed = capsys.readouterr().out
    assert "study: the same travel times: True" in printed
    assert "service: the same travel times: True" in printed
    assert "refracted  mean position error" in printed
