"""Signatures and docstrings of all public names, as `help` shows them."""

import importlib
import inspect
import pkgutil

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


@pytest.mark.parametrize("folder", ["pymantaray", *FOLDERS])
def test_every_public_function_describes_its_parameters(folder):
    bare = [
        name
        for name, thing in public(folder)
        if inspect.isfunction(thing)
        and "." not in name
        and inspect.signature(thing).parameters
        and "Parameters\n----------\n" not in (inspect.getdoc(thing) or "")
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
