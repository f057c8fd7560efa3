"""Keys of a configuration as headings of tables."""

from typing import Any

from pymantaray.config.meanings import LAST_UNIT, meaning
from pymantaray.config.sections import StudyConfig
from pymantaray.records.result_table import heading


def key_heading(key: str) -> str:
    """
    Key of a configuration, followed by the unit of its description in brackets; the heading of a
    column without a dot.
    """
    if "." not in key:
        return heading(key)
    section, _, name = key.partition(".")
    model: Any = (
        StudyConfig.model_fields[section].annotation
        if section in StudyConfig.model_fields
        else None
    )
    known = name in getattr(model, "model_fields", {})
    unit = LAST_UNIT.search(meaning(model, name)) if known else None
    return f"{key} [{unit[1]}]" if unit else key
