"""
Computation of an atlas: workers compute blocks in a folder beside the file, which is then assembled
from them.
"""

from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.apps.atlas.blocks import block_name, read_block, run_block, source_of
from pymantaray.apps.atlas.dataset import LocatedBlock, open_atlas, write_atlas
from pymantaray.apps.atlas.plan import Atlas, Block, described
from pymantaray.errors import AtlasError, JobError, WriteError
from pymantaray.jobs.dask_pool import check_scheduler, open_pool
from pymantaray.jobs.pool import Queue, run_tasks
from pymantaray.jobs.progress import TaskCount, TaskProgress
from pymantaray.jobs.store import Store, failure_content, open_store, read_sealed

if TYPE_CHECKING:
    from pymantaray.jobs.pool import Client

_MARKER = "atlas.json"


def blocks_folder(out: Path) -> Path:
    """Folder beside a file with the blocks of an unfinished atlas."""
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
    Compute the missing blocks of an atlas and write its file.

    Parameters
    ----------
    atlas : Atlas
        Definition.
    out : str or pathlib.Path
        NetCDF file. Until it is written, the folder ``<out>.blocks`` beside it contains finished
        blocks, from which the same call resumes after any interruption. With Dask, every worker
        must have access to this folder.
    client : distributed.Client or str, optional
        Dask client or scheduler address. Default: processes of this machine.
    workers : int, optional
        Number of processes of this machine. Default: one per core. Results do not depend on it.
    force : bool
        If True, replace an existing file with other content.
    progress : callable, optional
        Called with the number of finished blocks, the number of failed blocks and the total.

    Returns
    -------
    pathlib.Path
        The file. An existing file of this atlas is unchanged.

    Raises
    ------
    AtlasError
        If a block fails (after all other blocks are finished), or the file has other content.
    JobError
        If the scheduler does not answer, or workers have access to another folder.
    WriteError
        If a file cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.atlas`:

    >>> from pymantaray.apps.atlas import run_atlas
    >>> run_atlas(definition, "again.nc", workers=1).name
    'again.nc'
    """
    check_scheduler(client)
    path = Path(out)
    if path.exists() and _is_of(path, atlas):
        if blocks_folder(path).is_dir():  # of a run that was stopped at its end
            _clear(open_store(blocks_folder(path)), atlas)
        return path
    if path.exists() and not force:
        raise WriteError(
            f"{path}: already exists, from another atlas or version of the code; give another name"
            " or `force=True`"
        )
    store = open_store(blocks_folder(path))
    store.claim("atlas", _MARKER, {_MARKER, "blocks"})
    store.write(_MARKER, described(atlas))
    for name in store.names("blocks"):
        if name.endswith(".failed.json"):  # failed in another run; try again
            store.remove(f"blocks/{name}")
    names = (name for name in store.names("blocks") if store.has(f"blocks/{name}"))
    there = {name.removesuffix(".npz") for name in names}
    blocks = _Blocks(
        store, [b for b in atlas.blocks if b.key not in there], len(atlas.blocks), progress
    )
    if blocks.left:
        with open_pool(partial(run_block, store.url), client, workers) as pool:
            run_tasks(blocks, pool)
    if blocks.lines:
        raise AtlasError(
            f"{len(blocks.lines)} of {len(atlas.blocks)} blocks failed, the first with:"
            f" {blocks.lines[0]}"
        )
    title, synthetic = source_of(atlas.blocks[0])
    try:
        write_atlas(atlas, _contents(store, atlas), path, title=title, synthetic=synthetic)
    except JobError:
        if not _is_of(path, atlas):  # unless another runner has written it and removed the blocks
            raise
    _clear(store, atlas)
    return path


def _is_of(path: Path, atlas: Atlas) -> bool:
    try:
        with open_atlas(path) as dataset:
            return bool(dataset.attrs.get("atlas_key") == atlas.key)
    except AtlasError:
        return False


def _contents(store: Store, atlas: Atlas) -> Iterator[LocatedBlock]:
    """Contents of the blocks one by one."""
    for block in atlas.blocks:
        if not store.has(block_name(block.key)):
            raise JobError(
                f"{store.url}: a worker wrote a block to another place; all workers must have"
                " access to this folder"
            )
        values = read_sealed(store, block_name(block.key), read_block)
        if values is None:
            raise AtlasError(f"{store.url}: a damaged block was removed; run the atlas again")
        yield block.place, values


def _clear(store: Store, atlas: Atlas) -> None:
    """Remove the blocks of an atlas after its file is written; those of another stay."""
    if store.read(_MARKER) == described(atlas):
        for name in store.names("blocks"):
            store.remove(f"blocks/{name}")
        store.remove(_MARKER)
    assert store.folder is not None  # the store is beside a file
    for folder in (store.folder / "blocks", store.folder):
        with suppress(OSError):  # not empty, or removed by another runner
            folder.rmdir()


class _Blocks(Queue):
    """Unfinished blocks."""

    def __init__(
        self, store: Store, blocks: list[Block], total: int, progress: TaskProgress | None
    ) -> None:
        super().__init__(block.key for block in blocks)
        self._store = store
        self._blocks = {block.key: block for block in blocks}
        self._count = TaskCount(total, progress, done=total - self.left)
        self.lines: list[str] = []

    def task(self, key: str) -> Block:
        """Block with a key."""
        return self._blocks[key]

    def record_result(self, key: str, result: str | None) -> None:  # noqa: ARG002
        """Count a block, and store its error line if it failed."""
        self.left -= 1
        if result is not None:
            self.lines.append(result)
        self._count.add(failed=result is not None)

    def record_failure(self, key: str, line: str) -> None:
        """Store the error line of a block whose worker ended."""
        self._store.write(block_name(key, failed=True), failure_content(AtlasError(line)))
        self.record_result(key, line)
