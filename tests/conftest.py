"""Common to all tests: what several folders' tests run once, whatever the number of workers."""

import fcntl
import gc
import hashlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from needs import missing_applications

pytest_plugins = ["command_fixtures", "stored_numbers"]

# the same examples each time, however slow the machine is and whatever was found before
settings.register_profile(
    "tests",
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("tests")

COMPILE = """
from pymantaray.collection import collect_rarely

collect_rarely()

import matplotlib.font_manager  # its first import looks for all fonts, and says so if that is slow

from pymantaray.acoustics import Medium, find_eigenrays

for interpolation in ("smooth", "linear"):
    medium = Medium.from_profile(
        [0.0, 500.0], [1450.0, 1460.0], bottom_depth=500.0, interpolation=interpolation
    )
    find_eigenrays(medium, [[0, 0, 20]], [[900, 0, 50]])
    find_eigenrays(medium, [[0, 0, 20]], [[900, 0, 50]], max_surface_bounces=1)

from tempfile import TemporaryDirectory

from factories import TINY

from pymantaray.apps.study import run_study
from pymantaray.config import parse_study

with TemporaryDirectory() as folder:
    run_study(parse_study(TINY, "tiny"), f"{folder}/run", workers=1)
"""


def pytest_addoption(parser):
    """Numbers of tiny runs are stored instead of compared."""
    parser.addoption("--store-numbers", action="store_true", help="of tests that are run now")


def pytest_configure(config):
    """
    Processes that tests start and interrupt inherit what a shell's background job ignores: Ctrl-C.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if config.getoption("numprocesses", None) and "PYTEST_XDIST_WORKER" not in os.environ:
        # each process of the tests has a processor: threads of OpenBLAS that wait for one take it
        # from others, up to 20 times what they compute (tests/apps/study/test_study_anywhere.py
        # compares numbers of threads)
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Numba makes an error of each type that it tries, in colours
        os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
        # tests start hundreds of interpreters: without bytecode, each of them compiles all that it
        # imports for seconds
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        if "PYMANTARAY_TESTS_COMPILED" not in os.environ:  # once, before there are workers
            path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
            subprocess.run(
                [sys.executable, "-c", COMPILE], check=True, env=os.environ | {"PYTHONPATH": path}
            )


def pytest_ignore_collect(collection_path):
    """A module or folder of tests that needs a deleted application is not collected."""
    is_folder = collection_path.is_dir()
    module = collection_path / "conftest.py" if is_folder else collection_path
    is_there = module.suffix == ".py" and module.is_file()
    return True if is_there and missing_applications(module) else None


def pytest_collection_finish():
    """
    Modules and tests stay until the end: no search for garbage looks at them again. Others are
    rare: arrays and figures go without them.
    """
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


@pytest.fixture(scope="session", autouse=True)
def one_sound_speed_of_each_water():
    """
    TEOS-10 on a grid is evaluated once for the same values: hundreds of studies have one ocean, and
    it is half of their time.
    """
    from pymantaray.ocean.equations import EQUATIONS

    own, known = EQUATIONS["teos-10"], {}

    def sound_speed(*water):
        arrays = [np.asarray(values) for values in water]
        if arrays[0].size < 3000:
            return own.sound_speed(*water)
        digest = hashlib.blake2b()
        for values in arrays:
            digest.update(f"{values.shape} {values.dtype}".encode())
            digest.update(values.tobytes())
        key = digest.digest()
        if key not in known:
            if len(known) == 40:
                known.clear()
            known[key] = own.sound_speed(*water)
        return known[key].copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EQUATIONS, "teos-10", own._replace(sound_speed=sound_speed))
        yield


@pytest.fixture(scope="session")
def once(tmp_path_factory, worker_id) -> Callable[[str, Callable[[Path], None]], Path]:
    """Make a folder or file of this name by a function that is called once for all workers."""
    root = tmp_path_factory.getbasetemp()
    if worker_id != "master":
        root = root.parent

    def make(name: str, build: Callable[[Path], None]) -> Path:
        path = root / "once" / name
        path.parent.mkdir(exist_ok=True)
        with path.with_name(f".{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                build(path)
        return path

    return make


@pytest.fixture(scope="session")
def tiny_run_folder(once) -> Path:
    """Run folder of the study `factories.TINY`, without report; not to be written to."""
    from factories import TINY

    from pymantaray.apps.study import run_study
    from pymantaray.config import parse_study

    return once("tiny", lambda folder: run_study(parse_study(TINY, "tiny"), folder, workers=1))
