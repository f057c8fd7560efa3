"""Trajectories in the text format of the TUM RGB-D benchmark, which evo and others read."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.errors import MantaRayError


def write_tum(path: Path | str, time: ArrayLike, position: ArrayLike, quaternion: ArrayLike) -> None:
    """
    Write one vehicle's trajectory as TUM text, whole or not at all.

    Each line is ``time x y z qx qy qz qw`` with 17 significant digits. The format has no header to
    name a frame: x, y, z are our north, east and down, and the rotation is body to that frame.

    Parameters
    ----------
    path : pathlib.Path or str
        File to make or replace; its folder must exist.
    time : array_like, shape (n_times,)
        [s]
    position : array_like, shape (n_times, 3)
        North, east, down in the local frame. [m]
    quaternion : array_like, shape (n_times, 4)
        Rotation body to world, (w, x, y, z).

    Raises
    ------
    MantaRayError
        If the shapes disagree or a value is not finite.
    """
    path = Path(path)
    t, p, q = (np.asarray(a, dtype=float) for a in (time, position, quaternion))
    if t.ndim != 1 or p.shape != (t.size, 3) or q.shape != (t.size, 4):
        raise MantaRayError(
            f"{path}: time {t.shape}, position {p.shape}, quaternion {q.shape}; needs (n,), (n, 3) and (n, 4)"
        )
    table = np.concatenate([t[:, None], p, q[:, [1, 2, 3, 0]]], axis=1)
    if not np.isfinite(table).all():
        row = int(np.argmin(np.isfinite(table).all(axis=1)))
        raise MantaRayError(f"{path}: pose {row} is not finite; a failed solve has no trajectory to export")
    temporary = path.with_name(path.name + ".part")
    try:
        np.savetxt(temporary, table, fmt="%.17g")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
