"""Reader of surveys, which detects the format; options supply missing data."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pymantaray.apps.locate.read_garpos import read_garpos
from pymantaray.apps.locate.read_gnatss import read_gnatss
from pymantaray.apps.locate.read_obsrange import is_obsrange, read_obsrange
from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.read_table import read_table
from pymantaray.apps.locate.survey import Survey
from pymantaray.errors import LocateError, RecordError
from pymantaray.records.position_rows import order_of_times, repeated_note, repeated_rows
from pymantaray.user_files import check_regular, first_bytes


def read_survey(path: str | Path, options: ReadOptions | None = None) -> Survey:
    r"""
    Read a survey.

    Parameters
    ----------
    path : str or pathlib.Path
        A table (columns ``time``, ``node``, ``two_way_time_s`` and positions), survey text of
        OBSrange in both formats, the ini file of GARPOS, or the ``config.yaml`` of GNATSS. The
        latter two name further files.
    options : ReadOptions, optional
        Data that the file does not contain: prior positions, a track, transducer depth and so on.

    Returns
    -------
    Survey

    Raises
    ------
    LocateError
        If a file is missing or a line is invalid.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.apps.locate import ReadOptions, read_survey
    >>> rows = [f"{60 * i},M1,{1.8 + 0.001 * i},{100 * i},0" for i in range(8)]
    >>> lines = ["time,node,two_way_time_s,north_m,east_m", *rows]
    >>> _ = Path("pings.csv").write_text("\n".join(lines))
    >>> survey = read_survey("pings.csv", ReadOptions(depth=1300.0))
    >>> survey.time.size
    8
    """
    path = Path(path)
    selected = options or ReadOptions()
    check_regular(path, LocateError, what="the survey's file, for GARPOS its ini file")
    try:
        return _each_ping_once(_reader(path)(path, selected))
    except RecordError as error:
        raise LocateError(str(error)) from None


def _reader(path: Path) -> Callable[[Path, ReadOptions], Survey]:
    """Reader of the format of a file; files of GARPOS may have any suffix."""
    if path.suffix.lower() in (".yaml", ".yml"):
        return read_gnatss
    if path.suffix.lower() == ".ini" or b"[Site-parameter]" in first_bytes(path, 8192):
        return read_garpos
    return read_obsrange if is_obsrange(path) else read_table


def _each_ping_once(survey: Survey) -> Survey:
    """Survey in order of time with each ping once, and notes about it."""
    notes = list(survey.notes)
    keys = survey.time, survey.node, survey.partner, survey.direction, survey.travel_time
    repeated = repeated_rows(keys)
    if repeated.any():
        notes.append(repeated_note(survey.source, survey.line[repeated].tolist()))
        survey = survey.rows(np.flatnonzero(~repeated))
    dated = not np.isnat(survey.epoch)
    order, note = order_of_times(survey.time, survey.where, LocateError, dated=dated, blocks=True)
    if order is not None and note is not None:
        notes.append(note)
        survey = survey.rows(order)
    return survey.assign(notes=tuple(notes))
