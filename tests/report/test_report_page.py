"""A whole report in a run folder: tables equal independent computations, the page refers to what is there."""

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pymantaray.errors import MantaRayError, ReportError
from pymantaray.evaluation import comparison_table
from pymantaray.records import RayStatus
from pymantaray.report import write, write_report
from pymantaray.report.figures import Results
from pymantaray.report.page import heading, run_page, show
from pymantaray.study import open_run

FIGURES = {
    "ape_pooled", "dropouts", "error_over_time", "factor_graph", "fleet_layout", "range_error",
    "range_error_split", "ray_picture", "sound_speed",
}  # fmt: skip
TABLES = {
    "ate_difference", "ate_per_agent", "ate_per_realization", "ate_pooled", "dropouts", "range_error",
    "range_error_split", "region", "solves",
}  # fmt: skip
VOID = {"meta", "img", "br"}


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
        self.links += [value for key, value in attrs if key in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def without_drawing(monkeypatch):
    """Let a report be written without its figures, which other tests look at."""
    monkeypatch.setattr(write, "save_figure", lambda *_: None)


@pytest.fixture(scope="module")
def reported(run_folder):
    calls = []
    page = write_report(run_folder, progress=lambda *call: calls.append(call))
    return page, calls


def test_report_has_all_its_parts_and_the_page_refers_to_each(reported, run_folder):
    page, calls = reported
    assert page == run_folder / "index.html"
    for folder, names, kinds in (("figures", FIGURES, ("png", "pdf")), ("tables", TABLES, ("csv",))):
        expected = {f"{name}.{kind}" for name in names for kind in kinds}
        assert {p.name for p in (run_folder / folder).iterdir()} == expected
        assert all(p.stat().st_size > 0 for p in (run_folder / folder).iterdir())
    parsed = Page(page.read_text(encoding="utf-8"))
    assert all((run_folder / link).is_file() for link in parsed.links)
    for name in FIGURES:
        assert f"figures/{name}.png" in parsed.links
        assert (run_folder / f"figures/{name}.png").read_bytes().startswith(b"\x89PNG")
    assert {f"tables/{name}.csv" for name in TABLES} <= set(parsed.links)
    assert [done for _, done, _ in calls] == list(range(10))
    assert not [p for p in run_folder.iterdir() if ".part" in p.name]


def test_page_needs_no_network_and_says_that_the_ocean_is_synthetic(reported):
    text = reported[0].read_text(encoding="utf-8")
    assert not re.search(r"https?://|<script|@import|url\(", text)
    assert "The ocean of this study is synthetic" in text
    assert len(re.findall(r"<figcaption>[^<]*Synthetic ocean\.", text)) == len(FIGURES)


def test_tables_equal_an_independent_computation(reported, run_folder, run):
    def table(name):
        return pd.read_csv(run_folder / "tables" / f"{name}.csv")

    truth, o, estimates = run.truth, run.measurements, run.estimates
    errors = np.sqrt(((estimates.position - truth.position) ** 2).sum(-1))
    pooled = table("ate_pooled").set_index("condition")
    for name, e in zip(estimates.condition, errors, strict=True):
        assert pooled.loc[name, "mean_m"] == pytest.approx(e.mean(), rel=1e-12)
        assert pooled.loc[name, "p75_m"] == pytest.approx(np.quantile(e, 0.75), rel=1e-12)
    agents = table("ate_per_agent").set_index(["condition", "agent"])
    assert agents.loc[("straight", "B"), "rmse_m"] == pytest.approx(np.sqrt((errors[1, :, 1] ** 2).mean()))
    own = errors.mean(axis=(2, 3))
    difference = table("ate_difference").set_index(["condition", "baseline", "statistic"])
    assert difference.loc[("refracted", "straight", "mean"), "mean_difference_m"] == pytest.approx(
        (own[2] - own[1]).mean()
    )
    lost = o.range_status != RayStatus.OK
    drop = table("dropouts").set_index("category")
    assert drop.loc["all links", "attempts"] == o.range_status.size
    assert drop.loc["all links", "percent"] == pytest.approx(100.0 * lost.mean())
    station = (o.range_transmitter == 0) | (o.range_receiver == 0)
    assert drop.loc["station-keeping to float", "dropouts"] == (lost & station).sum()
    mean = (o.refracted_range - o.straight_range)[~lost].mean()
    assert table("range_error").set_index("category").loc["all links", "mean_m"] == pytest.approx(mean)
    split = table("range_error_split").query("category == 'all links'").set_index("part")["mean_m"]
    assert split["reference speed"] + split["bending"] == pytest.approx(split["total"])
    solves = table("solves")
    assert len(solves) == estimates.solve_status.size
    assert set(solves["status"]) == {"OK"}
    assert f"{pooled.loc['refracted', 'mean_m']:.2f} m" in reported[0].read_text(encoding="utf-8")


def test_names_are_escaped_everywhere(fakes, tmp_path, monkeypatch):
    evil = "<b>&\"'"
    made = fakes.Made(names=("A", f"B{evil}"), title=f"Sea {evil}", description=f"about {evil}", synthetic=0)
    folder = fakes.run(tmp_path / "run", made)
    without_drawing(monkeypatch)
    text = write_report(folder).read_text(encoding="utf-8")
    parsed = Page(text)  # an unescaped <b> would be left open
    assert "<b>&" not in text
    for word in (f"Sea {evil}", f"about {evil}", f"B{evil}"):
        assert any(word in piece for piece in parsed.text), word
    assert "ynthetic" not in text


def test_zero_ranges_all_dropouts_one_vehicle_and_failed_solves_still_report(
    run, fakes, tmp_path, monkeypatch
):
    lone = fakes.Made(names=("A",), pings=0, realizations=1, conditions=("odometry",), rays=False)
    deaf = fakes.Made(lost=1.0, failed=((1, 0), (1, 1), (1, 2)), rays=False)
    without_drawing(monkeypatch)
    text = write_report(fakes.run(tmp_path / "lone", lone)).read_text(encoding="utf-8")
    assert "0 of 0" in text
    assert "ray_picture" not in text
    difference = pd.read_csv(tmp_path / "lone" / "tables" / "ate_difference.csv")
    assert len(difference) == 0
    full = comparison_table(run.truth, run.estimates)
    assert list(difference.columns) == list(full.columns)
    text = write_report(fakes.run(tmp_path / "deaf", deaf)).read_text(encoding="utf-8")
    assert "100.0 % dropouts" in text
    assert "Condition straight: 3 of 3 solves have status FAILED." in text


def test_a_report_that_fails_leaves_the_folder_as_it_was(fakes, tmp_path, monkeypatch):
    folder = fakes.run(tmp_path / "run", fakes.Made(realizations=1))
    (folder / "index.html").write_text("the old page")
    before = sorted(p.relative_to(folder) for p in folder.rglob("*"))

    def fail(figure, target, name):
        if name == "factor_graph":
            raise ReportError("disk full")

    monkeypatch.setattr(write, "save_figure", fail)
    with pytest.raises(ReportError, match="disk full"):
        write_report(folder)
    assert sorted(p.relative_to(folder) for p in folder.rglob("*")) == before
    assert (folder / "index.html").read_text() == "the old page"


@pytest.mark.parametrize("before", [False, True])
def test_an_interrupt_while_a_report_is_put_in_place_leaves_all_of_one(fakes, tmp_path, monkeypatch, before):
    folder = fakes.run(tmp_path / "run", fakes.Made(realizations=1))
    without_drawing(monkeypatch)
    if before:
        for name in ("tables", "figures"):
            (folder / name).mkdir()
            (folder / name / "old").touch()
        (folder / "index.html").write_text("old")
    data = {p.name for p in folder.iterdir()}
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
            write_report(folder)
        assert {p.name for p in folder.iterdir()} == data
        if before:
            assert (folder / "index.html").read_text() == "old"
            assert [p.name for name in ("tables", "figures") for p in (folder / name).iterdir()] == [
                "old"
            ] * 2
    left = 0
    write_report(folder)
    assert not (folder / "tables" / "old").exists()
    assert {p.name for p in folder.iterdir()} == data | {"tables", "figures", "index.html"}


def test_a_new_report_replaces_the_old_one(fakes, tmp_path, monkeypatch):
    folder = fakes.run(tmp_path / "run", fakes.Made(realizations=1))
    without_drawing(monkeypatch)
    write_report(folder)
    (folder / "tables" / "stale.csv").write_text("old")
    write_report(folder)
    assert not (folder / "tables" / "stale.csv").exists()


def test_a_folder_that_is_no_run_is_one_clear_line(tmp_path):
    with pytest.raises(MantaRayError, match=r"not a run folder") as caught:
        write_report(tmp_path)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_page_tells_of_a_vehicle_that_stopped(fakes, tmp_path):
    folder = fakes.run(tmp_path / "run", fakes.Made(realizations=1))
    run = open_run(folder)
    status = run.truth.status.copy()
    status[1, 60:] = 1
    run.__dict__["truth"] = type(run.truth)(**{**vars(run.truth), "status": status})
    text = run_page(Results(run), [])
    assert "Vehicle B stopped after 10.0 h: GROUNDED." in text


@pytest.mark.parametrize(
    ("value", "shown"),
    [(4620, "4,620"), (-4.9213, "−4.921"), (np.nan, "–"), (None, "–"), (0.0, "0"), (831875.0, "831,875"),
     (6.0e-5, "6.000e−05"), (True, "yes"), ("A", "A"), (np.int64(-3), "−3")],
)  # fmt: skip
def test_numbers_are_shown_for_people(value, shown):
    assert show(value) == shown


def test_headings_carry_units_in_brackets():
    assert [heading(c) for c in ("mean_m", "p95_m", "start_h", "percent", "final_cost")] == [
        "mean [m]", "95 % [m]", "start [h]", "dropouts [%]", "final cost",
    ]  # fmt: skip
