"""Another package with an entry point, installed for one test."""

import importlib
import shutil
import sys
from importlib.metadata import distributions

import pytest

from pymantaray import entry_points
from pymantaray.apps.study.figures import register as figures

NOTHING = "def measure(scene, noise): return {}\ndef perturb(measurements, normal): return {}\n"
"""Source of a sensor without columns."""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """
    Install a package in a new folder of this process's path, with one module `hostile`; no other is
    found.
    """
    folder = str(tmp_path / "packages")
    # reading the metadata of all that is installed takes longer than a test
    monkeypatch.setattr(entry_points, "distributions", lambda: distributions(path=[folder]))
    figures.find_figures()  # modules register their figures once
    monkeypatch.setattr(figures, "_REGISTER", dict(figures._REGISTER))
    monkeypatch.syspath_prepend(tmp_path / "packages")

    def forget():
        for memory in (entry_points.extensions, entry_points._loaded, entry_points._source_hash):
            memory.cache_clear()
        sys.modules.pop("hostile", None)
        importlib.invalidate_caches()

    def put(source, group="sensors", version="1.0"):
        info = tmp_path / "packages" / "other-1.dist-info"
        info.mkdir(parents=True, exist_ok=True)
        metadata = f"Metadata-Version: 2.1\nName: other\nVersion: {version}\n"
        (info / "METADATA").write_text(metadata)
        (info / "entry_points.txt").write_text(f"[pymantaray.{group}]\nbad = hostile\n")
        (info.parent / "hostile.py").write_text(f"import sys\nimport numpy as np\n{source}")
        shutil.rmtree(info.parent / "__pycache__", ignore_errors=True)
        forget()
        return info.parent

    yield put
    forget()
