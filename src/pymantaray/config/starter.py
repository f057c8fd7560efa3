"""A study's file to begin with: a preset and its comments, and every key that it leaves at its default, commented out."""

import re
import tomllib
from collections.abc import Iterator
from typing import Any, get_args

import tomli_w
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from pymantaray.config.load import preset_text
from pymantaray.config.sections import StudyConfig

_HEADER = re.compile(r"^\[+([\w.]+)\]+", re.MULTILINE)
_HEAD = """\
# Made of the preset {name}. A line that begins with # and a key, without a space between, is that key's default: take the #
# away to set it. Lines that begin with # and a space are comments. Run: mantaray study run THIS_FILE

"""


def starter_text(name: str) -> str:
    """
    TOML text of a preset with its comments, and with each key that is not in it commented out at its default.

    Parameters
    ----------
    name : str
        Of the preset.

    Returns
    -------
    str

    Raises
    ------
    StudyError
        If there is no such preset; the message lists those there are.
    """
    text = preset_text(name)
    tree = tomllib.loads(text)
    headers = [match.group(1) for match in _HEADER.finditer(text)]
    places = [match.start() for match in _HEADER.finditer(text)]
    after = dict(zip(headers, [*places[1:], len(text)], strict=True))  # where each table ends
    added = dict[int, str]()
    for path, model in _tables(StudyConfig, ()):
        table = _at(tree, path)
        lines = [
            line
            for key, field in model.model_fields.items()
            if key not in table
            for line in _lines(key, field)
        ]
        header = ".".join(path)
        if not lines:
            continue
        if header not in after:
            lines = ["", f"#[{header}]" if path else "# Further tables:", *lines]
        end = after.get(header, len(text))
        added[end] = added.get(end, "") + "\n".join(lines) + "\n\n"
    for end in sorted(added, reverse=True):
        before = text[:end].rstrip("\n")
        comments = re.search(r"(\n\n#[^\n]*)+$", before) if end < len(text) else None  # of the next table
        place = comments.start() if comments else len(before)
        text = f"{before[:place]}\n{added[end].rstrip()}\n\n{before[place:].lstrip()}\n{text[end:]}"
    return _HEAD.format(name=name) + re.sub(r"\n{3,}", "\n\n", text).rstrip("\n") + "\n"


def _tables(
    model: type[BaseModel], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], type[BaseModel]]]:
    """Every table that is there without being asked for, by its keys from the root."""
    yield path, model
    for key, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _tables(field.annotation, (*path, key))


def _at(tree: dict[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    for key in path:
        tree = tree.get(key, {})
    return tree


def _lines(key: str, field: FieldInfo) -> list[str]:
    """A key at its default and what it means; where the default is that there is none, what it means alone."""
    if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
        return []
    meaning = " ".join((field.description or "").split()).replace("``", "")
    value = None if field.is_required() else field.get_default(call_default_factory=True)
    if value is None or any(_models(field.annotation)):
        return [f"# {key}: not set. {meaning}"]
    return [f"#{tomli_w.dumps({key: value}).rstrip()}  # {meaning}"]


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)
