"""
What several commands share: `--ocean` takes several files and no argument of the command; durations
are a configuration's.
"""

import inspect
import re
from typing import Annotated, ForwardRef, get_args

import pytest
import typer
from command_fixtures import registered_commands
from refusals import refused
from typer.testing import CliRunner

from pymantaray.cli.options import GridOptions, OceanCommand, parse_duration, quantity
from pymantaray.config import load_study, parse_study
from pymantaray.errors import MantaRayError, WaterError

app = typer.Typer()


@app.command(cls=OceanCommand)
def two(
    links: str,
    out: str,
    ocean: Annotated[list[str] | None, typer.Option()] = None,
    pair: Annotated[tuple[float, float] | None, typer.Option()] = None,
) -> None:
    """Say what came in."""
    typer.echo(f"{links} {out} {ocean} {pair}")


@pytest.mark.parametrize(("words", "ocean"), [
    ("--ocean synthetic:fram IN OUT", ["synthetic:fram"]),
    ("IN --ocean a OUT", ["a"]),
    ("IN OUT --ocean a", ["a"]),
    ("IN OUT --ocean a b c", ["a", "b", "c"]),
    ("--ocean a b IN OUT", ["a", "b"]),
    ("IN --ocean=a b OUT", ["a", "b"]),
    ("--ocean a --ocean b IN OUT", ["a", "b"]),
    ("--ocean a b --pair 1 -2 IN OUT", ["a", "b"]),
    ("IN --pair 1 -2 OUT --ocean a b", ["a", "b"]),
    ("IN OUT", None),
])  # fmt: skip
def test_files_are_files_and_arguments_arguments(words, ocean):
    done = CliRunner().invoke(app, words.split())
    pair = (1.0, -2.0) if "--pair" in words else None
    assert (done.exit_code, done.output) == (0, f"IN OUT {ocean} {pair}\n")


endless = typer.Typer()


@endless.command(cls=OceanCommand)
def many(
    files: list[str],
    ocean: Annotated[list[str], typer.Option()],
    out: Annotated[str, typer.Option()],
) -> None:
    """Say what came in."""
    typer.echo(f"{files} {ocean} {out}")


@pytest.mark.parametrize(("words", "files", "ocean"), [
    ("A --ocean a --out O", ["A"], ["a"]),
    ("A B --ocean a b --out O", ["A", "B"], ["a", "b"]),
    ("A B --out O --ocean a b", ["A", "B"], ["a", "b"]),
    ("--ocean a A B --out O", ["A", "B"], ["a"]),
])  # fmt: skip
def test_files_behind_any_number_of_arguments_are_the_ocean_s(words, files, ocean):
    done = CliRunner().invoke(endless, words.split())
    assert (done.exit_code, done.output) == (0, f"{files} {ocean} O\n")


@pytest.mark.parametrize(
    "words", ["--ocean a IN", "IN OUT MORE", "IN OUT MORE --ocean a", "IN OUT --ocean"]
)
def test_too_few_and_too_many_words_are_refused(words):
    assert CliRunner().invoke(app, words.split()).exit_code == 2


@pytest.mark.parametrize(
    "words", [("quick", "--ocean", "synthetic:fram"), ("--ocean", "synthetic:fram", "quick")]
)
def test_a_study_takes_an_ocean_by_name(mantaray, monkeypatch, words):
    seen = []

    def stop(config, *_, **__):
        seen.append(config.ocean.source)
        raise KeyboardInterrupt

    monkeypatch.setattr("pymantaray.apps.study.run_study", stop)
    assert mantaray("study", "run", *words).code == 130
    assert seen == [("synthetic:fram",)]
    assert load_study("quick", ocean=["synthetic:fram"]).ocean.files == ()


@pytest.mark.parametrize("text", ["5 min", " 1h30min ", "0.125 s", ".5 d", "1 d 12 h", "9999 min"])
def test_a_duration_is_read_as_a_configuration_reads_it(text):
    mission = {"sampling_period_s": text, "duration_h": text}
    tree = {
        "study": {"name": "own"},
        "ocean": {"source": "synthetic:fram"},
        "fleet": {"trajectories": "own.csv"},
    }
    config = parse_study({**tree, "mission": mission}).mission
    assert parse_duration("--own", text) == config.sampling_period_s
    assert parse_duration("--own", text, "h") == config.duration_h


@pytest.mark.parametrize(("text", "message"), [
    ("5 minutes", (r"--own: found '5 minutes'; allowed: a number of days, or text such as \"10"
                  r" min\"")),
    ("", "--own: found ''; allowed"),
    ("-1", "--own is -1 d; it must be finite and positive"),
    ("0 h", "--own is 0 d; it must be finite and positive"),
    ("nan", "--own is nan d; it must be finite"),
    ("9" * 400 + " h", "--own is inf d; it must be finite"),
])  # fmt: skip
def test_what_is_no_duration_is_refused(text, message):
    refused(MantaRayError, message, parse_duration, "--own", text, "d")


def test_a_number_in_the_option_s_unit_needs_no_word():
    assert (parse_duration("--own", "300"), parse_duration("--own", "0", positive=False)) == (
        300.0,
        0.0,
    )


