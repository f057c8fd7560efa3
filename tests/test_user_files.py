"""Files of a user: regular files up to a limit, and one line for every other path."""

import os
import re
import time
from pathlib import Path

import pytest
from refusals import refused

from pymantaray.acoustics import read_profile
from pymantaray.apps.graphs.external import open_graph
from pymantaray.apps.locate import read_survey
from pymantaray.apps.online import OnlineEstimator
from pymantaray.apps.sweep import load_sweep
from pymantaray.apps.table import open_table
from pymantaray.config import load_study
from pymantaray.errors import MantaRayError, RecordError
from pymantaray.exchange import read_trajectories
from pymantaray.ocean import open_ocean, open_sea_floor
from pymantaray.user_files import (
    first_bytes,
    matching_files,
    open_text,
    parse_toml,
    read_bytes,
    read_text,
    shown,
)

READERS = {
    "profile": (read_profile, ".csv"),
    "graph": (open_graph, ".pyfg"),
    "g2o": (open_graph, ".g2o"),
    "tum": (read_trajectories, ".tum"),
    "table of tracks": (read_trajectories, ".csv"),
    "trajectory in NetCDF": (read_trajectories, ".nc"),
    "survey": (read_survey, ".csv"),
    "survey of GARPOS": (read_survey, ".ini"),
    "survey of GNATSS": (read_survey, ".yaml"),
    "ocean": (open_ocean, ".nc"),
    "sea floor": (open_sea_floor, ".nc"),
    "table": (open_table, ".table"),
    "state": (lambda path: OnlineEstimator.restore(path, None), ".json"),
    "study": (load_study, ".toml"),
    "sweep": (load_sweep, ".toml"),
}


def _paths(folder, suffix):
    """Names of every kind that is not a regular file."""
    pipe = folder / f"pipe{suffix}"
    os.mkfifo(pipe)
    (folder / f"link{suffix}").symlink_to("/dev/zero")
    (folder / f"folder{suffix}").mkdir()
    (folder / f"loop{suffix}").symlink_to(folder / f"loop{suffix}")
    return [
        pipe,
        folder / f"link{suffix}",
        folder / f"folder{suffix}",
        folder / f"loop{suffix}",
        folder / f"none{suffix}",
        folder / ("x" * 300 + suffix),
        folder / f"a\0b{suffix}",
        folder / f"\x1b[31m\udcff{suffix}",
        Path("/dev/zero"),
    ]


@pytest.mark.parametrize("kind", READERS)
def test_readers_refuse_all_but_regular_files(tmp_path, kind):
    read, suffix = READERS[kind]
    for path in _paths(tmp_path, suffix):
        begin = time.monotonic()
        with pytest.raises(MantaRayError) as caught:
            read(path)
        assert time.monotonic() - begin < 20.0, path
        line = str(caught.value)
        assert line.isprintable() or "\udcff" in line, line
        assert "\x1b" not in line
        assert len(line) < 700, line


def test_a_file_that_grows_or_has_no_size_is_read_to_the_limit(tmp_path):
    (tmp_path / "a").write_bytes(b"x" * 100)
    assert read_bytes(tmp_path / "a", RecordError, limit=100) == b"x" * 100
    refused(RecordError, "more than 99 bytes", read_bytes, tmp_path / "a", RecordError, limit=99)
    with (
        pytest.raises(RecordError, match="more than 99 bytes"),
        open_text(tmp_path / "a", RecordError, limit=99),
    ):
        pass
    if Path("/proc/self/status").exists():  # a regular file with a size of 0
        refused(
            RecordError,
            "more than 99 bytes",
            read_bytes,
            "/proc/self/status",
            RecordError,
            limit=99,
        )
    assert first_bytes(tmp_path / "a", 3) == b"xxx"
    assert first_bytes("/dev/zero", 3) == first_bytes(tmp_path / "none", 3) == b""
    (tmp_path / "a").write_bytes(b"\xff\xfea")
    refused(RecordError, "not UTF-8 text; save it as UTF-8", read_text, tmp_path / "a", RecordError)


def test_toml_keys_have_at_most_a_hundred_parts():
    assert parse_toml("a.b.c = 1\nb = [1.5, 2.5]", "x", RecordError) == {
        "a": {"b": {"c": 1}},
        "b": [1.5, 2.5],
    }
    key = ".".join(["a", '"b.c"', "'d'"] * 20_000)
    for text in (f"{key} = 1", f"[{key}]", f"[[{key}]]", f"x = {{ {key} = 1 }}"):
        refused(
            RecordError,
            "x: not valid TOML: line 1: a key of more than 100 parts",
            parse_toml,
            text,
            "x",
            RecordError,
        )
    parse_toml(f"# {'word' * 300_000}\n", "x", RecordError)


def test_a_pattern_finds_what_glob_finds_and_stops(tmp_path, monkeypatch):
    for name in ("a/b/x.csv", "a/x.csv", "c/x.csv", "x.csv", "c/y.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "a" / "back").symlink_to(tmp_path)
    for pattern in (
        "*",
        "*.csv",
        "**/x.csv",
        "a/**/*.csv",
        "?/x.csv",
        "[ac]/*.csv",
        "x.csv",
        "none",
        "*/none",
    ):
        expected = {p for p in tmp_path.glob(pattern) if "back" not in p.parts or pattern == "*"}
        assert matching_files(pattern, tmp_path, RecordError) == sorted(expected), pattern
        absolute = str(tmp_path / pattern)
        assert matching_files(absolute, Path(), RecordError) == sorted(expected), pattern
    monkeypatch.setattr("pymantaray.user_files._MAX_SEARCHED", 5)
    refused(
        RecordError, "more than 5 files to search", matching_files, "**/y", tmp_path, RecordError
    )


def test_names_in_messages_are_short_and_printable():
    assert shown("a" * 300) == "a" * 140 + "..." + "a" * 57
    assert shown("a\x1b[2J\n") == r"a\x1b[2J\n"
    assert re.fullmatch(r"x\\x07y", str(MantaRayError("x\x07y")))
