"""
Reader of trajectories, which selects the format by the suffix of the file, and of text by its first
lines.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from pymantaray.errors import ExchangeError, OceanError, RecordError, errors_as
from pymantaray.exchange.centre import centre_beside
from pymantaray.exchange.cf import read_cf
from pymantaray.exchange.euroc import HEADER, read_euroc
from pymantaray.exchange.frames import swap_enu, swap_enu_attitude
from pymantaray.exchange.kitti import read_kitti
from pymantaray.exchange.rosbag import read_bag
from pymantaray.exchange.surface import NMEA, read_gpx, read_nmea
from pymantaray.exchange.table import read_frame, read_table
from pymantaray.exchange.tracks import Poses, Tracks, poses_of_record, same_vehicle_notes
from pymantaray.exchange.tum import read_tum
from pymantaray.ocean.files import open_file
from pymantaray.quantities.checks import parsed_number
from pymantaray.records import Trajectories
from pymantaray.records.digits import counted
from pymantaray.user_files import check_there, first_bytes, matching_files, shown

Source = str | Path | Sequence[str | Path] | pd.DataFrame
Reader = Callable[[Path], tuple[list[Poses], Sequence[str]]]


def read_trajectories(source: Source, *, enu: bool = False, names: Sequence[str] = ()) -> Tracks:
    r"""
    Read trajectories from one or more files of any supported format, or from a data frame.

    Parameters
    ----------
    source : str, pathlib.Path, sequence of them, or pandas.DataFrame
        A data frame has the columns of a table. Files or patterns with ``*``. The suffix selects
        the format: tables (``.csv``, ``.tsv``, ``.txt``, ``.parquet``), TUM files with one vehicle
        each (``.tum``, ``.txt``), EuRoC files (``.csv``), KITTI files with times beside them
        (``.txt``), CF trajectories or a study's ``truth.nc`` (``.nc``), ROS bags (``.bag``,
        ``.mcap``, ``.db3`` or their folder); of surface vehicles GPX (``.gpx``) and NMEA 0183
        (``.nmea``, ``.log``, ``.raw``, ``.txt``).
    enu : bool
        True if TUM, EuRoC and KITTI files use ROS's axes: world east, north, up; body forward,
        left, up.
    names : sequence of str
        Vehicles to use, such as one of two topics of a robot in a bag. Default: all.

    Returns
    -------
    Tracks
        Names, time spans, dates and notes; `Tracks.at` gives poses at common times.

    Raises
    ------
    ExchangeError
        If a file is unreadable, lacks data of a trajectory, or does not match the other files.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray import read_trajectories
    >>> rows = ["time,vehicle,north,east,depth", "0,A,0,0,20", "60,A,30,0,20"]
    >>> _ = Path("mission.csv").write_text("\n".join(rows))
    >>> tracks = read_trajectories("mission.csv")
    >>> print([one.name for one in tracks.poses], tracks.poses[0].place.shape)
    ['A'] (2, 3)
    """
    if isinstance(source, pd.DataFrame):
        return Tracks.of(*read_frame(source)).selected(names)
    paths = files_of(source)
    poses: list[Poses] = []
    notes: list[str] = []
    for path in paths:
        kind = _format(path)
        own, own_notes = _READERS[kind](path)
        notes += own_notes
        for p in own:
            if p.centre is None:
                p = p._replace(centre=centre_beside(path))
            if enu and kind in _TEXTS and p.quaternion is not None:
                p = p._replace(place=swap_enu(p.place), quaternion=swap_enu_attitude(p.quaternion))
            poses.append(p)
    tracks = Tracks.of(poses, notes).selected(names)
    return replace(tracks, notes=(*tracks.notes, *same_vehicle_notes(tracks)))


def files_of(source: str | Path | Sequence[str | Path]) -> list[Path]:
    """Files of a source; those of a pattern are sorted."""
    paths: list[Path] = []
    for one in [source] if isinstance(source, str | Path) else source:
        found = matching_files(str(one), Path(), ExchangeError) if "*" in str(one) else [Path(one)]
        if not found:
            raise ExchangeError(f"{shown(one)}: no file matches this pattern")
        for path in found:
            check_there(path, ExchangeError)
        paths += found
    if not paths:
        raise ExchangeError("trajectories: no file; name at least one")
    return paths


def _format(path: Path) -> str:
    """Format of a file by its suffix, and of a text file by its first lines."""
    suffix = ".bag" if path.is_dir() else path.suffix.lower()
    if suffix not in _FORMATS:
        raise ExchangeError(
            f"{path}: unknown format of trajectories; allowed: {', '.join(sorted(_FORMATS))}"
        )
    if suffix not in (".csv", ".tsv", ".txt"):
        return _FORMATS[suffix]
    lines = first_bytes(path, _HEAD).decode("utf-8", "replace").splitlines()
    if any(map(HEADER.match, lines)):
        return "euroc"
    if any(map(NMEA.match, lines)):
        return "nmea"
    first = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")
    cells = re.split(r"[\s,;]+", first.strip(" \t,;"))
    try:
        _ = [parsed_number(cell) for cell in cells]
    except ValueError:
        return "table"
    if len(cells) not in _NUMBERS:
        raise ExchangeError(
            f"{path}: {counted(len(cells), 'number')} per row and no header; a table needs names of"
            " columns, TUM text has 8 numbers per row, KITTI text 12"
        )
    return _NUMBERS[len(cells)]


@errors_as(ExchangeError, OceanError, RecordError)
def _read_netcdf(path: Path) -> tuple[list[Poses], list[str]]:
    with open_file(path) as data:
        own = data.attrs.get("mantaray_record") == Trajectories.kind
    return (poses_of_record(Trajectories.load(path), str(path)), []) if own else read_cf(path)


_FORMATS = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".parquet"), "table"),
    **dict.fromkeys((".bag", ".mcap", ".db3"), "bag"),
    **dict.fromkeys((".nmea", ".log", ".raw"), "nmea"),
    ".gpx": "gpx",
    ".nc": "netcdf",
    ".tum": "tum",
}
_TEXTS: dict[str, Reader] = {"tum": read_tum, "euroc": read_euroc, "kitti": read_kitti}
_READERS: dict[str, Reader] = {
    **_TEXTS,
    "table": read_table,
    "bag": read_bag,
    "gpx": read_gpx,
    "nmea": read_nmea,
    "netcdf": _read_netcdf,
}
_NUMBERS = {8: "tum", 12: "kitti"}
"""Format of a text without header by the count of numbers in a row."""
_HEAD = 65_536  # bytes
