"""
Panels and words of the help: a command's own options first, then output, arrivals and water.

Typer writes the help. This module gives its parameters a panel, an order, and words instead of the
names of types.
"""

from typing import Any

from typer.core import TyperArgument, TyperCommand, TyperGroup

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
    """Command with panels in order, and words for values."""

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
