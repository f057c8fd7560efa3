"""Figures of other packages: one is in the report, a broken one is named in one line."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pymantaray

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


def test_figure_of_an_installed_package_is_in_the_report(tmp_path, tiny_run_folder):
    packages = tmp_path / "packages"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", packages]
    subprocess.run([*install, ROOT / "examples" / "extension"], check=True)
    run = copy_of(tiny_run_folder, tmp_path / "run")
    done = report(run, packages)
    assert done.returncode == 0, done.stderr
    assert (run / "figures" / "speed.png").is_file()
    page = (run / "index.html").read_text()
    assert re.search(r"Speed of each of the \d+ vehicles over ground", page)


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
