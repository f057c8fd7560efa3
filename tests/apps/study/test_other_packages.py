"""Figures and sensors of other packages; a broken or missing one is named in one line."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from factories import python
from refusals import refused

import pymantaray
from pymantaray.config.build.study import build_study
from pymantaray.errors import MantaRayError

ROOT = Path(__file__).parents[3]
SOURCES = str(Path(pymantaray.__file__).parents[1])


def report(run, packages):
    """Report of a run, written by a process that finds packages in a folder."""
    return subprocess.run(
        [sys.executable, "-m", "pymantaray", "study", "report", run],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([SOURCES, str(packages)])},
        capture_output=True,
        text=True,
        check=False,
    )


def copy_of(run, folder):
    """A run without its report, whose files are links."""
    folder.mkdir()
    for file in run.iterdir():
        if file.is_file():
            (folder / file.name).symlink_to(file)
    return folder


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """Folder in which the example package is installed."""
    folder = tmp_path_factory.mktemp("packages")
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder]
    subprocess.run([*install, ROOT / "examples" / "extension"], check=True)
    return folder


def test_figure_of_an_installed_package_is_in_the_report(tmp_path, packages, tiny_run_folder):
    run = copy_of(tiny_run_folder, tmp_path / "run")
    done = report(run, packages)
    assert done.returncode == 0, done.stderr
    assert (run / "figures" / "speed.png").is_file()
    page = (run / "index.html").read_text()
    assert re.search(r"Speed of each of the \d+ vehicles over ground", page)


SENSOR = """
import json
import numpy as np
from factories import TINY
from pymantaray import open_run, run_study
from pymantaray.config import parse_study
plain, gauge = (parse_study(TINY, "tiny"), parse_study({**TINY, "mission": {**TINY["mission"],
    "sensors": ["pressure-gauge"]}}, "tiny"))
runs = [run_study(config, name, workers=1) for config, name in ((plain, "a"), (gauge, "b"))]
one, two = (run.noisy_measurements(0) for run in runs)
error = two.depth - one.depth
print(json.dumps({
    "constant": float(abs(error - error[:, :1]).max()), "size": float(abs(error[:, 0]).max()),
    "others": bool(np.array_equal(one.refracted_range, two.refracted_range, equal_nan=True)),
    "version": runs[1].manifest["versions"]["pymantaray-example"]}))
"""


def test_sensor_of_an_installed_package_replaces_its_columns(tmp_path, packages):
    paths = [SOURCES, str(ROOT / "tests"), str(packages)]
    done = python(SENSOR, environment={"PYTHONPATH": os.pathsep.join(paths)}, cwd=tmp_path)
    found = json.loads(done.stdout)
    assert found["constant"] < 1e-9
    assert 0.01 < found["size"] < 2.5  # sigma 0.5 m
    assert found["others"]
    assert found["version"] == "0.1.0"


def test_sensor_that_no_package_has_is_refused(tiny):
    config = tiny(mission={"sensors": ["echo"]})
    refused(MantaRayError, "sensors: no installed package has 'echo'", build_study, config)


@pytest.mark.slow
def test_package_that_cannot_be_imported_is_named(tmp_path, tiny_run_folder):
    info = tmp_path / "packages" / "broken-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[pymantaray.figures]\nbeam = nowhere.beams\n")
    done = report(copy_of(tiny_run_folder, tmp_path / "run"), info.parent)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == (
        "error: package 'broken': its entry point 'beam' of 'pymantaray.figures' cannot be loaded:"
        " ModuleNotFoundError: No module named 'nowhere'; repair or uninstall the package"
    )
    assert not (tmp_path / "run" / "index.html").exists()
