"""
The nomenclature against everything that has a name in it: parameters, columns of records, keys of
configurations.
"""

import ast
import importlib
import inspect
import re
import runpy
from dataclasses import fields, is_dataclass

from pages import DOCS
from sources import nodes_of
from test_documentation import MODELS

from pymantaray.config.meanings import meaning

PAGES = runpy.run_path(str(DOCS / "site" / "reference_pages.py"))
ENTRY = re.compile(r"^(\w+(?:, \w+)*) : .*\n((?:(?: .*)?\n)*)", re.MULTILINE)
"""Names, and what is said of them, in a section of a docstring."""
EMPTY = {"", "-"}


def exported():
    """Functions, classes and their public methods, by name."""
    for folder in PAGES["FOLDERS"]:
        module = importlib.import_module(f"pymantaray.{folder}")
        for name in module.__all__:
            thing = getattr(module, name)
            yield f"{folder}.{name}", thing
            for inner, method in list(vars(thing).items()) if inspect.isclass(thing) else ():
                if callable(getattr(method, "__func__", method)) and not inner.startswith("_"):
                    yield f"{folder}.{name}.{inner}", method


def units_of(names, text):
    """Unit of each name of an entry: one for all, or as many as there are names."""
    units = [
        u
        for bracket in re.findall(r"\[([^][]+)\](?=[\s,.;]|$)", text)
        for u in re.split(r",\s+", bracket)
    ]
    if len(set(units)) > 1 and len(units) == len(names):
        return units
    return [", ".join(units)] * len(names)


def documented():
    """Place, name and unit of all that is named in docstrings, records and configurations."""
    for place, thing in exported():
        for names, text in ENTRY.findall(
            inspect.getdoc(thing) + "\n" if inspect.getdoc(thing) else ""
        ):
            words = names.split(", ")
            yield from (
                (place, name, unit) for name, unit in zip(words, units_of(words, text), strict=True)
            )
        for f in fields(thing) if is_dataclass(thing) and inspect.isclass(thing) else ():
            if "dims" in f.metadata:
                yield place, f.name, PAGES["column_unit"](f.name, f.metadata["units"])
    for model in MODELS:
        for name in model.model_fields:
            unit = re.search(r"\[([^][]+)\]$", meaning(model, name))
            yield f"{model.__name__} (configuration)", name, unit[1] if unit else ""


def test_a_name_of_the_nomenclature_has_its_unit_wherever_it_stands():
    units = PAGES["nomenclature"]()
    places = [
        (place, name, unit, units[entry])
        for place, name, unit in documented()
        if (entry := PAGES["quantity"](name))
    ]
    assert len(places) > 100
    wrong = [
        f"{place}: {name} [{unit}]; the nomenclature has {allowed}"
        for place, name, unit, allowed in places
        if unit not in allowed and not (unit in EMPTY and EMPTY & set(allowed))
    ]
    assert not wrong, "\n".join(wrong)


def test_every_name_of_the_nomenclature_is_one_of_the_code():
    names = {name for _, name, _ in documented()}
    source = "".join(path.read_text() for path in (DOCS.parent / "src").rglob("*.py"))
    for entry in PAGES["nomenclature"]():
        word = entry.replace("...", r"\w+")
        assert any(re.fullmatch(word, name) for name in names) or re.search(
            rf"\b{word}\b", source
        ), entry


def test_no_docstring_begins_with_a_relative_clause():
    """
    It begins with a verb or a noun, as in "Return True if ..." or "Travel time of each link.".
    """
    clause = re.compile(r"\s*(Whether|What|Told|How|Which|Who|Where)\b")
    begun = []
    for path in sorted((DOCS.parent / "src").rglob("*.py")):
        for node in nodes_of(path):
            constant = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            if constant and isinstance(node.value.value, str) and clause.match(node.value.value):
                begun.append(f"{path.name}:{node.lineno}")
    assert not begun
