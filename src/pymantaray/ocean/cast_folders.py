"""
Folders and ZIP archives with one or several casts per file, such as those of ice-tethered profilers
and of CCHDO.
"""

import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from pymantaray.errors import MantaRayError
from pymantaray.messages import one_line
from pymantaray.records.digits import counted
from pymantaray.user_files import MAX_BYTES, check_regular, exists, first_bytes

_ZARR = (".zgroup", ".zattrs", ".zmetadata", "zarr.json")
_MAX_FILES = 20_000
_MAX_UNPACKED = 2_000_000_000  # bytes of all files
ReadT = TypeVar("ReadT")


def is_cast_folder(path: str | Path) -> bool:
    """Return True for a ZIP archive, and for a folder that is not a Zarr store."""
    if exists(path) and Path(path).is_dir():
        return not any(exists(Path(path) / name) for name in _ZARR)
    return first_bytes(path, 4) == b"PK\x03\x04"


def read_each(
    path: Path, read: Callable[[Path], list[ReadT]], refusal: type[MantaRayError]
) -> tuple[list[ReadT], tuple[str, ...]]:
    """
    Results of a reader for each file of a folder or archive, and a note about files that it
    refuses.
    """
    results: list[ReadT] = []
    refused: list[str] = []
    with _files(path, refusal) as (files, folder):
        for file in files:
            try:
                results += read(file)
            except MantaRayError as error:
                refused.append(str(error).removeprefix(f"{folder}/"))
    if not results:
        cause = f"; {one_line(refused[0], 200)}" if refused else ""
        raise refusal(f"{path}: none of {counted(len(files), 'file')} has a cast{cause}")
    if not refused:
        return results, ()
    first = one_line(refused[0], 160)
    return results, (
        f"{len(refused)} of {len(files)} files of {path.name} dropped, the first: {first}",
    )


@contextmanager
def _files(path: Path, refusal: type[MantaRayError]) -> Iterator[tuple[list[Path], Path]]:
    """Regular files of a folder or archive in order of their names, and their folder."""
    if path.is_dir():
        files = sorted(
            file for file in path.iterdir() if file.is_file() and not file.name.startswith(".")
        )
        if len(files) > _MAX_FILES:
            raise refusal(
                f"{path}: {len(files):,} files; the limit is {_MAX_FILES:,}; name a smaller folder"
            )
        yield files, path
        return
    check_regular(path, refusal, what="a ZIP archive")
    with TemporaryDirectory() as temporary:
        try:
            files = _unpacked(path, Path(temporary), refusal)
        except (
            zipfile.BadZipFile,
            OSError,
            RuntimeError,
            NotImplementedError,
            EOFError,
            ValueError,
        ) as error:
            raise refusal(f"{path}: not a readable ZIP archive: {one_line(error, 80)}") from None
        yield files, Path(temporary)


def _unpacked(path: Path, folder: Path, refusal: type[MantaRayError]) -> list[Path]:
    """
    Unpack the files of an archive into a folder, by the last part of their names, up to the limits.
    """
    files: list[Path] = []
    with zipfile.ZipFile(path) as archive:
        members = [
            m
            for m in archive.infolist()
            if not m.is_dir() and not stat.S_ISLNK(m.external_attr >> 16)
        ]
        members = [
            m
            for m in members
            if not Path(m.filename).name.startswith(".") and "__MACOSX" not in m.filename
        ]
        if len(members) > _MAX_FILES or sum(m.file_size for m in members) > _MAX_UNPACKED:
            raise refusal(
                f"{path}: {len(members):,} files of {sum(m.file_size for m in members) / 1e9:.3g}"
                f" GB; the limits are {_MAX_FILES:,} and {_MAX_UNPACKED / 1e9:g} GB; unpack a part"
                " of it"
            )
        for k, member in enumerate(members):
            target = folder / Path(member.filename).name
            if exists(target):
                target = folder / f"{target.stem}_{k}{target.suffix}"
            with archive.open(member) as packed:
                content = packed.read(MAX_BYTES + 1)
            if len(content) > MAX_BYTES:
                raise refusal(
                    f"{path}: {member.filename[:80]} has more than {MAX_BYTES:,} bytes; unpack it"
                )
            target.write_bytes(content)
            files.append(target)
    return sorted(files)
