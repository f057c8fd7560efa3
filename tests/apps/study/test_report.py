"""
A whole report in a run folder: tables equal independent computations, the page refers to what is
there.
"""

import base64
import gzip
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.figure import Figure
from refusals import refused

from pymantaray.apps.study import open_run, write_report
from pymantaray.apps.study.figures import register
from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
from pymantaray.apps.study.page import _first_vehicle, _fleet, citation_of, headlines, run_page
from pymantaray.apps.study.report import StudyReport
from pymantaray.apps.study.tables import TABLES as TABLES_OF_PAGE
from pymantaray.config.settings import key_heading
from pymantaray.errors import MantaRayError, ReportError
from pymantaray.evaluation import comparison_table, dropout_table, error_table, range_error_table
from pymantaray.jobs.folder import staged_parts
from pymantaray.pages import page as page_module
from pymantaray.plotting import drawing as write
from pymantaray.plotting.style import rendered
from pymantaray.records.result_table import ResultTable

OF_THE_PAPER = {
    "ape_pooled",
    "factor_graph",
    "fleet_layout",
    "pipeline",
    "ray_picture",
    "sound_speed",
}
LATER = ("covariances.nc", "estimates.nc", "manifest.json")  # written when realizations are solved
VOID = {"meta", "img", "br", "input", "source"}


class Page(HTMLParser):
    """Checks that tags close in order; collects addresses and text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.links, self.text = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        links = (value for key, value in attrs if key in ("src", "href"))
        self.links += [
            link for link in links if not link.startswith(("data:image/png;base64,", "#"))
        ]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def without_drawing(monkeypatch):
    """Let a report be written without its figures, which other tests look at."""
    monkeypatch.setattr(write, "rendered", lambda _, kinds, **__: dict.fromkeys(kinds, b"drawn"))
    specs = run_figure_specs
    monkeypatch.setattr(
        register,
        "run_figure_specs",
        lambda r, **of: [replace(spec, draw=Figure) for spec in specs(r, **of)],
    )


def empty(figure, kinds, **_):
    """In place of `rendered`: a small PNG of the figure's size; what is in it others look at."""
    page = Figure(figure.get_size_inches())
    return dict.fromkeys(kinds, rendered(page, ("png",), dpi=50.0)["png"])


@pytest.fixture(scope="module", params=[empty])
def reported(request, once, tiny_run_folder):
    """
    Folder of a run with its report, the page's text, and what was told of the progress; not to be
    written to. Its figures are empty unless a test asks for `rendered` itself.
    """

    def report(place):
        calls = []
        shutil.copytree(tiny_run_folder, place / "run")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(write, "rendered", request.param)
            page = write_report(
                place / "run", formats=("pdf", "tex"), progress=lambda *call: calls.append(call)
            )
        assert page == place / "run" / "index.html"
        (place / "calls.json").write_text(json.dumps(calls))

    place = once(f"reported-{request.param.__name__}", report)
    run = open_run(place / "run")
    return SimpleNamespace(
        folder=run.path,
        text=(run.path / "index.html").read_text(encoding="utf-8"),
        calls=json.loads((place / "calls.json").read_text()),
        figures={spec.name for spec in run_figure_specs(RunResults(run))},
        tables=set(run.tables),
    )


def test_report_has_all_its_parts_and_the_page_refers_to_each(reported, tiny_run_folder):
    folder = reported.folder
    assert reported.figures > OF_THE_PAPER
    for parts, names, kinds in (
        ("figures", reported.figures, ("png", "pdf")),
        ("tables", reported.tables, ("csv", "tex")),
    ):
        expected = {f"{name}.{kind}" for name in names for kind in kinds}
        assert {p.name for p in (folder / parts).iterdir()} == expected
        assert all(p.stat().st_size > 0 for p in (folder / parts).iterdir())
    assert "<source " not in reported.text  # layouts for one column are drawn if asked
    assert 'class="keys"' in reported.text  # legends of figures that are moved sideways
    links = Page(reported.text).links
    assert all((folder / link).is_file() for link in links)
    assert {f"figures/{name}.pdf" for name in reported.figures} | {
        f"tables/{name}.csv" for name in reported.tables
    } <= set(links)
    drawn = re.findall(
        r'id="(\w+)"[^>]*>\n(?:<p class="keys">.*\n)?<a .*><img src="[^"]*" width="(\d+)"'
        r' height="(\d+)"',
        reported.text,
    )
    assert len(drawn) == len(reported.figures)
    for name, *size in drawn:
        rows, columns = mpl.image.imread(folder / "figures" / f"{name}.png").shape[:2]
        assert int(size[0]) / int(size[1]) == pytest.approx(columns / rows, rel=0.01)
        assert 400 < int(size[0]) < 1000
    assert [done for _, done, _ in reported.calls] == list(range(len(reported.figures) + 1))
    report = {"figures", "tables", "index.html"}
    assert {p.name for p in folder.iterdir()} == {
        p.name for p in tiny_run_folder.iterdir()
    } | report


