"""Study files: sections with defaults and checks, presets, and text again."""

from pymantaray.config.load import list_presets, load_sound, load_study, parse_study, preset_text, study_toml
from pymantaray.config.sections import SoundConfig, StudyConfig
from pymantaray.config.starter import starter_text

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
