"""What a worker does for an atlas: the columns of one block, written where the others are."""

import io
from functools import lru_cache
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.atlas.column import EDGE, LAND, WATER, column_errors, medium_at
from pymantaray.atlas.dataset import VARIABLES, shape_of
from pymantaray.atlas.plan import Block
from pymantaray.geometry.longitude import whole_turns
from pymantaray.jobs.pool import run_in_store
from pymantaray.jobs.store import Store
from pymantaray.ocean import open_sea_floor
from pymantaray.ocean.open import read_ocean
from pymantaray.ocean.window import crop
from pymantaray.records.unpacking import MOST_UNPACKED_BYTES

_STATUS = "column_status"


def block_name(key: str, *, failed: bool = False) -> str:
    """Name of a block's file."""
    return f"blocks/{key}{'.failed.json' if failed else '.npz'}"


def run_block(url: str, block: Block) -> str | None:
    """Do a block unless it is done; the line by which it failed, None if it did not."""
    return run_in_store(url, block, _compute, block_name(block.key, failed=True))


def _compute(store: Store, block: Block) -> None:
    if not store.has(block_name(block.key)):
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **block_errors(block))
        store.write(block_name(block.key), content.getvalue())


def read_block(content: bytes) -> dict[str, NDArray[Any]]:
    """Variables of a block from its file; one that is damaged is a ValueError."""
    try:
        with ZipFile(io.BytesIO(content)) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > MOST_UNPACKED_BYTES:
            raise ValueError(f"takes {size / 1e9:.3g} GB unpacked, more than a block has")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (BadZipFile, EOFError, KeyError, OSError) as error:
        raise ValueError(str(error)) from None


def block_errors(block: Block) -> dict[str, NDArray[Any]]:
    """Variables of an atlas for the columns of a block, each (lat, lon, ...)."""
    ocean = _water(block)
    floor = None if block.sea_floor is None else open_sea_floor(block.sea_floor, window=block.window)
    out = {
        name: np.full((len(block.lat), len(block.lon), *shape_of(v, block.links)), v.nothing, v.dtype)
        for name, v in VARIABLES.items()
    }
    middle = 0.5 * float(ocean["lon"][0] + ocean["lon"][-1])
    for i, lat in enumerate(block.lat):
        for j, lon in enumerate(block.lon):
            place = (lat, lon - whole_turns(lon, about=middle))
            out[_STATUS][i, j], errors = _column(ocean, place, block, floor)
            for name, values in errors.items():
                out[name][i, j] = values
    return out


def _column(
    ocean: xr.Dataset, place: tuple[float, float], block: Block, sea_floor: xr.DataArray | None
) -> tuple[int, dict[str, NDArray[Any]]]:
    there = ocean["water_temp"].isel(depth=0).sel(lat=place[0], lon=place[1], method="nearest")
    if not np.isfinite(there):
        return LAND, {}
    medium = medium_at(ocean, place, block.links, equation=block.equation, sea_floor=sea_floor)
    return (EDGE, {}) if medium is None else (WATER, column_errors(medium, block.links)._asdict())


def _water(block: Block) -> xr.Dataset:
    """Grid points that the links of a block can need, which may all be land."""
    time = str(block.time)
    if block.files[0].startswith("synthetic:"):
        return crop(_whole(block.files, time), block.window)
    return read_ocean(block.files, time=time, window=block.window, currents="rest")


@lru_cache(maxsize=1)
def _whole(files: tuple[str, ...], time: str) -> xr.Dataset:
    """A synthetic ocean, which is made as a whole."""
    return read_ocean(files, time=time, window=None, currents="rest")
