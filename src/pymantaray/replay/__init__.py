"""Measured travel times beside predicted ones: events in; residuals, coverage, clocks and switching out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pymantaray.replay.rules import DEFAULT_RULE, DetectionRule

if TYPE_CHECKING:
    from pymantaray.replay.compare import Replay, replay_events
    from pymantaray.replay.events import Events, read_events

__all__ = [
    "DEFAULT_RULE",
    "DetectionRule",
    "Events",
    "Replay",
    "read_events",
    "replay_events",
]

_HOME = {"compare": ("Replay", "replay_events"), "events": ("Events", "read_events")}
_LATER = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import what is heavy on first use."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
