"""Study files: sections with defaults and checks, presets, and conversion to text."""

from pymantaray.config.load import (
    convert_study,
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
    "convert_study",
    "list_presets",
    "load_sound",
    "load_study",
    "parse_study",
    "preset_text",
    "starter_text",
    "study_toml",
]
