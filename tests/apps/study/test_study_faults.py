"""
What happens to runs: full disks, folders that go away, other threads; one line each, and nothing
half-written.
"""

import shutil
import sys
import threading

import numpy as np
import pytest
from factories import python

from pymantaray.apps.study import open_run, run_study
from pymantaray.config.door import ocean as water_ocean
from pymantaray.config.door.beliefs import Beliefs
from pymantaray.config.estimators import ModesSection
from pymantaray.errors import JobError
from pymantaray.ocean import open_ocean
from pymantaray.records import write_netcdf

FULL = """
import resource
from factories import TINY
from pymantaray.errors import WriteError
from pymantaray.apps.study import run_study
from pymantaray.config import parse_study
def fill(stage, done, total):  # no file can grow beyond this once realizations are solved
    if stage == "realizations" and done == total:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    run_study(parse_study(TINY | {"conditions": ["odometry"]}), "run", workers=1, progress=fill)
except WriteError as error:
    print(error)
"""


@pytest.mark.slow
def test_full_disk_is_one_line_with_the_file_and_the_cause(tmp_path):
    """
    In a process of its own, which HDF5 leaves with the file open, and which must not write half of
    Python's caches.
    """
    environment = {"PYTHONPATH": ":".join(sys.path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = python(FULL, environment=environment, cwd=tmp_path)
    assert done.stderr in ("", "compiling kernels: takes up to a minute, only the first time\n")
    assert done.stdout.endswith("/estimates.nc: cannot be written: File too large\n")
    assert list(tmp_path.iterdir()) == []


def test_folder_removed_under_a_run_is_one_line(tiny_config, tmp_path):
    def remove(stage, _done, _total):
        if stage == "realizations":
            shutil.rmtree(tmp_path / "runs")

    with pytest.raises(JobError, match=r"\.tiny\.mantaray-part: this folder was removed") as caught:
        run_study(tiny_config, tmp_path / "runs" / "tiny", workers=1, progress=remove)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_studies_in_threads_of_one_process_are_those_of_one(tiny, tiny_run, tmp_path):
    """
    The libraries behind NetCDF hold one state for all threads; signals are for the main one alone.
    """
    errors = []

    def run(name, workers):
        try:
            run_study(tiny(conditions=["odometry"]), tmp_path / name, workers=workers)
        except Exception as error:  # noqa: BLE001
            errors.append(error)

    threads = [threading.Thread(target=run, args=(str(n), 1 + n)) for n in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    for name in ("truth", "arrivals", "measurements"):
        assert (
            len({(p / f"{name}.nc").read_bytes() for p in (tiny_run.path, *tmp_path.iterdir())})
            == 1
        )
    one, other = (open_run(tmp_path / name).estimates.position for name in "01")
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(one[0], tiny_run.estimates.position[0])


@pytest.fixture
def window_file(tmp_path):
    """Some of the synthetic Beaufort Sea at three times, in a file each."""
    ocean = open_ocean("synthetic:beaufort", window=(74.2, 74.8, -141.2, -138.8))
    for hours in (0, 3, 6):
        time = ocean["time"].values + np.timedelta64(hours, "h")
        write_netcdf(
            ocean.assign_coords(time=((), time, ocean["time"].attrs)), tmp_path / f"{hours}.nc"
        )
    return tmp_path


def test_beliefs_find_files_relative_to_the_working_folder(tiny, window_file, monkeypatch):
    """
    The configuration is read again in the run's folder, and the ocean for the cast from its source.
    """
    monkeypatch.chdir(window_file)
    cast = {"name": "cast", "range_model": {"kind": "mean-slowness", "belief": "cast"}}
    config = tiny(conditions=["odometry", cast], ocean={"source": "0.nc"})
    run = run_study(config, "run", workers=1)
    assert run.estimates.condition.tolist() == ["odometry", "cast"]
    assert np.isfinite(run.estimates.position).all()


def test_input_file_that_goes_away_once_it_is_read_costs_no_work(tiny, window_file):
    file = window_file / "0.nc"
    config = tiny(conditions=["odometry"], ocean={"source": str(file)})

    def remove(stage, _done, _total):
        if stage == "realizations":
            file.unlink(missing_ok=True)

    run = run_study(config, window_file / "run", workers=1, progress=remove)
    assert list(run.manifest["ocean"]["sha256"]) == [str(file)]


def test_what_beliefs_need_of_a_varying_ocean_is_its_start(run_tiny, window_file, monkeypatch):
    """Not all of its snapshots brought to the local grid, in every worker."""
    files = {"source": [str(window_file / f"{h}.nc") for h in (0, 3, 6)], "time_varying": True}
    run = run_tiny(study={"realizations": 1}, conditions=["odometry"], ocean=files)
    monkeypatch.setattr(water_ocean, "to_local", lambda *_a, **_k: pytest.fail("regridded"))
    depth, shapes, sigma = Beliefs(run).modes(ModesSection(count=2))
    assert shapes.shape == (2, depth.size)
    assert (sigma > 0.0).all()
