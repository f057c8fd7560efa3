"""Renamed keys: the present version reads files with old names, with a message that gives the new names."""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any

from pymantaray.errors import StudyError

RENAMED = {
    "ocean.centre_latitude_deg": "ocean.centre_lat",
    "ocean.centre_longitude_deg": "ocean.centre_lon",
    "ranging.clock_offset_sigma": "noise.clock_offset_sigma",
    "ranging.clock_skew_sigma": "noise.clock_skew_sigma",
    "detection.surface_loss": "acoustics.surface_loss",
    "detection.ice_loss_db": "acoustics.ice_loss_db",
    "detection.sediment": "acoustics.sediment",
    "estimator.initialise": "estimator.start",
    "estimators.*.lag_h": "conditions.*.solver.lag_h",
    "estimators.*.uncertainty_rms": "conditions.*.variance.rms",
    "estimators.*.uncertainty_horizontal_scale": "conditions.*.variance.horizontal_scale",
    "estimators.*.uncertainty_down_to": "conditions.*.variance.down_to",
    "estimators.*.belief.path": "conditions.*.range_model.belief.source",
    "estimators.*.belief": "conditions.*.range_model.belief",
    "estimators.*.sound_speed": "conditions.*.range_model.sound_speed",
    "estimators.*.modes": "conditions.*.range_model.modes",
}
"""New key by old key; a star is any entry of a list."""
_ENTRIES = "estimators", "conditions"
NEW_VALUES = {
    "acoustics.spreading_cutoff_db": {"off": "none"},
    "ranging.mistaken": {"off": "none"},
}
"""New values by old values, for each key."""


@lru_cache
def new_key(key: str) -> str:
    """Present name of a dotted key."""
    for old, new in RENAMED.items():
        if match := re.fullmatch(re.escape(old).replace(r"\*", "(?P<name>.+)") + r"(?P<rest>(\..+)?)", key):
            return new.replace("*", match.groupdict().get("name", "*")) + match["rest"]
    before, now = _ENTRIES
    return now + key.removeprefix(before) if key.startswith(f"{before}.") else key


def with_new_names(tree: Any, label: str, *, warn: bool = True) -> Any:
    """
    Convert nested dictionaries to present keys and values.

    Raises
    ------
    StudyError
        If both the old and the new name of a key are present.
    """
    said = list[str]()
    for old, new in RENAMED.items():
        tree = _moved(tree, old, new, label, said)
    for key, values in NEW_VALUES.items():
        tree = _revalued(tree, key, values, said)
    if warn and said:
        words = f"{label}: {'; '.join(said)}. The old names will not be read by the next version"
        warnings.warn(words, FutureWarning, stacklevel=3)
    return tree


def _moved(tree: Any, old: str, new: str, label: str, said: list[str]) -> Any:
    """Copy of a tree in which values at an old key are at the new key."""
    path, before, after = _paths(old, new)

    def move(node: Any) -> Any:
        there, value = _take(node, before)
        if there is node:
            return node
        if _take(there, after)[0] is not there:
            raise StudyError(
                f"{label}: `{old}` is the old name of `{new}`, and both are given; remove the old one"
            )
        said.append(f"`{old}` is now `{new}`")
        return _with(there, after, value)

    return _within(tree, path, move)


@cache
def _paths(old: str, new: str) -> tuple[list[str], list[str], list[str]]:
    """Common path of the old and the new place of a value, and the rest of each."""
    before, after = old.split("."), _value_path(old, new).split(".")
    shared = next(k for k, pair in enumerate(zip(before, after, strict=False)) if pair[0] != pair[1])
    return before[:shared], before[shared:], after[shared:]


def _value_path(old: str, new: str) -> str:
    """New path of a single value, after its list and its table have been moved."""
    for table, moved in RENAMED.items():
        if old.startswith(f"{table}.") and new.startswith(f"{moved}."):
            return table + new.removeprefix(moved)
    before, now = _ENTRIES
    return before + new.removeprefix(now) if old.startswith(f"{before}.") else new


def _revalued(tree: Any, key: str, values: Mapping[str, str], said: list[str]) -> Any:
    """Copy of a tree in which new values of a key replace old values."""
    *path, name = key.split(".")

    def change(node: Any) -> Any:
        value = node.get(name) if isinstance(node, Mapping) else None
        if not isinstance(value, str) or value not in values:
            return node
        said.append(f'`{key} = "{value}"` is now `"{values[value]}"`')
        return {**node, name: values[value]}

    return _within(tree, path, change)


def _within(node: Any, path: Sequence[str], change: Callable[[Any], Any]) -> Any:
    """Copy of a node with changed parts at a path."""
    if not path:
        return change(node)
    first, rest = path[0], path[1:]
    if first == "*" and isinstance(node, list | tuple):
        return [_within(entry, rest, change) for entry in node]
    if first == "*" and isinstance(node, Mapping):  # entries of the list of a base, by name
        return {name: _within(entry, rest, change) for name, entry in node.items()}
    if isinstance(node, Mapping) and first in node:
        return {**node, first: _within(node[first], rest, change)}
    return node


def _take(node: Any, path: Sequence[str]) -> tuple[Any, Any]:
    """Node without the value at a path, and this value; the node itself if there is none."""
    first, rest = path[0], path[1:]
    if not isinstance(node, Mapping) or first not in node:
        return node, None
    if not rest:
        return {key: value for key, value in node.items() if key != first}, node[first]
    inner, value = _take(node[first], rest)
    return (node, None) if inner is node[first] else ({**node, first: inner}, value)


def _with(node: Any, path: Sequence[str], value: Any) -> Any:
    """Copy of a node with a value at a path."""
    first, rest = path[0], path[1:]
    inner = node.get(first, {})
    inner = {"kind": inner} if rest and isinstance(inner, str) else inner  # text is a table with only a kind
    return {**node, first: _with(inner, rest, value) if rest else value}
