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
from pymantaray.jobs.store import Store, read_valid
from pymantaray.records import whole_file

_LOG = logging.getLogger("pymantaray.jobs")
_SAVE_INTERVAL = 30.0  # shorter jobs save nothing [s]
_STAGE = "mission"  # names from earlier versions
_CHECKSUMS = "mission.json"
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
        self._noun, self._key, self._latest = noun, "", time.monotonic()
        self._kept: set[int] = set()

    @property
    def exists(self) -> bool:
        """True if an earlier call saved something."""
        return self._folder is not None and self._folder.is_dir()

    def use(self, key: str) -> None:
        """Set the key of the job: a hash of everything that its results depend on."""
        self._key = key

    def restore(self, stage: Path) -> bool:
        """
        Copy the files of the first stage into a folder; False if there are none or they are
        damaged, then they are removed.
        """
        if not self.exists or not (self._own / _STAGE).is_dir():
            return False
        if not self._stage_is_complete():
            line = "damaged: wrong checksums; removed and computed again"
            _LOG.warning("%s: %s", self._own, line)
            shutil.rmtree(self._own, ignore_errors=True)
            return False
        _link(self._own / _STAGE, stage)
        return True

    def results(self, count: int, parse: Callable[[bytes], ResultT]) -> dict[int, ResultT]:
        """Results of the tasks 0 to count - 1 that an earlier call finished."""
        if self._folder is None:
            return {}
        store = Store(str(self._own))
        results = {}
        for number in range(count):
            result = read_valid(store, f"{number}.nc", parse)
            if result is not None:
                results[number] = result
        self._kept = set(results)
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
        Save the files in a stage and the results if the block raises, and on calls of the yielded
        function.

        The function saves at most once per interval.
        """
        names = sorted(path.name for path in stage.iterdir() if path.is_file())

        def look() -> None:
            if self._folder is not None and time.monotonic() - self._latest >= _SAVE_INTERVAL:
                self._save(stage, names, results, content)
                self._latest = time.monotonic()

        begun = self._latest
        try:
            look()
            yield look
        except BaseException:
            if self._folder is not None and time.monotonic() - begun >= _SAVE_INTERVAL:
                try:
                    self._save(stage, names, results, content)
                except WriteError as error:
                    _LOG.warning("not all results could be saved: %s", error)
                if self._kept:
                    _LOG.warning(
                        "%d %s are saved in %s; the same call resumes",
                        len(self._kept),
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
    def _own(self) -> Path:
        assert self._folder is not None  # callers check this
        return self._folder / self._key

    def _save(
        self,
        stage: Path,
        names: list[str],
        results: Mapping[int, Any],
        content: Callable[[Any], bytes],
    ) -> None:
        if not (self._own / _STAGE).is_dir():
            self.clear()  # checkpoint of another key
            part = self._own / f"{_STAGE}.part"
            try:
                part.mkdir(parents=True)
                _link(stage, part, names)
                with whole_file(self._own / _CHECKSUMS) as temporary:
                    temporary.write_text(json.dumps(_checksums(part)), encoding="utf-8")
                part.rename(self._own / _STAGE)
            except OSError as error:
                raise WriteError(f"{self._own}: cannot be written: {error.strerror}") from None
        store = Store(str(self._own))
        for number in sorted(results.keys() - self._kept):
            store.write(f"{number}.nc", content(results[number]))
            self._kept.add(number)

    def _stage_is_complete(self) -> bool:
        try:
            return bool(
                json.loads((self._own / _CHECKSUMS).read_bytes()) == _checksums(self._own / _STAGE)
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
