"""The command `mantaray export`."""

import re

import pandas as pd
from authors_files import write_simulation
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


def test_export_authors_takes_a_study_or_a_run_and_import_reads_it(mantaray, tmp_path):
    write_simulation(tmp_path)
    done = mantaray("study", "import", tmp_path / "sim.json", "--out", tmp_path / "study.toml")
    assert done.code == 0
    assert "without meaning here: output_dir" in done.err
    assert "output_dir" in (tmp_path / "study.toml").read_text()
    run = tmp_path / "run"
    words = ("--realizations", 1, "--no-figures", "--out", run)
    assert mantaray("study", "run", tmp_path / "study.toml", *words).code == 0
    for source, folder in ((tmp_path / "study.toml", "one"), (run, "two")):
        done = mantaray("export", "authors", source, tmp_path / folder)
        assert (done.code, done.out) == (0, f"{tmp_path / folder}\n"), done.err
        assert names_in(tmp_path / folder) == ["environment", "environment.json", "sim.json"]
    assert mantaray("study", "import", tmp_path / "two" / "sim.json").code == 0
    refused = mantaray("export", "authors", tmp_path / "study.toml")
    assert (refused.code, "export authors STUDY FOLDER" in refused.err) == (2, True)
