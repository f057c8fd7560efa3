"""
The command `mantaray`: what it prints, what it refuses in one line, and that refusal leaves nothing
behind.
"""

import json
import re
import webbrowser
from pathlib import Path
from time import perf_counter

import pandas as pd
import pytest
from command_fixtures import WATER_WORDS
from factories import names_in

import pymantaray
from pymantaray.apps.study import command as study_commands, open_run, run_study
from pymantaray.apps.study.references import citation
from pymantaray.cli.main import main
from pymantaray.cli.output import Watch
from pymantaray.cli.printing import Printer
from pymantaray.config import load, load_study, preset_text
from pymantaray.config.common import Section
from pymantaray.errors import StudyError
from pymantaray.evaluation import ALL_LINKS, error_table
from pymantaray.records import RayStatus, SolveStatus
from pymantaray.records.result_table import ResultTable
from pymantaray.records.status import SOLVE_STATUS_WORDS

PRESETS = "beaufort, estimators-beaufort, estimators-fram, fram, quick, survey"


@pytest.fixture
def small(small_text, tmp_path, monkeypatch):
    """File of a study that takes seconds, in the working folder, where there is nothing else."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(small_text)
    return tmp_path / "small.toml"


def test_version(mantaray):
    done = mantaray("--version")
    assert (done.code, done.out) == (0, f"mantaray {pymantaray.__version__}\n")


def test_list_names_each_preset_and_show_prints_it(mantaray, told):
    listed = mantaray("study", "list").out.splitlines()
    assert [line.split()[0] for line in listed] == PRESETS.split(", ")
    assert mantaray("study", "show", "fram").out == preset_text("fram")
    assert [preset["name"] for preset in told("study", "list")["presets"]] == PRESETS.split(", ")
    assert told("study", "show", "fram") == load_study("fram").model_dump(mode="json")


@pytest.mark.parametrize("words", [(), ("--json",)])
def test_show_reads_a_file_once_and_no_preset(mantaray, small, monkeypatch, words):
    opened, read = [], load._read
    monkeypatch.setattr(load, "_read", lambda path: opened.append(path) or read(path))
    monkeypatch.setattr(load, "preset_text", lambda name: pytest.fail(name))
    assert mantaray("study", "show", small, *words).code == 0
    assert opened == [small]


def test_show_of_a_file_has_every_key_and_loads_the_same(mantaray, told, small, tmp_path):
    shown = tmp_path / "shown.toml"
    shown.write_text(mantaray("study", "show", str(small)).out)
    assert load_study(shown) == load_study(small)
    assert "max_surface_bounces" in shown.read_text()
    assert told("study", "show", str(small)) == load_study(small).model_dump(mode="json")


def test_show_of_trajectories_has_their_duration_and_centre(mantaray, told, tmp_path):
    rows = "".join(f"{3600 * hour},{74.0 + 0.01 * hour},-141.0,50\n" for hour in range(4))
    (tmp_path / "track.csv").write_text("time,lat,lon,depth\n" + rows)
    own = tmp_path / "own.toml"
    own.write_text(
        'study.name = "own"\nocean.source = "synthetic:beaufort"\nfleet.trajectories ='
        ' "track.csv"\n'
    )
    assert "\nduration_h = 3.0  # " in mantaray("study", "show", own).out
    shown = told("study", "show", own)
    assert shown["mission"]["duration_h"] == 3.0
    assert shown["ocean"]["centre_lat"] == pytest.approx(74.015)


def test_a_mission_without_a_duration_says_how_long_it_lasts(tmp_path, caplog):
    config = load_study("quick")
    unset = config.model_copy(update={"mission": {"physics_step_s": 1e-9}})
    with pytest.raises(StudyError, match="physics steps"):
        run_study(unset, tmp_path / "run")
    assert [record.getMessage() for record in caplog.records] == [
        "mission.duration_h is not given: the mission lasts 168 h"
    ]
    caplog.clear()
    with pytest.raises(StudyError, match="physics steps"):
        run_study(
            config.model_copy(update={"mission": {"physics_step_s": 1e-9, "duration_h": 8}}),
            tmp_path / "run",
        )
    assert not caplog.records


@pytest.mark.parametrize("name", PRESETS.split(", "))
def test_init_writes_a_preset_with_the_defaults_of_all_other_keys(
    mantaray, tmp_path, monkeypatch, name
):
    """What is commented out is what holds without it, and every key of each table is there."""
    monkeypatch.chdir(tmp_path)
    assert mantaray("study", "init", name, "mine.toml").code == 0
    text, preset = Path("mine.toml").read_text(), load_study(name)
    assert load_study("mine.toml") == preset
    set_text, count = re.subn(r"^#(?=[\w\[])", "", text, flags=re.MULTILINE)
    Path("set.toml").write_text(set_text)
    assert load_study("set.toml") == preset
    assert count >= 15
    tables = [table for _, table in preset if isinstance(table, Section)]
    for key in {key for table in tables for key in type(table).model_fields}:
        assert re.search(rf"^(#|# |#?\[+fleet\.)?{key}\b", text, flags=re.MULTILINE), key


EVENTS = (
    "time,source,receiver,source_lat,source_lon,source_depth,receiver_lat,receiver_lon,receiver_depth,travel_time\n"
    "2014-07-15T12:00:00,A,B,74.5,-140.0,10,74.51,-140.0,20,0.8\n"
)
LOUD = "[detection]\nsource_level_db = 185.0\nfrequency_hz = 25e3\nbandwidth_hz = 5e3\n"
OF_A_STUDY = [
    ("study", "show", "quick"),
    ("study", "init", "quick", "mine.toml"),
    ("study", "cite", "quick"),
    ("study", "run", "quick", "--out", "run"),
    ("sweep", "show", "sweep.toml"),
    ("sweep", "run", "sweep.toml", "--out", "out"),
    ("serve", "quick", "--port", 0),
    ("ocean", "check", "--study", "quick"),
    ("ranges", "own.csv", "--ocean", "synthetic:fram", "--interval", "5 min", "--out", "out"),
]


@pytest.mark.parametrize("words", OF_A_STUDY, ids=lambda words: " ".join(words[:2]))
def test_every_command_of_a_study_changes_it_and_says_what_was_meant(mantaray, small, words):
    Path("sweep.toml").write_text('base = "quick"\nseeds = [1]\n')
    Path("own.csv").write_text("time,north,east,depth\n0,0,0,5\n1800,900,0,5\n")
    done = mantaray(*words, "--set", "noise.rnge_sigma=2")
    assert done.err.splitlines()[-1].endswith(
        "`noise.rnge_sigma`: unknown key. Did you mean `noise.range_sigma`?"
    )
    assert (done.code, done.out) == (2, "")
    assert names_in(Path()) == ["own.csv", "small.toml", "sweep.toml"]


def test_replay_changes_the_section_detection(mantaray, small):
    Path("events.csv").write_text(EVENTS)
    Path("loud.toml").write_text(LOUD)
    words = (
        "replay",
        "events.csv",
        "--ocean",
        "synthetic:beaufort",
        "--set",
        "detection.thresold_db=2",
    )
    done = mantaray(*words, "--detection", "loud.toml")
    assert done.code == 2
    assert done.err.endswith(
        "`detection.thresold_db`: unknown key. Did you mean `detection.threshold_db`?\n"
    )


def test_changes_hold_in_what_is_shown_and_in_a_file_made_of_them(
    mantaray, told, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    changes = (
        "--set",
        "noise.range_sigma=2",
        "--set",
        "fleet.vehicles.B.target_depth=123",
        "--set",
        "ocean.source=synthetic:fram",
    )
    shown = told("study", "show", "quick", *changes)
    assert (shown["noise"]["range_sigma"], shown["ocean"]["source"]) == (2.0, ["synthetic:fram"])
    assert shown["fleet"]["vehicles"][1]["target_depth"] == 123.0
    assert mantaray("study", "init", "quick", "mine.toml", *changes).code == 0
    assert load_study("mine.toml").model_dump(mode="json") == shown


def test_init_needs_no_word_and_never_overwrites(mantaray, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert mantaray("study", "init").code == 0
    assert load_study("study.toml") == load_study("quick")
    Path("study.toml").write_text("# mine")
    refused = mantaray("study", "init", "quick", "study.toml")
    assert (refused.code, refused.err) == (
        2,
        "error: study.toml: already exists; give another name\n",
    )
    assert Path("study.toml").read_text() == "# mine"


@pytest.mark.slow
def test_an_interrupted_report_is_written_by_a_later_command(mantaray, small, monkeypatch, undrawn):
    stages = {}

    def interrupt(*_arguments, **_options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("pymantaray.apps.study.report.write_files", interrupt)
        patch.setattr(
            Watch, "report", lambda watch, stage, *_: stages.update({stage: watch.stages})
        )
        done = mantaray("study", "run", small, "--out", "run", "--workers", 1)
    run = small.parent / "run"
    assert done.code == 130
    assert all(list(announced) == list(stages) for announced in stages.values())
    command = f"mantaray study report {run}"
    assert done.err.splitlines()[-1] == f"the data are complete; write their report with: {command}"
    monkeypatch.setattr(
        "pymantaray.apps.study.figures.register.run_figure_specs", lambda _: []
    )  # other tests look at figures
    done = mantaray(*command.split()[1:])
    assert (done.code, done.out) == (0, f"{run / 'index.html'}\n")
    assert {"index.html", "tables", "figures"} < set(names_in(run))


def test_ocean_files_and_realizations_can_be_given(
    mantaray, small, ocean_file, monkeypatch, as_stored
):
    words = ("--ocean", ocean_file, "--realizations", 2, "--out", "run", "--no-figures")
    done = mantaray("study", "run", small, *words, "--workers", 1)
    assert done.code == 0, done.err
    assert "2 realizations, synthetic ocean" in done.out
    assert "Position error by condition, pooled over vehicles, times and realizations" in done.out
    assert done.out.splitlines()[-1] == str(small.parent / "run")
    as_stored(done.out.partition("took")[0], name="printed")
    run = open_run("run")
    assert run.config.ocean.files == (str(ocean_file),)
    assert run.config.study.description == f"{small} with 2 realizations and the ocean {ocean_file}"
    assert list(run.manifest["ocean"]["sha256"]) == [str(ocean_file)]
    assert run.estimates.realization.tolist() == [0, 1]
    assert (run.measurements.range_status == RayStatus.OK).all()
    assert " lost: " not in done.out
    called = perf_counter()
    monkeypatch.setattr("pymantaray.apps.study.command.STARTED", called - 1e3)
    again = ("study", "run", small, *words[:-2], "json", "--no-figures", "--workers", 1)
    summary = json.loads(mantaray(*again, "--json").out)
    waited = 1e3 + perf_counter() - called
    as_stored(summary, without="memory")
    stages = summary["seconds"]
    assert (next(iter(stages)), list(stages)[-1]) == ("start", "tables")
    assert stages["tables"] < sum(stages.values()) - 1e3 <= waited - 1e3  # all that the user waits
    assert stages["start"] >= 1e3
    assert (summary["realizations"], summary["synthetic_ocean"], summary["folder"]) == (
        2,
        True,
        str(Path("json").resolve()),
    )
    assert summary["range_error"][0].keys() > {"category", "attempts", "mean_m", "p99_m"}
    rmse = [row["rmse_m"] for row in summary["ate_pooled"]]
    assert rmse == error_table(run.truth, run.estimates)["rmse_m"].tolist()


def test_what_is_not_healthy_is_a_line_each(tiny_run_folder, monkeypatch):
    run = open_run(tiny_run_folder)
    refused = [
        {"condition": "straight", "realization": r, "status": status}
        for r, status in ((0, "FAILED"), (1, "FAILED"), (1, "OVER_CHI_SQUARE"))
    ]
    stopped = {"D": {"time_s": 5400.0, "status": "GROUNDED"}}
    outcome = {"stopped_vehicles": stopped, "unhealthy_solves": refused}
    monkeypatch.setitem(vars(run), "manifest", run.manifest | {"outcome": outcome})
    vehicle, failed, over = study_commands._warnings(run)
    assert vehicle == "vehicle D stopped after 1.5 h: GROUNDED"
    assert failed == "condition straight: 2 of 2 solves FAILED, realizations 0, 1"
    words = SOLVE_STATUS_WORDS[SolveStatus.OVER_CHI_SQUARE]
    assert over == (
        "condition straight: 1 of 2 solves OVER_CHI_SQUARE, realizations 1"
        f" ({words.meaning}; {words.advice})"
    )


def test_one_vehicle_and_one_realization_are_no_plural(made_run, tmp_path, capsys):
    lone = made_run(names=("A",), pings=0, realizations=1, conditions=("odometry",), rays=False)
    run = open_run(lone.write(tmp_path / "run"))
    run.manifest["outcome"] = {"stopped_vehicles": {}, "unhealthy_solves": []}
    study_commands._print_summary(Printer(quiet=False), run)
    assert " h, 1 vehicle, 1 realization, synthetic ocean\n" in capsys.readouterr().out


def test_causes_of_lost_ranges_have_the_words_of_the_page(capsys):
    counts = {"category": ALL_LINKS} | {status.name.lower(): 0 for status in RayStatus}
    counts |= {
        "attempts": 90,
        "dropouts": 12,
        "shadow": 3,
        "blocked": 7,
        "unheard": 2,
        "leaked": 20,
    }
    study_commands._print_causes(Printer(quiet=False), pd.DataFrame([counts]), 15.0)
    assert (
        capsys.readouterr().out
        == "12 of 90 lost: 7 blocked by the bottom, 3 shadow, 2 not detected\n"
    )
    study_commands._print_causes(
        Printer(quiet=False),
        pd.DataFrame([dict.fromkeys(counts, 0) | {"category": ALL_LINKS}]),
        15.0,
    )
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(("cutoff", "advised"), [(15.0, True), (60.0, False), (None, False)])
def test_weak_links_come_with_the_option_that_includes_them(mantaray, capsys, cutoff, advised):
    counts = (
        {"category": ALL_LINKS}
        | {status.name.lower(): 0 for status in RayStatus}
        | {"attempts": 100, "dropouts": 31, "weak": 31}
    )
    study_commands._print_causes(Printer(quiet=False), pd.DataFrame([counts]), cutoff)
    said = capsys.readouterr().out
    assert ("31 % too weak: spreading loss more than 15 dB above spherical;" in said) == advised
    assert ("`--cutoff-db 60` includes all within 60 dB" in said) == advised
    for command in (["study", "run"], ["ranges"]):
        assert "--cutoff-db" in mantaray(*command, "--help").out


@pytest.mark.slow
def test_the_page_opens_in_the_browser_that_the_user_has(mantaray, small, monkeypatch):
    assert mantaray("study", "run", small, "--out", "run", "--no-figures", "--workers", 1).code == 0
    browser = Path("browser")
    browser.write_text(f'#!/bin/sh\necho "$1" > {browser.resolve()}.opened\n')
    browser.chmod(0o755)
    monkeypatch.setattr(
        "pymantaray.apps.study.figures.register.run_figure_specs", lambda _: []
    )  # other tests look at figures
    for command, said in (
        (f"{browser.resolve()} %s", ""),
        ("/nowhere %s", "warning: no browser to open"),
    ):
        monkeypatch.setenv("BROWSER", command)
        monkeypatch.setenv("PATH", "/bin" if not said else "/nowhere")
        monkeypatch.setattr(webbrowser, "_tryorder", None)  # it looks for browsers once a process
        monkeypatch.setattr(webbrowser, "_browsers", {})
        done = mantaray("study", "report", "run", "--open")
        assert (done.code, done.out) == (0, f"{Path('run').resolve() / 'index.html'}\n")
        assert done.err.startswith(said)
        assert bool(done.err) == bool(said)
    assert (
        Path("browser.opened").read_text().strip()
        == (Path("run").resolve() / "index.html").as_uri()
    )
    refused = mantaray("study", "run", small, "--out", "other", "--no-figures", "--open")
    assert refused.code == 2
    assert "--no-figures writes no page to open" in refused.err
    assert not Path("other").exists()


@pytest.mark.slow
def test_runs_with_reports_are_compared(mantaray, told, small, undrawn):
    text = small.read_text().replace("synthetic:beaufort", "synthetic:fram")
    Path("other.toml").write_text(text.replace("= 74.5", "= 78.0").replace("= -140.0", "= 0.0"))
    for name in ("small", "other"):
        done = mantaray("study", "run", f"{name}.toml", "--out", name)
        assert done.code == 0, done.err
        assert (Path(name) / "index.html").stat().st_size > 0
    done = mantaray("study", "compare", "small", "other", "--out", "both")
    assert done.code == 0, done.err
    assert "Position error" in done.out
    assert "Beaufort" in done.out
    assert (Path("both") / "index.html").exists()
    compared = told("study", "compare", "small", "other", "--out", "json")
    assert compared["ate_pooled"][0].keys() >= {"condition"}
    assert compared["page"] == str(Path("json").resolve() / "index.html")
    same = mantaray("study", "compare", "small", "small", "--out", "same")
    assert "The configurations have the same values." in same.out
    refused = mantaray("study", "compare", "small", "other", "--out", "both")
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)


def check_refusal(done, expected, left=("small.toml",)):
    assert (done.code, done.out) == (2, "")
    assert len(done.err.splitlines()) == 1, done.err
    assert done.err.startswith("error: ")
    assert expected in done.err
    assert names_in(Path()) == sorted(left)


@pytest.mark.parametrize(("old", "new", "said"), [
    ("[noise]\n", "[noise]\nrange_sigm = 2.0\n",
     "`noise.range_sigm`: unknown key. Did you mean `noise.range_sigma`?"),
    ("target_depth = 250.0",
     "target_depth = 6000.0", "'G': target_depth is 6000 m deep, below the sea floor"),
    ("half_extent_north = 15000.0", "half_extent_north = 9e6", "contains a pole"),
])  # fmt: skip
def test_bad_configuration_is_one_line_and_leaves_nothing(mantaray, small, old, new, said):
    text = small.read_text()
    assert old in text
    small.write_text(text.replace(old, new, 1))
    check_refusal(mantaray("study", "run", small, "--out", "deep/run"), said)


def test_ocean_file_that_is_cut_is_one_line_and_leaves_nothing(mantaray, small, ocean_file):
    whole = ocean_file.read_bytes()
    Path("broken.nc").write_bytes(whole[: len(whole) // 2])
    done = mantaray("study", "run", small, "--ocean", "broken.nc", "--out", "run")
    check_refusal(done, "broken.nc: ", ["broken.nc", "small.toml"])


def test_full_output_folder_is_refused_untouched(mantaray, small):
    check_refusal(
        mantaray("study", "run", small, "--out", "."), "is not empty; give a new or empty folder"
    )


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ("run", "quick", "--realizations", "0"),
            "quick: study.realizations: found 0; allowed: 1 or more",
        ),
        (("run", "fast"), f"no preset 'fast'; allowed: {PRESETS}"),
        (("run", "no.toml"), "no.toml: no such file"),
        (("show", "fast"), "no preset 'fast'"),
        (("run", "."), ".: not a preset, and not a study file, whose name ends in .toml"),
        (("compare", "here", "there"), "here: no such folder; name an existing folder"),
        (("report", "."), ".: not a run folder: it has no manifest.json"),
    ],
)
def test_known_errors_are_one_line(mantaray, small, words, expected):
    check_refusal(mantaray("study", *words), expected)


def test_a_run_folder_is_not_a_study_but_contains_one(mantaray, small):
    Path("done").mkdir()
    Path("done/config.toml").write_text(small.read_text())
    check_refusal(
        mantaray("study", "show", "./done"),
        "done: not a preset, and not a study file, whose name ends in .toml; use done/config.toml",
        ("done", "small.toml"),
    )


@pytest.mark.parametrize("key", ["bathymetry", "ice"])
def test_a_length_in_another_unit_is_no_file(mantaray, small, key):
    check_refusal(
        mantaray("study", "run", small, "--set", f"ocean.{key}=40 kg"),
        f"ocean.{key}: found '40 kg'; allowed: a number of metres, or text such as \"2 km\"",
    )


def test_unknown_errors_keep_their_traceback(monkeypatch):
    def fail(*_arguments, **_options):
        raise ZeroDivisionError

    monkeypatch.setattr("pymantaray.config.load_study", fail)
    with pytest.raises(ZeroDivisionError):
        main(["study", "show", "quick"])


def test_the_overview_of_commands_has_every_command_of_study():
    overview = (Path(__file__).parents[3] / "docs" / "reference" / "at-a-glance.md").read_text()
    for command in study_commands.app.registered_commands:
        name = command.name or command.callback.__name__
        assert f"mantaray study {name}" in overview


def test_tables_of_a_run_are_printed_with_the_numbers_of_the_library(
    mantaray, told, tiny_run_folder, as_stored
):
    run = open_run(tiny_run_folder)
    rows = told("study", "tables", tiny_run_folder, "ate_per_vehicle")["ate_per_vehicle"]
    table = error_table(run.truth, run.estimates, by=["vehicle"], freedom=run.degrees_of_freedom)
    assert rows == table.to_dict("records")
    summary = mantaray("study", "tables", tiny_run_folder).out
    latex = mantaray("study", "tables", tiny_run_folder, "ate_pooled", "--to", "latex").out
    as_stored({"summary": summary, "latex": latex})
    assert latex.count("\\toprule") == 1
    for row in run.tables["ate_pooled"].short().rows:
        assert all(text in summary for text in row)
        assert all(text in latex for text in row)
    refused = mantaray("study", "tables", tiny_run_folder, "ate")
    assert (refused.code, refused.out) == (2, "")
    assert "table 'ate'" in refused.err
    assert "ate_pooled, ate_per_vehicle" in refused.err
    unknown = mantaray("study", "tables", tiny_run_folder, "--to", "word")
    assert unknown.code == 2
    assert "'text', 'latex', 'csv', 'json'" in unknown.err.replace("\n", " ")


COMMAND = "pymantaray.apps.study.command"
CHANGES = ("--set", "noise.range_sigma=2", "--set", "mission.duration_h=5")
LOADED = {
    "show": "study show quick",
    "cite": "study cite quick",
    "run": f"study run quick --realizations 7 --ocean a.nc b.nc {WATER_WORDS}",
    "run in a profile": "study run quick --profile a.nc",
}


@pytest.mark.parametrize("command", LOADED)
def test_every_option_reaches_the_configuration(reached, small, command):
    for name in ("a.nc", "b.nc"):
        Path(name).write_text("")
    given = reached("pymantaray.config.load_study", *LOADED[command].split(), *CHANGES)
    if command == "run":
        assert given["ocean.time"].isoformat() == "2014-07-24T19:20:00"


def test_every_option_reaches_the_file_of_a_preset(mantaray, reached, small):
    reached("pymantaray.config.starter_text", "study", "init", "fram", "mine.toml", *CHANGES)
    done = mantaray("study", "init", "fram", "mine.toml")
    assert done.out == (
        "mine.toml: written from preset fram; edit it, then: mantaray study run mine.toml\n"
    )
    nowhere = mantaray("study", "init", "fram", "no/mine.toml")
    assert nowhere.err == "error: no/mine.toml: cannot be written: No such file or directory\n"


def test_every_option_reaches_the_citation(mantaray):
    references = citation(load_study("quick"))
    assert mantaray("study", "cite", "quick").out == f"{references}\n"
    assert mantaray("study", "cite", "quick", "--bibtex").out == references.bibtex


class NoReport:
    """A report that is not made, and what it was asked for."""

    failures = ()

    def __init__(self, *, formats):
        type(self).formats = formats

    def begin(self, _):
        return iter(())

    def write(self, run, progress):
        type(self).written = run, progress
        return [*self.failures]


@pytest.fixture
def unreported(monkeypatch):
    """Studies whose report is not made."""
    kind = type("NoReport", (NoReport,), {})
    monkeypatch.setattr("pymantaray.apps.study.report.StudyReport", kind)
    return kind


@pytest.mark.parametrize(
    "how", [(), ("--quiet",), ("--no-figures",)], ids=["told", "quiet", "no figures"]
)
def test_every_option_reaches_the_run(reached, small, unreported, how):
    paper = () if how == ("--no-figures",) else ("--format", "pdf,tex")
    words = ("study", "run", "quick", "--out", "run", "--workers", 3, *paper, *CHANGES, *how)
    given = reached("pymantaray.apps.study.run_study", *words)
    assert (given[1], given["workers"]) == (Path("run"), 3)
    changes = {"noise.range_sigma": 2, "mission.duration_h": 5}
    assert given[0] == load_study("quick", **changes)
    if paper:
        assert unreported.formats == ("pdf", "tex")


@pytest.mark.parametrize("conditions", ["default", "none"])
@pytest.mark.parametrize("figures", [True, False])
def test_every_option_reaches_the_bars_of_the_run(reached, small, unreported, conditions, figures):
    words = ("--set", "conditions=[]") if conditions == "none" else ()
    more = () if figures else ("--no-figures", "--quiet")
    reached(f"{COMMAND}.progress_bars", "study", "run", "quick", *words, *more)


@pytest.fixture(scope="module")
def opened(tiny_run_folder):
    """A run whose tables are computed once."""
    return open_run(tiny_run_folder)


@pytest.fixture
def finished(opened, monkeypatch):
    """A run that took known times and memory, some of whose solves and vehicles failed."""
    run = opened
    unhealthy = [{"condition": "straight", "realization": 1, "status": "FAILED"}]
    manifest = run.manifest | {
        "seconds": {"ocean": 1.5, "rays": 2.25, "tables": 4.5},
        "peak_memory_mib": {"main": 321.4, "largest_worker": 210.6},
        "machine": run.manifest["machine"] | {"workers": 3},
        "from_batch_m": {"gtsam": [1e-3, 2.34e-3], "isam": [5e-4]},
        "outcome": {
            "stopped_vehicles": {"A": {"time_s": 5400.0, "status": "GROUNDED"}},
            "unhealthy_solves": unhealthy,
        },
    }
    monkeypatch.setitem(vars(run), "manifest", manifest)
    clock = iter([100.0, 103.0, 160.0, *range(200, 290, 7)])
    monkeypatch.setattr(f"{COMMAND}.perf_counter", lambda: next(clock))
    monkeypatch.setattr(f"{COMMAND}.STARTED", 40.0)
    monkeypatch.setattr("pymantaray.apps.study.run_study", lambda *_, **__: run)
    return run


@pytest.mark.parametrize("words", [(), ("--no-figures",)], ids=["report", "tables"])
def test_every_option_reaches_what_a_run_prints(
    mantaray, small, finished, unreported, as_stored, words
):
    done = mantaray("study", "run", "quick", *words)
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    if not words:
        assert unreported.written[0] is finished
        assert lines[-2] == f"page: {finished.path / 'index.html'}"
    assert lines[-1] == str(finished.path)
    said = [line for line in lines[: -1 if words else -2] if line[:1].strip()]
    as_stored([*said, done.err], name="printed")


@pytest.mark.parametrize("words", [(), ("--no-figures",)], ids=["report", "tables"])
def test_every_option_reaches_what_a_run_tells(told, small, finished, unreported, words):
    tables = "dropouts|range_error|ate_pooled|ping_error|notes"
    values = told("study", "run", "quick", *words, without=tables)
    assert values["folder"] == str(finished.path)
    assert values.get("page") == (None if words else str(finished.path / "index.html"))
    last = {"tables": 7.5} if words else {"tables": 4.5, "report": 3.0}
    spent = {"ocean": 1.5, "rays": 2.25, **last}
    assert values["seconds"] == {"start": 120.0 - sum(spent.values()), **spent}
    assert values["peak_memory_mib"] == {"main": 321.4, "largest_worker": 210.6}


def test_every_option_reaches_the_page_of_the_run(
    mantaray, small, finished, unreported, monkeypatch
):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda page: opened.append(page) or len(opened) == 1)
    page = finished.path / "index.html"
    words = ("study", "run", "quick", "--quiet", "--open")
    for warned in ("", f"warning: no browser to open {page}\n"):
        done = mantaray(*words[:3], "--open") if warned else mantaray(*words)
        assert done.code == 0
        assert done.err.endswith(warned)
    assert opened == [page.resolve().as_uri()] * 2
    unreported.failures = ("figure a failed", "figure b failed")
    failed = mantaray(*words)
    assert failed.code == 1
    assert failed.err == "error: figure a failed\nerror: figure b failed\n"
    assert failed.out == f"{finished.path}\n"
    assert len(opened) == 2


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_report(reached, spied, small, monkeypatch, quiet):
    function = "pymantaray.apps.study.report.report_of"
    Path("run").mkdir()
    words = ("study", "report", "run", "--format", "svg,84mm", *quiet)
    assert reached(function, *words)[0] == Path("run")
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda page: not opened.append(page))
    (_,), done = spied(function, (Path("run/index.html"), ["a", "b"]), *words, "--open", code=1)
    assert (done.out, done.err) == ("run/index.html\n", "error: a\nerror: b\n")
    assert opened == [Path("run/index.html").resolve().as_uri()]


@pytest.mark.parametrize("to", ["text", "csv", "latex"])
def test_every_option_reaches_the_tables(mantaray, told, tiny_run_folder, as_stored, to):
    words = ("study", "tables", tiny_run_folder, "range_error", "dropouts")
    as_stored(mantaray(*words, "--to", to).out)
    if to == "csv":
        assert list(told(*words)) == ["range_error", "dropouts"]


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_comparison(reached, small, quiet):
    for name in ("one", "two"):
        Path(name).mkdir()
    words = ("study", "compare", "one", "two", "--out", "both", "--format", "pdf", *quiet)
    given = reached("pymantaray.apps.study.write_comparison", *words)
    assert given[0] == [Path("one"), Path("two")]
    assert given[1] == Path("both")


@pytest.mark.parametrize("runs", [2, 3])
@pytest.mark.parametrize("same", [True, False])
def test_every_option_reaches_what_a_comparison_prints(
    mantaray, told, spied, small, monkeypatch, as_stored, runs, same
):
    names = ["Sea A", "Sea B", "Sea C"][:runs]
    rows = [] if same else [["study.seed", *range(runs)]]
    configuration = pd.DataFrame(rows, columns=["key", *names])
    region = pd.DataFrame([["depth", *range(10, 10 + runs)]], columns=["property", *names])
    frames = {"configuration": configuration, "region": region}
    tables = {name: ResultTable(name, frame) for name, frame in frames.items()}
    asked = []
    page = "pymantaray.apps.study.comparison_page"
    monkeypatch.setattr(f"{page}.read_comparison", lambda folder: asked.append(folder) or tables)
    monkeypatch.setattr(f"{page}.SUMMARY", ("region", "ate_pooled", "configuration"))
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda page: not opened.append(page))
    folders = ["one", "two", "three"][:runs]
    for name in folders:
        Path(name).mkdir()
    words = ("study", "compare", *folders)
    function = "pymantaray.apps.study.write_comparison"
    (_,), done = spied(function, Path("both/index.html"), *words, "--open")
    as_stored(done.out.splitlines())
    assert asked == [Path("both")]
    assert opened == [Path("both/index.html").resolve().as_uri()]
    values = told(*words)
    assert values["page"] == "both/index.html"
    assert mantaray(*words, "--quiet").out == "both/index.html\n"
    table = mantaray(*words, "--to", "csv").out
    assert table.startswith(f"property,{','.join(names)}\n")  # for programs, no numbers
    assert len(opened) == 1
