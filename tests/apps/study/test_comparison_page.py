"""Two runs side by side."""

import json
import re
import shutil
from itertools import count
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pymantaray.apps.study import comparison_page as compare, open_run, write_comparison
from pymantaray.apps.study.comparison_page import (
    by_name,
    comparison_figure_specs,
    comparison_tables,
)
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.config import load_study
from pymantaray.errors import JobError, ReportError
from pymantaray.pages.folder import PAGE
from pymantaray.pages.page import Page
from pymantaray.plotting import drawing as write_module


@pytest.fixture(scope="module")
def other_folder(made_run, tmp_path_factory):
    made = made_run(
        names=("A", "B", "C"), landmarks=1, lost=0.3, title="Other {Sea}", synthetic=0,
        conditions=("straight", "refracted", "no-ranges"),
    )  # fmt: skip
    return made.write(tmp_path_factory.mktemp("other") / "run")


@pytest.mark.slow
def test_comparison_has_tables_figures_and_page(run_folder, other_folder, tmp_path, monkeypatch):
    drawn = count()  # equal figures of missions would be shown once
    monkeypatch.setattr(
        write_module,
        "rendered",
        lambda _, kinds, **__: dict.fromkeys(kinds, f"drawn {next(drawn)}".encode()),
    )
    page = write_comparison([run_folder, other_folder], tmp_path / "both")
    assert page == tmp_path / "both" / "index.html"
    text = page.read_text(encoding="utf-8")
    names = sorted(path.name for path in (tmp_path / "both" / "figures").iterdir())
    joint = [
        "ape_pooled.png",
        "ape_pooled_linear.png",
        "range_error.png",
        "sound_speed.png",
        "pipeline.png",
    ]
    each = [
        f"{name}_{i}.png"
        for name in ("factor_graph", "fleet_layout", "ray_picture")
        for i in (1, 2)
    ]
    assert names == sorted(joint + each)
    assert all(f'href="figures/{name}"' in text for name in names)
    assert text.partition("<script")[0].count('src="data:image/png;base64,') == len(names)
    assert len(list((tmp_path / "both" / "tables").iterdir())) == 10
    assert "Test Sea and Other {Sea}" in text
    assert "Test Sea: The ocean of this study is synthetic" in text
    assert [p.name for p in tmp_path.iterdir()] == ["both"]
    addresses = re.findall(r'<a href="([^"]*)">Run ', text)
    assert [(page.parent / unquote(a)).resolve() for a in addresses] == [
        run_folder.resolve(),
        other_folder.resolve(),
    ]
    assert str(run_folder.parent) not in text
    assert text.count("SHA-256 of config.toml") >= 2
    assert "@software{mantaray," in text


def test_differences_of_runs_with_one_seed_are_paired(made_run, tmp_path, as_stored):
    """By scipy's tests on means that this test forms of the errors itself."""
    runs = {
        name: RunResults(open_run(made_run(("A", "B"), pings=1, **keywords).write(tmp_path / name)))
        for name, keywords in {
            "one": {"realizations": 4, "failed": ((1, 2),)},
            "more": {"realizations": 3, "scale": 2.0},
            "other": {"realizations": 5, "seed": 7},
        }.items()
    }
    means = {
        (name, c): np.array([np.linalg.norm(e, axis=-1).mean() for e in errors])
        for name, r in runs.items()
        for c, errors in zip(
            r.run.estimates.condition.tolist(),
            r.run.estimates.position - r.run.truth.position,
            strict=True,
        )
    }
    table = comparison_tables(runs)["ate_run_difference"].frame
    as_stored(table)
    specs = {spec.name: spec for spec in comparison_figure_specs(runs)}
    as_stored([specs[name].draw() for name in ("ape_pooled", "range_error")], name="of three")
    as_stored({name: spec.caption for name, spec in specs.items()}, name="captions")
    assert list(zip(table["run"], table["baseline"], strict=True))[::3] == [
        ("more", "one"), ("other", "one"), ("other", "more")
    ]  # fmt: skip
    for row in table.to_dict("records"):
        a, b = means[row["run"], row["condition"]], means[row["baseline"], row["condition"]]
        if row["run"] == "more":
            assert (row["paired"], row["realizations"]) == (
                "yes",
                "2" if row["condition"] == "straight" else "3",
            )
            usable = np.isfinite(b[:3])
            a, b = a[usable], b[:3][usable]
            test = stats.ttest_rel(a, b)
        else:
            a, b = a[np.isfinite(a)], b[np.isfinite(b)]
            assert (row["paired"], row["realizations"]) == ("no", f"{a.size} and {b.size}")
            test = stats.ttest_ind(a, b, equal_var=False)
        assert row["difference_m"] == pytest.approx(a.mean() - b.mean())
        assert (row["t_low_m"], row["t_high_m"]) == pytest.approx(test.confidence_interval(0.95))


