"""Run folders: whole or not at all."""

import pytest

from pymantaray.errors import StudyError
from pymantaray.study.store import default_out, point_latest_at, staged_folder


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_folder_takes_its_name_only_at_the_end(tmp_path):
    out = tmp_path / "deep" / "run"
    with staged_folder(out) as stage:
        (stage / "data").write_text("x")
        assert not out.exists()
    assert (out / "data").read_text() == "x"
    assert names_in(out.parent) == ["run"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_nothing_is_left_behind_on_failure(tmp_path, error):
    def fail():
        with staged_folder(tmp_path / "deep" / "run") as stage:
            (stage / "data").write_text("x")
            raise error

    with pytest.raises(error):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_empty_folder_is_taken_and_a_full_one_refused(tmp_path):
    out = tmp_path / "run"
    out.mkdir()
    with staged_folder(out) as stage:
        (stage / "data").write_text("x")
    assert (out / "data").exists()
    with (
        pytest.raises(StudyError, match="run: folder is not empty; give an empty or a new one"),
        staged_folder(out),
    ):
        pytest.fail("the block must not be entered")
    assert (out / "data").read_text() == "x"


def test_file_in_the_way_is_refused(tmp_path):
    (tmp_path / "run").write_text("mine")
    with pytest.raises(StudyError, match="is a file"), staged_folder(tmp_path / "run"):
        pytest.fail("the block must not be entered")
    with pytest.raises(StudyError, match="cannot be written"), staged_folder(tmp_path / "run" / "below"):
        pytest.fail("the block must not be entered")
    assert (tmp_path / "run").read_text() == "mine"


def test_latest_follows_the_newest_run(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        point_latest_at(tmp_path / name)
        assert (tmp_path / "latest").resolve() == (tmp_path / name).resolve()
    assert names_in(tmp_path) == ["latest", "one", "two"]


def test_default_names_never_collide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = set()
    for _ in range(3):
        out = default_out("quick")
        out.mkdir(parents=True)
        names.add(out)
    assert len(names) == 3
    assert all(name.parent.name == "runs" and name.name.startswith("quick-2") for name in names)
