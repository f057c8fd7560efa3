"""
Folders for results, which are written atomically.

A stage (temporary folder) is locked as long as its process runs. This distinguishes leftovers of
killed processes from active stages.
"""

import datetime as dt
import fcntl
import json
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

from pymantaray.errors import JobError
from pymantaray.records import whole_file

MANIFEST = "manifest.json"
RUNS = Path("runs")
_REMEDY = "select another folder with `out`"
_PART = ".mantaray-part"


@contextmanager
def staged_folder(
    out: str | Path | None, name: str = "", *, latest: bool = True
) -> Iterator[tuple[Path, Path]]:
    """
    Create a temporary folder for results, which is moved to its final place if the block succeeds.

    On any exception, including Ctrl-C, the folder and any created parents are removed. Leftovers of
    a killed process are removed by the next process that writes there.

    Parameters
    ----------
    out : str or pathlib.Path, optional
        Final place: a new or empty folder, which may be a link or a mount point. Default:
        ``runs/<name>-<YYYYmmdd-HHMMSS>`` in the working folder, with a number if that exists.
    name : str
        Name for the default.
    latest : bool
        If True, ``runs/latest`` then points to the folder.

    Yields
    ------
    stage, folder : pathlib.Path
        Temporary folder and final place.

    Raises
    ------
    JobError
        If ``out`` is a file, a folder that is not empty or in use by another process, if it is not
        writable, or if the temporary folder is removed during the block.
    """
    missing: list[Path] = []
    try:
        folder, stage, lock = _reserve(out, name, missing)
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        _remove_empty(missing)
        cause = getattr(error, "strerror", None) or error
        raise JobError(f"{out or RUNS}: cannot be written: {cause}; {_REMEDY}") from None
    try:
        yield stage, folder
        _publish(stage, folder)
    except BaseException as error:
        is_missing = not stage.is_dir()
        shutil.rmtree(stage, ignore_errors=True)
        _remove_empty(missing)
        if is_missing and isinstance(error, Exception):
            raise JobError(
                f"{stage}: this folder was removed during the job; run the job again"
            ) from None
        raise
    finally:
        if lock is not None:
            os.close(lock)
    if out is None and latest:
        _point_latest_at(folder)


@contextmanager
def staged_parts(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """
    Create a temporary folder for parts of a finished run.

    The parts replace the existing ones if the block succeeds.

    On any exception, including Ctrl-C, all existing parts are unchanged. Parts are moved in the
    order of ``names``; the last marks the run as complete.

    Raises
    ------
    JobError
        If the folder is not writable.
    """
    stage = folder / f".{secrets.token_hex(8)}{_PART}"
    try:
        with _exclusive(folder):
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


def _reserve(
    out: str | Path | None, name: str, missing: list[Path]
) -> tuple[Path, Path, int | None]:
    """Create a stage for a final folder and lock it; two processes never get the same."""
    for folder in _names(name) if out is None else [Path(os.path.realpath(out))]:
        if any("\ud800" <= letter <= "\udfff" for letter in str(folder)):
            raise JobError(f"{str(out)!r}: not a name in UTF-8; {_REMEDY}")
        # a stage lies in an existing folder, which may be a mount point, else beside the new one
        parent = folder if folder.is_dir() else folder.parent
        missing[:] = [path for path in (parent, *parent.parents) if not path.exists()]
        parent.mkdir(parents=True, exist_ok=True)
        with _exclusive(parent):
            if folder.is_dir() and any(
                not entry.name.endswith(_PART) for entry in folder.iterdir()
            ):
                if out is None:
                    continue
                raise JobError(f"{folder}: folder is not empty; give a new or empty folder")
            if folder.exists() and not folder.is_dir():
                raise JobError(f"{folder}: is a file; give a new or empty folder")
            stage = parent / f".{folder.name}{_PART}"
            if not stage.exists():
                stage.mkdir()
                return folder, stage, _lock(stage)
            if out is not None:
                raise JobError(
                    f"{folder}: another process writes here; if none does, remove {stage}"
                )
    raise AssertionError("names never end")


def _names(name: str) -> Iterator[Path]:
    stamp = dt.datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    yield RUNS.absolute() / f"{name}-{stamp}"
    yield from (RUNS.absolute() / f"{name}-{stamp}-{n}" for n in count(2))


def _lock(folder: Path, *, wait: bool = False) -> int | None:
    """Lock a folder until the descriptor is closed; None if that is impossible."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


@contextmanager
def _exclusive(folder: Path) -> Iterator[None]:
    """
    Exclude other processes from creating a stage in a folder.

    Stages of killed processes are removed.
    """
    lock = _lock(folder, wait=True)
    try:
        for stage in folder.glob(f".*{_PART}"):
            with suppress(OSError):  # its process has just moved it
                stage_lock = _lock(stage)
                if stage_lock is not None:
                    shutil.rmtree(stage, ignore_errors=True)
                    os.close(stage_lock)
        yield
    finally:
        if lock is not None:
            os.close(lock)


def _publish(stage: Path, folder: Path) -> None:
    """
    Move a stage to its final place.

    In an existing folder, the manifest is moved last and completes the run.
    """
    targets: list[Path] = []
    try:
        if stage.parent != folder:
            stage.replace(folder)
            return
        for entry in sorted(stage.iterdir(), key=lambda entry: entry.name == MANIFEST):
            targets.append(entry.rename(folder / entry.name))
        stage.rmdir()
    except BaseException as error:
        for entry in targets:
            entry.rename(stage / entry.name)
        if isinstance(error, OSError) and stage.is_dir():
            raise JobError(f"{folder}: cannot be written: {error.strerror}; {_REMEDY}") from None
        raise


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _point_latest_at(run: Path) -> None:
    link = run.parent / "latest"
    temporary = run.parent / f".latest.{secrets.token_hex(8)}"
    if link.exists() and not link.is_symlink():
        return
    with suppress(OSError):  # the disk may not support links
        temporary.symlink_to(run.name)
        temporary.replace(link)


def write_json(content: dict[str, Any], path: Path) -> None:
    """Write a dictionary as indented JSON, with numpy scalars as numbers."""
    with whole_file(path) as temporary:
        temporary.write_text(
            json.dumps(content, indent=2, default=lambda scalar: scalar.item()) + "\n",
            encoding="utf-8",
        )
