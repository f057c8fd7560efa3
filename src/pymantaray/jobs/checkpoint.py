"""Checkpoint of an interrupted job beside its folder, from which the same call resumes."""

import json
import logging
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from pymantaray.errors import WriteError
from pymantaray.jobs.keys import sha256
from pymantaray.jobs.store import Store, read_sealed, write_sealed
from pymantaray.records import whole_file

_LOG = logging.getLogger("pymantaray.jobs")
_SAVE_INTERVAL = 30.0  # shorter jobs save nothing [s]
_STAGE = "stage"
_CHECKSUMS = "stage.json"
ResultT = TypeVar("ResultT")


class Checkpoint:
    """
    Folder ``NAME.unfinished`` beside the folder of a job's results.

    It has a subfolder named by the job's key, with the files from the first stage of the job and a
    file for each finished numbered task. Jobs without a named folder have no checkpoint, because a
    second call would use another folder.

    Parameters
    ----------
    folder : pathlib.Path or None
        Folder of the results.
    noun : str
        Plural noun for the tasks, for messages.
    """

    def __init__(self, folder: Path | None, noun: str) -> None:
        self._folder = None if folder is None else folder.with_name(f"{folder.name}.unfinished")
        self._noun = noun
        self._key = ""
        self._latest = time.monotonic()
        self._saved: set[int] = set()
        """Numbers of the tasks whose results are saved."""

    @property
    def exists(self) -> bool:
        """True if an earlier call saved something."""
        return self._folder is not None and self._folder.is_dir()

    def use(self, key: str) -> None:
        """Set the key of the job: a hash of everything that its results depend on."""
        self._key = key

    def restore(self, stage: Path) -> bool:
        """
        Copy the files of the first stage into a folder; False if there are none.

        Damaged files are removed, and the result is False.
        """
        if not self.exists or not (self._job_folder / _STAGE).is_dir():
            return False
        if not self._stage_is_complete():
            _LOG.warning(
                "%s: damaged: wrong checksums; removed and computed again", self._job_folder
            )
            shutil.rmtree(self._job_folder, ignore_errors=True)
            return False
        _link(self._job_folder / _STAGE, stage)
        return True

    def results(self, count: int, parse: Callable[[bytes], ResultT]) -> dict[int, ResultT]:
        """Results of the tasks 0 to count - 1 that an earlier call finished."""
        if self._folder is None:
            return {}
        store = Store(str(self._folder))
        results = {}
        for number in range(count):
            result = read_sealed(store, f"{self._key}/{number}.nc", parse)
            if result is not None:
                results[number] = result
        self._saved = set(results)
        if results:
            _LOG.warning(
                "resuming with %d %s of an interrupted run, %s",
                len(results),
                self._noun,
                self._folder,
            )
        return results

    @contextmanager
    def saving(
        self, stage: Path, results: Mapping[int, Any], content: Callable[[Any], bytes]
    ) -> Iterator[Callable[[], None]]:
        """
        Save the stage and the results if the block raises, or if the yielded function is called.

        The function saves at most once per interval.
        """
        names = sorted(path.name for path in stage.iterdir() if path.is_file())

        def save_if_due() -> None:
            if self._folder is not None and time.monotonic() - self._latest >= _SAVE_INTERVAL:
                self._save(stage, names, results, content)
                self._latest = time.monotonic()

        start_time = self._latest
        try:
            save_if_due()
            yield save_if_due
        except BaseException:
            if self._folder is not None and time.monotonic() - start_time >= _SAVE_INTERVAL:
                try:
                    self._save(stage, names, results, content)
                except WriteError as error:
                    _LOG.warning("not all results could be saved: %s", error)
                if self._saved:
                    _LOG.warning(
                        "%d %s are saved in %s; the same call resumes",
                        len(self._saved),
                        self._noun,
                        self._folder,
                    )
            raise

    def clear(self) -> None:
        """Remove the checkpoint; other files in the folder stay."""
        if self._folder is None or not self._folder.is_dir():
            return
        for folder in self._folder.iterdir():
            if re.fullmatch(r"[0-9a-f]{64}", folder.name):
                shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            self._folder.rmdir()

    @property
    def _job_folder(self) -> Path:
        assert self._folder is not None  # callers check this
        return self._folder / self._key

    def _save(
        self,
        stage: Path,
        names: list[str],
        results: Mapping[int, Any],
        content: Callable[[Any], bytes],
    ) -> None:
        if not (self._job_folder / _STAGE).is_dir():
            self.clear()  # checkpoint of another key
            part = self._job_folder / f"{_STAGE}.part"
            try:
                part.mkdir(parents=True)
                _link(stage, part, names)
                with whole_file(self._job_folder / _CHECKSUMS) as temporary:
                    temporary.write_text(json.dumps(_checksums(part)), encoding="utf-8")
                part.rename(self._job_folder / _STAGE)
            except OSError as error:
                raise WriteError(
                    f"{self._job_folder}: cannot be written: {error.strerror}"
                ) from None
        store = Store(str(self._folder))
        for number in sorted(results.keys() - self._saved):
            write_sealed(store, f"{self._key}/{number}.nc", content(results[number]))
            self._saved.add(number)

    def _stage_is_complete(self) -> bool:
        try:
            return bool(
                json.loads((self._job_folder / _CHECKSUMS).read_bytes())
                == _checksums(self._job_folder / _STAGE)
            )
        except (OSError, ValueError, RecursionError):
            return False


def _checksums(folder: Path) -> dict[str, str]:
    return {path.name: sha256(path) for path in sorted(folder.iterdir())}


def _link(source: Path, target: Path, names: list[str] | None = None) -> None:
    """Link files into another folder, or copy them if the disk does not support links."""
    for name in names or [path.name for path in source.iterdir()]:
        try:
            os.link(source / name, target / name)
        except OSError:
            shutil.copyfile(source / name, target / name)