def test_one_page_has_all_figures_and_tables_of_the_paper(
    run_folder, other_folder, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        write_module, "rendered", lambda _, kinds, **__: dict.fromkeys(kinds, b"drawn")
    )
    text = write_comparison([run_folder, other_folder], tmp_path / "both").read_text(
        encoding="utf-8"
    )
    named = re.findall(r'<(figcaption|caption)>.*?class="paper">In the paper: ([^<.]+)\.', text)
    tables = {what for element, what in named if element == "caption"}
    assert tables == {"Table I", "Table II", "Table III", "Table IV"}
    numbers = " ".join(what for element, what in named if element == "figcaption")
    assert {"1", "2A", "2B", "3", "4", "5", "6", "7", "8"} <= set(numbers.replace(",", " ").split())


def test_runs_of_one_mission_share_its_figures_below_a_fold(run_folder, tmp_path, monkeypatch):
    """The figures of equal missions are equal to the last byte."""
    monkeypatch.setattr(Page, "files", lambda page, *_: pages.append(page) or {PAGE: b""})
    pages = []
    runs = [shutil.copytree(run_folder, tmp_path / name) for name in ("one", "other")]
    write_comparison(runs, tmp_path / "both")
    (page,) = pages
    shown = [picture.name for picture in page.pictures]
    assert "range_error" in shown
    assert not {"fleet_layout_1", "fleet_layout_2", "pipeline"} & set(shown)
    ((_, mission),) = page.more_pictures.items()
    names = [picture.name for picture in mission]
    assert "fleet_layout_1" in names
    assert "fleet_layout_2" not in names
    assert all("one and other. " in p.caption for p in mission if p.name != "pipeline")


def test_settings_stand_side_by_side_with_unit_and_meaning(run, other_folder):
    tables = comparison_tables(
        {"one": RunResults(run), "other": RunResults(open_run(other_folder))}
    )
    timing = tables["timing"].frame.set_index("key")
    assert timing.loc["mission.duration_h", ["one", "unit"]].tolist() == [
        run.config.mission.duration_h,
        "h",
    ]
    noise = tables["noise"].frame.set_index("key")
    assert noise.loc["noise.range_sigma", "one"] == run.config.noise.range_sigma
    assert (noise["unit"] != "").all()


def test_a_comparison_is_not_the_latest_run(run_folder, other_folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compare, "comparison_figure_specs", lambda _: [])
    page = write_comparison([run_folder, other_folder])
    assert page.parent.name.startswith("comparison-")
    assert [p.name for p in (tmp_path / "runs").iterdir()] == [page.parent.name]


def test_dropouts_are_laid_out_as_in_the_paper_all_links_last(other_folder, run, as_stored):
    tables = comparison_tables(
        {"one": RunResults(run), "other": RunResults(open_run(other_folder))}
    )
    as_stored({name: table.frame for name, table in tables.items()}, without="configuration")
    table = tables["range_drop_category_compare"].frame
    assert list(table.columns) == ["link category", "one [%]", "other [%]"]
    assert table["link category"].iloc[-1] == "all links"
    lost = run.measurements.range_status != 0
    assert table["one [%]"].iloc[-1] == pytest.approx(100.0 * lost.mean())
    landmark = table.set_index("link category").loc["landmark to float"]
    assert pd.isna(landmark["one [%]"])
    assert landmark["other [%]"] > 0.0
    errors = tables["ate_pooled"].frame.set_index(["condition", "quantity"])
    assert pd.isna(errors.loc[("odometry", "mean_m"), "other"])
    assert errors.loc[("no-ranges", "mean_m"), "other"] > 0.0
    at_pings = tables["ping_error"].frame.set_index(["condition", "quantity"])
    assert (
        at_pings.loc[("straight", "rmse_m"), "one"]
        > at_pings.loc[("straight", "from_straight_rmse_m"), "one"]
        == 0.0
    )
    assert set(tables["range_error_split"].frame["part"]) == {"total", "reference speed", "bending"}


def test_the_keys_that_differ_come_first_and_no_others(run, other_folder, run_folder):
    tables = comparison_tables(
        {"one": RunResults(run), "other": RunResults(open_run(other_folder))}
    )
    assert next(iter(tables)) == "configuration"
    ((key, *values),) = tables["configuration"].frame.to_numpy().tolist()
    assert (key, values[0], values[1].endswith("somewhere.nc")) == (
        "ocean.source",
        "synthetic:beaufort",
        True,
    )
    again = comparison_tables({"one": RunResults(run), "other": RunResults(open_run(run_folder))})
    assert again["configuration"].frame.empty


