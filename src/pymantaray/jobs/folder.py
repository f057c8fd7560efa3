"""
Folders that results are written into, whole or not at all.

A stage is locked as long as the process that writes it lives, so that what a killed process has left behind
is told from what is being written.
"""

import datetime as dt
import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from pymantaray.errors import JobError

MANIFEST = "manifest.json"
RUNS = Path("runs")
_PART = ".mantaray-part"


@contextmanager
def staged_folder(
    out: str | Path | None, name: str = "", *, latest: bool = True
) -> Iterator[tuple[Path, Path]]:
    """
    Folder to write results into, which take their final place only if the block ends well.

    On any exception, Ctrl-C included, it is removed, and so are the parents made for it. What a process that
    was killed has left behind is removed by the next one that writes there.

    Parameters
    ----------
    out : str or pathlib.Path, optional
        Final place: new, or an empty folder, which may be a link or a mount point. By default
        ``runs/<name>-<YYYYmmdd-HHMMSS>`` in the working folder, with a number where that is taken.
    name : str
    latest : bool
        Whether ``runs/latest`` then points to it.

    Yields
    ------
    stage, folder : pathlib.Path
        Where to write, and the final place.

    Raises
    ------
    JobError
        If ``out`` is a file, a folder with something in it or being written by another process, if nothing
        can be written there, or if the folder is removed meanwhile.
    """
    missing: list[Path] = []
    try:
        folder, stage, lock = _reserve(out, name, missing)
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        _remove_empty(missing)
        cause = getattr(error, "strerror", None) or error
        raise JobError(f"{out or RUNS}: cannot be written: {cause}; choose another with --out") from None
    try:
        yield stage, folder
        _publish(stage, folder)
    except BaseException as error:
        removed = not stage.is_dir()
        shutil.rmtree(stage, ignore_errors=True)
        _remove_empty(missing)
        if removed and isinstance(error, Exception):
            raise JobError(f"{stage}: was removed while the results were written there") from None
        raise
    finally:
        if lock is not None:
            os.close(lock)
    if out is None and latest:
        _point_latest_at(folder)


@contextmanager
def staged_parts(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """
    Folder to write parts of a finished run into, which replace those of its names if the block ends well.

    On any exception, Ctrl-C included, they are all as they were. ``names`` are in the order in which they are
    put in place; the last says that all are there.

    Raises
    ------
    JobError
        If nothing can be written there.
    """
    stage = folder / f".{secrets.token_hex(8)}{_PART}"
    try:
        with _alone(folder):
            stage.mkdir()
            lock = _lock(stage)
    except OSError as error:
        raise JobError(f"{folder}: cannot be written: {error.strerror}") from None
    try:
        yield stage
        _exchange(stage, folder, names)
    except OSError as error:
        raise JobError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _exchange(stage: Path, folder: Path, names: Sequence[str]) -> None:
    before = stage / "before"
    before.mkdir()
    try:
        for name in reversed(names):
            if (folder / name).exists():
                (folder / name).rename(before / name)
        for name in names:
            (stage / name).rename(folder / name)
    except BaseException:
        for name in names:
            if (before / name).exists() or not (stage / name).exists():
                if (folder / name).exists():
                    (folder / name).rename(stage / name)
                if (before / name).exists():
                    (before / name).rename(folder / name)
        raise


def _reserve(out: str | Path | None, name: str, missing: list[Path]) -> tuple[Path, Path, int | None]:
    """Final folder, the stage made for it, and its lock; two processes never get the same."""
    for folder in _names(name) if out is None else [Path(os.path.realpath(out))]:
        if any("\ud800" <= c <= "\udfff" for c in str(folder)):
            raise JobError(f"{str(out)!r}: not a name in UTF-8; choose another with --out")
        where = folder if folder.is_dir() else folder.parent
        missing[:] = [parent for parent in (where, *where.parents) if not parent.exists()]
        where.mkdir(parents=True, exist_ok=True)
        with _alone(where):
            if folder.is_dir() and any(entry.name[-len(_PART) :] != _PART for entry in folder.iterdir()):
                if out is None:
                    continue
                raise JobError(f"{folder}: folder is not empty; give an empty or a new one")
            if folder.exists() and not folder.is_dir():
                raise JobError(f"{folder}: is a file; give an empty or a new folder")
            stage = where / f".{folder.name}{_PART}"
            if not stage.exists():
                stage.mkdir()
                return folder, stage, _lock(stage)
            if out is not None:
                raise JobError(f"{folder}: is being written by another process; if by none, remove {stage}")
    raise AssertionError("names never end")


def _names(name: str) -> Iterator[Path]:
    stamp = dt.datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    yield RUNS.absolute() / f"{name}-{stamp}"
    yield from (RUNS.absolute() / f"{name}-{stamp}-{n}" for n in count(2))


def _lock(folder: Path, *, wait: bool = False) -> int | None:
    """Lock a folder until this is closed or the process ends; None if another has it or it cannot be."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


@contextmanager
def _alone(where: Path) -> Iterator[None]:
    """While no other process makes a stage in a folder; stages that no living process writes are removed."""
    alone = _lock(where, wait=True)
    try:
        for stage in where.glob(f".*{_PART}"):
            with suppress(OSError):  # its writer has just moved it
                lock = _lock(stage)
                if lock is not None:
                    shutil.rmtree(stage, ignore_errors=True)
                    os.close(lock)
        yield
    finally:
        if alone is not None:
            os.close(alone)


def _publish(stage: Path, folder: Path) -> None:
    """Give a stage its final place; inside a folder that was there the manifest comes last and makes a run of it."""
    moved: list[Path] = []
    try:
        if stage.parent != folder:
            stage.replace(folder)
            return
        for entry in sorted(stage.iterdir(), key=lambda entry: entry.name == MANIFEST):
            moved.append(entry.rename(folder / entry.name))
        stage.rmdir()
    except BaseException as error:
        for entry in moved:
            entry.rename(stage / entry.name)
        if isinstance(error, OSError) and stage.is_dir():
            raise JobError(
                f"{folder}: cannot be written: {error.strerror}; choose another with --out"
            ) from None
        raise


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _point_latest_at(run: Path) -> None:
    link, temporary = run.parent / "latest", run.parent / f".latest.{secrets.token_hex(8)}"
    if link.exists() and not link.is_symlink():
        return
    with suppress(OSError):  # a disk without links has no latest one
        temporary.symlink_to(run.name)
        temporary.replace(link)
