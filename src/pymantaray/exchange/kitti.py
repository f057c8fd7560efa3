"""
Reader and writer of the text format of the KITTI odometry benchmark, which evo and other programs
read.
"""

from pathlib import Path

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import ExchangeError
from pymantaray.exchange.tracks import Poses
from pymantaray.exchange.tum import text_numbers
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix
from pymantaray.records import whole_file
from pymantaray.records.text_table import check_seconds
from pymantaray.user_files import exists

_MAX_SKEW = 1e-3  # of a rotation times its transpose, from the digits of files


def write_kitti(path: Path, position: Array, quaternion: Array) -> None:
    """
    Write one vehicle's poses, one per line: the first three rows of the matrix from body to north,
    east, down.

    The format has no times and no frame. KITTI's own files use the axes of a camera.
    """
    poses = np.concatenate([matrix_from_quaternion(quaternion), position[:, :, None]], axis=2)
    with whole_file(path) as temporary:
        np.savetxt(temporary, poses.reshape(-1, 12), fmt="%.17g")


def read_kitti(path: Path) -> tuple[list[Poses], tuple[str, ...]]:
    """
    Read the trajectory of a KITTI file and the times beside it; the name of the file is the name of
    the vehicle.

    The times, one per line, are in the first that exists of ``NAME_times.txt``,
    ``times-VEHICLE.txt`` (`write_kitti`'s ``CONDITION-VEHICLE.txt``) and ``times.txt``. An
    invalid line is an error, because poses and times belong together by their
    numbers.
    """
    names = [f"{path.stem}_times.txt", f"times-{path.stem.partition('-')[2]}.txt", "times.txt"]
    times = next((path.with_name(name) for name in names if exists(path.with_name(name))), None)
    if times is None:
        raise ExchangeError(
            f"{path}: poses of KITTI have no times; put them, one per line, into {names[0]} beside"
            " it"
        )
    rows, line = text_numbers(path, 12, "a KITTI file has 12 per row, a 3 by 4 matrix")
    table = rows.reshape(-1, 3, 4)
    time = text_numbers(times, 1, "times of KITTI have one per row")[0][:, 0]
    if time.size != len(table):
        raise ExchangeError(f"{times}: {time.size} times, but {path.name} has {len(table)} poses")
    check_seconds(time, str(times), ExchangeError)
    rotation = table[:, :, :3]
    with np.errstate(all="ignore"):  # of impossible numbers
        skew = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        wrong = ~((skew <= _MAX_SKEW) & (np.linalg.det(rotation) > 0.0))
    if wrong.any():
        raise ExchangeError(
            f"{path}: pose {int(np.argmax(wrong))} has no rotation matrix; correct or remove it"
        )
    quaternion = quaternion_from_matrix(rotation)
    return [Poses(path.stem, time, table[:, :, 3], quaternion, False, str(path), line=line)], ()