def test_differences_in_physics_come_before_the_study():
    one, runs = load_study("quick"), {}
    study = one.study.model_copy(update={"name": "b", "description": "b", "seed": 7})
    noise = one.noise.model_copy(update={"range_sigma": 2.0})
    for name, config in (
        ("one", one),
        ("other", one.model_copy(update={"study": study, "noise": noise})),
    ):
        runs[name] = SimpleNamespace(run=SimpleNamespace(config=config))
    assert compare._differences(runs)["key"].tolist() == ["noise.range_sigma", "study.seed"]


def test_a_vehicle_that_differs_is_named_by_its_key():
    quick = load_study("quick")
    vehicles = list(quick.fleet.vehicles)
    vehicles[2] = vehicles[2].model_copy(update={"north": 5.0})
    other = quick.model_copy(
        update={"fleet": quick.fleet.model_copy(update={"vehicles": tuple(vehicles)})}
    )
    runs = {
        name: SimpleNamespace(run=SimpleNamespace(config=c))
        for name, c in (("one", quick), ("other", other))
    }
    assert compare._differences(runs).to_numpy().tolist() == [
        ["fleet.vehicles.C.north", "2000.0", "5.0"]
    ]


def test_the_page_offers_what_groups_runs_and_what_all_of_them_have(run, as_stored):
    runs = {name: RunResults(run) for name in ("one", "two", "three")}
    rows = [
        ["noise.range_sigma", "1", "2", "3"],
        ["ocean.source", "a", "a", "b"],
        ["fleet.vehicles.B.points", "–", "–", "[]"],
    ]
    page = json.loads(compare._explorer(runs, pd.DataFrame(rows, columns=["key", *runs])).data)
    as_stored(page)
    assert page["across"] == ["run", "noise.range_sigma", "ocean.source"]
    assert page["each"] == ["condition", "run", "ocean.source"]


def test_figures_of_a_mixed_pair_name_the_synthetic_one(run, other_folder, as_stored):
    specs = comparison_figure_specs(
        {"one": RunResults(run), "other": RunResults(open_run(other_folder))}
    )
    as_stored({spec.name: spec.caption for spec in specs}, name="captions")
    figure = specs[0].draw()
    as_stored([figure, specs[2].draw()])
    assert figure.get_suptitle() == "one and other; synthetic ocean: one"


def test_runs_of_one_region_are_told_apart_by_their_folders(run, made_run, tmp_path):
    again = open_run(made_run().write(tmp_path / "again"))
    assert list(by_name([RunResults(run), RunResults(again)])) == ["run", "again"]
    assert list(by_name([RunResults(run), RunResults(run)])) == ["quick (1)", "quick (2)"]


def test_a_folder_that_is_not_empty_is_refused_and_kept(run_folder, other_folder, tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(JobError, match="not empty"):
        write_comparison([run_folder, other_folder], tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_a_comparison_that_fails_leaves_nothing(run_folder, other_folder, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(write_module, "rendered", fail)
    with pytest.raises(KeyboardInterrupt):
        write_comparison([run_folder, other_folder], tmp_path / "deep" / "both")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_six_runs_have_a_column_each_and_figures_without_collisions(made_run, look, tmp_path):
    """
    Names longer than a figure has room for; figures are drawn, where what does not fit is a
    warning, and warnings are errors.
    """
    runs = {}
    for i in range(6):
        name = f"a run with a rather long name, number {i}"
        made = made_run(realizations=2 + i, title=f"Sea {i % 2} (synthetic)")
        runs[name] = RunResults(open_run(made.write(tmp_path / str(i))))
    tables = comparison_tables(runs)
    configuration = tables["configuration"].frame.set_index("key")
    assert list(configuration.columns) == list(runs)
    assert configuration.loc["study.realizations"].tolist() == ["2", "3", "4", "5", "6", "7"]
    specs = {spec.name: spec for spec in comparison_figure_specs(runs)}
    assert list(specs) == ["ape_pooled", "range_error", "sound_speed"]
    for spec in specs.values():
        figure = look.draw(spec.draw())
        assert figure.get_suptitle() == "6 runs, synthetic oceans"
        assert len(spec.caption) < 300
    axes = specs["range_error"].draw().axes[0]
    assert len({label.get_text() for label in axes.get_yticklabels()}) == 6
    total = runs[next(iter(runs))].ranges.total
    whisker = axes.lines[1].get_xdata()
    np.testing.assert_allclose(whisker, np.nanpercentile(total, [5, 95]))


def test_one_run_is_not_compared(run_folder, tmp_path):
    with pytest.raises(ReportError, match="1 run to compare"):
        write_comparison([run_folder], tmp_path / "alone")
    assert list(tmp_path.iterdir()) == []
