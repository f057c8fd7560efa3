"""Study files: sections with defaults and checks, presets, and text again."""

from pymantaray.config.load import (
    list_presets,
    load_sound,
    load_study,
    parse_study,
    preset_text,
    starter_text,
)
from pymantaray.config.sections import SoundConfig, StudyConfig
from pymantaray.config.text import study_toml

__all__ = [
    "SoundConfig",
    "StudyConfig",
    "list_presets",
    "load_sound",
    "load_study",
    "parse_study",
    "preset_text",
    "starter_text",
    "study_toml",
]
