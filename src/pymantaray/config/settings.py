"""Tables of settings as in papers: timing of the mission, and noise."""

from typing import Any

import pandas as pd

from pymantaray.config.meanings import LAST_UNIT, meaning
from pymantaray.config.sections import NoiseSection, StudyConfig

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
