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
from pymantaray.exchange.tracks import Poses
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.user_files import read_text

HEADER = re.compile(r"\s*#\s*timestamp.*\bp_RS_R_x\b.*\bq_RS_w\b", re.IGNORECASE)
_POSE = ("p_RS_R_x", "p_RS_R_y", "p_RS_R_z", "q_RS_w", "q_RS_x", "q_RS_y", "q_RS_z")
# ns; later stamps are dates, earlier stamps are from another clock
_FIRST_DATE = 100_000_000_000_000_000
_LAST_STAMP = 2**63 - 1  # ns


def read_euroc(path: Path) -> tuple[list[Poses], tuple[str, ...]]:
    """
    Read the trajectory of a EuRoC file, and a note about invalid lines; the name of the file is the
    name of the vehicle.
    """
    lines = read_text(path, ExchangeError, what="a EuRoC file").splitlines()
    header = next(line for line in lines if HEADER.match(line))
    names = [re.split(r"[\s\[]", cell.strip(" #"))[0] for cell in header.split(",")]
    try:
        columns = [names.index(name) for name in _POSE]
    except ValueError:
        raise ExchangeError(f"{path}: a EuRoC file needs the columns {', '.join(_POSE)}") from None
    rows: list[tuple[int, int, list[float]]] = []
    invalid = InvalidLines()
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = line.split(",")
        try:
            stamp = int(cells[0])
            pose = [parsed_number(cells[k]) for k in columns]
        except (ValueError, IndexError):
            pose = [np.nan]
        if not np.isfinite(pose).all() or abs(stamp) > _LAST_STAMP:
            wanted = f"a whole number of nanoseconds, and {len(names) - 1} numbers"
            invalid.add(path, number, f"not a pose of EuRoC: {wanted}")
        else:
            rows.append((number, stamp, pose))
    invalid.refuse_most(len(rows), ExchangeError)
    if not rows:
        raise ExchangeError(f"{path}: no poses; a trajectory needs at least two")
    numbers, stamps, poses = zip(*rows, strict=True)
    time = np.array(stamps, dtype=np.int64)
    table = np.array(poses)
    own_time = time.astype("datetime64[ns]") if time.min() > _FIRST_DATE else 1e-9 * time
    line_of = np.array(numbers)
    track = Poses(path.stem, own_time, table[:, :3], table[:, 3:], False, str(path), line=line_of)
    return [track], invalid.notes
