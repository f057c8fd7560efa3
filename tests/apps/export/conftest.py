"""A run, and one realization of it as exported files."""

import pytest

from pymantaray.apps.export import export_run
from pymantaray.apps.study import open_run

REALIZATION = 1  # that the tests compare


@pytest.fixture(scope="module")
def run(tiny_run_folder):
    return open_run(tiny_run_folder)


@pytest.fixture
def exported(run, tmp_path):
    return lambda to: export_run(run, to, tmp_path / "out", realization=REALIZATION)
