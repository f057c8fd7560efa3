"""What a study that is interrupted leaves beside its folder, so that the same call goes on with it."""

import hashlib
import json
import logging
import os
import pickle
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pymantaray
from pymantaray.config.sections import StudyConfig
from pymantaray.config.text import study_toml
from pymantaray.errors import WriteError
from pymantaray.records import whole_file
from pymantaray.study.manifest import checksums, git_commit
from pymantaray.study.realization import Solved

_LOG = logging.getLogger("pymantaray.study")
_EVERY = 30.0  # between two times at which what is done is kept; shorter studies leave nothing [s]
_MISSION = "mission"


class Unfinished:
    """
    Mission and realizations of a study that was interrupted: a folder beside that of its results, for one configuration.

    Its name is that folder's with ``.unfinished``, and in it is one of the hash of configuration, input files, version and commit. Nothing
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
        mission = self._own(inputs) / _MISSION
        if not mission.is_dir():
            return None
        _link(mission, stage)
        return inputs

    def solved(self, inputs: Mapping[str, str]) -> dict[int, Solved]:
        """Realizations that are there, by their numbers."""
        if self._place is None:
            return {}
        files = {int(path.stem): path for path in self._own(inputs).glob("*.pickle")}
        self._there = set(files)
        if files:
            _LOG.warning("going on with %d realizations of an interrupted run, %s", len(files), self._place)
        return {number: pickle.loads(path.read_bytes()) for number, path in sorted(files.items())}

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
        if self._place is not None:
            shutil.rmtree(self._place, ignore_errors=True)

    def _own(self, inputs: Mapping[str, str]) -> Path:
        assert self._place is not None  # asked only then
        what = [study_toml(self._config), dict(inputs), pymantaray.__version__, git_commit()]
        return self._place / hashlib.sha256(json.dumps(what).encode()).hexdigest()

    def _keep(self, stage: Path, names: list[str], own: Path, solved: Mapping[int, Solved]) -> None:
        if not (own / _MISSION).is_dir():
            self.clear()  # of another configuration
            part = own / f"{_MISSION}.part"
            try:
                part.mkdir(parents=True)
                _link(stage, part, names)
                part.rename(own / _MISSION)
            except OSError as error:
                raise WriteError(f"{own}: cannot be written: {error.strerror}") from None
        for number in sorted(solved.keys() - self._there):
            with whole_file(own / f"{number}.pickle") as temporary:
                temporary.write_bytes(pickle.dumps(solved[number]))
            self._there.add(number)


def _link(source: Path, target: Path, names: list[str] | None = None) -> None:
    """Have files in another folder, too, as links to the same content where the disk knows such."""
    for name in names or [path.name for path in source.iterdir()]:
        try:
            os.link(source / name, target / name)
        except OSError:
            shutil.copyfile(source / name, target / name)
