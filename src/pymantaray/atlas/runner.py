"""Making an atlas: blocks go to workers, who leave them beside the file that is put together of them."""

from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.atlas.blocks import block_name, read_block, run_block, source_of
from pymantaray.atlas.dataset import Placed, open_atlas, write_atlas
from pymantaray.atlas.plan import Atlas, Block, described
from pymantaray.errors import AtlasError, JobError, WriteError
from pymantaray.jobs.pool import Queue, check_scheduler, open_pool, run_tasks
from pymantaray.jobs.progress import TaskCount, TaskProgress
from pymantaray.jobs.store import Store, failure_content, open_store, read_valid

if TYPE_CHECKING:
    from pymantaray.jobs.pool import Client

_MARKER = "atlas.json"


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
    progress: TaskProgress | None = None,
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
        Called with the number of blocks that are done, the number that failed and the total.

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
            f"{path}: exists already, and is not of this atlas and this version of the code; give another name or --force"
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
        with open_pool(partial(run_block, store.url), client, workers) as pool:
            run_tasks(blocks, pool)
    if blocks.lines:
        raise AtlasError(
            f"{len(blocks.lines)} of {len(atlas.blocks)} blocks failed, the first by: {blocks.lines[0]}"
        )
    title, synthetic = source_of(atlas.blocks[0])
    try:
        write_atlas(atlas, _contents(store, atlas), path, title=title, synthetic=synthetic)
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
        if not store.has(block_name(block.key)):
            raise JobError(f"{store.url}: a block was done elsewhere; all workers must see this place")
        values = read_valid(store, block_name(block.key), read_block)
        if values is None:
            raise AtlasError(f"{store.url}: a block was damaged and is removed; run the atlas again")
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


class _Blocks(Queue):
    """Blocks that are still to be done."""

    def __init__(self, store: Store, blocks: list[Block], total: int, progress: TaskProgress | None) -> None:
        super().__init__(block.key for block in blocks)
        self._store, self._blocks = store, {block.key: block for block in blocks}
        self._count = TaskCount(total, progress, done=total - self.left)
        self.lines: list[str] = []

    def task(self, key: str) -> Block:
        """Return a block by its key."""
        return self._blocks[key]

    def ended(self, key: str, result: str | None) -> None:  # noqa: ARG002
        """Count a block, and note the line by which it failed."""
        self.left -= 1
        if result is not None:
            self.lines.append(result)
        self._count.add(failed=result is not None)

    def lost(self, key: str, line: str) -> None:
        """Write down why a block failed whose worker could not."""
        self._store.write(block_name(key, failed=True), failure_content(AtlasError(line)))
        self.ended(key, line)
