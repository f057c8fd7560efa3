"""
Options that several commands share, and the panels and words of their help: a command's own options
first, then output, arrivals and water.
"""

import functools
import inspect
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup
from typer.models import OptionInfo

from pymantaray.cli.groups import OptionalValue, existing, number_in, quantity
from pymantaray.cli.printing import Printer, log_to_stderr, printer, use_options_of
from pymantaray.errors import AcousticsError, MantaRayError, StudyError, WaterError
from pymantaray.ocean.names import Equation
from pymantaray.plotting.formats import FORMATS
from pymantaray.quantities.units import is_like_quantity

OUTPUT = "Output"
ARRIVALS = "Arrivals"
WATER = "Water"
_ORDER = (None, OUTPUT, ARRIVALS, WATER)  # None: a command's own options
_LONGEST_CHOICES = 22  # characters; longer lists of words stand in the text of an option
_WORDS = {
    "bool": "",
    "float": "NUMBER",
    "int": "N",
    "int range": "N",
    "list[Path]": "FILE",
    "list[int]": "N",
    "list[str]": "NAME",
    "path": "FILE",
    "str": "NAME",
}
_VALUES = {
    "DURATION": "DURATION is a number of seconds, or text such as '10 min' or '13 ms'.",
    "METRES": "METRES is a number, or text such as '2 km'.",
}
"""Sentences for the end of the help of a command that has such values."""


class Command(TyperCommand):
    """Command with panels in order, words for values, and options whose value may be left out."""

    optional_values: ClassVar[Sequence[OptionalValue]] = ()

    def make_context(self, info_name: Any, args: list[str], *rest: Any, **extra: Any) -> Any:
        """Insert the values that are left out, and read the arguments."""
        words = with_optional_values(args, self.optional_values)
        return super().make_context(info_name, words, *rest, **extra)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help."""
        prepare_help(self, ctx)
        super().format_help(ctx, formatter)


class Group(TyperGroup):
    """Group of commands, with words for values."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help."""
        prepare_help(self, ctx)
        super().format_help(ctx, formatter)


def prepare_help(command: Any, ctx: Any) -> None:
    """Give every parameter a panel and words, in the order of the panels."""
    parameters = command.get_params(ctx)
    if isinstance(command, Command):
        parameters[-1].rich_help_panel = OUTPUT  # --help
    for parameter in parameters:
        word = _word(parameter, ctx)
        if isinstance(parameter, TyperArgument):  # typer writes a type in any case
            parameter.display_type_rich = lambda **_: ""  # type: ignore[method-assign]
        else:
            parameter.metavar = word
    command.params.sort(key=lambda parameter: _ORDER.index(parameter.rich_help_panel))
    values = " ".join(str(parameter.metavar) for parameter in parameters)
    sentences = [text for word, text in _VALUES.items() if word in values]
    command.epilog = " ".join(sentences) or None


def _word(parameter: Any, ctx: Any) -> str:
    """Word for a value: that of the option, the choices, or one for the type."""
    if parameter.metavar is not None:
        return str(parameter.metavar)
    if getattr(parameter, "count", False):
        return ""
    name = parameter.display_type(ctx).strip("<>")
    if len(name) <= _LONGEST_CHOICES or "|" not in name:
        return _WORDS.get(str(name), str(name))
    words = name.split("|")
    if any(word not in parameter.help for word in words):
        parameter.help += f" Allowed: {', '.join(words)}."
    return "WORD"


