"""Conditions of a study before their check: a list, or tables that change the standard list, or old keys."""

import warnings
from collections.abc import Mapping
from typing import Any

from pymantaray.config.common import NONE
from pymantaray.config.estimators import STANDARD
from pymantaray.config.keys import merged

CONDITIONS = "conditions"
DEFAULT = ("odometry", "straight", "refracted")
"""Names of the conditions of a study without a list."""


def with_conditions(tree: Any, label: str, *, warn: bool = True) -> Any:
    """
    Convert nested dictionaries of a study to ones with a single list of conditions.

    Tables by name change or extend the list of the base, or the default list. The lists of earlier versions,
    ``study.conditions`` and ``estimators``, replace the standard conditions and the others.
    """
    if not isinstance(tree, Mapping):
        return tree
    listed, study = tree.get(CONDITIONS, DEFAULT), tree.get("study", {})
    if isinstance(listed, str) and listed == NONE:
        listed = ()
    if isinstance(listed, Mapping):
        listed = merged(_tables(DEFAULT), listed, CONDITIONS)
    listed = _tables(listed)
    if not isinstance(listed, list):
        return tree
    names = study.get(CONDITIONS) if isinstance(study, Mapping) else None
    own = tree.get("estimators")
    if names is None and own is None:
        return {**tree, CONDITIONS: listed} if CONDITIONS in tree else tree
    if warn:
        old = {"study.conditions": names, "estimators": own}
        said = "; ".join(f"`{key}` is now `{CONDITIONS}`" for key, value in old.items() if value is not None)
        warnings.warn(
            f"{label}: {said}. The old names will not be read by the next version", FutureWarning, 4
        )
    standard, others = [c for c in listed if _is_standard(c)], [c for c in listed if not _is_standard(c)]
    if names is not None:
        standard = _tables(names)
    if own is not None:
        own = merged(others, own, CONDITIONS) if isinstance(own, Mapping) else _tables(own)
        others = [] if own == NONE else own
    parts: list[Any] = [standard, others]
    odd = [part for part in parts if not isinstance(part, list)]
    whole = odd[0] if odd else [*standard, *(_started(c, tree) for c in others)]
    rest = {key: value for key, value in tree.items() if key != "estimators"}
    if names is not None:
        rest["study"] = {key: value for key, value in study.items() if key != CONDITIONS}
    return {**rest, CONDITIONS: whole}


def _tables(entries: Any) -> Any:
    """Entries as tables; text is a name without other keys."""
    if not isinstance(entries, list | tuple):
        return entries
    if isinstance(entries, list) and not any(isinstance(entry, str) for entry in entries):
        return entries
    return [{"name": entry} if isinstance(entry, str) else entry for entry in entries]


def _is_standard(entry: Any) -> bool:
    return isinstance(entry, Mapping) and entry.get("name") in STANDARD


def _started(entry: Any, tree: Mapping[str, Any]) -> Any:
    """Estimator of an earlier version, whose default start was the ground truth."""
    general = tree.get("estimator", {})
    own = not isinstance(general, Mapping) or general.get("start", "truth") == "truth"
    return entry if own or not isinstance(entry, Mapping) else {"start": "truth", **entry}
