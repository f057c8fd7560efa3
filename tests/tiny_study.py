"""The study `factories.TINY`, its run, and runs of it with other sections."""

import copy

import pytest
from factories import TINY, changed

from pymantaray.config import parse_study
from pymantaray.config.door.study import build_study


@pytest.fixture(scope="session")
def tiny():
    """Configuration of TINY with other sections."""
    return lambda **sections: parse_study(changed(copy.deepcopy(TINY), sections), "tiny")


@pytest.fixture(scope="session")
def tiny_config(tiny):
    return tiny()


@pytest.fixture(scope="session")
def tiny_run(tiny_run_folder):
    from pymantaray.apps.study import open_run

    return open_run(tiny_run_folder)


@pytest.fixture(scope="session")
def run_tiny(tiny, tmp_path_factory):
    """Run TINY with other sections, in a folder of its own."""
    from pymantaray.apps.study import run_study

    def run(workers=1, **sections):
        return run_study(tiny(**sections), tmp_path_factory.mktemp("run") / "tiny", workers=workers)

    return run


@pytest.fixture(scope="session")
def fly_tiny(tiny):
    """The mission of TINY with other sections, and as a run without estimates."""
    from pymantaray.apps.study.manifest import Stopwatch
    from pymantaray.apps.study.mission import simulate_mission
    from pymantaray.apps.study.store import run_in_memory

    def fly(**sections):
        config = tiny(**sections)
        mission = simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
        return mission, run_in_memory(build_study(config), mission)

    return fly
