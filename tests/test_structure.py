"""Laws of the package's structure: imports without circles, short functions, short test names."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest
from sources import nodes_of, tree_of

import pymantaray

HOUSE = Path(__file__).parents[1]
ROOT = Path(pymantaray.__file__).parent
MODULES = {
    ".".join(("pymantaray", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(
        ".__init__"
    ): path
    for path in ROOT.rglob("*.py")
}
MAX_LINES = {"pymantaray.acoustics._kernels.trace.trace": 134}
"""One step of a ray with all its events."""
USUAL_LINES = 60
MAX_ARGUMENTS = 8
MAX_LETTERS = 60  # of the name of a test


def _trees() -> dict[str, ast.Module]:
    """All modules, not read before a test runs: every worker collects this file."""
    return {name: tree_of(path) for name, path in MODULES.items()}


def _imports(tree: ast.Module, *, of_package: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """
    Imports anywhere in a module; those for type checkers count in a package, whose lazy exports
    they are.
    """
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif (
            not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
            or of_package
        ):
            waiting += ast.iter_child_nodes(node)


@cache
def _home(package: str, name: str) -> str:
    """Module that defines a name that is imported from a package or a module."""
    if f"{package}.{name}" in MODULES:
        return f"{package}.{name}"
    if package in MODULES and MODULES[package].name == "__init__.py":
        for line in _imports(_trees()[package], of_package=True):
            if isinstance(line, ast.ImportFrom) and name in {
                a.asname or a.name for a in line.names
            }:
                return _home(str(line.module), name)
    return package


def _needed(module: str) -> set[str]:
    """Modules of the package that a module imports at its start or later."""
    needed = set[str]()
    for line in _imports(_trees()[module], of_package=False):
        if isinstance(line, ast.Import):
            needed |= {alias.name for alias in line.names}
        else:
            needed |= {_home(str(line.module), alias.name) for alias in line.names}
    return {name for name in needed & MODULES.keys() if name != module}


def test_no_module_imports_itself_through_others():
    """Imports inside functions count."""
    try:
        TopologicalSorter({name: _needed(name) for name in MODULES}).prepare()
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None


def test_no_module_is_imported_by_a_string_from_another_package():
    """Contracts do not see names of modules in strings."""
    wrong = [
        f"{name}: {node.value}"
        for name, path in MODULES.items()
        for node in nodes_of(path)
        if isinstance(node, ast.Constant)
        and node.value in MODULES
        and not name.startswith(str(node.value))
        and node.value != "pymantaray"
    ]
    assert wrong == []


SCRIPTS = [
    path
    for folder in ("benchmarks", "examples", "docs")
    for path in (Path(__file__).parents[1] / folder).rglob("*.py")
]


@pytest.mark.skipif(not SCRIPTS, reason="the scripts are not beside the tests")
def test_scripts_import_names_that_exist():
    """No other test runs every benchmark."""
    missing = []
    for path in SCRIPTS:
        for line in _imports(ast.parse(path.read_text()), of_package=False):
            if isinstance(line, ast.ImportFrom) and str(line.module).startswith("pymantaray"):
                module = import_module(str(line.module))
                missing += [
                    f"{path.name}: {line.module}.{alias.name}"
                    for alias in line.names
                    if not hasattr(module, alias.name)
                    and f"{line.module}.{alias.name}" not in MODULES
                ]
    assert missing == []


def _functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    for module, path in MODULES.items():
        for node in nodes_of(path):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{module}.{node.name}", node


def test_functions_are_short():
    long = {}
    for name, node in _functions():
        body = node.body[1:] if ast.get_docstring(node) else node.body
        lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
        if lines > USUAL_LINES:
            long[name] = lines
    assert long.keys() == MAX_LINES.keys()
    assert all(lines <= MAX_LINES[name] for name, lines in long.items())


def test_functions_have_few_arguments():
    """Options of public functions that have a default do not count."""
    wide = {}
    for name, node in _functions():
        private = node.name.startswith("_")
        a = node.args
        options = zip(a.kwonlyargs, a.kw_defaults, strict=True)
        required = [arg for arg, default in options if private or default is None]
        count = len({arg.arg for arg in (*a.posonlyargs, *a.args, *required)} - {"self", "cls"})
        if count > MAX_ARGUMENTS:
            wide[name] = count
    assert wide == {}


@pytest.mark.skipif(not SCRIPTS, reason="the scripts are not beside the tests")
def test_the_picture_in_contributing_is_that_of_the_contracts():
    from house_picture import picture

    assert f"```text\n{picture()}\n```" in (HOUSE / "CONTRIBUTING.md").read_text()


def test_names_of_tests_are_short():
    tests = Path(__file__).parent.rglob("test_*.py")
    names = [
        name
        for path in tests
        for name in re.findall(r"^ *def test_(\w+)", path.read_text(), re.MULTILINE)
    ]
    assert len(names) > 1000
    assert [name for name in names if len(name) > MAX_LETTERS] == []
