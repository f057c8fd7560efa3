"""Signatures and docstrings of all public names, as `help` shows them."""

import importlib
import inspect
import pkgutil
import types

import pytest

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
                (f"{name}.{key}", member) for key, member in members.items() if inspect.isroutine(member)
            )


def public_routines(folder):
    """Public functions of a folder, and methods of its classes and their bases, each with its texts: its own and inherited."""
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
        keys = {key for kind in kinds for key, member in vars(kind).items() if isinstance(member, kept)}
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
