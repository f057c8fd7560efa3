"""Writer of the text format of the KITTI odometry benchmark, which evo and other programs read."""

from pathlib import Path

import numpy as np

from pymantaray.arrays import Array
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import whole_file


def write_kitti(path: Path, position: Array, quaternion: Array) -> None:
    """
    Write one vehicle's poses, one per line: the first three rows of the matrix from body to north, east, down.

    The format has no times and no frame. KITTI's own files use the axes of a camera.
    """
    poses = np.concatenate([matrix_from_quaternion(quaternion), position[:, :, None]], axis=2)
    with whole_file(path) as temporary:
        np.savetxt(temporary, poses.reshape(-1, 12), fmt="%.17g")
