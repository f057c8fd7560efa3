"""Signatures and docstrings of all public names, as `help` shows them."""

import ast
import importlib
import inspect
import pkgutil
import types
from pathlib import Path

import pytest
from sources import tree_of

import pymantaray

FOLDERS = [
    name
    for _, name, is_package in pkgutil.iter_modules(pymantaray.__path__, "pymantaray.")
    if is_package and name != "pymantaray.cli"
]


def public(folder):
    """Public names of a folder, and the public methods of its classes."""
    module = importlib.import_module(folder)
    for name in getattr(module, "__all__", []):
        thing = getattr(module, name)
        yield name, thing
        if inspect.isclass(thing):
            members = {
                key: getattr(thing, key)
                for key in vars(thing)
                if key == "__init__" or not key.startswith("_")
            }
            yield from (
                (f"{name}.{key}", member)
                for key, member in members.items()
                if inspect.isroutine(member)
            )


def public_routines(folder):
    """
    Public functions of a folder, and methods of its classes and their bases, each with its texts:
    its own and inherited.
    """
    module = importlib.import_module(folder)
    for name in getattr(module, "__all__", []):
        thing = getattr(module, name)
        if inspect.isfunction(thing):
            yield name, thing, [inspect.getdoc(thing)]
        kinds = (
            [kind for kind in thing.__mro__ if kind.__module__.startswith("pymantaray.")]
            if inspect.isclass(thing)
            else []
        )
        kept = types.FunctionType | classmethod | staticmethod
        keys = {
            key for kind in kinds for key, member in vars(kind).items() if isinstance(member, kept)
        }
        for key in sorted(key for key in keys if not key.startswith("_")):
            texts = [inspect.getdoc(getattr(kind, key)) for kind in kinds if hasattr(kind, key)]
            yield f"{name}.{key}", getattr(thing, key), texts


@pytest.mark.parametrize("folder", ["pymantaray", *FOLDERS])
def test_every_public_function_and_method_describes_its_parameters(folder):
    """A method that overrides another may leave this to the other."""
    bare = [
        name
        for name, routine, texts in public_routines(folder)
        if set(inspect.signature(routine).parameters) - {"self", "cls"}
        and not any("Parameters\n----------\n" in (text or "") for text in texts)
    ]
    assert not bare


@pytest.mark.parametrize("folder", ["pymantaray", *FOLDERS])
def test_signatures_name_array_like_by_one_word(folder):
    """Without postponed annotations, `help` shows a union of eight types instead."""
    wide = []
    for name, thing in public(folder):
        if inspect.isclass(thing) and thing.__init__ is object.__init__:
            continue
        try:
            text = str(inspect.signature(thing))
        except (TypeError, ValueError):  # numpy and enum classes have none
            continue
        if "_NestedSequence" in text or "_SupportsArray" in text:
            wide.append(name)
    assert not wide


PACKAGES = [
    "pymantaray",
    *(m.name for m in pkgutil.walk_packages(pymantaray.__path__, "pymantaray.") if m.ispkg),
]


def exported_things():
    """
    Every exported name of every package, with the objects that have it and the packages that export
    them.
    """
    things: dict[str, dict[int, tuple[object, list[str]]]] = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", []):
            thing = getattr(module, name)
            things.setdefault(name, {}).setdefault(id(thing), (thing, []))[1].append(package)
    return things


def types_in(path):
    """Names of the classes and named tuples that a module defines."""
    for node in tree_of(path).body:
        if isinstance(node, ast.ClassDef):
            yield node.name
        called = isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
        if called and ast.unparse(node.value.func).split(".")[-1] == "namedtuple":
            yield ast.unparse(node.targets[0])


def test_an_exported_name_stands_for_one_object():
    things = exported_things()
    assert len(things) > 250
    doubles = {
        name: [packages for _, packages in objects.values()]
        for name, objects in things.items()
        if len(objects) > 1
    }
    assert not doubles


def test_no_module_defines_another_type_with_an_exported_name():
    root = Path(pymantaray.__path__[0])
    homes: dict[str, list[str]] = {}
    for path in sorted(root.rglob("*.py")):
        for name in types_in(path):
            homes.setdefault(name, []).append(path.relative_to(root).as_posix())
    exported = {
        name
        for name, objects in exported_things().items()
        if any(inspect.isclass(t) for t, _ in objects.values())
    }
    assert len(exported & set(homes)) > 100
    assert not {name: homes[name] for name in exported & set(homes) if len(homes[name]) > 1}
