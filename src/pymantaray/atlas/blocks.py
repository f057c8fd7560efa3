"""Computation of one block of columns of an atlas by a worker."""

import io
from collections.abc import Iterator
from functools import lru_cache
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium
from pymantaray.atlas.column import EDGE, LAND, WATER, column_errors, water_at
from pymantaray.atlas.dataset import VARIABLES, shape_of
from pymantaray.atlas.plan import Block
from pymantaray.geometry.longitude import whole_turns
from pymantaray.jobs.pool import run_in_store
from pymantaray.jobs.store import Store
from pymantaray.ocean.names import SYNTHETIC
from pymantaray.ocean.open import read_ocean
from pymantaray.ocean.window import crop
from pymantaray.records.unpacking import MAX_UNPACKED_BYTES
from pymantaray.water.ocean import build_medium, build_sea_floor, is_profile, profile_fields
from pymantaray.water.uniform import one_profile

_STATUS = "column_status"


def block_name(key: str, *, failed: bool = False) -> str:
    """Name of a block's file."""
    return f"blocks/{key}{'.failed.json' if failed else '.npz'}"


def run_block(url: str, block: Block) -> str | None:
    """Compute a block unless it exists; return the error line of a failure, else None."""
    return run_in_store(url, block, _compute, block_name(block.key, failed=True))


def _compute(store: Store, block: Block) -> None:
    if not store.has(block_name(block.key)):
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **block_errors(block))
        store.write(block_name(block.key), content.getvalue())


def read_block(content: bytes) -> dict[str, NDArray[Any]]:
    """Read the variables of a block; a damaged file raises ValueError."""
    try:
        with ZipFile(io.BytesIO(content)) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > MAX_UNPACKED_BYTES:
            raise ValueError(f"unpacks to {size / 1e9:.3g} GB, more than a block has")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (BadZipFile, EOFError, KeyError, OSError) as error:
        raise ValueError(str(error)) from None


def block_errors(block: Block) -> dict[str, NDArray[Any]]:
    """Variables of an atlas for the columns of a block, each (lat, lon, ...)."""
    out = {
        name: np.full((len(block.lat), len(block.lon), *shape_of(v, block.links)), v.nothing, v.dtype)
        for name, v in VARIABLES.items()
    }
    section = block.water.ocean
    if is_profile(section):
        fields = profile_fields(section, one_profile(section), block.links.interpolation)
        medium = build_medium(fields, block.water.acoustics.interpolation, block.water.acoustics.earth)
        assert isinstance(medium, Medium)  # one profile does not vary in time
        columns = [(0, 0, WATER, column_errors(medium, block.links)._asdict())]
    else:
        columns = list(_columns(block))
    for i, j, status, errors in columns:
        out[_STATUS][i, j] = status
        for name, values in errors.items():
            out[name][i, j] = values
    return out


def source_of(block: Block) -> tuple[str, bool]:
    """Title of the water, and True if it is synthetic."""
    if is_profile(block.water.ocean):
        return one_profile(block.water.ocean).name, False
    attrs = _water(block).attrs
    return str(attrs["title"]), bool(attrs["synthetic"])


def _columns(block: Block) -> Iterator[tuple[int, int, int, dict[str, NDArray[Any]]]]:
    """Row, column, status and errors of each column of a gridded ocean."""
    ocean = _water(block)
    sea_floor = build_sea_floor(block.water.ocean, ocean)
    middle = 0.5 * float(ocean["lon"][0] + ocean["lon"][-1])
    for i, lat in enumerate(block.lat):
        for j, lon in enumerate(block.lon):
            place = (lat, lon - whole_turns(lon, about=middle))
            yield i, j, *_column(ocean, place, block, sea_floor)


def _column(
    ocean: xr.Dataset, place: tuple[float, float], block: Block, sea_floor: xr.DataArray | None
) -> tuple[int, dict[str, NDArray[Any]]]:
    there = ocean["water_temp"].isel(depth=0).sel(lat=place[0], lon=place[1], method="nearest")
    if not np.isfinite(there):
        return LAND, {}
    local = water_at(ocean, place, block.links, block.water.ocean, sea_floor)
    if local is None:
        return EDGE, {}
    medium = Medium.from_dataset(
        local, interpolation=block.links.interpolation, earth=block.water.acoustics.earth
    )
    currents = Currents.from_dataset(local) if block.water.acoustics.currents else None
    return WATER, column_errors(medium, block.links, currents)._asdict()


def _water(block: Block) -> xr.Dataset:
    """Grid points that the links of a block may need; all of them may be land."""
    time, section = str(block.time), block.water.ocean
    if block.files[0].startswith(SYNTHETIC):
        return crop(_whole(block.files, time), block.window)
    options: dict[str, Any] = {"currents": section.currents, "names": section.standard_names}
    return read_ocean(block.files, time=time, window=block.window, **options)


@lru_cache(maxsize=1)
def _whole(files: tuple[str, ...], time: str) -> xr.Dataset:
    """A complete synthetic ocean."""
    return read_ocean(files, time=time, window=None, currents="rest")
