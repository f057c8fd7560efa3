"""Check nested dictionaries of a file, with the keys of earlier versions, against the models of a configuration."""

from pathlib import Path
from typing import Any

from pymantaray.config.checks import Model, checked
from pymantaray.config.common import Section
from pymantaray.config.conditions import CONDITIONS, with_conditions
from pymantaray.config.renamed import with_new_names


def parse(model: type[Model], tree: dict[str, Any], label: str, folder: Path | None) -> Model:
    """Check nested dictionaries by a model, as `checked`; a study may have keys of earlier versions."""
    if issubclass(model, Section) and model.in_toml:
        tree = with_new_names(tree, label)
        if CONDITIONS in model.model_fields:
            tree = with_conditions(tree, label)
    return checked(model, tree, label, folder)
