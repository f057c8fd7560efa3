"""
A study that was interrupted goes on where it was, and its results are those of one that was not.
"""

import errno
import os
import pickle
import subprocess
import sys
import time
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from pymantaray.apps.study import open_run, run_study, runner
from pymantaray.apps.study.realization import RealizationResult, RealizationSolver
from pymantaray.apps.study.store import Run
from pymantaray.config import load_study
from pymantaray.errors import JobError, WriteError
from pymantaray.estimation import UnknownsEstimate
from pymantaray.jobs import checkpoint
from pymantaray.records import SolveStatus

DATA = ("estimates", "covariances", "measurements", "truth", "arrivals", "ranging_truth", "links")


@pytest.fixture(scope="session")
def tiny(tiny):
    """Configuration with two conditions and other sections: more of them take only longer."""
    return lambda **sections: tiny(**{"conditions": ["odometry", "straight"]} | sections)


@pytest.fixture
def at_once(monkeypatch):
    """Keep everything as soon as it is done."""
    monkeypatch.setattr(checkpoint, "_SAVE_INTERVAL", 0.0)


@pytest.fixture
def solved(monkeypatch):
    """Realizations that are solved in this process."""
    numbers, solve = [], RealizationSolver.solve

    def count(self, number):
        numbers.append(number)
        return solve(self, number)

    monkeypatch.setattr(RealizationSolver, "solve", count)
    return numbers


def interrupted(config, out, after):
    """Run until so many realizations are solved."""

    def stop(stage, done, _total):
        if stage == "realizations" and done == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(config, out, workers=1, progress=stop)


@pytest.fixture(scope="session")
def undisturbed(once, tiny):
    """Run of three realizations that was not interrupted."""
    config = tiny(study={"realizations": 3})
    return open_run(once("undisturbed", lambda folder: run_study(config, folder, workers=1)))


def same(one, other):
    """Whether all data of two runs are equal to the last digit."""
    for name in DATA:
        a, b = (getattr(run, name).to_dataset() for run in (one, other))
        assert a.identical(b), name
    assert one.manifest["outcome"] == other.manifest["outcome"]
    names = [
        {str(path.relative_to(run.path)) for path in run.path.rglob("*")} for run in (one, other)
    ]
    assert names[0] == names[1]


def test_the_same_call_goes_on_with_what_was_done(
    tiny, at_once, solved, monkeypatch, undisturbed, tmp_path, caplog
):
    config, out = tiny(study={"realizations": 3}), tmp_path / "run"
    interrupted(config, out, 2)
    assert solved == [0, 1]
    assert [path.name for path in tmp_path.iterdir()] == ["run.unfinished"]
    assert "2 realizations are saved in " in caplog.text
    told = []
    with monkeypatch.context() as patch:
        patch.setattr(runner, "simulate_mission", None)  # is not called again
        run = run_study(config, out, workers=1, progress=lambda *counts: told.append(counts))
    assert solved == [0, 1, 2]
    assert [done for stage, done, _ in told if stage == "realizations"] == [2, 3]
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    same(run, undisturbed)


def test_a_full_disk_is_told_and_nothing_is_said_to_be_there(
    tiny, at_once, monkeypatch, tmp_path, caplog
):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(checkpoint, "_link", full)
    with pytest.raises(WriteError, match="No space left"):
        run_study(tiny(), tmp_path / "run", workers=1)
    assert "not all results could be saved" in caplog.text
    assert "are saved in" not in caplog.text


@pytest.mark.slow
def test_workers_go_on_as_well(tiny, at_once, undisturbed, tmp_path):
    config, out = tiny(study={"realizations": 3}), tmp_path / "run"
    interrupted(config, out, 1)
    same(run_study(config, out, workers=2), undisturbed)


@pytest.mark.slow
def test_what_another_configuration_left_is_not_taken(tiny, at_once, solved, tmp_path):
    out = tmp_path / "run"
    interrupted(tiny(study={"realizations": 3}), out, 2)
    other = tiny(study={"realizations": 2, "seed": 7})
    interrupted(other, out, 1)
    assert len(list((tmp_path / "run.unfinished").iterdir())) == 1
    run = run_study(other, out, workers=1)
    assert solved == [0, 1, 0, 1]
    assert run.config.study.seed == 7
    assert not (tmp_path / "run.unfinished").exists()


