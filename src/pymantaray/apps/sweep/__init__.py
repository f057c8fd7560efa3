"""Sweeps: many studies (points) with shared stages, and one table of their results."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.sweep.definition import Sweep as Sweep, load_sweep as load_sweep
    from pymantaray.apps.sweep.page import write_sweep_page as write_sweep_page
    from pymantaray.apps.sweep.results import SweepResults as SweepResults, open_sweep as open_sweep
    from pymantaray.apps.sweep.runner import run_sweep as run_sweep

__getattr__, __dir__, __all__ = lazy_exports(__name__)
