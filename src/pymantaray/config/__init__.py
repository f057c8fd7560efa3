"""Study files: sections with defaults and checks, presets, and conversion to text."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.config.load import (
        list_presets as list_presets,
        load_sound as load_sound,
        load_study as load_study,
        parse_study as parse_study,
        preset_text as preset_text,
        starter_text as starter_text,
    )
    from pymantaray.config.sections import SoundConfig as SoundConfig, StudyConfig as StudyConfig
    from pymantaray.config.text import study_toml as study_toml

__getattr__, __dir__, __all__ = lazy_exports(__name__)
