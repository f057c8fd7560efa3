"""The command `mantaray export`."""

import re

import pandas as pd
from factories import names_in

from pymantaray.study import open_run
from pymantaray.study.export import FORMATS


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
        "error: export: unknown format 'ply'; allowed: tum, kitti, cf, csv, parquet, g2o, pyfg, rrd, mcap, bag\n"
    )
    again = mantaray("export", tiny_run_folder, "--to", "csv", "--out", tmp_path / "tables")
    assert again.code == 2
    assert len(again.err.splitlines()) == 1
    assert names_in(tmp_path) == ["tables"]
