"""Access to the plots of an object, which are imported when one is drawn: only the report imports matplotlib."""

from importlib import import_module
from typing import Any


def plotter(name: str) -> Any:
    """Function or class of `pymantaray.apps.study.plots` with this name."""
    return getattr(import_module("pymantaray.apps.study.plots"), name)
