"""Whole studies: realizations, conditions and the run folder. `pymantaray.config` reads their configuration files.

Modules that only a run needs are imported at their first use.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.export.run_files import export_run as export_run
    from pymantaray.apps.ranges.measure import measure as measure
    from pymantaray.apps.study.references import citation as citation
    from pymantaray.apps.study.runner import run_study as run_study
    from pymantaray.apps.study.store import Run as Run
    from pymantaray.apps.study.store import open_run as open_run
    from pymantaray.config import SoundConfig as SoundConfig
    from pymantaray.config import StudyConfig as StudyConfig
    from pymantaray.config import list_presets as list_presets
    from pymantaray.config import load_sound as load_sound
    from pymantaray.config import load_study as load_study
    from pymantaray.config import parse_study as parse_study
    from pymantaray.config import preset_text as preset_text
    from pymantaray.config import starter_text as starter_text
    from pymantaray.config import study_toml as study_toml

__getattr__, __dir__, __all__ = lazy_exports(__name__)
