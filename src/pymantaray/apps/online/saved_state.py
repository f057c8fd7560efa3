"""
File of an estimator's state: one JSON document with a version and a checksum, written atomically.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.apps.online.drifting_water import saved_water
from pymantaray.apps.online.slow_errors import SlowErrors, saved_ways
from pymantaray.apps.online.timeline import Kind, Outcome
from pymantaray.arrays import Array
from pymantaray.errors import OnlineError
from pymantaray.estimation.filters.error_state import SIZE
from pymantaray.estimation.graph.graph import LARGEST
from pymantaray.messages import one_line
from pymantaray.records.writing import whole_file
from pymantaray.user_files import read_text

KIND = "pymantaray online state"
FORMAT = 4
_ROUNDING = 1e-9

_N_VALUES = {Kind.ODOMETRY: 12, Kind.DEPTH: 2, Kind.FIX: 6, Kind.RANGE: 3}


def write_state(content: dict[str, Any], path: Path | str) -> None:
    """Write a state; numbers keep all digits."""
    text = json.dumps(content)
    head = {"kind": KIND, "format": FORMAT, "sha256": _checksum(text)}
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(head) + "\n" + text + "\n", encoding="utf-8")


def read_state(path: Path | str) -> dict[str, Any]:
    """Read a state."""
    lines = read_text(path, OnlineError, what="a saved estimator").splitlines()
    try:
        head = json.loads(lines[0])
        kind = head["kind"]
        version = head["format"]
    except (ValueError, IndexError, KeyError, TypeError, RecursionError):
        kind = None
        version = None
    if kind != KIND:
        raise OnlineError(f"{path}: not a saved estimator; save one with OnlineEstimator.save")
    if version != FORMAT:
        raise OnlineError(
            f"{path}: format {version}; this version of pymantaray reads format {FORMAT}"
        )
    if len(lines) != 2 or head.get("sha256") != _checksum(lines[1]):
        raise OnlineError(
            f"{path}: damaged: its content does not have its checksum; use an earlier file"
        )
    try:
        content: dict[str, Any] = json.loads(lines[1])
    except (ValueError, RecursionError) as error:
        raise OnlineError(
            f"{path}: not a usable state: {one_line(error, 80)}; use an earlier file"
        ) from None
    return content


def fault_of(content: Any) -> str:
    """First fault of a state that would make an estimator fail later; empty without one."""
    try:
        return _fault(content)
    except OnlineError as error:
        return str(error)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        return one_line(f"{type(error).__name__} {error}", 80)


def _fault(content: dict[str, Any]) -> str:
    # names of vehicles and beacons, and of the range model
    vehicles = content["vehicles"]
    beacons = content["beacons"]
    if not (isinstance(vehicles, list) and isinstance(beacons, list)):
        return "the names of vehicles and beacons are not lists"
    names = [*vehicles, *beacons]
    if (
        not vehicles
        or len(set(names)) != len(names)
        or not all(isinstance(name, str) for name in names)
    ):
        return "the names of vehicles and beacons are not different texts"
    if not isinstance(content["model"], str):
        return f"model is {content['model']!r}"
    # estimates, with and without errors of ways
    base = content["base"]
    fixed = _numbers(content["fixed"]).reshape(-1, 3)
    n = len(vehicles)
    errors = SlowErrors(saved_water(content["water"]), saved_ways(content["ways"]), n, len(names))
    size = len(names) - len(fixed) + errors.members
    others = {"time": (n,), "begin": (n,), "errors_time": (), "no_error": ()}
    if fault := _shape_fault("base", base, others) or _state_fault("base", base, size):
        return fault
    if (content["without"] is None) != (errors.ways is None):
        return "without is not the estimate without errors of ways"
    if errors.ways is not None and (fault := _state_fault("without", content["without"], size)):
        return fault
    if not 0.0 <= base["no_error"] <= 1.0:
        return f"base.no_error is {base['no_error']!r}"
    # fixed positions and settings
    if not (np.abs(fixed) <= LARGEST).all():
        return f"fixed is not finite, or beyond {LARGEST:g} m"
    for name in ("lag", "longest_step", "horizon", "gate"):
        value = content[name]
        if value is None and name == "gate":
            continue
        is_number = type(value) in (int, float) and np.isfinite(float(value))
        if not is_number or (name != "horizon" and value <= 0.0):
            return f"{name} is {value!r}"
    # outcomes and events
    if any(
        name not in Outcome.__members__ or type(k) is not int
        for name, k in content["total"].items()
    ):
        return "total is not numbers of outcomes"
    rows = [*content["events"], *content["waiting"]]
    early = next((row for row in rows if not row[0] >= content["horizon"]), None)
    if early is not None:
        return f"event {one_line(early, 60)} is before the horizon"
    return next((fault for row in rows if (fault := _event(row, len(names), n))), "")


def _numbers(values: Any) -> Array:
    """Array of numbers; an error for texts, which NumPy would convert."""
    array = np.array(values)
    if array.dtype.kind not in "if":
        raise OnlineError(f"{one_line(values, 60)} is no array of numbers")
    return array.astype(float)


def _shape_fault(what: str, content: dict[str, Any], shapes: dict[str, tuple[int, ...]]) -> str:
    """First array that is not finite or has another shape; empty without one."""
    for name, shape in shapes.items():
        values = _numbers(content[name])
        if values.shape != shape or not np.isfinite(values).all():
            return f"{what}.{name} is not a finite array of shape {shape}"
    return ""


def _state_fault(what: str, content: dict[str, Any], size: int) -> str:
    """Fault of a saved state of a number of members; empty without one."""
    shapes: dict[str, tuple[int, ...]] = {
        "rotation": (size, 3, 3),
        "position": (size, 3),
        "covariance": (SIZE * size, SIZE * size),
    }
    if fault := _shape_fault(what, content, shapes):
        return fault
    rotation, position, covariance = (_numbers(content[name]) for name in shapes)
    is_small = (np.abs(rotation) <= 1.0 + _ROUNDING).all()
    if not is_small or not np.allclose(rotation @ rotation.transpose(0, 2, 1), np.eye(3)):
        return f"{what}.rotation is no rotation"
    if not (np.abs(position) <= LARGEST).all():
        return f"{what}.position is beyond {LARGEST:g} m"
    if not (np.abs(covariance) <= LARGEST**2).all():
        return f"{what}.covariance is too large"
    values = np.linalg.eigvalsh(covariance + covariance.T)
    if values.min(initial=0.0) < -_ROUNDING * max(float(values.max(initial=0.0)), 1e-300):
        return f"{what}.covariance is not positive semidefinite"
    return ""


def _event(row: Any, n_members: int, n_vehicles: int) -> str:
    """Fault of an event; empty without one."""
    time, kind, members, values = row
    fitting = (
        kind in set(Kind)
        and len(members) == (2 if kind == Kind.RANGE else 1)
        and all(type(m) is int and 0 <= m < n_members for m in members)
        and members[-1] < n_vehicles
        and np.isfinite(_numbers([time, *values])).all()
        and len(values) == _N_VALUES[Kind(kind)]
    )
    return "" if fitting else f"event {one_line(row, 60)}"


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
