"""
Applications: each folder has its objects, its command and its page; deleting the folder deletes the
application.

The module ``command`` of an application has a dictionary ``COMMANDS``: functions and groups of
commands by name. The command line finds it, so an application is registered by being here.
"""

from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any


def commands() -> dict[str, Callable[..., Any]]:
    """Functions and groups of commands of all applications, by name."""
    found: dict[str, Callable[..., Any]] = {}
    for application in iter_modules(__path__):
        names = [module.name for module in iter_modules([f"{__path__[0]}/{application.name}"])]
        if "command" in names:
            found |= import_module(f"{__name__}.{application.name}.command").COMMANDS
    return found
