"""Runs the whole experiment: realizations, conditions, and the run folder; `pymantaray.config` reads its file.

Reading a configuration is quick; what it takes to run one is imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pymantaray.config import (
    SoundConfig,
    StudyConfig,
    list_presets,
    load_sound,
    load_study,
    parse_study,
    preset_text,
    starter_text,
    study_toml,
)

if TYPE_CHECKING:
    from pymantaray.study.export import export_run
    from pymantaray.study.ranges import measure
    from pymantaray.study.references import citation
    from pymantaray.study.runner import run_study
    from pymantaray.study.store import Run, open_run

__all__ = [
    "Run",
    "SoundConfig",
    "StudyConfig",
    "citation",
    "export_run",
    "list_presets",
    "load_sound",
    "load_study",
    "measure",
    "open_run",
    "parse_study",
    "preset_text",
    "run_study",
    "starter_text",
    "study_toml",
]

_LATER = {
    "Run": "store",
    "citation": "references",
    "export_run": "export",
    "measure": "ranges",
    "open_run": "store",
    "run_study": "runner",
}


def __getattr__(name: str) -> Any:
    """Import what is heavy on first use."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
