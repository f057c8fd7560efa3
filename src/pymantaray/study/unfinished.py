"""What a study that is interrupted leaves beside its folder, so that the same call goes on with it."""

import hashlib
import json
import logging
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from pymantaray.config.load import study_toml
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import RecordError, WriteError
from pymantaray.installation import code_version
from pymantaray.jobs.keys import sha256
from pymantaray.records import whole_file
from pymantaray.study.manifest import checksums
from pymantaray.study.realization import Solved

_LOG = logging.getLogger("pymantaray.study")
_EVERY = 30.0  # between two times at which what is done is kept; shorter studies leave nothing [s]
_MISSION, _SUMS = "mission", "mission.json"


class Unfinished:
    """
    Mission and realizations of a study that was interrupted: a folder beside that of its results, for one configuration.

    Its name is that folder's with ``.unfinished``, and in it is one of the hash of configuration, input files and code. Nothing
    is kept of a study whose folder nobody named, since a second call would not have the same.
    """

    def __init__(self, folder: Path | None, config: StudyConfig) -> None:
        self._place = None if folder is None else folder.with_name(f"{folder.name}.unfinished")
        self._config, self._latest = config, time.monotonic()
        self._there: set[int] = set()

    def restore(self, stage: Path) -> dict[str, str] | None:
        """Put the files of a mission that is there into a stage; the checksums of its input, None if there is none."""
        if self._place is None or not self._place.is_dir():
            return None
        inputs = checksums(self._config)
        own = self._own(inputs)
        if not (own / _MISSION).is_dir():
            return None
        if not _is_whole(own):
            _LOG.warning(
                "%s: damaged: files do not have their checksums; it is removed and computed again", own
            )
            shutil.rmtree(own, ignore_errors=True)
            return None
        _link(own / _MISSION, stage)
        return inputs

    def solved(self, inputs: Mapping[str, str]) -> dict[int, Solved]:
        """Realizations that are there, by their numbers."""
        if self._place is None:
            return {}
        there = {}
        for number in range(self._config.study.realizations):
            path = self._own(inputs) / f"{number}.nc"
            try:
                there[number] = Solved.from_bytes(path.read_bytes())
            except FileNotFoundError:
                continue
            except (OSError, RecordError) as error:
                _LOG.warning("%s: %s; it is removed and computed again", path, error)
                path.unlink(missing_ok=True)
        self._there = set(there)
        if there:
            _LOG.warning("going on with %d realizations of an interrupted run, %s", len(there), self._place)
        return there

    @contextmanager
    def keeping(
        self, stage: Path, inputs: Mapping[str, str], solved: Mapping[int, Solved]
    ) -> Iterator[Callable[[], None]]:
        """Keep the mission in a stage and realizations as they are solved, now and then and when something ends the block."""
        names = sorted(path.name for path in stage.iterdir() if path.is_file())

        def look() -> None:
            if self._place is not None and time.monotonic() - self._latest >= _EVERY:
                self._keep(stage, names, self._own(inputs), solved)
                self._latest = time.monotonic()

        begun = self._latest
        try:
            look()
            yield look
        except BaseException:
            if self._place is not None and time.monotonic() - begun >= _EVERY:
                try:
                    self._keep(stage, names, self._own(inputs), solved)
                except WriteError as error:
                    _LOG.warning("what is done could not be kept whole: %s", error)
                if self._there:
                    _LOG.warning(
                        "%d realizations are kept in %s; the same call goes on", len(self._there), self._place
                    )
            raise

    def clear(self) -> None:
        """Remove what was kept, the study being done."""
        if self._place is None or not self._place.is_dir():
            return
        for folder in self._place.iterdir():  # it may hold something of the user's, too
            if re.fullmatch(r"[0-9a-f]{64}", folder.name):
                shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            self._place.rmdir()

    def _own(self, inputs: Mapping[str, str]) -> Path:
        assert self._place is not None  # asked only then
        what = [study_toml(self._config), dict(inputs), code_version()]
        return self._place / hashlib.sha256(json.dumps(what).encode()).hexdigest()

    def _keep(self, stage: Path, names: list[str], own: Path, solved: Mapping[int, Solved]) -> None:
        if not (own / _MISSION).is_dir():
            self.clear()  # of another configuration
            part = own / f"{_MISSION}.part"
            try:
                part.mkdir(parents=True)
                _link(stage, part, names)
                with whole_file(own / _SUMS) as temporary:
                    temporary.write_text(json.dumps(_sums(part)), encoding="utf-8")
                part.rename(own / _MISSION)
            except OSError as error:
                raise WriteError(f"{own}: cannot be written: {error.strerror}") from None
        for number in sorted(solved.keys() - self._there):
            with whole_file(own / f"{number}.nc") as temporary:
                temporary.write_bytes(solved[number].to_bytes())
            self._there.add(number)


def _is_whole(own: Path) -> bool:
    """True if the files of a mission are those that were kept."""
    try:
        return bool(json.loads((own / _SUMS).read_bytes()) == _sums(own / _MISSION))
    except (OSError, ValueError, RecursionError):
        return False


def _sums(folder: Path) -> dict[str, str]:
    return {path.name: sha256(path) for path in sorted(folder.iterdir())}


def _link(source: Path, target: Path, names: list[str] | None = None) -> None:
    """Have files in another folder, too, as links to the same content where the disk knows such."""
    for name in names or [path.name for path in source.iterdir()]:
        try:
            os.link(source / name, target / name)
        except OSError:
            shutil.copyfile(source / name, target / name)