_OCEAN = "--ocean"
Pair = tuple[float, float]
LINKS = typer.Argument(
    callback=existing(),
    metavar="LINKS.csv",
    help="Columns source_north, source_east, source_depth, receiver_north, receiver_east,"
    " receiver_depth, all in metres; with --ocean also source_lat, source_lon and so on; one link"
    " per row.",
    show_default=False,
)
Force = Annotated[
    bool,
    typer.Option("--force", help="Overwrite the output if it exists.", rich_help_panel=OUTPUT),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="No progress, no summary, no warnings.", rich_help_panel=OUTPUT
    ),
]
NoWarnings = Annotated[
    bool, typer.Option("--quiet", "-q", help="No warnings.", rich_help_panel=OUTPUT)
]
Verbose = Annotated[
    int,
    typer.Option(
        "--verbose",
        "-v",
        count=True,
        show_default=False,
        help="Log stages and times; -vv: log all messages.",
        rich_help_panel=OUTPUT,
    ),
]
Json = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON object, for scripts.", rich_help_panel=OUTPUT),
]
To = Annotated[
    Literal["text", "latex", "csv", "json"],
    typer.Option(
        help="Print text, the tables alone as LaTeX (for booktabs) or CSV, or JSON.",
        rich_help_panel=OUTPUT,
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the study, such as noise.range_sigma=2 or"
        " fleet.vehicles.B.target_depth=300; none removes a value.",
    ),
]


RepairFreezing = Annotated[
    bool,
    typer.Option(
        "--repair-freezing",
        help="Raise the salinity of casts below the freezing point to the freezing line.",
    ),
]


def parse_duration(option: str, text: str, unit: str = "s", *, positive: bool = True) -> float:
    """Parse a number in the option's unit, or text with a unit, as in a configuration."""
    try:
        value = number_in(text, unit)
    except ValueError as error:
        raise MantaRayError(f"{option}: {error}") from None
    from pymantaray.quantities.checks import check_number

    check_number(MantaRayError, option, value, unit, positive=positive)
    return value


def changes_of(assignments: list[str] | None) -> dict[str, Any]:
    """Values by dotted key from the assignments of ``--set``."""
    from pymantaray.config.keys import parse_changes

    try:
        return parse_changes(assignments or [])
    except StudyError as error:
        raise StudyError(f"--set {error}") from None


