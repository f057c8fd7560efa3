"""
Reader of the CSV ground truth of the EuRoC MAV dataset (ASL dataset format), which evo and other
programs read.

A comment line has the names of the columns: time stamp in nanoseconds, position ``p_RS_R`` and
quaternion ``q_RS``, w first.
"""

import re
from pathlib import Path

import numpy as np

from pymantaray.errors import ExchangeError
from pymantaray.exchange.frames import swap_enu, swap_enu_attitude
from pymantaray.exchange.tracks import Poses
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.user_files import read_text

HEADER = re.compile(r"\s*#\s*timestamp.*\bp_RS_R_x\b.*\bq_RS_w\b", re.IGNORECASE)
_POSE = ("p_RS_R_x", "p_RS_R_y", "p_RS_R_z", "q_RS_w", "q_RS_x", "q_RS_y", "q_RS_z")
_FIRST_DATE = (
    100_000_000_000_000_000  # ns; later stamps are dates, earlier stamps are from another clock
)
_LAST_STAMP = 2**63 - 1  # ns


def read_euroc(path: Path, *, enu: bool = False) -> tuple[list[Poses], tuple[str, ...]]:
    """
    Read the trajectory of a EuRoC file, and a note about invalid lines; the name of the file is the
    name of the vehicle.

    With ``enu``, x, y, z are east, north, up and the body axes are forward, left, up; without,
    north, east, down.
    """
    lines = read_text(path, ExchangeError, what="a EuRoC file").splitlines()
    header = next(line for line in lines if HEADER.match(line))
    names = [re.split(r"[\s\[]", cell.strip(" #"))[0] for cell in header.split(",")]
    try:
        columns = [names.index(name) for name in _POSE]
    except ValueError:
        raise ExchangeError(f"{path}: a EuRoC file needs the columns {', '.join(_POSE)}") from None
    stamps: list[int] = []
    numbers: list[int] = []
    poses: list[list[float]] = []
    invalid = InvalidLines()
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            stamp, pose = _stamp_and_pose(line.split(","), columns)
        except (ValueError, IndexError):
            wanted = f"a whole number of nanoseconds, and {len(names) - 1} numbers"
            invalid.add(path, number, f"not a pose of EuRoC: {wanted}")
            continue
        stamps.append(stamp)
        numbers.append(number)
        poses.append(pose)
    invalid.refuse_most(len(poses), ExchangeError)
    time = np.array(stamps, dtype=np.int64)
    table = np.array(poses).reshape(-1, len(columns))
    place = table[:, :3]
    quaternion = table[:, 3:]
    if enu:
        place = swap_enu(place)
        quaternion = swap_enu_attitude(quaternion)
    dated = time.size > 0 and time.min() > _FIRST_DATE
    own_time = time.astype("datetime64[ns]") if dated else 1e-9 * time
    track = Poses(path.stem, own_time, place, quaternion, False, str(path), line=np.array(numbers))
    return [track], invalid.notes


def _stamp_and_pose(cells: list[str], columns: list[int]) -> tuple[int, list[float]]:
    """Time stamp [ns] and finite numbers of a row; a ValueError or IndexError for other rows."""
    stamp = int(cells[0])
    pose = [parsed_number(cells[k]) for k in columns]
    if abs(stamp) > _LAST_STAMP or not np.isfinite(pose).all():
        raise ValueError(cells[0])
    return stamp, pose
