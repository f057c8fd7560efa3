"""
Applications: each folder has its objects, its command and its page; deleting the folder deletes the
application.

The module ``command`` of an application has a dictionary ``COMMANDS``: functions and groups of
commands by name. The command line finds it, so an application is registered by being here.
"""

import ast
import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NamedTuple


class Summary(NamedTuple):
    """A command or a group of commands in the help of `mantaray`."""

    help: str
    is_group: bool


def commands(first: str = "") -> dict[str, Callable[..., Any]]:
    """
    Functions and groups of commands by name, of all applications or of those that have a command
    with a first word, if any has.
    """
    homes = _sources()
    # first words of the names in COMMANDS of a module, which is not imported for them
    words = {
        name: set(re.findall(r'"([\w-]+)[^"]*":', source[source.rindex("\nCOMMANDS = ") :]))
        for name, source in homes.items()
    }
    wanted = [name for name in homes if first in words[name]] or list(homes)
    found: dict[str, Callable[..., Any]] = {}
    for name in wanted:
        found |= import_module(f"{__name__}.{name}.command").COMMANDS
    return found


def summaries() -> dict[str, Summary]:
    """Commands and groups of all applications by name, without importing an application."""
    out = {}
    for source in _sources().values():
        definitions = dict(_definitions(ast.parse(source)))
        table = definitions["COMMANDS"]
        assert isinstance(table, ast.Dict)  # as the docstring of this folder requires
        for key, value in zip(table.keys, table.values, strict=True):
            assert isinstance(key, ast.Constant)
            name = str(key.value)
            if " " not in name:  # not a command of another application's group
                assert isinstance(value, ast.Name)
                out[name] = _summary(definitions[value.id])
    return out


def _sources() -> dict[str, str]:
    """Source of the commands of each application."""
    return {
        application.name: source.read_text(encoding="utf-8")
        for application in iter_modules(__path__)
        if (source := Path(__path__[0], application.name, "command.py")).is_file()
    }


def _definitions(module: ast.Module) -> Iterator[tuple[str, ast.AST]]:
    """Names of functions and of values that are set at the top of a module."""
    for node in module.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            yield node.targets[0].id, node.value


def _summary(definition: ast.AST) -> Summary:
    """Summary of a function, from its docstring, or of a group, from its ``help``."""
    if isinstance(definition, ast.FunctionDef):
        return Summary(" ".join((ast.get_docstring(definition) or "").split()), is_group=False)
    assert isinstance(definition, ast.Call)
    text = next(ast.literal_eval(word.value) for word in definition.keywords if word.arg == "help")
    return Summary(str(text), is_group=True)
