"""
Sweeps: many studies (points) with shared stages, and one table of their results.

Examples
--------
>>> from pymantaray import load_study
>>> from pymantaray.apps.sweep import Sweep, run_sweep
>>> hours = {"mission.duration_h": 1.0, "mission.ping_interval_h": 0.5}
>>> study = load_study("quick", realizations=1, **hours)
>>> sweep = Sweep(study, cross={"noise.range_sigma": [0.5, 2.0]})
>>> results = run_sweep(sweep, "sweep", workers=1)
>>> results.status()
Status(points=2, done=2, failed=0, failures={})
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.sweep.definition import Sweep as Sweep, load_sweep as load_sweep
    from pymantaray.apps.sweep.page import write_sweep_page as write_sweep_page
    from pymantaray.apps.sweep.results import SweepResults as SweepResults, open_sweep as open_sweep
    from pymantaray.apps.sweep.runner import run_sweep as run_sweep

__getattr__, __dir__, __all__ = lazy_exports(__name__)
