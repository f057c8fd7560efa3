"""
Public names of a package that are imported on first use, each listed once: in its ``if
TYPE_CHECKING`` block.
"""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_exports(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """
    Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package.

    Parameters
    ----------
    package : str
        Name of the package, whose ``__init__`` has ``if TYPE_CHECKING`` with lines such as ``from
        pymantaray.acoustics import Medium as Medium``. Type checkers read them, and so does this
        function.

    Returns
    -------
    tuple
    """
    loader: Any = sys.modules[package].__spec__.loader  # type: ignore[union-attr]
    blocks = (
        node for node in ast.parse(loader.get_source(package)).body if isinstance(node, ast.If)
    )
    lines = (line for block in blocks for line in block.body if isinstance(line, ast.ImportFrom))
    homes = {name.name: str(line.module) for line in lines for name in line.names}

    def get(name: str) -> Any:
        """Import a public name from its module."""
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    names = sorted(homes)
    return get, lambda: sorted({*vars(sys.modules[package]), *names}), names
