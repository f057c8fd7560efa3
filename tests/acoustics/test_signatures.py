"""Signatures and docstrings of the public functions of pymantaray.acoustics, as `help` shows them."""

import inspect

import pytest

import pymantaray.acoustics

PUBLIC = [getattr(pymantaray.acoustics, name) for name in pymantaray.acoustics.__all__]
FUNCTIONS = [f for f in PUBLIC if inspect.isfunction(f)]


def own_methods(kind):
    return [
        getattr(kind, name)
        for name in vars(kind)
        if (callable(getattr(kind, name)) and name == "__init__") or not name.startswith("_")
    ]


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_a_function_has_a_section_for_its_parameters(function):
    assert "Parameters\n----------\n" in inspect.getdoc(function)


@pytest.mark.parametrize("kind", [k for k in PUBLIC if inspect.isclass(k)], ids=lambda k: k.__name__)
def test_signatures_name_array_like_by_one_word(kind):
    methods = [member for member in own_methods(kind) if callable(member)]
    for thing in (kind, *methods, *FUNCTIONS):
        if inspect.isclass(thing) and thing.__init__ is object.__init__:
            continue
        assert "_SupportsArray" not in str(inspect.signature(thing)), thing