def test_tables_for_a_paper_are_those_of_the_page(reported):
    """LaTeX of the page's cells, a row a line; what LaTeX takes for a command is escaped."""
    text = (reported.folder / "tables" / "dropouts.tex").read_text(encoding="utf-8")
    frame = open_run(reported.folder).tables["dropouts"].frame
    body = text[text.index("\\midrule") : text.index("\\bottomrule")]
    rows = [line.removesuffix(r" \\").split(" & ") for line in body.splitlines()[1:]]
    assert [row[0] for row in rows] == frame["category"].tolist()
    assert [int(row[1].replace(",", "")) for row in rows] == frame["attempts"].tolist()
    assert r"dropouts [\%]" in text
    assert r"\label{tab:dropouts}" in text
    for file in (reported.folder / "tables").glob("*.tex"):
        lines = file.read_text(encoding="utf-8").splitlines()
        assert not [line for line in lines if re.search(r"(?<!\\)[%#]|−|²", line)], file.name


def test_a_report_has_figures_for_one_column_if_asked(made_run, tmp_path, monkeypatch):
    folder, told, drawn = made_run(realizations=1).write(tmp_path / "run"), [], []
    without_drawing(monkeypatch)
    render = write.rendered
    monkeypatch.setattr(write, "rendered", lambda *a, **k: drawn.append(a) or render(*a, **k))
    maker = StudyReport(formats=["84mm"])
    assert [*maker.begin(folder)]
    assert maker.write(open_run(folder), lambda *step: told.append(step)) == []
    assert told == [("report", n, len(told) - 1) for n in range(len(told))]
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert re.search(r", 1 noise realization\b", text)
    files = {path.name for path in (folder / "figures").glob("*.pdf")}
    pictures = {path.stem for path in (folder / "figures").glob("*.png")}
    assert files == {f"{name}.84mm.pdf" for name in pictures}
    assert len(pictures) > 10
    assert all(f'href="figures/{name}"' in text for name in files)
    assert all(f'href="figures/{name.partition(".")[0]}.png"' in text for name in files)
    narrow = text.count("<source ")
    assert len(drawn) == len([*(folder / "figures").iterdir()]) + narrow  # each once


def test_an_unknown_format_is_one_clear_line(tmp_path):
    refused(
        ReportError,
        "format 'jpg': unknown; allowed: png, pdf, svg, tex, 84mm",
        write_report,
        tmp_path,
        formats=("jpg",),
    )


def test_costs_are_those_of_the_solves_of_each_condition(reported):
    table = pd.read_csv(reported.folder / "tables" / "costs.csv")
    run = open_run(reported.folder)
    assert table["condition"].tolist() == run.estimates.condition.tolist()
    assert set(table["seed"]) == {run.config.study.seed}
    assert set(table["realizations"]) == {run.config.study.realizations}
    assert (table["cpu_total_s"] > 0.0).all()
    assert (
        table["cpu_total_s"] <= 60.0 * run.manifest["seconds"]["realizations"]
    ).all()  # seconds, no other unit


def test_page_needs_no_network_and_says_that_the_ocean_is_synthetic(reported):
    text = reported.text
    own = text[
        : text.index('<script type="text/plain"')
    ]  # what follows is data and the library that draws it
    assert not re.search(r"https?://|<script|@import|url\(", own)
    assert not re.search(
        r'(src|href)="(?!figures/|tables/|data:image/png;base64,|#|config.toml|manifest.json)', own
    )
    assert "The ocean of this study is synthetic" in text
    assert f" on {open_run(reported.folder).manifest['made']['began'][:10]}." in text
    assert len(re.findall(r"<figcaption>[^<]*Synthetic ocean\.", text)) == len(reported.figures)


