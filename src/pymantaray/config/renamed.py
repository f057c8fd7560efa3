"""Keys that have new names: files with the old ones are read for one version, with a message that gives the new ones."""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
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
"""New key by the old one; a star is any entry of a list."""
LISTS = {"study.conditions": "conditions", "estimators": "conditions"}
"""Two lists that are one today, see `pymantaray.config.conditions`."""
_ENTRIES = "estimators", "conditions"
NEW_VALUES = {
    "acoustics.spreading_cutoff_db": {"off": "none"},
    "ranging.mistaken": {"off": "none"},
}
"""New value by the old one, by key."""


def new_key(key: str) -> str:
    """Name of a dotted key today."""
    for old, new in RENAMED.items():
        if match := re.fullmatch(re.escape(old).replace(r"\*", "(?P<name>.+)") + r"(?P<rest>(\..+)?)", key):
            return new.replace("*", match.groupdict().get("name", "*")) + match["rest"]
    before, now = _ENTRIES
    return now + key.removeprefix(before) if key.startswith(f"{before}.") else key


def with_new_names(tree: Any, label: str, *, warn: bool = True) -> Any:
    """
    Nested dictionaries with today's keys and values.

    Raises
    ------
    StudyError
        If a key is there by its old and its new name.
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
    """Tree whose values at an old key are at the new one."""
    before, after = old.split("."), _place(old, new).split(".")
    shared = next(k for k, pair in enumerate(zip(before, after, strict=False)) if pair[0] != pair[1])

    def move(node: Any) -> Any:
        there, value = _take(node, before[shared:])
        if there is node:
            return node
        if _take(there, after[shared:])[0] is not there:
            raise StudyError(
                f"{label}: `{old}` is the old name of `{new}`, and both are given; leave the old one out"
            )
        said.append(f"`{old}` is now `{new}`")
        return _with(there, after[shared:], value)

    return _within(tree, before[:shared], move)


def _place(old: str, new: str) -> str:
    """Path of a single value; its list and its table are moved as a whole."""
    for table, moved in RENAMED.items():
        if old.startswith(f"{table}.") and new.startswith(f"{moved}."):
            return table + new.removeprefix(moved)
    before, now = _ENTRIES
    return before + new.removeprefix(now) if old.startswith(f"{before}.") else new


def _revalued(tree: Any, key: str, values: Mapping[str, str], said: list[str]) -> Any:
    """Tree whose old values of a key are the new ones."""
    *path, name = key.split(".")

    def change(node: Any) -> Any:
        value = node.get(name) if isinstance(node, Mapping) else None
        if not isinstance(value, str) or value not in values:
            return node
        said.append(f'`{key} = "{value}"` is now `"{values[value]}"`')
        return {**node, name: values[value]}

    return _within(tree, path, change)


def _within(node: Any, path: Sequence[str], change: Callable[[Any], Any]) -> Any:
    """Node whose parts at a path are changed."""
    if not path:
        return change(node)
    first, rest = path[0], path[1:]
    if first == "*" and isinstance(node, list | tuple):
        return [_within(entry, rest, change) for entry in node]
    if first == "*" and isinstance(node, Mapping):  # entries of a base's list, by name
        return {name: _within(entry, rest, change) for name, entry in node.items()}
    if isinstance(node, Mapping) and first in node:
        return {**node, first: _within(node[first], rest, change)}
    return node


def _take(node: Any, path: Sequence[str]) -> tuple[Any, Any]:
    """Node without what is at a path, and that; the node itself where there is nothing."""
    first, rest = path[0], path[1:]
    if not isinstance(node, Mapping) or first not in node:
        return node, None
    if not rest:
        return {key: value for key, value in node.items() if key != first}, node[first]
    inner, value = _take(node[first], rest)
    return (node, None) if inner is node[first] else ({**node, first: inner}, value)


def _with(node: Any, path: Sequence[str], value: Any) -> Any:
    """Node with a value at a path."""
    first, rest = path[0], path[1:]
    inner = node.get(first, {})
    inner = (
        {"kind": inner} if rest and isinstance(inner, str) else inner
    )  # a kind alone is a table with no other key
    return {**node, first: _with(inner, rest, value) if rest else value}
