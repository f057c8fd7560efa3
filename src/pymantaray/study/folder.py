"""The folder a run is written into: whole or not at all."""

import datetime as dt
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pymantaray.errors import StudyError

RUNS = Path("runs")


def default_out(name: str) -> Path:
    """
    Dated folder for a run of a study that was given none.

    Parameters
    ----------
    name : str
        Name of the study.

    Returns
    -------
    pathlib.Path
        ``runs/<name>-<YYYYmmdd-HHMMSS>`` in the working folder, with a number where that is taken.
    """
    stamp = dt.datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    candidate, n = RUNS / f"{name}-{stamp}", 1
    while candidate.exists():
        n += 1
        candidate = RUNS / f"{name}-{stamp}-{n}"
    return candidate


@contextmanager
def staged_folder(out: Path) -> Iterator[Path]:
    """
    Folder to write a run into; takes its final name only if the block ends well.

    On any exception, Ctrl-C included, it is removed, and so are the parents made for it.

    Parameters
    ----------
    out : pathlib.Path
        Final name. May exist if it is an empty folder.

    Yields
    ------
    pathlib.Path
        Temporary folder beside ``out``.

    Raises
    ------
    StudyError
        If ``out`` is a file or a folder with something in it, or nothing can be written there.
    """
    _require_free(out)
    out = out.absolute()
    made = [parent for parent in out.parents if not parent.exists()]
    stage = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        stage.mkdir(parents=True)
    except OSError as error:
        _remove_empty(made)
        raise StudyError(f"{out}: cannot be written: {error.strerror}; choose another with --out") from None
    try:
        yield stage
        _require_free(out)
        stage.replace(out)
    except BaseException:
        shutil.rmtree(stage, ignore_errors=True)
        _remove_empty(made)
        raise


def point_latest_at(run: Path) -> None:
    """
    Make ``latest`` beside a run point at it.

    Parameters
    ----------
    run : pathlib.Path
        Folder of a finished run.
    """
    link = run.parent / "latest"
    if link.exists() and not link.is_symlink():
        return
    temporary = run.parent / f".latest.{os.getpid()}"
    temporary.unlink(missing_ok=True)
    temporary.symlink_to(run.name)
    temporary.replace(link)


def _require_free(out: Path) -> None:
    if out.is_dir():
        if any(out.iterdir()):
            raise StudyError(f"{out}: folder is not empty; give an empty or a new one")
    elif out.exists():
        raise StudyError(f"{out}: is a file; give an empty or a new folder")


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
