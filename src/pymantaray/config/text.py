"""
TOML text of a configuration with the meaning of each key; keys at their defaults are commented out.
"""

import datetime as dt
from collections.abc import Iterator, Mapping
from typing import Any

import tomli_w
from pydantic import BaseModel

from pymantaray.config.checks import models_in
from pymantaray.config.meanings import meaning
from pymantaray.config.sections import StudyConfig

STARTER = """\
# Made of {name}. A line that begins with # and a key, without a space between, is
# that key's default: take the # away to set it. Lines that begin with # and a space are comments.
# Run: mantaray study run THIS_FILE

"""
"""First lines of a new study file, with a field for the name of its origin."""


def study_toml(config: StudyConfig) -> str:
    """
    Return a resolved configuration, including defaults, as TOML for `load_study`.

    Parameters
    ----------
    config : StudyConfig

    Returns
    -------
    str

    Examples
    --------
    >>> from pymantaray.config import load_study, study_toml
    >>> text = study_toml(load_study("quick", realizations=2))
    >>> [line for line in text.splitlines() if line.startswith("realizations")]
    ['realizations = 2']
    """
    tree = config.model_dump(exclude_none=True)
    return tomli_w.dumps({"study": tree.pop("study"), **tree})


def commented_toml(config: StudyConfig) -> str:
    """
    Return a configuration as TOML with the meaning of each key; keys at their defaults are
    commented out.

    Parameters
    ----------
    config : StudyConfig

    Returns
    -------
    str
        Text for `load_study`. Of vehicles, landmarks and estimators, the first of each kind has
        comments.
    """
    names = sorted(type(config).model_fields, key=lambda name: name != "study")
    tables = [_tables((name,), config) for name in names]
    return "\n\n".join(block for blocks in tables for block in blocks) + "\n"


def _tables(path: tuple[str, ...], owner: BaseModel) -> list[str]:
    """Blocks of text for the tables of a key, which is the last part of its path."""
    value = getattr(owner, path[-1])
    if isinstance(value, BaseModel):
        return list(_blocks(path, value))
    if value and isinstance(value, tuple) and isinstance(value[0], BaseModel):
        known: set[type] = set()
        blocks = []
        for entry in value:
            explain = type(entry) not in known and entry.model_fields_set != {"name"}
            blocks.append(_entry(path, entry, explain=explain))
            known |= {type(entry)} if explain else set()
        if not known:  # names only: add the other possible keys of an entry
            text = _entry(path, type(value[0]).model_validate({"name": "mine"}), explain=True)
            blocks.append(
                "\n".join(f"# {line.removeprefix('#').lstrip()}" for line in text.splitlines())
            )
        return blocks
    model = type(owner)
    if models_in(model.model_fields[path[-1]].annotation) and len(path) == 1:
        return [f"# {path[0]}: {_not_set(model, path[0])}"]
    return []


def _blocks(path: tuple[str, ...], section: BaseModel) -> Iterator[str]:
    """Tables of a section and of the sections in it."""
    header = f"[{'.'.join(path)}]" if section.model_fields_set else f"#[{'.'.join(path)}]"
    meaning = " ".join((type(section).__doc__ or "").split("\n\n")[0].split()).replace("`", "")
    yield "\n".join([f"# {meaning}", header, *_keys(section, explain=True)])
    for key in type(section).model_fields:
        yield from _tables((*path, key), section)
    for name, table in (section.model_extra or {}).items():
        header = f"[{'.'.join((*path, name))}]"
        yield "\n".join([header, *(f"{key} = {_value(value)}" for key, value in table.items())])


def _keys(section: BaseModel, *, explain: bool) -> Iterator[str]:
    """Lines of the keys without tables."""
    tree = section.model_dump(exclude_none=True, exclude_unset=True)
    for key, field in type(section).model_fields.items():
        value = getattr(section, key)
        text = _meaning(type(section), key)
        tables = isinstance(value, BaseModel) or (
            isinstance(value, tuple) and bool(models_in(field.annotation))
        )
        hidden = key not in section.model_fields_set
        if value is None or (value == () and hidden):
            if explain:
                yield f"# {key}: {_not_set(type(section), key)}"
        elif not tables:
            line = f"{key} = {_value(tree.get(key, value))}"
            if explain:
                yield f"{'#' if hidden else ''}{line}  # {text}"
            elif not hidden:
                yield line


def _entry(path: tuple[str, ...], entry: BaseModel, *, explain: bool) -> str:
    """Table in a list, with inline tables."""
    tree = entry.model_dump(exclude_none=True, exclude_unset=True)
    inner = [f"{key} = {_value(value)}" for key, value in tree.items() if isinstance(value, dict)]
    if explain:
        inner += [
            f"#{key} = {_value(value.model_dump())}  # {_meaning(type(entry), key)}"
            for key in type(entry).model_fields
            if key not in tree and isinstance(value := getattr(entry, key), BaseModel)
        ]
    return "\n".join([f"[[{'.'.join(path)}]]", *_keys(entry, explain=explain), *inner])


def _value(value: Any) -> str:
    """TOML text of a value: one line, except for tables of numbers, which take one line per row."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list | tuple):
        rows = [_value(inner) for inner in value]
        if value and isinstance(value[0], list | tuple):
            return "[\n    " + ",\n    ".join(rows) + ",\n]"
        return f"[{', '.join(rows)}]"
    return (
        value.isoformat()
        if isinstance(value, dt.datetime)
        else tomli_w.dumps({"v": value})[4:].rstrip()
    )


def _meaning(model: type[BaseModel], key: str) -> str:
    return meaning(model, key).replace("``", "")


def _not_set(model: type[BaseModel], key: str) -> str:
    return f"not set. {_meaning(model, key)}"
