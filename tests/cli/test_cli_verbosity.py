"""
What all commands have alike: options for scripts and for how much is logged, and completion in a
shell.
"""

import json
import logging
import re
import signal
from importlib.metadata import metadata, version
from pathlib import Path

import pytest
from command_fixtures import registered_commands

from pymantaray.apps.doctor.command import EXIT_FAULTS
from pymantaray.apps.ocean.command import EXIT_WRONG
from pymantaray.apps.sweep.command import EXIT_POINTS_FAILED
from pymantaray.cli.output import EXIT_KNOWN_ERROR
from pymantaray.cli.printing import LOG, log_to_stderr, printer
from pymantaray.compile import PLAIN
from pymantaray.records.result_table import ResultTable

PATHS_ONLY = {
    "atlas plot", "export", "graph convert", "ocean correct", "ocean fetch copernicus",
    "ocean fetch hycom", "ocean from-cast",
    "ocean convert-cast", "ocean perturb", "ocean plot", "rays plot", "rays write-bellhop", "serve",
    "study cite", "authors export", "authors import", "study init", "study report", "sweep collect",
}  # fmt: skip
"""
Commands that print the names of what they wrote, an address or references, and nothing that would
be a table.
"""


def test_every_command_that_prints_a_table_prints_json():
    without = {
        name
        for name, command in registered_commands().items()
        if not any("--json" in one.opts for one in command.params)
    }
    assert without == PATHS_ONLY


def test_every_command_can_be_quiet_and_verbose():
    for name, command in registered_commands().items():
        options = {option for one in command.params for option in one.opts}
        assert options >= {"--quiet", "-q", "--verbose", "-v"}, name


def tell_all():
    LOG.error("an error")
    LOG.warning("a warning")
    LOG.info("a stage")
    LOG.debug("a detail")


@pytest.mark.parametrize(
    ("options", "lines"),
    [
        ({"quiet": True, "verbose": 0}, ["error: an error"]),
        ({"quiet": False, "verbose": 0}, ["error: an error", "warning: a warning"]),
        ({"quiet": False, "verbose": 1}, ["error: an error", "warning: a warning", "a stage"]),
        (
            {"quiet": False, "verbose": 2},
            ["error: an error", "warning: a warning", "a stage", "a detail"],
        ),
    ],
)
def test_levels_are_those_of_the_page(capsys, options, lines):
    before = logging.getLogger("pymantaray").handlers[:]
    with log_to_stderr(**options):
        tell_all()
    printed = capsys.readouterr().err.splitlines()
    assert printed[: len(lines)] == lines
    assert [
        bool(re.fullmatch(r"[\d.]+ s, at most \d+ MiB", line)) for line in printed[len(lines) :]
    ] == [True] * (options["verbose"] > 0)
    assert logging.getLogger("pymantaray").handlers == before


def test_a_verbose_command_prints_its_stages_and_causes_of_errors(mantaray):
    assert mantaray("ocean", "show", "synthetic:fram", "-v").err.endswith(" MiB\n")
    refused = mantaray("study", "show", "fast", "-vv").err
    assert refused.startswith("traceback:\nTraceback")
    assert refused.splitlines()[-1].startswith("error: no preset 'fast'")
    assert mantaray("study", "show", "fast", "-v").err.startswith("error: no preset 'fast'")


def test_a_command_that_fails_prints_no_json(capsys):
    def fail():
        with printer(as_json=True) as out:
            out.line("for people", number=1)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert capsys.readouterr().out == ""


def test_what_json_lacks_is_null_or_text(capsys):
    import numpy as np
    import pandas as pd

    with printer(as_json=True) as out:
        out.line("for people", number=np.int64(3), missing=np.nan, time=np.datetime64("2020-01-02"))
        frame = pd.DataFrame({"a_m": [1.5, np.inf], "b": pd.array([1, None], dtype="Int64")})
        out.table(ResultTable("rows", frame))
    told = json.loads(capsys.readouterr().out)
    rows = [{"a_m": 1.5, "b": 1}, {"a_m": None, "b": None}]
    assert told == {"number": 3, "missing": None, "time": "2020-01-02", "rows": rows}


