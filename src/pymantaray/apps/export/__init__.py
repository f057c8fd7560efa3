"""Exports of runs to formats of other programs."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.export.run_files import export_run as export_run

__getattr__, __dir__, __all__ = lazy_exports(__name__)
