"""Environments that a command refuses in one line, or that change nothing."""

import os
import subprocess
import sys

import pytest
from refusals import refused

from pymantaray.errors import ExchangeError, optional_package

LINKS = "source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth\n"


def command(*words, cwd=None, **environment):
    return subprocess.run(
        [sys.executable, "-m", "pymantaray", *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env=os.environ | environment,
    )


def test_an_interpreter_without_docstrings_is_refused():
    done = command("--help", PYTHONOPTIMIZE="2")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: environment: PYTHONOPTIMIZE")
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_an_unknown_backend_of_matplotlib_draws_files(tmp_path):
    (tmp_path / "p.csv").write_text("depth,sound_speed\n0,1500\n500,1490\n")
    ends = ("--source", "0,0,50", "--receiver", "900,0,90")
    words = ("rays", "plot", "x.png", *ends, "--profile", "p.csv", "--bathymetry", "500")
    done = command(*words, cwd=tmp_path, MPLBACKEND="nonsense")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "x.png").read_bytes()[:4] == b"\x89PNG"


def test_a_folder_that_the_locale_cannot_decode_is_refused(tmp_path):
    (tmp_path / "Å").mkdir()
    locale = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    done = command("study", "list", PWD=str(tmp_path / "Å"), **locale)
    assert (done.returncode, done.stdout) == (2, "")
    assert "the locale's encoding is ascii" in done.stderr


@pytest.mark.parametrize("utf8", ["0", ""])
def test_names_that_the_locale_cannot_decode_are_refused(tmp_path, utf8):
    folder = tmp_path / "Å"
    folder.mkdir()
    locale = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": utf8}
    done = command("study", "init", "quick", str(folder / "o.toml"), cwd=folder, **locale)
    if not utf8:  # Python's own choice for this locale
        assert done.returncode == 0, done.stderr
        assert (folder / "o.toml").is_file()
        return
    assert done.returncode == 2
    assert "the locale's encoding is ascii" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_damaged_extra_is_named_as_such(tmp_path, monkeypatch):
    """Not as a missing one, and not as a damaged file."""
    (tmp_path / "broken_extra.py").write_text("raise RuntimeError('half\\ninstalled')\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    def load(name):
        with optional_package(ExchangeError, "a.bag", name, "ros"):
            __import__(name)

    line = r'a.bag: missing_extra is not installed; pip install "pymantaray\[ros\]"'
    refused(ExchangeError, line, load, "missing_extra")
    line = r"broken_extra cannot be imported \(RuntimeError: half installed\); uninstall it"
    refused(ExchangeError, line, load, "broken_extra")
