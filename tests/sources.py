"""Syntax trees of the package for tests of its source, read once in each process."""

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pymantaray

PACKAGE = Path(pymantaray.__file__).parent


@cache
def tree_of(path: Path) -> ast.Module:
    """Syntax tree of a file of the package, not to be changed."""
    return ast.parse(path.read_text("utf-8"))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file of the package, as `ast.walk` gives them."""
    return tuple(ast.walk(tree_of(path)))


def trees() -> Mapping[Path, ast.Module]:
    """Syntax trees of all files of the package."""
    return {path: tree_of(path) for path in sorted(PACKAGE.rglob("*.py"))}
