"""
Reader of the CSV ground truth of the EuRoC MAV dataset (ASL dataset format), which evo and other programs read.

A comment line has the names of the columns: time stamp in nanoseconds, position ``p_RS_R`` and quaternion ``q_RS``, w first.
"""

import re
from pathlib import Path

import numpy as np

from pymantaray.errors import ExchangeError
from pymantaray.exchange.frames import swap_enu, swap_enu_attitude
from pymantaray.exchange.tracks import Poses
from pymantaray.user_files import read_text

HEADER = re.compile(r"\s*#\s*timestamp.*\bp_RS_R_x\b.*\bq_RS_w\b", re.IGNORECASE)
_POSE = ("p_RS_R_x", "p_RS_R_y", "p_RS_R_z", "q_RS_w", "q_RS_x", "q_RS_y", "q_RS_z")
_FIRST_DATE = 100_000_000_000_000_000  # ns; later stamps are dates, earlier stamps are from another clock


def read_euroc(path: Path, *, enu: bool = False) -> list[Poses]:
    """
    Read the trajectory of a EuRoC file; the name of the file is the name of the vehicle.

    With ``enu``, x, y, z are east, north, up and the body axes are forward, left, up; without, north, east, down.
    """
    lines = read_text(path, ExchangeError, what="a EuRoC file").splitlines()
    header = next(line for line in lines if HEADER.match(line))
    names = [re.split(r"[\s\[]", cell.strip(" #"))[0] for cell in header.split(",")]
    rows = [
        (k, line.split(","))
        for k, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    try:
        columns = [names.index(name) for name in _POSE]
    except ValueError:
        raise ExchangeError(f"{path}: a EuRoC file needs the columns {', '.join(_POSE)}") from None
    time = np.empty(len(rows), dtype=np.int64)
    poses = np.empty((len(rows), len(columns)))
    for row, (number, cells) in enumerate(rows):
        try:
            time[row] = int(cells[0])
            poses[row] = [float(cells[k]) for k in columns]
        except (ValueError, IndexError, OverflowError):
            raise ExchangeError(
                f"{path}, line {number}: not a pose of EuRoC: a whole number of nanoseconds, and {len(names) - 1} numbers"
            ) from None
    place, quaternion = poses[:, :3], poses[:, 3:]
    if enu:
        place, quaternion = swap_enu(place), swap_enu_attitude(quaternion)
    dated = time.size > 0 and time.min() > _FIRST_DATE
    stamps = time.astype("datetime64[ns]") if dated else 1e-9 * time
    return [Poses(path.stem, stamps, place, quaternion, False, str(path))]