def test_tables_are_those_of_the_evaluation_and_the_page_quotes_them(reported):
    run = open_run(reported.folder)
    for name, table in run.tables.items():
        read = pd.read_csv(reported.folder / "tables" / f"{name}.csv")
        frame = (
            table.frame.astype(str) if name == "region" else table.frame
        )  # has numbers and text in a column
        pd.testing.assert_frame_equal(
            read, frame.reset_index(drop=True), check_dtype=False, rtol=1e-12, obj=name
        )
    for shared in (run.bounds, run.degrees_of_freedom):
        assert shared["refracted"] is shared["straight"]
    tables = {name: table.frame for name, table in run.tables.items()}
    assert len(tables["solves"]) == run.estimates.solve_status.size
    for name, expected in (
        ("ate_pooled", error_table(run.truth, run.estimates, freedom=run.degrees_of_freedom)),
        (
            "ate_per_vehicle",
            error_table(run.truth, run.estimates, by=["vehicle"], freedom=run.degrees_of_freedom),
        ),
        ("ate_difference", comparison_table(run.truth, run.estimates)),
        ("dropouts", dropout_table(run.measurements, run.truth)),
        ("range_error", range_error_table(run.measurements, run.ranging_truth, run.truth)),
    ):
        pd.testing.assert_frame_equal(tables[name], expected, obj=name)
    split = tables["range_error_split"].set_index(["category", "part"])["mean_m"]["all links"]
    assert split["reference speed"] + split["bending"] == pytest.approx(split["total"])
    refracted = tables["ate_pooled"].set_index("condition")["mean_m"]["refracted"]
    assert f"{refracted:.2f}\u00a0m" in reported.text, "a number and its unit stay in one line"
    assert re.search("RMSE [\\d.]+\u00a0m(\u00a0±\u00a0[\\d.]+\u00a0m)?; RMSE", reported.text)


def test_a_citation_has_version_commit_and_day_if_the_manifest_has(run):
    entries = {"versions": {"pymantaray": "1.2", "git_commit": "0123456789abcdef"}}
    entries["made"] = {"began": "2025-03-04T05:06:07Z"}
    for of_run, how, year in (
        (entries, "version 1.2, commit 0123456789ab on 2025-03-04", "2025"),
        ({"versions": {}, "made": None}, "version unknown", None),
    ):
        known = SimpleNamespace(study=run.study, manifest=run.manifest | of_run)
        words, bibtex = citation_of([SimpleNamespace(run=known)])
        assert words.endswith(f", made with MantaRay, {how}.")
        assert f"{{{how.partition(' on ')[0]}; study {run.study.name}, seed" in bibtex
        assert year is None or f"year = {{{year}}}" in bibtex


def test_names_are_escaped_everywhere(made_run, tmp_path, monkeypatch):
    evil = "<b>&\"'"
    made = made_run(
        names=("A", f"B{evil}"), title=f"Sea {evil}", description=f"about {evil}", synthetic=0
    )
    folder = made.write(tmp_path / "run")
    without_drawing(monkeypatch)
    text = write_report(folder).read_text(encoding="utf-8")
    parsed = Page(text)  # an unescaped <b> would be left open
    assert "<b>&" not in text
    for word in (f"Sea {evil}", f"about {evil}", f"B{evil}"):
        assert any(word in piece for piece in parsed.text), word
    assert "ynthetic" not in text


def test_a_report_works_without_ranges_and_with_failed_solves(run, made_run, tmp_path, monkeypatch):
    lone = made_run(names=("A",), pings=0, realizations=1, conditions=("odometry",), rays=False)
    deaf = made_run(lost=1.0, failed=((1, 0), (1, 1), (1, 2)), rays=False)
    without_drawing(monkeypatch)
    text = write_report(lone.write(tmp_path / "lone"), formats=["tex"]).read_text(encoding="utf-8")
    assert "0 of 0" in text
    assert "Test Sea: 1 vehicle, " in text
    assert ">no rows</td>" in text  # of the differences between conditions
    assert "ray_picture" not in text
    difference = pd.read_csv(tmp_path / "lone" / "tables" / "ate_difference.csv")
    assert len(difference) == 0
    full = comparison_table(run.truth, run.estimates)
    assert list(difference.columns) == list(full.columns)
    text = write_report(deaf.write(tmp_path / "deaf")).read_text(encoding="utf-8")
    assert "100.0\u00a0% dropouts" in text
    assert "Condition straight: 3 of 3 solves have status FAILED." in text


