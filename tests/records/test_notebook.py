"""
What a notebook shows of results: short, with the numbers of the tables, and no markup of a user's.
"""

import re

import pandas as pd

from pymantaray.apps.study import open_run
from pymantaray.ocean import check_ocean
from pymantaray.records.result_table import ResultTable, notebook_html


def cells(html):
    return re.findall(r"<t[dh]>(.*?)</t[dh]>", html)


def test_a_run_shows_its_errors(tiny_run_folder):
    run = open_run(tiny_run_folder)
    html = run._repr_html_()
    assert "Run of tiny" in html
    assert f"folder: {tiny_run_folder}" in html
    assert "synthetic" in html
    errors = run.tables["ate_pooled"].short()
    rmse = [head.text for head in errors.heads].index("RMSE [m]")
    for row in errors.rows:
        assert row[rmse] in cells(html)
    assert len(html) < 12_000


def test_records_show_the_size_unit_and_values_of_each_column(tiny_run_folder):
    run = open_run(tiny_run_folder)
    arrivals = run.arrivals
    shown = cells(arrivals._repr_html_())
    row = shown.index("travel_time")
    times = f"{arrivals.travel_time.min():.6g} to {arrivals.travel_time.max():.6g}"
    assert shown[row + 1 : row + 4] == [f"arrival {arrivals.link.size}", "s", times]
    assert any(cell.endswith(" OK") or " OK," in cell for cell in shown)
    truth = cells(run.truth._repr_html_())
    assert truth[truth.index("name") + 3] == "A, B, C, D"
    for record in (run.measurements, run.ranging_truth, run.estimates, run.links):
        assert len(cells(record._repr_html_())) > 10


def test_findings_of_an_ocean_are_a_table(ocean_file):
    shown = check_ocean(ocean_file)._repr_html_()
    assert "wrong: 0 · doubtful: 1" in shown
    assert "made up" in cells(shown)


def test_a_long_table_is_cut_and_what_is_no_markup_stays_none():
    frame = pd.DataFrame({"<a>": range(100), "x_m": [None, *range(99)]})
    shown = notebook_html("<b>", {"<i>": "&"}, [ResultTable("t", frame, "<u>")])
    assert "the first 24 of 100 rows" in shown
    assert len(cells(shown)) < 60
    assert not set(re.findall(r"</?(\w+)", shown)) & {"b", "i", "u", "a"}