class Commands(typer.Typer):
    """Group of commands, all with ``--quiet`` and ``--verbose``."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(no_args_is_help=True, **({"cls": Group} | settings))

    def own(self) -> Self:
        """Copy to which commands of other applications can be added."""
        other = copy(self)
        other.registered_commands = [*self.registered_commands]
        other.registered_groups = [*self.registered_groups]
        return other

    def command(self, name: str | None = None, **settings: Any) -> Callable[..., Any]:
        """
        Add a function as a command, and return it unchanged; a function with an option ``--ocean``
        is an `OceanCommand`.
        """
        take = super().command

        def decorate(function: Callable[..., None]) -> Callable[..., None]:
            text = " ".join((inspect.getdoc(function) or "").split())
            parameters = inspect.signature(function).parameters
            marks = {
                name: getattr(p.annotation, "__metadata__", ()) for name, p in parameters.items()
            }
            is_option = any(isinstance(mark, OptionInfo) for mark in marks.get("ocean", ()))
            kind = OceanCommand if is_option else Command
            optional = [
                mark for of in marks.values() for mark in of if isinstance(mark, OptionalValue)
            ]
            about: dict[str, Any] = {
                "cls": type(kind.__name__, (kind,), {"optional_values": optional}),
                "help": text,
            }
            take(name, **(about | settings))(_with_verbosity(function))
            return function

        return decorate


def _with_verbosity(command: Callable[..., None]) -> Callable[..., None]:
    """
    Add ``--verbose``, and ``--quiet`` unless the command has it, and set the log level accordingly.
    """
    signature = inspect.signature(command)
    by_name = inspect.Parameter.KEYWORD_ONLY
    own = "quiet" in signature.parameters
    added = (
        [] if own else [inspect.Parameter("quiet", by_name, default=False, annotation=NoWarnings)]
    )
    added.append(inspect.Parameter("verbose", by_name, default=0, annotation=Verbose))
    parameters = [p.replace(kind=by_name) for p in signature.parameters.values()] + added

    @functools.wraps(command)
    def call(*, quiet: bool, verbose: int, **values: Any) -> None:
        use_options_of(parameters)
        with log_to_stderr(quiet=quiet, verbose=verbose):
            command(**values, **({"quiet": quiet} if own else {}))

    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters}
    return call


class OceanCommand(Command):
    """
    Command whose ``--ocean`` may be repeated or followed by several files: ``--ocean a b`` means
    ``--ocean a --ocean b``.

    Words after ``--ocean FILE`` are files only if the command has more words than arguments, so
    ``--ocean FILE IN OUT`` has one file. A command with any number of arguments takes all of them
    as files if its arguments come first: ``IN... --ocean a b``.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert ``--ocean`` before each additional file."""
        _, surplus, _ = self.make_parser(ctx).parse_args(args=list(args))
        endless = any(p.param_type_name == "argument" and p.nargs == -1 for p in self.params)
        first = bool(args) and not args[0].startswith("-")
        return super().parse_args(
            ctx, repeat_ocean(args, len(args) if endless and first else len(surplus))
        )


def with_optional_values(words: list[str], options: Sequence[OptionalValue]) -> list[str]:
    """
    Insert the value of an option whose value is left out.

    Examples
    --------
    >>> size = OptionalValue("--size", "large", ("small", "large"))
    >>> with_optional_values(["in.csv", "--size", "--quiet"], [size])
    ['in.csv', '--size', 'large', '--quiet']
    """
    out: list[str] = []
    for word, following in pairwise([*words, ""]):
        out.append(word)
        out += [one.value for one in options if word == one.flag and following not in one.values]
    return out


def repeat_ocean(words: list[str], most: int) -> list[str]:
    """
    Insert ``--ocean`` before the words after its first value, at most ``most`` of them.

    Examples
    --------
    >>> repeat_ocean(["quick", "--ocean", "a", "b", "--quiet"], 1)
    ['quick', '--ocean', 'a', '--ocean', 'b', '--quiet']
    """
    out: list[str] = []
    place = None  # number of the word after the option, from 0; the first is its value
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


class RunGroup(Group):
    """Group of commands whose error message for an unknown command suggests `run`."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find a command; for an unknown word the error message suggests `run`."""
        if args and self.get_command(ctx, args[0]) is None:
            commands = ", ".join(self.list_commands(ctx))
            ctx.fail(
                f"No such command '{args[0]}'; allowed: {commands}; did you mean"
                f" {ctx.command_path} run {' '.join(args)}?"
            )
        return super().resolve_command(ctx, args)