def test_no_option_takes_a_time_as_a_bare_number():
    numbers = []
    for words, command in registered_commands().items():
        for name, parameter in inspect.signature(command.callback).parameters.items():
            what, *about = get_args(parameter.annotation) or (None,)
            if what in (float, int, float | None, int | None) and about[0].parser is None:
                numbers.append((words, name, str(about[0].help)))
    assert ("ocean correct", "noise_ratio") in [number[:2] for number in numbers]
    assert not [n for n in numbers if re.search(r"\b(seconds|minutes|hours|days)\b", n[-1].lower())]


def test_every_option_has_a_type_and_not_the_name_of_one():
    """Of a name, typer takes one word for a tuple of numbers, and refuses every value."""
    kinds = {
        f"{words} {name}": get_args(parameter.annotation) or (parameter.annotation,)
        for words, command in registered_commands().items()
        for name, parameter in inspect.signature(command.callback).parameters.items()
    }
    assert len(kinds) > 300
    assert [name for name, (kind, *_) in kinds.items() if isinstance(kind, str | ForwardRef)] == []


def test_ranges_accept_times_in_words_and_need_the_file_first(mantaray, monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(
        "pymantaray.apps.study.command.run_and_report", lambda config, *_, **__: seen.append(config)
    )
    rows = "".join(
        f"{t},{name},79,{lon},10\n" for name, lon in (("A", 1), ("B", 1.1)) for t in (0, 600)
    )
    (tmp_path / "own.csv").write_text("time,vehicle,lat,lon,depth\n" + rows)
    words = ("ranges", tmp_path / "own.csv", "--ocean", "synthetic:fram", "--out", tmp_path / "new")
    assert mantaray(*words, "--interval", "5 min", "--sampling", "1 min 40 s").code == 0
    assert mantaray(*words, "--slots", "A,B", "--slot", "1.5 min").code == 0
    first, second = (config.mission for config in seen)
    assert (first.ping_interval_h, first.sampling_period_s) == (300.0 / 3600.0, 100.0)
    assert second.schedule.slot_s == 90.0
    missing = tmp_path / "nothere.csv"
    lost = mantaray("ranges", missing, *words[2:])
    assert (lost.code, lost.err) == (2, f"error: {missing}: no such file; name an existing file\n")
    assert "schedule of pings" in mantaray(*words).err


@pytest.mark.parametrize(("words", "fault"), [
    ("nope", "mantaray: No such command 'nope'"),
    ("study quick --quiet",
     ("mantaray study: No such command 'quick'; allowed: list, .*; did you mean"
                 " mantaray study run quick --quiet\\?")),
    ("ranges --itnerval 3", "mantaray ranges: No such option: --itnerval .*--interval"),
    ("export runs/latest --out o", "mantaray export: Missing option '--to'"),
    ("study run quick --workers two", "mantaray study run: Invalid value for '--workers'"),
    ("ocean check --currents rset",
     "mantaray ocean check: Invalid value for '--currents': 'rset' .*'rest'"),
    ("ocean make", "mantaray ocean: No such command 'make'"),
])  # fmt: skip
def test_an_unknown_word_is_one_line_that_names_the_command(mantaray, words, fault):
    wrong = mantaray(*words.split())
    assert (wrong.code, wrong.out) == (2, "")
    command = fault.partition(":")[0]
    assert re.fullmatch(f"error: {fault}.*; see {command} --help\n", wrong.err), wrong.err


@pytest.mark.parametrize("words", [(), ("ocean",), ("ocean", "fetch")])
def test_a_group_without_a_command_prints_its_help(mantaray, words):
    done = mantaray(*words)
    assert (done.code, done.err) == (2, "")
    assert f"Usage: {' '.join(('mantaray', *words))}" in done.out


@pytest.mark.parametrize(
    ("unit", "text", "number"),
    [("m", "4 km", 4000.0), ("m/s", "1450", 1450.0), ("km", "500 m", 0.5)],
)
def test_an_option_takes_a_number_in_its_unit_or_text_with_a_unit(unit, text, number):
    assert quantity(unit)(text) == number


def test_an_option_refuses_another_quantity_in_one_line(mantaray):
    words = (__file__, "b.csv", "--profile", __file__)
    done = mantaray("rays", "times", *words, "--bathymetry", "2 kg")
    assert done.code == 2
    assert done.err.startswith(
        "error: --bathymetry: found '2 kg'; allowed: a number of metres, or text"
    )
    assert len(done.err.splitlines()) == 1


def test_a_centre_beside_a_position_is_refused():
    both = GridOptions(centre=(70.0, 2.0), position=(70.0, 1.0))
    refused(WaterError, "--centre and --position: .* give one of them", getattr, both, "keys")


@pytest.mark.parametrize(
    "command",
    ["rays times a.csv b.csv --profile c.csv", "ocean from-cast c.csv o.nc", "serve c.csv"],
)
def test_the_sea_bed_has_one_name(mantaray, command):
    for name in ("--bottom", "--sea-floor", "--bottom-depth"):
        done = mantaray(*command.split(), name, "200")
        assert done.code == 2
        assert (
            f"No such option: {name}; the depth of the sea bed is --bathymetry; see mantaray"
            in done.err
        )
