"""A window of one step read over OPeNDAP, in blocks that are kept as they arrive."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.answers import Leaf, decode_times, read_arrays, read_attributes, unpack
from pymantaray.ocean.fetch.kept import Array, Source, WindowFields
from pymantaray.ocean.fetch.messages import place
from pymantaray.ocean.fetch.region import LARGEST_VALUES, Indices, Region, runs
from pymantaray.ocean.fetch.transport import ServerError

Instants = NDArray[np.datetime64]
AXES = ("time", "depth", "lat", "lon")
BLOCK_VALUES = 200_000  # of one request
_LARGEST_METADATA = 8 * 2**20  # bytes
_METADATA_AGE_S = 6 * 3600.0  # running analyses gain steps, others lose data sets
_SLACK = 1 << 20  # bytes of description and maps beside the values of a block
_SAME = 1e-3  # degrees, metres, hours


class MovedError(ServerError):
    """A server's axes are no longer those that were read."""


@dataclass(frozen=True)
class DapDataset:
    """A data set on a server: its axes as sent, its times, and the attributes of its variables."""

    url: str
    axes: dict[str, Array]
    times: Instants
    attributes: dict[str, dict[str, Any]]

    def index_of(self, instant: np.datetime64) -> int:
        """
        Step of an instant.

        Parameters
        ----------
        instant : numpy.datetime64

        Returns
        -------
        int
            The first, where the axis steps back and repeats itself.
        """
        return int(np.flatnonzero(self.times == instant)[0])


@dataclass(frozen=True)
class _Block:
    """One request: levels and longitudes by first and last index, and where they go in the result."""

    name: str
    dataset: DapDataset
    index: tuple[tuple[int, int], ...]
    levels: slice
    columns: slice


def open_dataset(source: Source, url: str, *, fresh: bool = False) -> DapDataset:
    """
    Read the axes and attributes of a data set.

    Parameters
    ----------
    source : Source
    url : str
        Without a suffix.
    fresh : bool, optional
        Ask the server even where an answer is kept.

    Returns
    -------
    DapDataset

    Raises
    ------
    OceanError
        If the server refuses or the data set is not one of HYCOM's.
    """
    oldest = 0.0 if fresh else _METADATA_AGE_S
    attributes = source.get(
        f"{url}.das", {"url": url, "kind": "das"}, _LARGEST_METADATA, read_attributes, oldest
    )
    axes = source.get(
        f"{url}.dods?{','.join(AXES)}", {"url": url, "kind": "axes"}, _LARGEST_METADATA, _read_axes, oldest
    )
    try:
        times = decode_times(axes["time"], str(attributes.get("time", {}).get("units", "")))
    except OceanError as error:
        raise ServerError(f"{place(url)}: {error}") from None
    return DapDataset(url, axes, times, attributes)


def read_window(
    source: Source, datasets: dict[str, DapDataset], instant: np.datetime64, region: Region
) -> WindowFields:
    """
    Read the variables of one step on a window.

    Parameters
    ----------
    source : Source
    datasets : dict of str to DapDataset
        The data set that holds each variable.
    instant : numpy.datetime64
        A step of each of them.
    region : Region

    Returns
    -------
    WindowFields

    Raises
    ------
    OceanError
        If the region is not covered or too large, the data sets disagree on the grid, or a block
        cannot be had.
    """
    first = next(iter(datasets.values()))
    for other in datasets.values():
        for axis in AXES[1:]:
            if not _same(other.axes[axis], first.axes[axis]):
                raise ServerError(f"{place(other.url)}: {axis} differs from that of {place(first.url)}")
    try:
        rows = region.latitudes(first.axes["lat"])
        columns, lon = region.longitudes(first.axes["lon"])
    except OceanError as error:
        raise OceanError(f"{place(first.url)}: {error}") from None
    depth = first.axes["depth"]
    shape = (depth.size, rows.size, columns.size)
    if int(np.prod(shape)) > LARGEST_VALUES:
        raise OceanError(
            f"fetch: the window has {shape[1]} x {shape[2]} x {shape[0]} points; allowed are"
            f" {LARGEST_VALUES:,}, make it smaller"
        )
    fields = {name: np.full(shape, np.nan) for name in datasets}
    blocks = [b for name, d in datasets.items() for b in _blocks(name, d, instant, shape[0], rows, columns)]
    for done, block in enumerate(blocks):
        source.report(done, len(blocks))
        fields[block.name][block.levels, :, block.columns] = _read_block(source, block, instant)
    source.report(len(blocks), len(blocks))
    return WindowFields(depth, first.axes["lat"][rows], lon, fields)


