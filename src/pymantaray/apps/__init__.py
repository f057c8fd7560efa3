"""
Applications: each folder has its objects, its command and its page; deleting the folder deletes the
application.

The module ``command`` of an application has a dictionary ``COMMANDS``: functions and groups of
commands by name. The command line finds it, so an application is registered by being here.
"""

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any


def commands(first: str = "") -> dict[str, Callable[..., Any]]:
    """
    Functions and groups of commands by name, of all applications or of those that have a command
    with a first word, if any has.
    """
    homes = {
        application.name: source.read_text(encoding="utf-8")
        for application in iter_modules(__path__)
        if (source := Path(__path__[0], application.name, "command.py")).is_file()
    }
    words = {name: _first_words(source) for name, source in homes.items()}
    wanted = [name for name in homes if first in words[name]] or list(homes)
    found: dict[str, Callable[..., Any]] = {}
    for name in wanted:
        found |= import_module(f"{__name__}.{name}.command").COMMANDS
    return found


def _first_words(source: str) -> set[str]:
    """First words of the names in ``COMMANDS`` of a module, which is not imported for them."""
    return set(re.findall(r'"([\w-]+)[^"]*":', source[source.rindex("\nCOMMANDS = ") :]))
