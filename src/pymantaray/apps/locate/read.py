"""Reader of surveys, which detects the format; options supply missing data."""

from pathlib import Path

from pymantaray.apps.locate.read_garpos import read_garpos
from pymantaray.apps.locate.read_gnatss import read_gnatss
from pymantaray.apps.locate.read_obsrange import is_obsrange, read_obsrange
from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.read_table import read_table
from pymantaray.apps.locate.survey import Survey
from pymantaray.errors import LocateError, RecordError
from pymantaray.user_files import check_regular, first_bytes


def read_survey(path: str | Path, options: ReadOptions | None = None) -> Survey:
    """
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
    """
    path = Path(path)
    selected = options or ReadOptions()
    check_regular(path, LocateError, what="the survey's file, for GARPOS its ini file")
    try:
        if path.suffix.lower() in (".yaml", ".yml"):
            return read_gnatss(path, selected)
        if path.suffix.lower() == ".ini" or _has_sections(path):
            return read_garpos(path, selected)
        if is_obsrange(path):
            return read_obsrange(path, selected)
        return read_table(path, selected)
    except RecordError as error:
        raise LocateError(str(error)) from None


def _has_sections(path: Path) -> bool:
    """True if a file has sections, as files of GARPOS with any suffix."""
    return b"[Site-parameter]" in first_bytes(path, 8192)
