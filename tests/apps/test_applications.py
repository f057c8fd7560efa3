"""An application is a folder: without it, its command is gone and everything else is there."""

import json
import shutil
import sys
from pathlib import Path

import pytest
from factories import python

import pymantaray
from pymantaray.apps import commands, summaries
from pymantaray.cli.main import tree

PACKAGE = Path(pymantaray.__file__).parent
LAST = (
    "atlas",
    "bellhop",
    "doctor",
    "export",
    "locate",
    "online",
    "plan",
    "ranges",
    "replay",
    "service",
)
FAST = ("locate",)
LIST = """
import sys
sys.path.insert(0, {!r})
from pymantaray.apps import commands
from pymantaray.cli.main import tree
print(*sorted(commands()), sep=",")
tree()
"""


def commands_of(application):
    """Names of the commands of an application."""
    module = sys.modules.get(f"pymantaray.apps.{application}.command")
    return set(getattr(module, "COMMANDS", ()))


@pytest.mark.parametrize(
    "application",
    [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in LAST],
)
def test_deleting_a_folder_deletes_the_application(application, tmp_path):
    every = set(commands())
    shutil.copytree(PACKAGE, tmp_path / "pymantaray", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.rmtree(tmp_path / "pymantaray" / "apps" / application)
    done = python(LIST.format(str(tmp_path)), cwd=tmp_path)
    left = set(done.stdout.strip().split(","))
    assert left == every - commands_of(application), done.stderr


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
