"""Making an atlas: blocks go to workers, who leave them beside the file that is put together of them."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.atlas.blocks import block_name, perform, read_block
from pymantaray.atlas.dataset import Placed, open_atlas, write_atlas
from pymantaray.atlas.plan import Atlas, Block, described
from pymantaray.errors import AtlasError, JobError, WriteError
from pymantaray.installation import code_version
from pymantaray.jobs.pool import check_scheduler, crew_of, do_all
from pymantaray.jobs.store import Store, failure_content, open_store
from pymantaray.ocean.open import read_ocean

if TYPE_CHECKING:
    from pymantaray.jobs.pool import Client

_MARKER = "atlas.json"
Told = Callable[[int, int, int], None]
"""Told how many blocks are done, how many have failed, and how many there are."""


def blocks_place(out: Path) -> Path:
    """Folder beside a file in which the blocks of an unfinished atlas lie."""
    return out.with_name(f"{out.name}.blocks")


def run_atlas(
    atlas: Atlas,
    out: str | Path,
    *,
    client: "Client | str | None" = None,
    workers: int | None = None,
    force: bool = False,
    progress: Told | None = None,
) -> Path:
    """
    Compute what is not there of an atlas, and write its file.

    Parameters
    ----------
    atlas : Atlas
    out : str or pathlib.Path
        NetCDF file. Blocks that are done lie in a folder beside it, ``<out>.blocks``, until it is written: the same call
        goes on with them, whatever ended it. With Dask every worker must see that folder.
    client : distributed.Client or str, optional
        Dask's client, or its scheduler's address. By default processes of this machine work.
    workers : int, optional
        Processes of this machine, by default one a core. No digit depends on it.
    force : bool
        Whether a file of that name that is of something else is replaced.
    progress : callable, optional
        Told how many blocks are done, how many have failed, and how many there are.

    Returns
    -------
    pathlib.Path
        The file. One that is of this atlas already is left as it is.

    Raises
    ------
    AtlasError
        If a block cannot be computed, by its line (all others are done first), or the file is of something else.
    JobError
        If the scheduler is gone, or workers see another folder.
    WriteError
        If something cannot be written.
    """
    check_scheduler(client)
    path = Path(out)
    if path.exists() and _is_of(path, atlas):
        return path
    if path.exists() and not force:
        raise WriteError(
            f"{path}: exists already, and is not of this atlas by pymantaray {code_version()}; give another name or --force"
        )
    store = open_store(blocks_place(path))
    store.claim("atlas", _MARKER, {_MARKER, "blocks"})
    store.write(_MARKER, described(atlas))
    for name in store.names("blocks"):
        if name.endswith(".failed.json"):  # in another run; tried again
            store.remove(f"blocks/{name}")
    there = {name.removesuffix(".npz") for name in store.names("blocks")}
    blocks = _Blocks(store, [b for b in atlas.blocks if b.key not in there], len(atlas.blocks), progress)
    if blocks.left:
        with crew_of(partial(perform, store.url), client, workers) as crew:
            do_all(blocks, crew)
    if blocks.lines:
        raise AtlasError(
            f"{len(blocks.lines)} of {len(atlas.blocks)} blocks failed, the first by: {blocks.lines[0]}"
        )
    first = atlas.blocks[0]
    ocean = read_ocean(first.files, time=str(first.time), window=first.window, currents="rest")
    attrs = ocean.attrs
    try:
        write_atlas(
            atlas, _contents(store, atlas), path, title=attrs["title"], synthetic=bool(attrs["synthetic"])
        )
    except JobError:
        if not _is_of(path, atlas):  # which another runner has written, and its blocks are gone
            raise
    _clear(store)
    return path


def _is_of(path: Path, atlas: Atlas) -> bool:
    try:
        with open_atlas(path) as dataset:
            return bool(dataset.attrs["atlas_key"] == atlas.key)
    except AtlasError:
        return False


def _contents(store: Store, atlas: Atlas) -> Iterator[Placed]:
    """What is in the blocks, one after the other."""
    for block in atlas.blocks:
        content = store.read(block_name(block.key))
        if content is None:
            raise JobError(f"{store.url}: a block was done elsewhere; all workers must see this place")
        try:
            values = read_block(content)
        except ValueError:
            store.remove(block_name(block.key))
            raise AtlasError(
                f"{store.url}: a block was damaged and is removed; run the atlas again"
            ) from None
        yield block.place, values


def _clear(store: Store) -> None:
    """Remove the blocks of an atlas whose file is written."""
    for name in store.names("blocks"):
        store.remove(f"blocks/{name}")
    store.remove(_MARKER)
    assert store.folder is not None  # beside a file
    for folder in (store.folder / "blocks", store.folder):
        with suppress(OSError):  # it holds something else, or another runner was first
            folder.rmdir()


class _Blocks:
    """Blocks that are to be done, and what becomes of them."""

    def __init__(self, store: Store, blocks: list[Block], total: int, progress: Told | None) -> None:
        self._store, self._blocks, self._progress = store, {b.key: b for b in blocks}, progress
        self._ready = list(reversed(self._blocks))
        self.left, self._total = len(self._blocks), total
        self.lines: list[str] = []
        self._tell()

    def next(self) -> str | None:
        """Key of a block that can be begun."""
        return self._ready.pop() if self._ready else None

    def again(self, key: str) -> None:
        """Take back a block that was given out and not done."""
        self._ready.append(key)

    def task(self, key: str) -> Block:
        """A block by its key."""
        return self._blocks[key]

    def ended(self, _key: str, line: str | None) -> None:
        """Note that a block is done, or why not."""
        self.left -= 1
        if line is not None:
            self.lines.append(line)
        self._tell()

    def lost(self, key: str, line: str) -> None:
        """Write down why a block failed whose worker could not."""
        self._store.write(block_name(key, failed=True), failure_content(AtlasError(line)))

    def _tell(self) -> None:
        if self._progress is not None:
            self._progress(self._total - self.left - len(self.lines), len(self.lines), self._total)
