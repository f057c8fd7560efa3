"""From one study to many: points of a sweep, the stages that they share, and one table of all of them."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pymantaray.sweep.definition import Sweep, load_sweep

if TYPE_CHECKING:
    from pymantaray.sweep.results import SweepResults, open_sweep
    from pymantaray.sweep.runner import run_sweep

__all__ = ["Sweep", "SweepResults", "load_sweep", "open_sweep", "run_sweep"]

_LATER = {"SweepResults": "results", "open_sweep": "results", "run_sweep": "runner"}


def __getattr__(name: str) -> Any:
    """Import what is heavy on first use."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
