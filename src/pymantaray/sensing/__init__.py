"""
What the vehicles measure: one module a sensor, ranges by sound, and the noise of all.

Levels of noise are quick to read; what ranges need is imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pymantaray.sensing.landmarks import Landmark
from pymantaray.sensing.noise import NoiseModel

if TYPE_CHECKING:
    from pymantaray.sensing.detection import Detector, Hearing
    from pymantaray.sensing.measure import assemble, perturb
    from pymantaray.sensing.picking import Candidates, Picker, draw_picks, find_candidates
    from pymantaray.sensing.ranging import Links, Ranging, measure_ranges
    from pymantaray.sensing.receptions import Receptions, SoundPath
    from pymantaray.sensing.schedule import PingList, PingSchedule, Schedule, SlotSchedule
    from pymantaray.sensing.timing import ClockModel, Clocks, OneWay, Timing, TwoWay
    from pymantaray.sensing.transmission import Reception, Transmission, find_receptions

__all__ = [
    "Candidates",
    "ClockModel",
    "Clocks",
    "Detector",
    "Hearing",
    "Landmark",
    "Links",
    "NoiseModel",
    "OneWay",
    "Picker",
    "PingList",
    "PingSchedule",
    "Ranging",
    "Reception",
    "Receptions",
    "Schedule",
    "SlotSchedule",
    "SoundPath",
    "Timing",
    "Transmission",
    "TwoWay",
    "assemble",
    "draw_picks",
    "find_candidates",
    "find_receptions",
    "measure_ranges",
    "perturb",
]

_HOME = {
    "detection": ("Detector", "Hearing"),
    "measure": ("assemble", "perturb"),
    "picking": ("Candidates", "Picker", "draw_picks", "find_candidates"),
    "ranging": ("Links", "Ranging", "measure_ranges"),
    "receptions": ("SoundPath", "Receptions"),
    "schedule": ("PingList", "PingSchedule", "Schedule", "SlotSchedule"),
    "timing": ("ClockModel", "Clocks", "OneWay", "Timing", "TwoWay"),
    "transmission": ("Reception", "Transmission", "find_receptions"),
}
_LATER = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
