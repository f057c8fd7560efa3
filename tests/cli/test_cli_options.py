"""One `--ocean` takes several files and no argument of the command."""

from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from pymantaray.cli.options import OceanCommand
from pymantaray.study import load_study

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
    files: list[str], ocean: Annotated[list[str], typer.Option()], out: Annotated[str, typer.Option()]
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


@pytest.mark.parametrize("words", ["--ocean a IN", "IN OUT MORE", "IN OUT MORE --ocean a", "IN OUT --ocean"])
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

    monkeypatch.setattr("pymantaray.study.run_study", stop)
    assert mantaray("study", "run", *words).code == 130
    assert seen == [("synthetic:fram",)]
    assert load_study("quick", ocean=["synthetic:fram"]).ocean.files == ()