def test_a_new_report_replaces_the_old_one_or_leaves_it_as_it_was(made_run, tmp_path, monkeypatch):
    folder = made_run(realizations=1).write(tmp_path / "run")
    without_drawing(monkeypatch)
    old = [folder / "figures" / "old.png", folder / "tables" / "old.csv"]
    for file in old:
        file.parent.mkdir()
        file.touch()
    (folder / "index.html").write_text("old")
    before = sorted(folder.rglob("*"))

    def fail(*_, **__):
        raise ReportError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr(write, "rendered", fail)
        refused(ReportError, "disk full", write_report, folder)
    assert sorted(folder.rglob("*")) == before
    assert (folder / "index.html").read_text() == "old"
    write_report(folder)
    assert set(before) - set(folder.rglob("*")) == set(old)
    assert (folder / "index.html").read_text() != "old"


@pytest.mark.slow
@pytest.mark.parametrize("steps", [None, 4, 0], ids=["all", "some", "none"])
@pytest.mark.parametrize("reported", [rendered], indirect=True, ids=["drawn"])
def test_a_report_begun_before_the_estimates_is_the_same(
    reported, tiny_run_folder, tmp_path, steps
):
    """Without PDF, to which the page then does not refer."""
    stage, folder = tmp_path / "stage", tmp_path / "run"
    shutil.copytree(tiny_run_folder, stage)
    later = {p.name: p.read_bytes() for p in map(stage.joinpath, LATER)}
    for name in later:
        (stage / name).unlink()
    maker = StudyReport(formats=())
    for _ in islice(maker.begin(stage), steps):
        pass
    for name, content in later.items():
        (stage / name).write_bytes(content)
    stage.rename(folder)
    assert maker.write(open_run(folder)) == []
    assert_like(folder, reported)


