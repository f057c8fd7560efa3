"""
Meanings of keys: the text below each key in the source of its section.

Pydantic can read them when a class is made, which takes longer than all else in these modules; they
are read here when help, a message or a file needs them.
"""

import ast
import inspect
import re
import sys
from functools import cache

from pydantic import BaseModel

LAST_UNIT = re.compile(r" ?\[([^][]+)\]$")
"""Unit at the end of a meaning."""


def meaning(model: type[BaseModel], key: str) -> str:
    """Meaning of a key on one line, with the unit in brackets at its end; empty without one."""
    if given := model.model_fields[key].description:
        return " ".join(given.split())
    texts = (
        _texts(owner.__module__).get(owner.__qualname__, {}).get(key)
        for owner in model.__mro__
        if issubclass(owner, BaseModel) and owner is not BaseModel
    )
    return next((text for text in texts if text), "")


@cache
def _texts(module: str) -> dict[str, dict[str, str]]:
    """Texts below the keys of the classes of a module, by class and key."""
    return {
        owner.name: {
            key.target.id: " ".join(text.value.value.split())
            for key, text in zip(owner.body, owner.body[1:], strict=False)
            if isinstance(key, ast.AnnAssign)
            and isinstance(key.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        }
        for owner in ast.walk(ast.parse(inspect.getsource(sys.modules[module])))
        if isinstance(owner, ast.ClassDef)
    }
