"""MantaRay: what the real ocean does to acoustic ranges, and to the positions estimated from them.

The names here are the public interface; each is imported from its folder when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pymantaray.acoustics import Medium, find_eigenrays
    from pymantaray.errors import MantaRayError
    from pymantaray.estimation import dead_reckon, read_pyfg, solve_conditions, write_pyfg
    from pymantaray.evaluation import dropout_table, error_table, range_error_table
    from pymantaray.exchange import Tracks, read_trajectories
    from pymantaray.fleet import (
        ConstantTwist,
        Drifting,
        FloatCycle,
        StationKeeping,
        Vehicle,
        Waypoints,
        simulate,
    )
    from pymantaray.geometry import LocalFrame
    from pymantaray.ocean import open_ocean, to_local
    from pymantaray.records import Arrivals, Estimates, Measurements, RangingTruth, Trajectories
    from pymantaray.sensing import Landmark, NoiseModel, PingList, PingSchedule, SlotSchedule, perturb
    from pymantaray.study import StudyConfig, citation, load_study, measure, open_run, run_study
    from pymantaray.water import open_water

__version__ = "0.2.0"

_HOME = {
    "acoustics": ("Medium", "find_eigenrays"),
    "errors": ("MantaRayError",),
    "estimation": ("dead_reckon", "read_pyfg", "solve_conditions", "write_pyfg"),
    "evaluation": ("dropout_table", "error_table", "range_error_table"),
    "exchange": ("Tracks", "read_trajectories"),
    "fleet": (
        "ConstantTwist",
        "Drifting",
        "FloatCycle",
        "StationKeeping",
        "Vehicle",
        "Waypoints",
        "simulate",
    ),
    "geometry": ("LocalFrame",),
    "ocean": ("open_ocean", "to_local"),
    "records": ("Arrivals", "Estimates", "Measurements", "RangingTruth", "Trajectories"),
    "sensing": ("Landmark", "NoiseModel", "PingList", "PingSchedule", "SlotSchedule", "perturb"),
    "water": ("open_water",),
    "study": ("StudyConfig", "citation", "load_study", "measure", "open_run", "run_study"),
}
_FOLDER_OF = {name: folder for folder, names in _HOME.items() for name in names}

__all__ = [
    "Arrivals",
    "ConstantTwist",
    "Drifting",
    "Estimates",
    "FloatCycle",
    "Landmark",
    "LocalFrame",
    "MantaRayError",
    "Measurements",
    "Medium",
    "NoiseModel",
    "PingList",
    "PingSchedule",
    "RangingTruth",
    "SlotSchedule",
    "StationKeeping",
    "StudyConfig",
    "Tracks",
    "Trajectories",
    "Vehicle",
    "Waypoints",
    "citation",
    "dead_reckon",
    "dropout_table",
    "error_table",
    "find_eigenrays",
    "load_study",
    "measure",
    "open_ocean",
    "open_run",
    "open_water",
    "perturb",
    "range_error_table",
    "read_pyfg",
    "read_trajectories",
    "run_study",
    "simulate",
    "solve_conditions",
    "to_local",
    "write_pyfg",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its folder on first use."""
    if name not in _FOLDER_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_FOLDER_OF[name]}"), name)


def __dir__() -> list[str]:
    """Public names, for completion."""
    return sorted([*__all__, "__version__"])
