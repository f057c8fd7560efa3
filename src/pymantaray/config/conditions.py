"""Conditions of a study before their check: a list, or tables that change the default list."""

from collections.abc import Mapping
from typing import Any

from pymantaray.config.common import NONE
from pymantaray.config.keys import merged

CONDITIONS = "conditions"
DEFAULT = ("odometry", "straight", "refracted")
"""Names of the conditions of a study without a list."""


def with_conditions(tree: Any) -> Any:
    """
    Convert nested dictionaries of a study to ones with a list of conditions.

    Tables by name change or extend the default list.
    """
    if not isinstance(tree, Mapping) or CONDITIONS not in tree:
        return tree
    listed = tree[CONDITIONS]
    if isinstance(listed, str) and listed == NONE:
        listed = ()
    if isinstance(listed, Mapping):
        listed = merged(_tables(DEFAULT), listed, CONDITIONS)
    listed = _tables(listed)
    return {**tree, CONDITIONS: listed} if isinstance(listed, list) else tree


def _tables(entries: Any) -> Any:
    """Entries as tables; text is a name without other keys."""
    if not isinstance(entries, list | tuple):
        return entries
    return [{"name": entry} if isinstance(entry, str) else entry for entry in entries]
