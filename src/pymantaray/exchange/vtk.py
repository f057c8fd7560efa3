"""Writer of VTK files (VTU) for ParaView, in axes east, north, up."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.acoustics import RayPaths
from pymantaray.arrays import Array
from pymantaray.errors import ExchangeError, optional_package
from pymantaray.exchange.frames import swap_enu
from pymantaray.exchange.recording import Recording, new_file
from pymantaray.records import Arrivals
from pymantaray.records.status import TRUTH


def write_fleet(recording: Recording, folder: Path) -> None:
    """
    Write ``<condition>-<vehicle>.vtu``: paths with time, depth and, for estimates, distance from
    the truth.
    """
    truth = recording.truth
    true = dict(zip(truth.name.tolist(), truth.position, strict=True))
    for p in recording.poses:
        values = {"time_s": truth.time[p.samples], "depth_m": p.position[:, 2]}
        if p.condition != TRUTH:
            error = p.position - true[p.vehicle][p.samples]
            values["error_m"] = np.linalg.norm(error, axis=1)
        _write(new_file(folder, p, ".vtu"), p.position, np.zeros(p.samples.size), points=values)


def write_ranges(recording: Recording, kinds: Mapping[str, str], folder: Path) -> None:
    """
    Write ``ranges.vtu``: lines between the true positions of all received range attempts.

    ``kinds`` has the measured ranges that each condition uses, ``straight`` or ``refracted``. The
    residual of a condition is this range minus the distance of the estimated positions; landmarks
    are at their true positions.
    """
    m = recording.measurements
    rows = recording.received
    samples = m.range_sample[rows]
    ends = np.stack([m.range_transmitter, m.range_receiver], axis=1)[rows]
    truth = _places(recording.truth.position, recording.landmarks, ends, samples)
    distance = np.linalg.norm(truth[:, 0] - truth[:, 1], axis=1)
    values = {
        "time_s": m.time[samples],
        "transmitter": ends[:, 0],
        "receiver": ends[:, 1],
        "distance_m": distance,
        "straight_range_m": m.straight_range[rows],
        "refracted_range_m": m.refracted_range[rows],
        "range_error_m": m.refracted_range[rows] - distance,
    }
    for condition, (position, _) in recording.estimates.items():
        if condition in kinds:
            places = _places(position, recording.landmarks, ends, samples)
            between = np.linalg.norm(places[:, 0] - places[:, 1], axis=1)
            values[f"residual_{condition}_m"] = values[f"{kinds[condition]}_range_m"] - between
    line = np.repeat(np.arange(rows.size), 2)
    _write(folder / "ranges.vtu", truth.reshape(-1, 3), line, cells=values)


def write_rays(paths: RayPaths, arrivals: Arrivals, time: Array, folder: Path) -> None:
    """
    Write ``rays.vtu``: eigenrays with the properties of their arrivals; ``time`` is that of each
    link. [s]
    """
    row = paths.arrival
    values = {
        "travel_time_s": paths.travel_time,
        "depth_m": paths.position[:, 2],
        "sound_speed_m_per_s": 1.0 / np.linalg.norm(paths.slowness, axis=1),
        "arrival": row,
        "link": arrivals.link[row],
        "time_s": time[arrivals.link[row]],
        "surface_bounces": arrivals.surface_bounces[row],
        "bottom_bounces": arrivals.bottom_bounces[row],
        "spreading_db": arrivals.spreading_db[row],
    }
    _write(folder / "rays.vtu", paths.position, row, points=values)


def _places(position: Array, landmarks: Array, ends: Any, samples: Any) -> Array:
    """Positions of both ends (n, 2, 3) of range attempts from those of a fleet. [m]"""
    still = np.broadcast_to(landmarks[:, None], (len(landmarks), *position.shape[1:]))
    return np.asarray(np.concatenate([position, still])[ends, samples[:, None]])


def _write(
    path: Path,
    position: Array,
    line: Any,
    *,
    points: Mapping[str, Any] | None = None,
    cells: Mapping[str, Any] | None = None,
) -> None:
    """
    Write consecutive positions with the same number of a line as a line; cells are segments, or
    points if no line has two. Without positions there is no file, which no reader would take.
    """
    if not len(position):
        return
    with optional_package(ExchangeError, "vtk", "meshio", "vtk"):
        import meshio
    first = np.flatnonzero(np.diff(line) == 0)
    segments = np.stack([first, first + 1], axis=1)
    kind = "line" if first.size else "vertex"
    shape = segments if first.size else np.arange(len(position))[:, None]
    mesh = meshio.Mesh(
        swap_enu(position),
        [(kind, shape)],
        point_data={name: _numbers(values) for name, values in (points or {}).items()},
        cell_data={name: [_numbers(values)] for name, values in (cells or {}).items()},
    )
    mesh.write(path, file_format="vtu")


def _numbers(values: Any) -> Any:
    """Values as 64-bit numbers, which every reader knows."""
    array = np.asarray(values)
    return array.astype(np.float64 if array.dtype.kind == "f" else np.int64)
