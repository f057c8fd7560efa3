"""
Dotted keys of a configuration, such as ``noise.range_sigma`` and ``fleet.vehicles.B.depth``: change
a key, or merge trees.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pymantaray.config.common import NONE, located
from pymantaray.errors import StudyError
from pymantaray.user_files import parse_toml

Tree = dict[str, Any]


def with_key(tree: Tree, key: str, value: Any) -> Tree:
    """
    Copy a tree with another value at a dotted key.

    A part of the key selects an entry of a list by its number or its ``name``. A table replaces a
    whole section; ``"none"`` removes an entry of a list.

    Raises
    ------
    StudyError
        If the entry does not exist, or the key continues below a value that is not a table.

    Examples
    --------
    >>> with_key({"noise": {"depth_sigma": 0.1}}, "noise.range_sigma", 2.0)
    {'noise': {'depth_sigma': 0.1, 'range_sigma': 2.0}}
    """
    changed: Tree = _put(tree, key.split("."), value, key)
    return changed


def merged(base: Any, over: Any, key: str = "") -> Any:
    """
    Merge a tree into another: tables are merged key by key, other values are replaced.

    A table with another ``kind`` replaces that of the base. A table for a list changes its entries
    by name, and adds new ones.
    """
    if not isinstance(over, Mapping) or not isinstance(base, Mapping | list | tuple):
        return over
    if isinstance(base, Mapping):
        if over.get("kind", base.get("kind")) != base.get("kind"):
            return over
        return {
            **base,
            **{k: merged(base.get(k), v, f"{key}.{k}" if key else k) for k, v in over.items()},
        }
    entries = list(base)
    for name, value in over.items():
        place = _find_entry(entries, [name])
        where = f"{key}.{name}"
        if place is not None:
            entries = _put(entries, [name], merged(entries[place[0]], value, where), where)
        elif isinstance(value, Mapping):
            entries.append({"name": name, **value})
        else:
            raise _no_entry(entries, [name], where)
    return entries


def parse_changes(assignments: Sequence[str]) -> Tree:
    """
    Parse texts such as ``noise.range_sigma=2`` to values by dotted key: TOML values, otherwise
    text.

    Raises
    ------
    StudyError
        If a text has no ``=``, or a key occurs twice.

    Examples
    --------
    >>> parse_changes(["noise.range_sigma=2", "ocean.source=synthetic:fram"])
    {'noise.range_sigma': 2, 'ocean.source': 'synthetic:fram'}
    """
    out: Tree = {}
    for assignment in assignments:
        key, sign, text = (part.strip() for part in assignment.partition("="))
        if not key or not sign:
            raise StudyError(f"{assignment}: it must be KEY=VALUE, such as noise.range_sigma=2")
        if key in out:
            raise StudyError(f"{assignment}: {key} is set twice; set it once")
        out[key] = _value(text)
    return out


def changed(tree: Tree, changes: Mapping[str, Any]) -> Tree:
    """
    Copy of a tree with values at dotted keys; file names among them are relative to the working
    folder.
    """
    for key, value in changes.items():
        tree = with_key(tree, key, located(value, Path()))
    return tree


def words_of(changes: Mapping[str, Any]) -> list[str]:
    """Texts of changes for the description of a study; none if the description is changed."""
    return (
        []
        if "study.description" in changes
        else [f"{key} = {_shown(value)}" for key, value in changes.items()]
    )


def described(tree: Tree, name: str, words: Sequence[str]) -> Tree:
    """Tree of a study whose description lists the changes, after earlier changes."""
    study = tree.get("study")
    before = str(study.get("description", "")) if isinstance(study, Mapping) else ""
    start = f"{before} and" if before.startswith(f"{name} with ") else f"{name} with"
    return with_key(tree, "study.description", f"{start} {' and '.join(words)}")


def _shown(value: Any) -> str:
    """Value as one line of text."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _value(text: str) -> Any:
    try:
        tree = parse_toml(f"value = {text}", text, StudyError)
    except StudyError:
        return text
    return tree["value"] if len(tree) == 1 else text


def _put(node: Any, parts: Sequence[str], value: Any, key: str) -> Any:
    """Node with a value at the key with these parts."""
    if not parts:
        return value
    first = parts[0]
    rest = parts[1:]
    if isinstance(node, list | tuple):
        place = _find_entry(node, parts)
        if place is None:
            raise _no_entry(node, parts, key)
        k, length = place
        rest = parts[length:]
        kept = () if not rest and value == NONE else (_put(node[k], rest, value, key),)
        return [*node[:k], *kept, *node[k + 1 :]]
    if not isinstance(node, Mapping):
        table = key.removesuffix("." + ".".join(parts))
        raise StudyError(
            f"`{key}`: `{table}` is {_shown(node)[:100]}, which has no keys; set `{table}` as a"
            " whole"
        )
    inner = node.get(first, {})
    return {**node, first: _put({} if rest and inner in (None, NONE) else inner, rest, value, key)}


def _find_entry(entries: Sequence[Any], parts: Sequence[str]) -> tuple[int, int] | None:
    """
    Number of the entry that the first parts of a key select, and the number of these parts; names
    may contain dots.
    """
    names = [entry.get("name") if isinstance(entry, Mapping) else entry for entry in entries]
    for length in range(len(parts), 0, -1):
        name = ".".join(parts[:length])
        if name in names:
            return names.index(name), length
    number = parts[0]
    return (int(number), 1) if number.isdecimal() and int(number) < len(entries) else None


def _no_entry(entries: Sequence[Any], parts: Sequence[str], key: str) -> StudyError:
    table = key.removesuffix("." + ".".join(parts))
    there = f"numbers from 0 to {len(entries) - 1}" if entries else "none"
    if names := [str(e["name"]) for e in entries if isinstance(e, Mapping) and "name" in e]:
        there = ", ".join(names)
    return StudyError(f"`{key}`: no such entry. Entries of `{table}`: {there[:300]}")