def _blocks(
    name: str, dataset: DapDataset, instant: np.datetime64, levels: int, rows: Indices, columns: Indices
) -> Iterator[_Block]:
    if name not in dataset.attributes:
        raise ServerError(f"{place(dataset.url)}: holds no {name}")
    step = dataset.index_of(instant)
    at = 0
    for west, east in runs(columns):
        width = east - west + 1
        height = max(1, BLOCK_VALUES // (rows.size * width))
        for top in range(0, levels, height):
            bottom = min(top + height, levels) - 1
            index = ((step, step), (top, bottom), (int(rows[0]), int(rows[-1])), (west, east))
            yield _Block(name, dataset, index, slice(top, bottom + 1), slice(at, at + width))
        at += width


def _read_block(source: Source, block: _Block, instant: np.datetime64) -> Array:
    dataset, name = block.dataset, block.name
    step = block.index[0][0]
    # the time is asked for along, since steps may come and go between two requests
    constraint = name + "".join(f"[{a}:1:{b}]" for a, b in block.index) + f",time[{step}:1:{step}]"
    wanted = {axis: dataset.axes[axis][a : b + 1] for axis, (a, b) in zip(AXES, block.index, strict=True)}
    shape = tuple(w.size for w in wanted.values())

    def parse(body: bytes) -> Array:
        leaves = read_arrays(body)
        if name not in leaves or "time" not in leaves:
            raise OceanError(f"answer holds no {name} or no time")
        _check_block(name, leaves, wanted)
        return unpack(name, leaves[name].values.reshape(shape[1:]), dataset.attributes[name])

    request = {
        "url": dataset.url,
        "kind": "block",
        "variable": name,
        "time": str(instant),
        # by what the indices mean: a server may drop or add steps
        "window": [[float(w[0]), float(w[-1]), int(w.size)] for w in list(wanted.values())[1:]],
        "packing": _digest(dataset.attributes[name]),
    }
    url = f"{dataset.url}.dods?{quote(constraint, safe=':,')}"
    return source.get(url, request, 8 * int(np.prod(shape)) + _SLACK, parse)


def _check_block(name: str, leaves: dict[str, Leaf], wanted: dict[str, Array]) -> None:
    """Refuse a block of another shape, or whose maps (THREDDS sends them along) are of another place."""
    shape = tuple(w.size for w in wanted.values())
    leaf = leaves[name]
    if leaf.values.shape != shape or leaf.dims not in (AXES, ()):
        raise OceanError(f"wrong size: {name} has {leaf.values.shape} along {leaf.dims}; asked for {shape}")
    for axis, values in wanted.items():
        for sent in (leaves.get(f"{name}.{axis}"), leaves.get(axis)):
            if sent is not None and not _same(sent.values, values):
                raise MovedError(f"{name} was sent for another {axis} than asked for")


def _read_axes(body: bytes) -> dict[str, Array]:
    leaves = read_arrays(body)
    axes = {}
    for name in AXES:
        if name not in leaves:
            raise OceanError(f"no coordinate {name}; is it a data set of HYCOM?")
        values = np.asarray(leaves[name].values, dtype=float)
        if values.ndim != 1 or not values.size or not np.all(np.isfinite(values)):
            raise OceanError(f"coordinate {name} is not an axis of numbers")
        axes[name] = values
    return axes


def _same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    return a.shape == b.shape and bool(np.all(np.abs(np.asarray(a, dtype=float) - b) < _SAME))


def _digest(attributes: dict[str, Any]) -> str:
    return hashlib.sha256(repr(sorted(attributes.items())).encode()).hexdigest()[:16]
