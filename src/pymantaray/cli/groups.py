"""
Groups of options: a parameter of a command whose type is a dataclass becomes one option for each
field.
"""

import functools
import inspect
import re
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin

import typer

from pymantaray.errors import MantaRayError
from pymantaray.quantities.units import has_units, quantity_of
from pymantaray.user_files import check_there

_ENTRY = re.compile(r"^(\w+) :.*\n((?: {4}.*\n?)+)", re.MULTILINE)  # of a numpydoc section
_UNIT = re.compile(r" *\[([^\]]+)\]$")
_NO_PATH = ":*?["  # in an address, a synthetic ocean, or a pattern
_METAVARS = {"s": "DURATION", "m": "METRES", "deg": "DEGREES", "-": "NUMBER"}
"""Words for units; others are the unit in capitals."""


def number_in(value: str | float, unit: str) -> float:
    """Convert a number, or text with a unit of its own, to a number in a unit."""
    try:
        return float(value)
    except ValueError:
        return quantity_of(str(value), unit)


def quantity(unit: str) -> Callable[[str | float], float]:
    """
    Return the parser of an option: a number in a unit, or text with a unit of its own, such as ``2
    km``.
    """

    def parse(value: str | float) -> float:
        try:
            return number_in(value, unit)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    parse.__name__ = unit
    return parse


def quantities(unit: str, count: int | None = None) -> Callable[[str], tuple[float, ...]]:
    """
    Return the parser of an option: numbers in a unit, or texts with units of their own, separated
    by commas.
    """
    words = "numbers" if count is None else f"{count} numbers"

    def parse(text: str) -> tuple[float, ...]:
        try:
            numbers = tuple(number_in(word, unit) for word in text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != (count or max(1, len(numbers))):
            raise typer.BadParameter(f"{text!r}; it must be {words} separated by commas")
        return numbers

    parse.__name__ = unit
    return parse


def existing(what: str = "file") -> Callable[[typer.Context, Any], Any]:
    """
    Return the callback of a parameter whose names must exist, which refuses others before a command
    loads the library. Addresses, patterns and words such as ``synthetic:fram`` are left to readers.
    """

    def check(ctx: typer.Context, value: Any) -> Any:
        for name in value if isinstance(value, list) else [value]:
            if name is not None and not ctx.resilient_parsing and _is_path(name):
                check_there(name, MantaRayError, what)
        return value

    return check


def _is_path(name: str | Path) -> bool:
    """True for a path, and for a word that ends as the name of a file does."""
    text = str(name)
    return not set(text) & set(_NO_PATH) and (isinstance(name, Path) or bool(Path(text).suffix))


class Fields:
    """
    Selection of the fields of a library's dataclass that are options of a command.

    The option of a name is the name itself (``within_db``: ``--within-db``). A keyword gives
    another option (``nominal_sound_speed="--nominal"``), one whose value may be left out and is
    then that in brackets (``method="--method[=fast]"``), two flags of a field with two values
    (``arrangement="--rigid/--free"``), or the fields of a field that is a dataclass
    (``speed_prior=Fields("scale")``).

    Examples
    --------
    >>> Fields("within_db", nominal_sound_speed="--nominal").options
    {'within_db': '--within-db', 'nominal_sound_speed': '--nominal'}
    """

    def __init__(self, *names: str, **options: "str | Fields") -> None:
        self.options: dict[str, str | Fields] = {
            name: f"--{name.replace('_', '-')}" for name in names
        }
        self.options |= options


class OptionalValue(NamedTuple):
    """Mark of an option whose value may be left out: its flag, the value then, and all values."""

    flag: str
    value: str
    values: tuple[str, ...]


class _Option(NamedTuple):
    """Parameter of a command for a field, and the conversion of its value to the field's."""

    parameter: inspect.Parameter
    convert: Callable[[Any], Any] | None = None

    def parameters(self) -> Iterator[inspect.Parameter]:
        """Yield the parameter."""
        yield self.parameter

    def take(self, values: dict[str, Any]) -> Any:
        """Remove the value from those of a call, and return the field's."""
        value = values.pop(self.parameter.name)
        return self.convert(value) if self.convert else value


class _Group(NamedTuple):
    """A dataclass, and options or groups by field."""

    kind: Any
    members: "dict[str, _Option | _Group]"

    def parameters(self) -> Iterator[inspect.Parameter]:
        """Yield the parameters of all options in the group."""
        for member in self.members.values():
            yield from member.parameters()

    def take(self, values: dict[str, Any]) -> Any:
        """Remove the values of the group from those of a call, and return the object."""
        return self.kind(**{name: member.take(values) for name, member in self.members.items()})


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """
    Let a command for typer take groups of options, arguments whose type is a dataclass, as one
    argument each.

    The fields of a dataclass of this folder are annotated with options, or are groups themselves.
    Those of a dataclass of the library need no annotation: `Fields` selects them, and type,
    default, unit and help come from the dataclass and its docstring.
    """
    signature = inspect.signature(command)
    by_name = inspect.Parameter.KEYWORD_ONLY
    groups = {
        p.name: group for p in signature.parameters.values() if (group := _group(p.annotation))
    }
    parameters: list[inspect.Parameter] = []
    for p in signature.parameters.values():
        parameters += groups[p.name].parameters() if p.name in groups else [p.replace(kind=by_name)]

    @functools.wraps(command)
    def call(**values: Any) -> None:
        arguments = {name: group.take(values) for name, group in groups.items()}
        command(**values, **arguments)

    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters}
    return call


