"""Settings in tables: timing of the mission and noise as in papers, and keys as headings."""

from typing import Any

import pandas as pd

from pymantaray.config.meanings import LAST_UNIT, meaning
from pymantaray.config.sections import NoiseSection, StudyConfig
from pymantaray.records.result_table import heading

TIMING = (
    "mission.duration_h",
    "mission.physics_step_s",
    "fleet.floats.hold_depth_h",
    "fleet.floats.hold_surface_h",
    "fleet.floats.vertical_speed",
    "mission.sampling_period_s",
    "mission.ping_interval_h",
    "study.realizations",
)
NOISE = tuple(f"noise.{name}" for name in NoiseSection.model_fields)


def settings_table(config: StudyConfig, keys: tuple[str, ...]) -> pd.DataFrame:
    """Table of key, value, unit and meaning of those settings that a configuration has."""
    rows = []
    for key in keys:
        *sections, name = key.split(".")
        section: Any = config
        for part in sections:
            section = getattr(section, part, None)
        if getattr(section, name, None) is None:
            continue
        words = meaning(type(section), name)
        unit = LAST_UNIT.search(words)
        rows.append(
            {
                "key": key,
                "value": float(getattr(section, name)),
                "unit": unit[1] if unit else "-",
                "meaning": LAST_UNIT.sub("", words),
            }
        )
    return pd.DataFrame(rows, columns=["key", "value", "unit", "meaning"])


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
