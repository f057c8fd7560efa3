"""Groups of options: a library's dataclass becomes options, and the options build the dataclass."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest
import typer
from typer.testing import CliRunner

from pymantaray.cli.groups import Fields, with_options


@dataclass(frozen=True)
class Clock:
    """
    Errors of a clock.

    Parameters
    ----------
    offset : float
        Standard deviation of the offset. [s]
    drift : float
        Standard deviation of the drift. [s/s]
    """

    offset: float = 120.0
    drift: float = 0.0


@dataclass(frozen=True)
class Buoy:
    """
    Buoy of a test.

    Parameters
    ----------
    depth : float
        Depth of the hydrophone
        below ``the surface``. [m]
    levels : tuple of float
        Depths of sensors. [m]
    files : tuple of str or pathlib.Path
        Files of the buoy.
    lever : tuple of float, optional
        Vector to the antenna. [m]
    kind : {"moored", "adrift"}, optional
        Mooring.
    name : str, optional
        Name.
    loud : bool
        Whether it pings.
    clock : Clock
        Clock.
    colour : str
        Not an option.
    """

    depth: float
    levels: tuple[float, ...] = (1.0, 20.0)
    files: tuple[str | Path, ...] = ()
    lever: tuple[float, float, float] | None = None
    kind: Literal["moored", "adrift"] | None = None
    name: str | None = None
    loud: bool = False
    clock: Clock = field(default_factory=Clock)
    colour: str = "yellow"


@dataclass(frozen=True, kw_only=True)
class Both:
    """A group with an option of its own and a group of the library."""

    buoy: Annotated[
        Buoy,
        Fields(
            *("levels", "files", "lever", "name", "loud"),
            depth="--hydrophone-depth",
            kind="--moored/--adrift",
            clock=Fields("drift", offset="--clock-offset"),
        ),
    ]
    pings: Annotated[int, typer.Option(help="Number of pings.")] = 1


@pytest.fixture
def call():
    """
    Call a command with the options of a buoy: what it was called with, and the result of the call.
    """
    calls, app = [], typer.Typer()

    @app.command()
    @with_options
    def command(both: Both, quiet: bool = False) -> None:
        calls.append((both, quiet))

    def run(*words):
        done = CliRunner().invoke(app, words)
        return (calls[-1] if calls else None), done

    return run


def test_unused_options_leave_the_defaults_of_the_dataclass(call):
    called, done = call("--hydrophone-depth", "30")
    assert done.exit_code == 0, done.output
    assert called == (Both(buoy=Buoy(depth=30.0)), False)


def test_every_type_of_field_is_an_option(call):
    words = (
        "--hydrophone-depth 0.2km --levels 5,1km --files a.csv --files b.csv --lever 1 -2 3"
        " --adrift --name B1"
    )
    called, done = call(
        *words.split(), "--loud", "--clock-offset", "5 ms", "--clock-drift", "1e-6", "--pings", "2"
    )
    assert done.exit_code == 2  # --clock-drift does not exist: the field's own name is the option
    called, done = call(
        *words.split(), "--loud", "--clock-offset", "5 ms", "--drift", "1e-6", "--pings", "2"
    )
    assert done.exit_code == 0, done.output
    buoy = Buoy(
        depth=200.0,
        levels=(5.0, 1000.0),
        files=(Path("a.csv"), Path("b.csv")),
        lever=(1.0, -2.0, 3.0),
        kind="adrift",
        name="B1",
        loud=True,
        clock=Clock(5e-3, 1e-6),
    )
    assert called[0] == Both(buoy=buoy, pings=2)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "--hydrophone-depth"),
        (("--hydrophone-depth", "2 kg"), "found '2 kg'"),
        (("--hydrophone-depth", "2", "--levels", "1,x"), "numbers separated by commas"),
        (("--hydrophone-depth", "2", "--lever", "1", "2"), "--lever"),
        (("--hydrophone-depth", "2", "--colour", "red"), "--colour"),
    ],
)
def test_what_a_field_cannot_be_is_refused(call, words, message):
    called, done = call(*words)
    assert (called, done.exit_code) == (None, 2)
    assert message in " ".join(done.output.replace("\u2502", " ").split())


def test_the_help_has_the_words_and_the_unit_of_the_docstring(call, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    text = " ".join(call("--help")[1].output.split())
    for words in (
        "--hydrophone-depth METRES Depth of the hydrophone below the surface.",
        "--levels METRES,... Depths of sensors. [default: 1,20]",
        "--clock-offset DURATION Standard deviation of the offset. [default: 2 min]",
        "--lever M M M Vector to the antenna.",
    ):
        assert words in text