def _group(hint: Any) -> _Group | None:
    """Group of an annotation; none if it is not a dataclass."""
    kind, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if not is_dataclass(kind) or not isinstance(kind, type):
        return None
    for mark in marks:
        if isinstance(mark, Fields):
            return _library_group(kind, mark)
    panel = getattr(kind, "panel", None)
    members = {
        field.name: _group(field.type)
        or _Option(_parameter(field.name, _in_panel(field.type, panel), field.default))
        for field in fields(kind)
    }
    return _Group(kind, members)


def _in_panel(annotation: Any, panel: str | None) -> Any:
    """Annotation of an option in a panel of the help, unless the option names one."""
    kind, *marks = get_args(annotation)
    moved = [copy(mark) for mark in marks]
    for mark in moved:
        mark.rich_help_panel = mark.rich_help_panel or panel
    return Annotated[kind, *moved]


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    default = inspect.Parameter.empty if default is MISSING else default
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def _library_group(kind: Any, selection: Fields) -> _Group:
    """Group of the selected fields of a library's dataclass."""
    # description and unit of each field, from the section Parameters of a docstring
    described = {}
    for name, text in _ENTRY.findall(inspect.getdoc(kind) or ""):
        words = " ".join(text.replace("`", "").split())
        unit = _UNIT.search(words)
        described[name] = (words[: unit.start()], unit[1]) if unit else (words, "")
    members: dict[str, _Option | _Group] = {}
    for field in fields(kind):
        option = selection.options.get(field.name)
        if isinstance(option, Fields):
            members[field.name] = _library_group(field.type, option)
        elif option is not None:
            members[field.name] = _option(field.type, field.default, option, *described[field.name])
    return _Group(kind, members)


def _option(hint: Any, default: Any, flag: str, text: str, unit: str) -> _Option:
    """Option of a field with a type, default, description and unit."""
    flag, _, left_out = flag.removesuffix("]").partition("[=")
    name = flag.partition("/")[0].removeprefix("--").replace("-", "_")
    metavar = _METAVARS.get(unit, unit.upper())
    settings: dict[str, Any] = {"help": text, "metavar": metavar or None}
    kind = _kind(hint)
    convert: Callable[[Any], Any] | None = None
    if "/" in flag:  # two flags for two values
        first, second = (word.removeprefix("--") for word in flag.split("/"))
        kind = bool
        convert = {True: first, False: second, None: None}.__getitem__
    elif get_origin(kind) is tuple:
        inner, *others = get_args(kind)
        if others != [...]:
            settings["metavar"] = " ".join([unit.upper() or "NUMBER"] * (1 + len(others)))
        elif inner is float:
            kind = str
            default = ",".join(f"{value:g}" for value in default)
            settings |= {"parser": quantities(unit), "metavar": f"{metavar},..."}
        else:
            kind = list[_kind(inner)]  # type: ignore[misc]
            default = None
            convert = lambda values: tuple(values or ())
    elif kind is float and has_units(unit):
        settings["parser"] = quantity(unit)
        if unit == "s" and default is not None and default % 60.0 == 0.0 < default:
            default = f"{default / 60.0:g} min"
    annotation = kind | None if default is None else kind
    marks: list[Any] = [typer.Option(flag, **settings)]
    if left_out:
        marks.append(OptionalValue(flag, left_out, get_args(kind)))
    return _Option(_parameter(name, Annotated[annotation, *marks], default), convert)


def _kind(hint: Any) -> Any:
    """
    Type of an option for a type of a field, which may be a union: a path before a text, and no
    other dataclass.
    """
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    return Path if Path in kinds else kinds[0]