@pytest.mark.slow
@pytest.mark.parametrize("reported", [rendered], indirect=True, ids=["drawn"])
def test_a_report_whose_beginning_fails_is_made_afterwards(reported, tiny_run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(tiny_run_folder, folder)
    maker = StudyReport(formats=())
    assert [*maker.begin(tmp_path / "missing")] == []
    assert maker.write(open_run(folder)) == []
    assert_like(folder, reported)


def assert_like(folder, reported):
    """The report in a folder is one that also has PDF, without it."""
    for path in sorted(
        (*reported.folder.glob("figures/*.png"), *reported.folder.glob("tables/*.csv"))
    ):
        assert (folder / path.relative_to(reported.folder)).read_bytes() == path.read_bytes(), (
            path.name
        )
    assert not list(folder.glob("figures/*.pdf"))
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert text == re.sub(r' <a href="figures/\w+.pdf">PDF</a>', "", reported.text).replace(
        ".pdf", ".png"
    )


def test_figures_of_the_mission_do_not_depend_on_estimates(run):
    """
    Drawn while realizations are solved: all that are not of them must be, or they are seconds later
    on the page.
    """
    mission = {p.name for p in run_figure_specs(RunResults(run), of_mission=True)}
    every = {p.name for p in run_figure_specs(RunResults(run))}
    assert mission >= (OF_THE_PAPER | {"dropouts", "range_error"}) - {"ape_pooled"}
    assert every - mission >= {"ape_pooled", "error_by_vehicle", "error_over_time"}


@pytest.mark.parametrize("before", [False, True])
def test_an_interrupted_report_is_complete_or_absent(tmp_path, monkeypatch, before):
    parts = ("tables", "figures", "index.html")
    (tmp_path / "manifest.json").touch()

    def write(folder, word):
        for name in parts[:2]:
            (folder / name).mkdir()
            (folder / name / word).touch()
        (folder / parts[2]).write_text(word)

    def exchange():
        with staged_parts(tmp_path, parts) as stage:
            write(stage, "new")

    if before:
        write(tmp_path, "old")
    folder = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*"))
    rename, left = Path.rename, 0

    def interrupted(self, target):
        nonlocal left
        left -= 1
        if left == 0:
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", interrupted)
    for step in range(1, 7 if before else 4):
        left = step
        with pytest.raises(KeyboardInterrupt):
            exchange()
        assert sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*")) == folder
        assert not before or (tmp_path / "index.html").read_text() == "old"
    exchange()
    assert {p.name for p in tmp_path.rglob("*")} == {"manifest.json", "new", *parts}


def test_a_folder_that_is_no_run_is_one_clear_line(tmp_path):
    refused(MantaRayError, r"not a run folder", write_report, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_scene_shows_a_sea_floor_on_axes_of_its_own(run):
    finer = np.linspace(-3e4, 3e4, 7)
    own = xr.DataArray(
        finer[:, None] / 100.0 + np.zeros(7) + 900.0, dims=("floor_north", "floor_east")
    )
    ocean = run.ocean.drop_vars("sea_floor_depth").assign_coords(
        floor_north=finer, floor_east=finer
    )
    ocean["sea_floor_depth"] = own
    other = SimpleNamespace(truth=run.truth, ocean=ocean, measurements=run.measurements)
    bed = _fleet(other, np.array([0]))["bed"]
    np.testing.assert_allclose(
        bed["down"], 900.0 + np.array(bed["north"])[:, None] / 100.0 + np.zeros(41), atol=0.51
    )


def test_one_realization_has_no_interval_and_three_have_one(made_run, run, tmp_path):
    one = RunResults(open_run(made_run(realizations=1).write(tmp_path / "run")))
    assert not any("95 %" in remark or "– to –" in remark for _, _, remark in headlines(one))
    assert any("(95 %)" in remark for _, _, remark in headlines(RunResults(run)))


def test_an_rmse_has_its_standard_error_if_that_is_known(run, monkeypatch):
    results = RunResults(run)
    table = results.tables["ate_pooled"].frame
    error = {"odometry": float("nan"), "straight": 0.25, "refracted": 0.5}
    monkeypatch.setitem(table, "rmse_m", 12.5)  # of a run that other tests have too
    monkeypatch.setitem(table, "rmse_standard_error_m", table["condition"].map(error))
    remarks = [
        remark for what, _, remark in headlines(results) if what.startswith("Position error, ")
    ]
    texts = dict(
        zip(table["condition"], (remark.split("; ")[1] for remark in remarks), strict=True)
    )
    assert texts["straight"] == "RMSE 12.50 m ± 0.25 m"
    assert texts["odometry"] == "RMSE 12.50 m"


def test_many_conditions_are_a_table_and_each_word_is_explained(made_run, run, reported, tmp_path):
    conditions = tuple(f"estimator-{i}" for i in range(7))
    many = run_page(
        RunResults(open_run(made_run(conditions=conditions).write(tmp_path / "run"))), "[]"
    ).html()
    few = run_page(RunResults(run), "[]").html()
    assert many.count('class="card"') == 3
    assert all(f"Position error, {name}" in many for name in conditions)
    assert few.count('class="card"') == 3
    assert "Refracted ranges: same graph" in few
    assert "NEES: Normalized estimation error squared" in reported.text
    assert "NEES: Normalized estimation error squared" not in few, "it has no covariances"
    assert "water of 2014-07-15 12:00 UTC, seed 20140715" in few
    assert "Repeat with: mantaray study run config.toml" in few


def numbers(text):
    return {
        float(n.replace("−", "-").replace(",", "")) for n in re.findall(r"[+−]?[\d.,]*\d", text)
    }


def test_the_first_numbers_of_a_page_are_those_of_its_tables(run):
    """Range error, lost ranges and position error, each with its unit and one line of words."""
    results = RunResults(run)
    tables = {name: table.frame for name, table in results.tables.items()}
    links = tables["range_error"].set_index("category").loc["all links"]
    drops = tables["dropouts"].set_index("category").loc["all links"]
    mean = tables["ate_pooled"].set_index("condition")["mean_m"]
    difference = tables["ate_difference"].iloc[0]
    interval = {difference["bootstrap_low_m"], difference["bootstrap_high_m"], 95}
    expected = (
        {links["mean_m"], links["sd_m"]}, {1, 99, links["p1_m"], links["p99_m"]},
        {drops["dropouts"], drops["attempts"]}, {drops["percent"], drops["shadow"]} - {0},
        {difference["pooled_difference_m"]}, {mean["refracted"], mean["straight"]} | interval,
    )  # fmt: skip
    cards = headlines(results)[:3]
    found = [numbers(text) - {0} for card in cards for text in card[1:]]
    for shown, values in zip(found, expected, strict=True):
        assert sorted(shown) == pytest.approx(sorted(values), abs=0.051)
    assert [card.name for card in cards] == [
        "Range error from refraction", "Ranges lost", "Position error from refraction"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("fixes", "expected"),
    [([9, 9, 2], 2), ([9, 3, 0], 1), ([9, 9, 8], 2), ([0, 9, 9], 0), ([9, 9, 9], 0)],
)
def test_menus_begin_with_a_vehicle_that_has_few_fixes(fixes, expected):
    """Not with a beacon that has a fix at every pose."""
    mask = np.arange(9) < np.array(fixes)[:, None]
    assert _first_vehicle(SimpleNamespace(fixes=mask)) == expected


def test_columns_without_values_are_not_on_a_page():
    frame = pd.DataFrame(
        {"name": ["a", "b"], "rmse_m": [1.0, np.nan], "bound_m": np.nan, "note": "", "n": [0, 0]}
    )
    text = page_module.Page("Tables", tables=[ResultTable("t", frame)]).html()
    heads = re.findall(r"<th[^>]*>([^<]+)</th>", text)
    assert heads == ["name", "RMSE [m]", "N"]
    assert ResultTable("t", frame).to_csv().splitlines()[0] == "name,rmse_m,bound_m,note,n"
    empty = page_module.Page("Tables", tables=[ResultTable("t", frame.head(0))]).html()
    assert len(re.findall("<th", empty)) - len(re.findall("<thead", empty)) == 5


def test_page_tells_of_a_vehicle_that_stopped(made_run, tmp_path):
    folder = made_run(realizations=1).write(tmp_path / "run")
    run = open_run(folder)
    status = run.truth.status.copy()
    status[1, 60:] = 1
    run.__dict__["truth"] = type(run.truth)(**{**vars(run.truth), "status": status})
    text = run_page(RunResults(run), "[]").html()
    assert "Vehicle B stopped after 10 h 00 min: GROUNDED." in text


def test_heads_of_columns_fit_two_lines_of_their_numbers(run):
    """A head is broken at spaces; a table of many columns leaves each some ten letters."""
    for name in TABLES_OF_PAGE:
        if name in run.tables:
            for head in run.tables[name].heads:
                assert len(head.text.split()) <= 5, (name, head.text)


def test_headings_of_keys_have_the_units_of_their_descriptions():
    keys = (
        "noise.range_sigma",
        "mission.ping_interval_h",
        "ocean.source",
        "fleet.vehicles.A.depth",
        "sweep.no_such_key",
    )
    assert [key_heading(key) for key in keys] == [
        "noise.range_sigma [m]", "mission.ping_interval_h [h]",
        "ocean.source", "fleet.vehicles.A.depth", "sweep.no_such_key",
    ]  # fmt: skip


def test_numbers_of_all_tables_of_a_run_stay(reported, as_stored):
    tables = open_run(reported.folder).tables
    texts = {"region", "timing", "noise"}
    frames = {name: tables[name].frame for name in tables if name not in {"costs", *texts}}
    as_stored(frames, without="iterations")
    heads = {name: " ".join(head.text for head in tables[name].heads) for name in tables}
    brief = {name: " ".join(head.text for head in tables[name].short().heads) for name in tables}
    as_stored({"heads": heads, "brief": brief}, name="heads")


def test_numbers_of_the_data_and_words_of_a_page_stay(reported, as_stored):
    """The data of its script, and all that is said above its tables."""
    packed = re.findall('<script type="text/plain"[^>]*>(.*?)</script>', reported.text)
    data = json.loads(gzip.decompress(base64.b64decode(packed[0])))
    as_stored(data | {"rays": data["rays"][::9]})
    results = RunResults(open_run(reported.folder))
    (origin,) = (page := run_page(results, "[]")).origin
    assert (origin.caption, origin.file) == ("Manifest", "manifest.json")
    assert page.references == results.run.manifest["references"]
    assert page.links == {"Configuration": "config.toml"}
    captions = {spec.name: spec.caption for spec in run_figure_specs(results)}
    said = {"facts": page.facts, "notes": page.notes, "cards": page.cards, "words": page.words}
    as_stored(said | captions, name="words")
