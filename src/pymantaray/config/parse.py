"""Check nested dictionaries of a file against the models of a configuration."""

from pathlib import Path
from typing import Any

from pymantaray.config.checks import Model, checked
from pymantaray.config.common import Section
from pymantaray.config.conditions import CONDITIONS, with_conditions


def parse(model: type[Model], tree: dict[str, Any], label: str, folder: Path | None) -> Model:
    """
    Check nested dictionaries by a model, as `checked`; the conditions of a study may be tables by
    name.
    """
    if issubclass(model, Section) and model.in_toml and CONDITIONS in model.model_fields:
        tree = with_conditions(tree)
    return checked(model, tree, label, folder)
