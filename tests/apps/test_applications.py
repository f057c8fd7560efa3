"""An application is a folder: without it, its command is gone and everything else is there."""

import shutil
import sys
from pathlib import Path

import pytest
from factories import python

import pymantaray
from pymantaray.apps import commands

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


def test_commands_of_applications_have_different_names():
    names = [name for path in sorted(PACKAGE.glob("apps/*")) for name in commands_of(path.name)]
    assert sorted(names) == sorted(commands())
