"""Reader of trajectories, which selects the format by the suffix of the file."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from pymantaray.errors import ExchangeError, OceanError, RecordError
from pymantaray.exchange.centre import centre_beside
from pymantaray.exchange.cf import read_cf
from pymantaray.exchange.rosbag import read_bag
from pymantaray.exchange.table import read_frame, read_table
from pymantaray.exchange.tracks import Poses, Tracks, poses_of_record
from pymantaray.exchange.tum import read_tum
from pymantaray.ocean.files import open_file
from pymantaray.records import Trajectories
from pymantaray.user_files import exists, matching_files, shown

Source = str | Path | Sequence[str | Path] | pd.DataFrame


def read_trajectories(source: Source, *, enu: bool = False) -> Tracks:
    """
    Read trajectories from one or more files of any supported format, or from a data frame.

    Parameters
    ----------
    source : str, pathlib.Path, sequence of them, or pandas.DataFrame
        A data frame has the columns of a table. Files or patterns with ``*``. The suffix selects the format: tables (``.csv``, ``.tsv``, ``.txt``, ``.parquet``), TUM
        files with one vehicle each (``.tum``), CF trajectories or a study's ``truth.nc`` (``.nc``), ROS bags (``.bag``,
        ``.mcap``, ``.db3`` or their folder).
    enu : bool
        True if TUM files use ROS's axes: world east, north, up; body forward, left, up.

    Returns
    -------
    Tracks
        Names, time spans, dates and notes; `Tracks.at` gives poses at common times.

    Raises
    ------
    ExchangeError
        If a file is unreadable, lacks data of a trajectory, or does not match the other files.
    """
    if isinstance(source, pd.DataFrame):
        return Tracks.of(*read_frame(source))
    paths = files_of(source)
    poses: list[Poses] = []
    notes: list[str] = []
    for path in paths:
        own, own_notes = (
            _reader(path)(path) if path.suffix.lower() != ".tum" else (read_tum(path, enu=enu), [])
        )
        poses += [p if p.centre is not None else p._replace(centre=centre_beside(path)) for p in own]
        notes += own_notes
    return Tracks.of(poses, notes)


def files_of(source: str | Path | Sequence[str | Path]) -> list[Path]:
    """Files of a source; those of a pattern are sorted."""
    paths: list[Path] = []
    for one in [source] if isinstance(source, str | Path) else source:
        found = matching_files(str(one), Path(), ExchangeError) if "*" in str(one) else [Path(one)]
        if not found:
            raise ExchangeError(f"{shown(one)}: no file matches this pattern")
        if missing := [path for path in found if not exists(path)]:
            raise ExchangeError(f"{shown(missing[0])}: no such file")
        paths += found
    if not paths:
        raise ExchangeError("trajectories: no file; name at least one")
    return paths


def _reader(path: Path) -> Callable[[Path], tuple[list[Poses], list[str]]]:
    if path.is_dir():
        return read_bag
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise ExchangeError(
            f"{path}: unknown format of trajectories; allowed: {', '.join(sorted(_READERS))} and .tum"
        )
    return reader


def _read_netcdf(path: Path) -> tuple[list[Poses], list[str]]:
    try:
        with open_file(path) as data:
            own = data.attrs.get("mantaray_record") == Trajectories.kind
        if own:
            return poses_of_record(Trajectories.load(path), str(path)), []
    except (OceanError, RecordError) as error:
        raise ExchangeError(str(error)) from None
    return read_cf(path)


_READERS = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".parquet"), read_table),
    ".nc": _read_netcdf,
    **dict.fromkeys((".bag", ".mcap", ".db3"), read_bag),
}
