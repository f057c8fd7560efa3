"""Options that several commands share, each written down once."""

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from pymantaray.cli.printing import log_to_stderr
from pymantaray.errors import AcousticsError, MantaRayError, OceanError
from pymantaray.geometry.checks import check_number, duration_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_OCEAN = "--ocean"
Pair = tuple[float, float]
LINKS = typer.Argument(
    metavar="LINKS.csv",
    help="Columns source_north, source_east, source_depth, receiver_north, receiver_east, receiver_depth, all in metres;"
    " with --ocean also source_lat, source_lon and so on; one link a row.",
    show_default=False,
)
Force = Annotated[bool, typer.Option("--force", help="Overwrite the output if it exists.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no summary, no warnings.")]
NoWarnings = Annotated[bool, typer.Option("--quiet", "-q", help="No warnings.")]
Verbose = Annotated[
    int,
    typer.Option(
        "--verbose",
        "-v",
        count=True,
        show_default=False,
        help="Log stages and times; -vv: all that is logged.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object, for scripts.")]


Fan = Annotated[
    tuple[float, float, int] | None,
    typer.Option(
        metavar="FROM TO COUNT",
        help="So many rays launched between two angles in degrees, positive down: instead of eigenrays, of a plot behind them.",
    ),
]
_MOST_RAYS = 100_000  # of a fan
Workers = Annotated[int | None, typer.Option("--workers", min=1, help="Processes of this machine.")]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, tcp://HOST:PORT.")
]


def parse_pair(option: str, text: str) -> Pair:
    """Two numbers with a comma between."""
    try:
        first, second = (float(word) for word in text.split(","))
    except ValueError:
        raise OceanError(f"{option} is {text!r}; needs two numbers with a comma between, as 73,76") from None
    return first, second


def parse_place(option: str, text: str) -> tuple[float, float, float]:
    """North, east and depth with commas between. [m]"""
    try:
        north, east, depth = (float(word) for word in text.split(","))
    except ValueError:
        raise AcousticsError(
            f"{option} is {text!r}; needs north, east and depth in metres with commas between, as 6000,0,500"
        ) from None
    return north, east, depth


def parse_duration(option: str, text: str, unit: str = "s", *, positive: bool = True) -> float:
    """A number in the option's unit, or text with units of its own, as a configuration has it."""
    try:
        value = float(text)
    except ValueError:
        try:
            value = duration_of(text, unit)
        except ValueError as error:
            raise MantaRayError(f"{option}: {error}") from None
    check_number(MantaRayError, option, value, unit, positive=positive)
    return value


def fan_angles(first: float, last: float, count: int) -> "NDArray[np.float64]":
    """Launch angles of a fan from degrees. [rad]"""
    import numpy as np

    if not 1 <= count <= _MOST_RAYS or not first <= last or (count > 1 and first == last):
        raise AcousticsError(
            f"--fan {first:g} {last:g} {count}: needs FROM below TO and a COUNT of 1 to {_MOST_RAYS}"
        )
    return np.radians(np.linspace(first, last, count))


class Commands(typer.Typer):
    """A group of commands that all take ``--quiet`` and ``--verbose``."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(no_args_is_help=True, **settings)

    def command(self, name: str | None = None, **settings: Any) -> Callable[..., Any]:
        """Take a function as a command, and give it back as it is."""
        take = super().command(name, **settings)

        def decorate(function: Callable[..., None]) -> Callable[..., None]:
            take(_with_verbosity(function))
            return function

        return decorate


def _with_verbosity(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--verbose``, and ``--quiet`` where the command has no use of its own for it; log as much as they say."""
    signature, by_name = inspect.signature(command), inspect.Parameter.KEYWORD_ONLY
    own = "quiet" in signature.parameters
    added = [] if own else [inspect.Parameter("quiet", by_name, default=False, annotation=NoWarnings)]
    added.append(inspect.Parameter("verbose", by_name, default=0, annotation=Verbose))
    parameters = [p.replace(kind=by_name) for p in signature.parameters.values()] + added

    @functools.wraps(command)
    def call(*, quiet: bool, verbose: int, **values: Any) -> None:
        with log_to_stderr(quiet=quiet, verbose=verbose):
            command(**values, **({"quiet": quiet} if own else {}))

    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters}
    return call


class OceanCommand(TyperCommand):
    """
    Command whose ``--ocean`` is repeated, or followed by several files: ``--ocean a b`` for ``--ocean a --ocean b``.

    Words behind ``--ocean FILE`` are further files only as far as the command has more words than arguments, so
    that ``--ocean FILE IN OUT`` is one file. A command of any number of arguments takes all of them where its arguments
    stand first: ``IN... --ocean a b``.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write ``--ocean`` before each further file."""
        _, surplus, _ = self.make_parser(ctx).parse_args(args=list(args))
        endless = any(p.param_type_name == "argument" and p.nargs == -1 for p in self.params)
        first = bool(args) and not args[0].startswith("-")
        return super().parse_args(ctx, repeat_ocean(args, len(args) if endless and first else len(surplus)))


def repeat_ocean(words: list[str], most: int) -> list[str]:
    """
    Write ``--ocean`` before at most so many words that stand behind it and its first value.

    Examples
    --------
    >>> repeat_ocean(["quick", "--ocean", "a", "b", "--quiet"], 1)
    ['quick', '--ocean', 'a', '--ocean', 'b', '--quiet']
    """
    out: list[str] = []
    place = None  # of the word in a run behind the option, from 0; the first is its value
    for word in words:
        if word.startswith("-"):
            place = 0 if word == _OCEAN else 1 if word.startswith(f"{_OCEAN}=") else None
        elif place is not None:
            if place > 0 and most > 0:
                out.append(_OCEAN)
                most -= 1
            place += 1
        out.append(word)
    return out


