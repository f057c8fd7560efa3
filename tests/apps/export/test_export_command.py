"""The command `mantaray export`."""

import re
from pathlib import Path

import pandas as pd
import pytest
from factories import names_in

from pymantaray.apps.export.run_files import FORMATS
from pymantaray.apps.study import open_run


def test_help_has_every_format(mantaray):
    words = re.findall(r"[a-z0-9]+", mantaray("export", "--help").out)
    assert set(FORMATS) <= set(words)


def test_export_names_what_it_made_and_refuses_in_one_line(mantaray, tiny_run_folder, tmp_path):
    done = mantaray(
        "export", tiny_run_folder, "--to", "csv", "--out", tmp_path / "tables", "--realization", 1
    )
    assert (done.code, done.out) == (0, f"{tmp_path / 'tables'}\n")
    ranges = pd.read_csv(tmp_path / "tables" / "ranges.csv", dtype=str)["straight_range_m"]
    assert [*map(float, ranges)] == open_run(tiny_run_folder).ranges(1)["straight_range"].tolist()
    refused = mantaray("export", tiny_run_folder, "--to", "ply", "--out", tmp_path / "other")
    assert refused.code == 2
    assert refused.err == (
        "error: export: unknown format 'ply'; allowed: tum, kitti, cf, csv, parquet, g2o, pyfg,"
        " rrd, mcap, bag, vtk, kml, geojson, mat\n"
    )
    for option, given in (("to", ("--out", tmp_path / "other")), ("out", ("--to", "csv"))):
        done = mantaray("export", tiny_run_folder, *given)
        assert (done.code, f"Missing option '--{option}'" in done.err) == (2, True)
    again = mantaray("export", tiny_run_folder, "--to", "csv", "--out", tmp_path / "tables")
    assert again.code == 2
    assert len(again.err.splitlines()) == 1
    assert names_in(tmp_path) == ["tables"]


def test_every_option_reaches_the_export(reached, mantaray, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    words = ("export", "run", "--to", "tum", "--out", "new", "--realization", 3)
    given = reached("pymantaray.apps.export.export_run", *words)
    assert (given[0], given[2]) == (Path("run"), Path("new"))
    monkeypatch.setattr(
        "pymantaray.apps.export.export_run", lambda run, to, out, **more: f"{run} {to} {out} {more}"
    )
    assert mantaray(*words[:-2]).out == "run tum new {'realization': 0}\n"
    gone = mantaray("export", "gone", *words[2:])
    assert gone.err == "error: gone: no such file or folder; name an existing file or folder\n"


@pytest.mark.parametrize(("words", "said"), [
    (("run", "--to", "tum", "--out", "x"), "run: no such file or folder"),
    (("run", "quick", "--to", "tum", "--out", "x"), "Got unexpected extra argument(s) (quick)"),
    (("run", "--out", "x"), "Missing option '--to'; see"),
    (("run", "--to", "tum"), "Missing option '--out'; see"),
])  # fmt: skip
def test_words_that_export_does_not_take_are_refused(mantaray, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    done = mantaray("export", *words)
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert said in done.err
    assert names_in(tmp_path) == []