@pytest.mark.parametrize(
    ("words", "word", "completed"),
    [
        ("mantaray study ", 2, {"list", "show", "init", "run", "report", "tables", "compare"}),
        ("mantaray sweep sta", 2, {"status"}),
        ("mantaray study show qu", 3, {"quick"}),
        ("mantaray study run --work", 3, {"--workers"}),
    ],
)
def test_a_shell_completes_commands_options_and_presets(
    mantaray, monkeypatch, words, word, completed
):
    """By the variables that a shell sets, as the script of --show-completion does."""
    shell = {"_MANTARAY_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(word)}
    for name, value in shell.items():
        monkeypatch.setenv(name, value)
    done = mantaray()
    assert completed <= set(done.out.split()), done


PAGE = Path(__file__).parents[2] / "docs" / "reference" / "at-a-glance.md"


@pytest.mark.parametrize("words", sorted(registered_commands()))
def test_an_unknown_command_exits_with_2_and_prints_no_result(mantaray, words):
    refused = mantaray(*words.split(), "--nosuch")
    assert (refused.code, refused.out) == (2, "")
    assert "No such option" in refused.err
    assert "| 2 | the command did nothing" in PAGE.read_text()


def test_the_page_has_every_status_that_commands_end_with():
    told = {
        int(number) for number in re.findall(r"^\| (\d+) \|", PAGE.read_text(), flags=re.MULTILINE)
    }
    ours = {EXIT_FAULTS, EXIT_POINTS_FAILED, EXIT_KNOWN_ERROR, EXIT_WRONG}
    signals = {128 + number for number in (signal.SIGINT, signal.SIGPIPE, signal.SIGTERM)}
    assert told == {0} | ours | signals


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_doctor_compiles_the_kernels_that_studies_need(mantaray, told):
    compiled = told("doctor", "--compile")["kernels"]["compiled"]
    assert compiled > 15
    again = mantaray("doctor", "--compile").out
    assert re.search(
        rf"^compiled 0 kernels in \d+ s of a processor; {compiled} were there$", again, re.MULTILINE
    )


MACHINE = "^platform$|^python$"


def test_doctor_knows_what_is_here_and_what_is_not(mantaray, told, monkeypatch, tmp_path):
    state = told("doctor", without=MACHINE)
    assert {row["name"] for row in state["packages"]} >= {"numpy", "gtsam", "typer"}
    assert all(row["version"] == version(row["name"]) for row in state["packages"])
    assert {row["name"] for row in state["extras"]} == set(
        metadata("pymantaray").get_all("Provides-Extra")
    )
    assert {row["use"] for row in state["folders"]} >= {
        "compiled kernels",
        "figures",
        "temporary files",
    }
    assert 0 <= state["kernels"]["compiled"] <= state["kernels"]["all"] > 15

    requirements = [
        "nosuch>=1.0",
        "numpy>=99",
        'nosuch>=2; extra == "more"',
        'numpy>=2; extra == "all"',
    ]
    monkeypatch.setattr("pymantaray.installation.requires", lambda _: requirements)
    state = told("doctor", code=1, without=MACHINE)
    assert state["faults"] == ["nosuch: is not installed", "numpy: has an unsupported version"]
    assert [row["missing"] for row in state["extras"]] == [["nosuch>=2"], []]
    shown = mantaray("doctor")
    assert shown.code == 1
    assert "lacks nosuch>=2: pip install 'pymantaray[more]'" in shown.out

    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TMPDIR", str(tmp_path / "file" / "folder"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file" / "folder"))
    fault = f"{tmp_path / 'file' / 'folder'}: not writable; set TMPDIR to a writable folder"
    assert fault in told("doctor", code=1, without=MACHINE)["faults"]
