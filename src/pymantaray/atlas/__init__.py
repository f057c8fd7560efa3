"""What ranging along straight lines costs in every column of an ocean: errors by convention, and where there is no direct path."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pymantaray.atlas.links import AtlasLinks

if TYPE_CHECKING:
    from pymantaray.atlas.dataset import open_atlas, safety_table
    from pymantaray.atlas.plan import Atlas
    from pymantaray.atlas.runner import run_atlas

__all__ = ["Atlas", "AtlasLinks", "open_atlas", "run_atlas", "safety_table"]

_LATER = {"Atlas": "plan", "open_atlas": "dataset", "run_atlas": "runner", "safety_table": "dataset"}


def __getattr__(name: str) -> Any:
    """Import what is heavy on first use."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
