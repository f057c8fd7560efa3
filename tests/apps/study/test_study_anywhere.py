"""
A study runs wherever Python does: from standard input, in a thread, at the prompt, in a notebook;
with workers, without a guard.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from factories import python

from pymantaray.apps.study import open_run

STATEMENTS = """\
from factories import TINY
from pymantaray.apps.study import run_study
from pymantaray.config import parse_study
run = run_study(parse_study(TINY, "tiny"), "run", workers=2)
print(run.estimates.position.shape)
"""
IN_A_THREAD = f"""\
import threading
def work():
    exec({STATEMENTS!r}, {{}})

thread = threading.Thread(target=work)
thread.start()
thread.join()
"""
# eleven vehicles: the 110 ranges of a ping are enough for a product to be shared by threads
QUICK = """\
import sys
from pymantaray.apps.study import run_study
from pymantaray.config import load_study
run_study(load_study("quick"), sys.argv[1], workers=1)
"""
TESTS = str(Path(__file__).parents[2])


def check(folder, tiny_run_folder):
    """The run is that of one process."""
    ours, theirs = (open_run(path).estimates.position for path in (folder / "run", tiny_run_folder))
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "text"), [
        pytest.param((), IN_A_THREAD, id="thread, from standard input"),
        pytest.param(("-i", "-q"), STATEMENTS, id="prompt"),
])  # fmt: skip
def test_a_study_with_workers_runs_from(tmp_path, tiny_run_folder, options, text):
    done = subprocess.run(
        [sys.executable, *options, *([] if options else ["-"])],
        input=text,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": TESTS},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{open_run(tmp_path / 'run').estimates.position.shape}\n", done.stderr
    check(tmp_path, tiny_run_folder)


@pytest.mark.slow
def test_threads_of_the_linear_algebra_change_no_digit(tmp_path):
    for threads in ("1", "3"):
        done = python(
            QUICK,
            threads,
            environment={"PYTHONPATH": TESTS, "OPENBLAS_NUM_THREADS": threads},
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
    for name in ("estimates.nc", "covariances.nc"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "3" / name).read_bytes(), name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_study_with_workers_runs_in_a_notebook(tmp_path, tiny_run_folder, monkeypatch):
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("PYTHONPATH", TESTS)
    cells = [nbformat.v4.new_code_cell(text) for text in (STATEMENTS, "run", "run.arrivals")]
    notebook = nbformat.v4.new_notebook(cells=cells)
    NotebookClient(notebook, resources={"metadata": {"path": str(tmp_path)}}, timeout=600).execute()
    check(tmp_path, tiny_run_folder)
    run, arrivals = (cell.outputs[0].data["text/html"] for cell in notebook.cells[1:])
    assert "Run of tiny" in run
    assert "travel_time" in arrivals