class Harmful:
    """Leaves a file where it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


@pytest.mark.parametrize("content", [pytest.param("cut", marks=pytest.mark.slow), "pickle"])
def test_a_damaged_realization_is_discarded_and_solved_again(
    tiny, at_once, solved, undisturbed, tmp_path, caplog, content
):
    config, out = tiny(study={"realizations": 3}), tmp_path / "run"
    interrupted(config, out, 2)
    (path,) = (tmp_path / "run.unfinished").glob("*/0.nc")
    whole = path.read_bytes()
    path.write_bytes(
        whole[: len(whole) // 2] if content == "cut" else pickle.dumps(Harmful(tmp_path / "harmed"))
    )
    path.with_name("9.nc").write_bytes(whole)  # of no realization
    path.with_name("notes.nc").write_bytes(b"mine")
    run = run_study(config, out, workers=1)
    assert solved == [0, 1, 0, 2]
    assert "0.nc: damaged: its content does not have its checksum; removed" in caplog.text
    assert not (tmp_path / "harmed").exists()
    same(run, undisturbed)


@pytest.mark.parametrize("damage", [pytest.param("gone", marks=pytest.mark.slow), "sums"])
def test_a_damaged_mission_is_discarded_and_simulated_again(
    tiny, at_once, solved, undisturbed, tmp_path, caplog, damage
):
    config, out = tiny(study={"realizations": 3}), tmp_path / "run"
    interrupted(config, out, 1)
    (own,) = (tmp_path / "run.unfinished").iterdir()
    truth = own / "stage" / "truth.nc"
    if damage == "gone":
        truth.unlink()
    else:
        path = own / "stage.json"
        path.write_bytes(path.read_bytes()[:-9])
    mine = own.with_name("notes.txt")
    mine.write_text("mine")
    run = run_study(config, out, workers=1)
    assert solved == [0, 0, 1, 2]
    assert [path.read_text() for path in own.parent.iterdir()] == ["mine"], "the user's file stays"
    assert "damaged: wrong checksums; removed and computed again" in caplog.text
    same(run, undisturbed)


def test_a_checkpoint_beside_a_finished_run_is_removed(tiny, tmp_path):
    """A stop at the very end of a run leaves it."""
    out = tmp_path / "run"
    saved = tmp_path / "run.unfinished" / ("a" * 64)
    for folder in (out, saved):
        folder.mkdir(parents=True)
    (out / "manifest.json").touch()
    with pytest.raises(JobError, match="folder is not empty"):
        run_study(tiny(), out, workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_realization_is_kept_to_the_last_digit(tiny, tmp_path):
    """With covariances, with unknowns, and solves that failed or did not converge."""
    run = run_study(tiny(study={"realizations": 1}, landmarks=[]), tmp_path / "run", workers=1)
    one = RealizationSolver.of(run).solve(0)
    failed = replace(
        one.solutions["straight"],
        status=SolveStatus.FAILED,
        covariances=None,
        final_cost=float("nan"),
        unknowns=UnknownsEstimate(
            ("a b", "c"), ("s", "1"), np.ones(2), np.array([0.1, -0.0]), np.eye(2) / 3.0
        ),
    )
    unconverged = replace(failed, last_point=one.solutions["straight"].values)
    one = RealizationResult(
        {**one.solutions, "of / two": failed, "last": unconverged},
        {"of / two": {"a b": 0.1, "c": 1.0 / 3.0}},
    )
    two = RealizationResult.from_bytes(one.to_bytes())
    assert two.true_unknowns == one.true_unknowns
    assert list(two.solutions) == list(one.solutions)

    def leaves(value):
        if is_dataclass(value):
            value = [getattr(value, f.name) for f in fields(value)]
        return (
            [leaf for v in value for leaf in leaves(v)]
            if isinstance(value, (list, tuple))
            else [value]
        )

    for name, solution in one.solutions.items():
        for a, b in zip(leaves(solution), leaves(two.solutions[name]), strict=True):
            assert type(a) is type(b)
            np.testing.assert_array_equal(a, b)
            assert getattr(a, "dtype", None) == getattr(b, "dtype", None)


def test_a_short_study_leaves_nothing(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(
        checkpoint, "_SAVE_INTERVAL", 3600.0
    )  # short beside this, however busy the machine is
    interrupted(tiny(study={"realizations": 2}), tmp_path / "run", 1)
    assert not list(tmp_path.iterdir())


def test_a_study_whose_folder_nobody_named_leaves_nothing(tiny, at_once, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    interrupted(tiny(study={"realizations": 2}), None, 1)
    assert not list(tmp_path.iterdir())


REALIZATIONS = 16
RUN = f"""
import sys
from pymantaray.jobs import checkpoint
from pymantaray.apps.study import run_study
from pymantaray.config import load_study
checkpoint._SAVE_INTERVAL = 0.0
run_study(load_study(sys.argv[1], realizations={REALIZATIONS}), sys.argv[2], workers=2)
"""


def begin(file, out):
    return subprocess.Popen([sys.executable, "-c", RUN, file, out], stderr=subprocess.PIPE)


def kept(folder):
    return {path.name for path in folder.glob("run.unfinished/*/*.nc")}


@pytest.mark.slow
def test_kill_minus_nine_at_any_moment_loses_no_realization(tmp_path):
    out, rng, there = tmp_path / "run", np.random.default_rng(11), set()
    for _ in range(3):
        process = begin("quick", out)
        while process.poll() is None and len(kept(tmp_path)) <= len(there):
            time.sleep(0.02)
        time.sleep(rng.uniform(0.0, 0.3))
        process.kill()
        process.communicate()
        assert not out.exists()
        assert kept(tmp_path) > there
        there = kept(tmp_path)
    config = load_study("quick", realizations=REALIZATIONS)
    assert len(there) < REALIZATIONS
    same(*(run_study(config, tmp_path / name, workers=1) for name in ("run", "undisturbed")))
    assert {path.name for path in tmp_path.iterdir()} == {"run", "undisturbed"}


def test_a_run_without_a_manifest_has_the_files_that_are_there(tmp_path):
    run = Run(tmp_path)
    assert not run.has_file("estimates.nc")
    (tmp_path / "estimates.nc").touch()
    assert run.has_file("estimates.nc")