class RunGroup(TyperGroup):
    """Group of commands of which `run` takes what a user may write right behind the group's name."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; a word that is none is refused with what was perhaps meant."""
        if args and self.get_command(ctx, args[0]) is None:
            commands = ", ".join(self.list_commands(ctx))
            ctx.fail(
                f"No such command '{args[0]}'; there are {commands}; perhaps: {ctx.command_path} run {' '.join(args)}"
            )
        return super().resolve_command(ctx, args)


@dataclass(frozen=True)
class MediumOptions:
    """Where the water comes from: a profile, an ocean or a study's run."""

    profile: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="A profile or cast: a table with depth (m) or pressure (dbar), and sound_speed (m/s) or temperature"
            " (degC) and salinity, an instrument's file, Argo or CF profiles; needs --bottom.",
        ),
    ] = None
    bottom: Annotated[
        float | None, typer.Option(metavar="M", help="Depth of the sea bed under the profile, in metres.")
    ] = None
    thin: Annotated[
        float | None,
        typer.Option(
            metavar="M/S", help="Leave out levels of the profile that interpolation meets within so many m/s."
        ),
    ] = None
    smooth: Annotated[
        float | None, typer.Option(metavar="M", help="Average the profile over so many metres.")
    ] = None
    position: Annotated[
        Pair | None,
        typer.Option(
            metavar="LAT LON",
            help="Where the profile was taken, if sound speed or depth has to be computed (TEOS-10). Default: what"
            " the file's comment lines say.",
        ),
    ] = None
    ocean: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME|FILE...", help="Ocean files, or synthetic:beaufort or synthetic:fram."),
    ] = None
    centre: Annotated[
        Pair | None,
        typer.Option(
            metavar="LAT LON", help="Where in the ocean north and east are 0. Default: the data's middle."
        ),
    ] = None
    half_extent: Annotated[
        Pair | None,
        typer.Option(
            metavar="NORTH EAST", help="Half sides of the domain in metres. Default: the largest that fits."
        ),
    ] = None
    time: Annotated[str | None, typer.Option(help="Which time of the ocean's files, UTC.")] = None
    ice: Annotated[
        str | None,
        typer.Option(
            metavar="M|FILE",
            help="Draft of an ice cover over profile or ocean: metres everywhere, or a NetCDF file over an ocean.",
        ),
    ] = None
    run: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of a study's run, for its ocean.")
    ] = None
    interpolation: Annotated[
        Literal["smooth", "linear"] | None,
        typer.Option(
            help="What lies between grid points: cubic splines or straight lines. Default: smooth, for --run as in"
            " the study, for Bellhop linear."
        ),
    ] = None

    @property
    def files(self) -> list[Path]:
        """Files that no output may overwrite."""
        ice = self.ice_cover
        names = (ice if isinstance(ice, str) else None, *(self.profile or []), *(self.ocean or []))
        return [Path(name) for name in names if name is not None]

    @property
    def ice_cover(self) -> float | str:
        """Draft of the ice [m], or the file that has it."""
        try:
            return float(self.ice or 0.0)
        except ValueError:
            return str(self.ice)


@dataclass(frozen=True)
class SearchOptions:
    """Which eigenrays are looked for."""

    max_surface_bounces: Annotated[
        int, typer.Option(min=0, max=15, help="Reflections at the surface that an arrival may have.")
    ] = 0
    max_bottom_bounces: Annotated[
        int, typer.Option(min=0, max=15, help="Reflections at the sea bed that an arrival may have.")
    ] = 0
    cutoff_db: Annotated[
        str,
        typer.Option(
            metavar="DB|off", help="Rays weaker than spherical spreading by more than this are no arrivals."
        ),
    ] = "15"
    tolerance: Annotated[
        float, typer.Option(metavar="M", help="Error allowed at the end of a ray, in metres.")
    ] = 1e-3

    def __post_init__(self) -> None:
        check_number(AcousticsError, "--tolerance", self.tolerance, "m", positive=True)
        try:
            cutoff = self.spreading_cutoff_db
        except ValueError:
            cutoff = 0.0
        if cutoff is not None and not cutoff > 0.0:
            raise AcousticsError(
                f"--cutoff-db {self.cutoff_db}: a positive number of decibels or off is needed"
            )

    @property
    def spreading_cutoff_db(self) -> float | None:
        """The cut-off as `find_eigenrays` takes it. [dB]"""
        return None if self.cutoff_db == "off" else float(self.cutoff_db)


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Let a command for typer take groups of options, arguments whose type is a dataclass above, as one argument each."""
    signature, by_name = inspect.signature(command), inspect.Parameter.KEYWORD_ONLY
    own = signature.parameters.values()
    groups: dict[str, Any] = {p.name: p.annotation for p in own if is_dataclass(p.annotation)}
    parameters = [p.replace(kind=by_name) for p in own if p.name not in groups]
    for group in groups.values():
        hints = get_type_hints(group, include_extras=True)
        parameters += [
            inspect.Parameter(f.name, by_name, default=f.default, annotation=hints[f.name])
            for f in fields(group)
        ]

    @functools.wraps(command)
    def call(**values: Any) -> None:
        arguments = {
            name: group(**{f.name: values.pop(f.name) for f in fields(group)})
            for name, group in groups.items()
        }
        command(**values, **arguments)

    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters}
    return call
