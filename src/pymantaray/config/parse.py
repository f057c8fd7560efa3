"""Check nested dictionaries of a file against the models of a configuration."""

from pathlib import Path
from typing import Any

from pymantaray.config.checks import Model, checked
from pymantaray.config.common import Section
from pymantaray.config.conditions import CONDITIONS, with_conditions
from pymantaray.config.geographic import PLACED

Like = tuple[dict[str, Any], Section]
"""Nested dictionaries and the configuration that `parse` made of them."""


def parse(
    model: type[Model],
    tree: dict[str, Any],
    label: str,
    folder: Path | None,
    like: Like | None = None,
) -> Model:
    """
    Check nested dictionaries by a model, as `checked`; the conditions of a study may be tables by
    name.

    Sections that are the same objects as in ``like`` are not checked again.
    """
    if issubclass(model, Section) and model.in_toml and CONDITIONS in model.model_fields:
        tree = with_conditions(tree)
    return checked(
        model, tree if like is None else tree | _same_sections(tree, *like), label, folder
    )


def _same_sections(tree: dict[str, Any], other: dict[str, Any], config: Section) -> dict[str, Any]:
    """
    Sections of a configuration of another tree that are the same in this one, without those whose
    positions may differ.
    """
    same = {name for name in other.keys() | PLACED if tree.get(name) is other.get(name)}
    same = same if same >= PLACED else same - PLACED
    return {name: getattr(config, name) for name in same & tree.keys()}
