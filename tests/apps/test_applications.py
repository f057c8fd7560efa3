"""An application is a folder: without it, its command is gone and everything else is there."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from factories import python

import pymantaray
from pymantaray.apps import commands, summaries
from pymantaray.cli.main import tree

PACKAGE = Path(pymantaray.__file__).parent
ROOT = PACKAGE.parents[1]
ALL = sorted(path.name for path in (PACKAGE / "apps").iterdir() if (path / "__init__.py").is_file())
FAST = ("locate",)
USE = """
import runpy, sys
from pymantaray import *
from pymantaray.apps import commands
from pymantaray.cli.main import main, tree
print(*sorted(commands()), sep=",")
tree()
pages = runpy.run_path("docs/site/reference_pages.py")
for name in ("configuration", "choices", "commands", "interface"):
    pages[name]()
main(["--help"])
"""


def users_of(application):
    """The application and all others that import it."""
    found = {application}
    for other in ALL:
        sources = (path.read_text() for path in (PACKAGE / "apps" / other).rglob("*.py"))
        if other not in found and any(
            re.search(rf"pymantaray\.apps\.{application}\b", source) for source in sources
        ):
            found |= users_of(other)
    return found


def copy_without(applications, folder, *, tests=False):
    """Copy of the package and the pages, or of the project, without some applications."""
    outside = ("runs", ".git", ".venv", "__pycache__")
    for path in ROOT.iterdir() if tests else (ROOT / "src", ROOT / "docs"):
        if path.is_file():
            shutil.copy(path, folder / path.name)
        elif path.name not in outside and not path.name.endswith("_cache"):
            shutil.copytree(path, folder / path.name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in applications:
        shutil.rmtree(folder / "src" / "pymantaray" / "apps" / name)
        shutil.rmtree(folder / "tests" / "apps" / name, ignore_errors=True)


def commands_of(application):
    """Names of the commands of an application."""
    module = sys.modules.get(f"pymantaray.apps.{application}.command")
    return set(getattr(module, "COMMANDS", ()))


@pytest.mark.parametrize(
    "application",
    [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in ALL],
)
def test_deleting_a_folder_deletes_the_application(application, tmp_path):
    """With it go those that import it; public names, help, commands and reference remain."""
    every, gone = set(commands()), users_of(application)
    copy_without(gone, tmp_path)
    done = python(USE, cwd=tmp_path, environment={"PYTHONPATH": str(tmp_path / "src")})
    left = set(done.stdout.partition("\n")[0].split(","))
    assert left == every - set().union(*map(commands_of, gone)), done.stderr
    assert "Usage: mantaray" in done.stdout, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("kept", [["study"], sorted({*ALL} - users_of("study"))], ids=str)
def test_all_other_tests_are_collected_without_applications(kept, tmp_path):
    copy_without({*ALL} - {*kept}, tmp_path, tests=True)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "tests"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": f"{tmp_path / 'src'}:{tmp_path / 'tests'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert "tests/acoustics/test_eigenrays.py" in done.stdout


def test_summaries_are_the_help_of_the_commands():
    """They are read from sources, without an import."""
    whole = tree().commands
    assert {name: one.help for name, one in summaries().items()} == {
        name: command.help for name, command in whole.items()
    }
    groups = {name for name, command in whole.items() if hasattr(command, "commands")}
    assert {name for name, one in summaries().items() if one.is_group} == groups


def test_a_first_word_has_the_commands_of_its_applications_only():
    assert set(commands("export")) == {"export"}
    assert {name.split()[0] for name in commands("rays")} == {"rays"}
    assert commands("no such word").keys() == commands().keys()


def test_commands_of_applications_have_different_names():
    names = [name for path in sorted(PACKAGE.glob("apps/*")) for name in commands_of(path.name)]
    assert sorted(names) == sorted(commands())


STATE = {
    "version": "1.2.3",
    "folder": "there",
    "python": "3.11.7, python",
    "platform": "Linux",
    "packages": [
        {"name": "numpy", "version": "2.1", "needs": ">=2", "fault": ""},
        {"name": "nosuch", "version": None, "needs": ">=1", "fault": "is not installed"},
    ],
    "extras": [
        {"name": "more", "missing": ["one>=2", "two"], "install": "pip install more"},
        {"name": "all", "missing": [], "install": "pip install all"},
    ],
    "folders": [
        {"use": "figures", "folder": "pictures", "writable": True, "remedy": ""},
        {"use": "temporary files", "folder": "tmp", "writable": False, "remedy": "set TMPDIR"},
    ],
    "kernels": {"compiled": 17, "all": 40},
    "processors": {"cores": 8, "usable_cores": 6, "memory_gib": 31.4},
    "faults": ["nosuch: is not installed", "tmp: not writable"],
}


@pytest.mark.parametrize("faults", [True, False])
@pytest.mark.parametrize("words", [(), ("--compile",)], ids=["report", "compile"])
def test_every_option_reaches_the_doctor(mantaray, monkeypatch, as_stored, faults, words):
    state = STATE | {"faults": STATE["faults"] if faults else []}
    found = [state | {"kernels": {"compiled": 5, "all": 40}}, state] if words else [state]
    answers, used, clock = [*found, *found], [], iter([3.0, 45.25, 3.0, 45.25])
    monkeypatch.setattr("pymantaray.installation.installation", lambda: answers.pop(0))
    monkeypatch.setattr("pymantaray.apps.doctor.command._use_kernels", lambda: used.append(1))
    monkeypatch.setattr("time.process_time", lambda: next(clock))
    done = mantaray("doctor", *words)
    assert done.code == int(faults)
    as_stored(done.out.splitlines())
    told = mantaray("doctor", *words, "--json")
    assert told.code == int(faults)
    compiled = {"compiled_now": 12, "compile_s": 42.2} if words else {}
    assert json.loads(told.out) == compiled | state
    assert len(used) == 2 * len(words)


def test_every_option_reaches_the_kernels(monkeypatch, as_stored):
    from pymantaray.apps.doctor.command import _use_kernels
    from pymantaray.config import load_study

    given = []

    def instead(name):
        return lambda *a, **k: given.append((name, *a, k)) or name

    for name in ("find_eigenrays", "ray_picture", "trace_paths"):
        monkeypatch.setattr(f"pymantaray.acoustics.{name}", instead(name))
    monkeypatch.setattr("pymantaray.apps.study.run_study", instead("run_study"))
    _use_kernels()
    rays, studies = given[:-2], given[-2:]
    as_stored([call[:1] + call[2:] for call in rays])
    as_stored(rays[0][1], without="lut|knots|nodes", name="medium")
    for (_, config, folder, options), name in zip(studies, ("quick", "survey"), strict=True):
        assert config == load_study(name, realizations=1)
        assert folder.name == name
        assert not folder.parent.exists()
        assert options == {"workers": 1}