@dataclass(frozen=True)
class OceanOptions:
    """Source of the water: an ocean, a profile or cast, or a configuration."""

    panel: ClassVar = WATER

    ocean: Annotated[
        list[str] | None,
        typer.Option(
            callback=existing(),
            metavar="NAME|FILE...",
            help="Ocean files that belong together, a profile or cast, synthetic:beaufort or"
            " synthetic:fram, a preset, or a TOML file.",
        ),
    ] = None
    profile: Annotated[
        list[Path] | None,
        typer.Option(
            callback=existing(),
            metavar="FILE",
            help="A profile or cast: a table with depth (m) or pressure (dbar), and sound_speed"
            " (m/s) or temperature (degC) and salinity, an instrument's file, Argo or CF profiles;"
            " needs --bathymetry.",
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.ocean and self.profile:
            raise WaterError("--ocean and --profile cannot be combined; give one of them")

    @property
    def words(self) -> list[str]:
        """
        Names of files, of a synthetic ocean, of a preset or of a configuration; empty without an
        option.
        """
        return [str(word) for word in (self.ocean or self.profile or [])]

    @property
    def files(self) -> list[Path]:
        """Files that no output may overwrite."""
        return [Path(word) for word in self.words]


@dataclass(frozen=True)
class AnySourceOptions(OceanOptions):
    """Source of the water, which may also be a run."""

    run: Annotated[
        Path | None,
        typer.Option(
            callback=existing("folder"),
            metavar="FOLDER",
            help="Folder of a study's run, for its ocean at the start.",
        ),
    ] = None

    def __post_init__(self) -> None:
        if len(self.given) > 1:
            raise WaterError(f"{' and '.join(self.given)} cannot be combined; give one of them")

    @property
    def given(self) -> list[str]:
        """Options that name a source."""
        return [f"--{name}" for name in ("ocean", "profile", "run") if getattr(self, name)]


@dataclass(frozen=True)
class SourceOptions(AnySourceOptions):
    """Source of the water, which is required."""

    def __post_init__(self) -> None:
        if len(self.given) != 1:
            found = " and ".join(self.given) or "no ocean"
            raise WaterError(
                f"{found} given; exactly one of --ocean, --profile and --run is needed"
            )


@dataclass(frozen=True)
class GridOptions:
    """Sea floor, currents, domain, time and names of water on a grid, without options of rays."""

    panel: ClassVar = WATER

    bathymetry: Annotated[
        str | None,
        typer.Option(
            metavar="METRES|FILE",
            help="Depth of the sea floor, or a file of it (NetCDF, GeoTIFF, ESRI ASCII, text of"
            " x, y, z); required for a profile. Default: the deepest levels of the ocean.",
        ),
    ] = None
    crs: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Projection of a sea floor file that does not name it, such as EPSG:3996 for"
            " IBCAO.",
        ),
    ] = None
    currents: Annotated[
        Literal["required", "rest", "carry"] | None,
        typer.Option(
            help="required: files must have currents; rest: water without currents is at rest;"
            " carry: currents also change travel times along the rays. Default: rest."
        ),
    ] = None
    equation: Annotated[
        Equation | None,
        typer.Option(help="Equation of sound speed. Default: teos-10."),
    ] = None
    centre: Annotated[
        Pair | None,
        typer.Option(
            metavar="LAT LON",
            help="Position where north and east are 0. Default: the middle of the data, or the"
            " position of a cast.",
        ),
    ] = None
    half_extent: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="NORTH EAST",
            help="Half sides of the domain, in METRES each. Default: the largest"
            " domain in the data; a profile has no sides.",
        ),
    ] = None
    time: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TIME",
            help="Time of the ocean (UTC), if its files have several. May be repeated for an"
            " atlas. Default for an atlas: the first.",
        ),
    ] = None
    cast: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|nearest",
            help="Cast of a file with several: its name, or the nearest to --centre, and there to"
            " --time.",
        ),
    ] = None
    bearing: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Direction of a section of sound speed by range and depth, clockwise from north."
            " Default: 0.",
        ),
    ] = None
    repair_freezing: RepairFreezing = False
    position: Annotated[
        Pair | None,
        typer.Option(
            metavar="LAT LON",
            help="Position of a profile whose file has none, for the computation of sound speed or"
            " depth.",
        ),
    ] = None
    name: Annotated[
        list[str] | None,
        typer.Option(
            metavar="VARIABLE=STANDARD_NAME",
            help="CF standard name of a variable that lacks one, such as"
            " temp=sea_water_temperature. May be repeated.",
        ),
    ] = None

    @property
    def keys(self) -> dict[str, Any]:
        """Options of `pymantaray.open_water`."""
        if self.time is not None and len(self.time) > 1:
            raise WaterError(
                f"--time is given {len(self.time)} times; only one instant is allowed; give one"
            )
        if self.centre is not None and self.position is not None:
            raise WaterError(
                "--centre and --position: a profile lies at the centre; give one of them"
            )
        return _given(
            bathymetry=_metres_or_file("--bathymetry", self.bathymetry),
            bathymetry_crs=self.crs,
            currents=self.currents,
            equation=self.equation,
            centre=self.centre or self.position,
            half_extent=None
            if self.half_extent is None
            else tuple(metres_of("--half-extent", side) for side in self.half_extent),
            time=_instant(self.time[0]) if self.time else None,
            cast=self.cast,
            bearing=self.bearing,
            repair_freezing=self.repair_freezing or None,
            names=dict(map(_named, self.name)) if self.name else None,
        )


