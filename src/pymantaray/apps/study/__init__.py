"""
Whole studies: realizations, conditions and the run folder. `pymantaray.config` reads their
configuration files.

Modules that only a run needs are imported at their first use.

Examples
--------
>>> from pymantaray import load_study
>>> from pymantaray.apps.study import run_study
>>> hours = {"mission.duration_h": 1.0, "mission.ping_interval_h": 0.5}
>>> run = run_study(load_study("quick", realizations=2, **hours), "run", workers=1)
>>> run.estimates.position.shape[:2]
(3, 2)
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.study.comparison_page import write_comparison as write_comparison
    from pymantaray.apps.study.references import citation as citation
    from pymantaray.apps.study.report import write_report as write_report
    from pymantaray.apps.study.runner import run_study as run_study
    from pymantaray.apps.study.store import Run as Run, open_run as open_run

__getattr__, __dir__, __all__ = lazy_exports(__name__)
