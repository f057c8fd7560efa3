"""Every page of the documentation is followed."""

import contextlib
import doctest
import importlib
import inspect
import re
import runpy
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from factories import pool_here
from pages import DOCS, MARKS, ROOT, RUNS, agree, blocks_of, compare, follow

from pymantaray.ocean import open_ocean

FOLDERS = runpy.run_path(str(DOCS / "site" / "reference_pages.py"))["FOLDERS"]
PAGES = sorted(DOCS.rglob("*.md"))
GALLERY = DOCS / "figures" / "README.md"
"""Followed by `make figures`, into the repository."""
WITH_CODE = [
    p
    for p in PAGES
    if p != GALLERY
    and any(b.language in RUNS and b.mark != "not run" for b in blocks_of(p.read_text()))
]
QUICK = ("reference/ocean-files.md", "theory/loss.md")
"""Pages that take seconds."""


def name_of(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


def marked(page: Path):
    return pytest.param(
        page, id=name_of(page), marks=() if name_of(page) in QUICK else pytest.mark.slow
    )


@pytest.mark.parametrize("page", [marked(page) for page in WITH_CODE])
@pytest.mark.filterwarnings("default")  # as the reader's Python has it
def test_a_page_runs_as_it_stands(page, tmp_path, monkeypatch, undrawn):
    """README's commands have processes of their own, and its figures are drawn."""
    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # no workers, which take seconds to start
    monkeypatch.setattr("pymantaray.apps.atlas.runner.open_pool", pool_here)
    names = follow(page, tmp_path, own_process=False)
    if name_of(page) == "how-to/travel-times.md":
        table = pd.read_csv(tmp_path / "times.csv")
        assert table["status"].tolist() == ["ok", "ok", "ok"]
        np.testing.assert_allclose(
            table["travel_time_s"][:2], names["first"].travel_time, rtol=1e-11
        )
        assert np.all(names["travel_time_sensitivity"](names["paths"], names["layers"]) <= 0.0)
    if name_of(page) == "tutorials/first-study.md":
        stated = re.search(r"at the pings it is ([\d.]+) m, and ([\d.]+) m", page.read_text())
        for run, rmse in zip(("latest", "mine"), stated.groups(), strict=True):
            table = pd.read_csv(tmp_path / "runs" / run / "tables" / "ping_error.csv")
            of = table.set_index("condition").loc["straight", "rmse_m"]
            assert rmse == f"{of:.1f}", run
    if name_of(page) == "reference/ocean-files.md":
        ocean = open_ocean(tmp_path / "ligurian.nc")
        assert dict(ocean.sizes) == {"depth": 4, "lat": 26, "lon": 13}
        assert ocean.attrs == {"title": "Ligurian Sea", "source": "my model, run 7", "synthetic": 1}


def test_python_in_readme_prints_what_it_shows(tmp_path):
    names = follow(ROOT / "README.md", tmp_path, languages=("python",))
    reported = float(names["ray"].source_sound_speed[0] * names["ray"].travel_time[0])
    true = float(np.hypot(10_000.0, 180.0))
    assert f"{true:.1f} m true" in (ROOT / "README.md").read_text()
    assert f"{round(true - reported)} m too short" in (ROOT / "README.md").read_text()


@pytest.mark.slow
def test_all_of_readme_runs(tmp_path):
    follow(ROOT / "README.md", tmp_path, languages=("sh",))  # the rest above
    assert (tmp_path / "runs" / "latest" / "index.html").is_file()
    assert (tmp_path / "times.csv").is_file()


def test_commands_of_readme_fit_on_a_screen():
    blocks = [b for b in blocks_of((ROOT / "README.md").read_text()) if b.language == "sh"]
    assert sum(len(b.text.splitlines()) for b in blocks) <= 24


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_marks_of_blocks_say_something(page):
    for block in blocks_of(page.read_text()):
        assert block.mark is None or (block.mark in MARKS and len(block.said) > 3), (
            f"line {block.line}"
        )
        assert not block.language.isspace()


def test_what_is_shown_has_to_be_printed():
    printed = "3 links, 2 heard\nlost  1.50 %\n"
    compare("3 links, ... heard\n...\nlost 1.50 %\n", printed, "here")
    for wrong in ("3 links, 3 heard", "lost 1.51 %\n3 links, 2 heard", "gone 1.50 %"):
        with pytest.raises(AssertionError, match="not printed"):
            compare(wrong, printed, "here")
    assert agree("1,234.50000000 m", "1,234.50000001  m")
    assert not agree("1,234.5 m", "1,234.6 m")


def test_a_page_that_fails_is_told_with_its_line(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# A page\n\n<!-- not run: it ends everything -->\n```sh\nexit 1\n```\n\n```python\nx = 1"
        " / 0\n```\n"
    )
    with pytest.raises(ZeroDivisionError):
        follow(page, tmp_path)
    page.write_text("```console\n$ echo one\ntwo\n```\n")
    (tmp_path / "sub").mkdir()
    with pytest.raises(AssertionError, match=r"page.md, line 1: not printed:\ntwo"):
        follow(page, tmp_path / "sub")


def test_every_figure_has_a_caption_and_commands_that_write_it():
    gallery = runpy.run_path(str(ROOT / "benchmarks" / "gallery.py"))
    made = {
        name: text
        for names, _, text in gallery["commands"](gallery["GALLERY"].read_text())
        for name in names
    }
    assert set(made) == {path.stem for path in (DOCS / "figures").glob("*.png")}
    for name, text in made.items():
        scripts = [
            (ROOT / script).read_text() for script in re.findall(r"benchmarks/\w+\.py", text)
        ]
        stem = re.split(r"_(?=fram$|beaufort$)", name)[0]
        assert any(stem in words for words in (text, *scripts)), name


SOURCES = sorted(path for path in (ROOT / "src").rglob("*.py") if ">>>" in path.read_text())
_CONTINUED = re.compile(r"Continues the example of\s+`(pymantaray[.\w]*)`")


def run_example(text, names, page_names, place="page", line=0):
    """Names after an example, which may continue that of a package's page."""
    if continued := _CONTINUED.search(text):
        names = names | page_names(continued[1])
    test = doctest.DocTestParser().get_doctest(text, names, place, None, line)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    runner.run(test, clear_globs=False)
    assert runner.failures == 0, place
    return test.globs


@pytest.fixture(scope="session")
def page_names(tmp_path_factory):
    """Names after the example of a package's page, which runs once for all docstrings."""

    @cache
    def names(package):
        with contextlib.chdir(tmp_path_factory.mktemp("page")):
            return run_example(importlib.import_module(package).__doc__, {}, names, package)

    return names


SECONDS = ("apps/atlas/", "apps/sweep/", "apps/study/report", "apps/study/comparison")
"""Sources whose examples start a process or write a report."""


def by_path(source: Path):
    place = source.relative_to(ROOT / "src").as_posix()
    is_slow = place.removeprefix("pymantaray/").startswith(SECONDS)
    return pytest.param(source, id=place, marks=pytest.mark.slow if is_slow else ())


@pytest.mark.parametrize("source", [by_path(source) for source in SOURCES])
def test_examples_in_docstrings_print_what_they_show(source, page_names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    name = ".".join(source.relative_to(ROOT / "src").with_suffix("").parts)
    module = importlib.import_module(name.removesuffix(".__init__"))
    tests = [test for test in doctest.DocTestFinder().find(module) if test.examples]
    assert tests
    for test in tests:
        run_example(test.docstring, {**vars(module)}, page_names, test.name, test.lineno or 0)


MADE_BY = {
    "acoustics": {"Leaks": "find_leaks", "RayPaths": "trace_paths", "Tails": "find_tails"},
    "ocean": {"VerticalModes": "vertical_modes"},
    "ocean.fetch": {"FetchResult": "fetch_hycom"},
    "records": {
        "FirstArrivals": "select",
        "PoseCovariances": "collect_covariances",
        "RangingTruth": "Ranging.truth",
    },
    "sensing": {
        "Candidates": "find_candidates",
        "Links": "Ranging.links",
        "Ranging": "measure_ranges",
        "Receptions": "Transmission.receptions",
        "Transmission": "find_receptions",
    },
    "estimation": {
        "CandidateArrivals": "CandidateModel.candidates",
        "FactorGraph": "build_graph",
        "Prediction": "ConstantSpeed.predict",
        "UnknownsEstimate": "GraphSolution.unknowns",
    },
    "evaluation": {"RangeErrors": "range_errors"},
    "exchange": {"Poses": "Tracks.poses"},
    "config": {"SoundConfig": "load_sound"},
    "config.door": {"Study": "build_study"},
    "apps.locate": {"Displacement": "displacement_between", "Location": "locate"},
    "apps.plan": {"PlanResults": "search_designs"},
    "apps.replay": {"Replay": "replay_events"},
    "apps.study": {"Run": "run_study"},
    "apps.sweep": {"SweepResults": "run_sweep"},
}
"""
Types that users do not construct, by package, and the function, method or field that returns them.
"""
SHOWN_AT = {
    "acoustics": {"Leakage": "find_leaks"},
    "sensing": {
        "OneWay": "TwoWay",
        "ReceptionOptions": "find_receptions",
        "Schedule": "PingSchedule",
    },
    "estimation": {
        "ClockPrior": "Estimator",
        "MixtureOptions": "CandidateModel",
        "RangeEndpoints": "ConstantSpeed",
    },
    "records": {"SharedUnknowns": "unknowns_table"},
    "apps.locate": {"Campaign": "displacement_between"},
    "apps.plan": {"PlanSection": "DeploymentPlan"},
}
"""Options and base classes, by package, and the name whose example shows them."""
NOT_RUN = {
    "fetch_hycom": "needs a server",
    "fetch_copernicus": "needs an account",
    "compare_with_bellhop": "needs Bellhop",
}
"""Names whose examples do not run, and why."""


def public_things():
    """Functions and types that packages of the reference export, by name."""
    return {
        name: thing
        for folder in ("", *FOLDERS)
        for name, thing in vars_of(folder).items()
        if inspect.isclass(thing) or inspect.isroutine(thing)
    }


def vars_of(folder):
    module = importlib.import_module(f"pymantaray.{folder}".rstrip("."))
    return {name: getattr(module, name) for name in module.__all__}


def example_of(thing):
    """Docstrings of a function, or of a type and its members, if they have an example."""
    members = vars(thing).values() if inspect.isclass(thing) else ()
    parts = [getattr(part, "__doc__", None) or "" for part in (thing, *members)]
    return "".join(part for part in parts if ">>>" in part)


def returned_by(maker):
    """Annotation of what a function or method returns, or of a field."""
    name, _, member = maker.partition(".")
    thing = public_things()[name]
    if member:
        found = inspect.getattr_static(thing, member, None)
        found = getattr(found, "fget", None) or getattr(found, "func", found)
        if not inspect.isroutine(found):
            return str(thing.__annotations__[member])
        thing = found
    return str(inspect.signature(thing).return_annotation)


@pytest.mark.parametrize("folder", ["", *FOLDERS])
def test_every_public_name_has_an_example_that_runs(folder):
    """
    The test above runs them. Constants and annotations need none; each other name has its own, is
    made by a name that has one, or is in that of another.
    """
    things = public_things()
    made, shown = MADE_BY.get(folder, {}), SHOWN_AT.get(folder, {})
    lacking = {
        name
        for name, thing in vars_of(folder).items()
        if thing is things.get(name) and not example_of(thing)
    }
    assert lacking == made.keys() | shown.keys()
    for name in vars_of(folder).keys() & things.keys():
        assert ("+SKIP" in example_of(things[name])) == (name in NOT_RUN), name
    for name, maker in made.items():
        assert re.search(rf"\b{name}\b", returned_by(maker)), name
        owner = maker.partition(".")[0]
        assert example_of(things[owner]) or any(owner in names for names in MADE_BY.values()), name
    for name, other in shown.items():
        is_base = things[name] in getattr(things[other], "__mro__", ())
        assert is_base or re.search(rf"\b{name}\b", example_of(things[other])), name


@pytest.mark.slow
def test_types_of_a_project_are_complete(tmp_path):
    """`mypy --strict` of a user's project passes without exceptions."""
    pytest.importorskip("mypy", reason="needs the group lint")
    project = ROOT / "tests" / "typed_project.py"
    assert "type: ignore" not in project.read_text()
    (tmp_path / "project.py").write_text(project.read_text())
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "project.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