@dataclass(frozen=True)
class WaterOptions(GridOptions):
    """Sea floor, ice, currents and domain of water from any source."""

    ice: Annotated[
        str | None,
        typer.Option(metavar="METRES|FILE", help="Draft of an ice cover, or a NetCDF file of it."),
    ] = None
    ice_slope: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Standard deviation of the slope of the underside of the ice, which is then rough"
            " for rays.",
        ),
    ] = None
    ice_length: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="Correlation length of the rough ice. Default: 20 m.",
        ),
    ] = None
    interpolation: Annotated[
        Literal["smooth", "linear"] | None,
        typer.Option(
            help="Between grid points: cubic splines or straight lines. Default: smooth, for --run"
            " as in the study, for Bellhop linear."
        ),
    ] = None
    earth: Annotated[
        Literal["flat", "sphere"] | None,
        typer.Option(
            help="Shape of the Earth for rays and straight distances. Default: flat; for locate and"
            " replay the sphere if positions have latitude and longitude."
        ),
    ] = None
    thin: Annotated[
        float | None,
        typer.Option(
            metavar="M/S",
            help="Remove levels of a profile if interpolation stays within this error of sound"
            " speed; 0 keeps all. Default: 0.02 for a raw cast.",
        ),
    ] = None
    smooth: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"), metavar="METRES", help="Average a profile over this depth."
        ),
    ] = None

    @property
    def keys(self) -> dict[str, Any]:
        """Options of `pymantaray.open_water`."""
        return super().keys | self.own_keys

    @property
    def own_keys(self) -> dict[str, Any]:
        """Options of ice, rays and profiles, which an ocean on its grid does not have."""
        return _given(
            ice=_metres_or_file("--ice", self.ice),
            ice_slope_deg=self.ice_slope,
            ice_length=self.ice_length,
            interpolation=self.interpolation,
            earth=self.earth,
            thin=self.thin,
            smooth=self.smooth,
        )

    @property
    def files(self) -> list[Path]:
        """Files that no output may overwrite."""
        given = (
            _metres_or_file("--bathymetry", self.bathymetry),
            _metres_or_file("--ice", self.ice),
        )
        return [Path(value) for value in given if isinstance(value, str)]


def _instant(text: str) -> Any:
    """Instant of a configuration (UTC)."""
    from pymantaray.ocean.convert import parse_instant

    return parse_instant(text).astype("datetime64[us]").item()


def metres_of(option: str, text: str) -> float:
    """Parse a length of an option. [m]"""
    try:
        return number_in(text, "m")
    except ValueError as error:
        raise WaterError(f"{option}: {error}") from None


def _cutoff(text: str) -> float | str:
    """Parse a cut-off in decibels, or a word for none."""
    if text in ("none", "off"):
        return "none"
    try:
        decibels = float(text)
    except ValueError:
        decibels = 0.0
    if not decibels > 0.0:
        raise AcousticsError(
            f"--cutoff-db is {text}; it must be a positive number of decibels, or none"
        )
    return decibels


def _given(**keys: Any) -> dict[str, Any]:
    """Return the keys that have a value."""
    return {key: value for key, value in keys.items() if value is not None}


def _metres_or_file(option: str, text: str | None) -> float | str | None:
    """
    Parse a depth or draft [m], or the name of a file with it; a number with another kind of unit
    raises an error.
    """
    try:
        return None if text is None else number_in(text, "m")
    except ValueError as error:
        if is_like_quantity(str(text)):
            raise WaterError(f"{option}: {error}") from None
        return text


def _named(text: str) -> tuple[str, str]:
    variable, sign, meaning = text.partition("=")
    if not (variable and sign and meaning):
        raise WaterError(
            f"--name {text}: it must be VARIABLE=STANDARD_NAME, such as"
            " temp=sea_water_potential_temperature"
        )
    return variable, meaning


@dataclass(frozen=True)
class ArrivalOptions:
    """
    Selection of eigenrays that count as arrivals. Default: that of a configuration, otherwise
    direct rays within 15 dB.
    """

    panel: ClassVar = ARRIVALS

    max_surface_bounces: Annotated[
        int | None,
        typer.Option(
            min=0, max=15, help="Maximum number of reflections at the surface. Default: 0."
        ),
    ] = None
    max_bottom_bounces: Annotated[
        int | None,
        typer.Option(
            min=0, max=15, help="Maximum number of reflections at the sea bed. Default: 0."
        ),
    ] = None
    cutoff_db: Annotated[
        Any,
        typer.Option(
            parser=_cutoff,
            metavar="DB|none",
            help="Eigenrays weaker than spherical spreading by more than this are discarded,"
            " except on links below 1 m. Default: 15.",
        ),
    ] = None

    @property
    def keys(self) -> dict[str, Any]:
        """Options of `pymantaray.open_water`."""
        return _given(
            max_surface_bounces=self.max_surface_bounces,
            max_bottom_bounces=self.max_bottom_bounces,
            spreading_cutoff_db=self.cutoff_db,
        )


@dataclass(frozen=True)
class SearchOptions(ArrivalOptions):
    """Options of the search for eigenrays."""

    tolerance: Annotated[
        float,
        typer.Option(
            parser=quantity("m"), metavar="METRES", help="Maximum error of the end of a ray."
        ),
    ] = 1e-3

    def __post_init__(self) -> None:
        from pymantaray.quantities.checks import check_number

        check_number(AcousticsError, "--tolerance", self.tolerance, "m", positive=True)


@dataclass(frozen=True)
class PrintOptions:
    """Form of the output, text or JSON, and its amount."""

    panel: ClassVar = OUTPUT

    as_json: Json = False
    quiet: Quiet = False

    def printer(self) -> AbstractContextManager[Printer]:
        """Return the printer that the options select."""
        return printer(as_json=self.as_json, quiet=self.quiet)


@dataclass(frozen=True)
class TableOptions(PrintOptions):
    """Form of the output, text, tables or JSON, and its amount."""

    to: To = "text"

    def printer(self) -> AbstractContextManager[Printer]:
        """Return the printer that the options select."""
        return printer(as_json=self.as_json, quiet=self.quiet, to=self.to)


@dataclass(frozen=True)
class ProcessOptions:
    """Processes of this machine or of a cluster."""

    workers: Annotated[int | None, typer.Option(min=1, help="Processes of this machine.")] = None
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, tcp://HOST:PORT.")
    ] = None


Formats = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="NAME,...",
        help="For a paper: figures as png (300 dpi), pdf or svg, tables as tex, 84mm for each"
        " figure as PDF for one column of a journal; several with commas.",
        rich_help_panel=OUTPUT,
    ),
]


FigureFormats = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="NAME,...",
        help="For a paper: png for 300 dpi, svg for SVG as well, 84mm for each figure in a layout"
        " for one column of a journal as well; several with commas.",
        rich_help_panel=OUTPUT,
    ),
]


@dataclass(frozen=True, kw_only=True)
class FolderOptions:
    """Folder of the results, and formats of its figures and tables."""

    panel: ClassVar = OUTPUT

    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="New or empty folder for the results. Default: a dated folder in runs.",
        ),
    ] = None
    formats: Formats = ""


def format_names(text: str, allowed: Sequence[str] = FORMATS) -> tuple[str, ...]:
    """Parse the names of ``--format``; an unknown name raises an error before any computation."""
    names = tuple(filter(None, text.split(",")))
    for name in names:
        if name not in allowed:
            raise typer.BadParameter(
                f"{name!r} is unknown; allowed: {', '.join(allowed)}", param_hint="--format"
            )
    return names
