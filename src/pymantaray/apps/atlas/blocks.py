"""
Computation of one block of columns of an atlas by a worker: water around each column, as in a study
centred there, and the range errors of its links.
"""

import io
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple
from zipfile import BadZipFile, ZipFile

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium, find_eigenrays, select
from pymantaray.acoustics.currents import carried
from pymantaray.acoustics.medium import ice_of
from pymantaray.apps.atlas.dataset import EDGE, LAND, NOTES, VARIABLES, WATER, shape_of
from pymantaray.apps.atlas.links import CONVENTIONS, AtlasLinks
from pymantaray.apps.atlas.plan import SPLINE, Block
from pymantaray.arrays import Array
from pymantaray.config.door.ocean import MissionOcean
from pymantaray.estimation.ranges.range_models import ConstantSpeed, TransmitterSpeed
from pymantaray.evaluation.ranging_error import range_errors
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.geometry.longitude import whole_turns
from pymantaray.jobs.pool import run_in_store
from pymantaray.jobs.store import Store, write_sealed
from pymantaray.ocean.grid_points import GridPoints
from pymantaray.ocean.local import LocalGrid
from pymantaray.ocean.names import SYNTHETIC
from pymantaray.ocean.open import read_ocean
from pymantaray.ocean.window import Window, crop, rectangle
from pymantaray.records import RangingTruth, RayStatus
from pymantaray.user_files import MAX_UNPACKED_BYTES

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
        write_sealed(store, block_name(block.key), content.getvalue())


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
    """Variables of an atlas for the columns of a block, each (lat, lon, ...), and notes."""
    out = {
        name: np.full(
            (len(block.lat), len(block.lon), *shape_of(v, block.links)), v.nothing, v.dtype
        )
        for name, v in VARIABLES.items()
    }
    if block.ocean.is_profile:
        opened = block.ocean.open(block.links.interpolation)
        medium = block.sound.medium(opened)
        assert isinstance(medium, Medium)  # one profile does not vary in time
        notes = [*opened.notes, *medium.notes]
        columns = [(0, 0, WATER, column_errors(medium, block.links)._asdict())]
    else:
        ocean = _water(block)
        sea_floor = block.ocean.sea_floor(ocean)
        notes = list(block.ocean.notes_of(ocean, sea_floor))
        columns = list(_columns(block, ocean, sea_floor))
    out[NOTES] = np.array(notes)
    for i, j, status, errors in columns:
        out[_STATUS][i, j] = status
        for name, values in errors.items():
            out[name][i, j] = values
    return out


def source_of(block: Block) -> tuple[str, bool]:
    """Title of the water, and True if it is synthetic."""
    if block.ocean.is_profile:
        return block.ocean.profile().name, False
    attrs = _water(block).attrs
    return str(attrs["title"]), bool(attrs["synthetic"])


def _columns(
    block: Block, ocean: xr.Dataset, sea_floor: xr.DataArray | None
) -> Iterator[tuple[int, int, int, dict[str, NDArray[Any]]]]:
    """Row, column, status and errors of each column of a gridded ocean."""
    surface = np.isfinite(ocean["water_temp"].values[0])
    lats = ocean["lat"].values
    lons = ocean["lon"].values
    middle = 0.5 * float(lons[0] + lons[-1])
    points = GridPoints.of(ocean, block.ocean.equation) if surface.any() else None
    for i, lat in enumerate(block.lat):
        for j, lon in enumerate(block.lon):
            place = (lat, lon - whole_turns(lon, about=middle))
            own = tuple(
                int(np.abs(axis - x).argmin()) for axis, x in zip((lats, lons), place, strict=True)
            )
            if points is None or not surface[own]:
                yield i, j, LAND, {}
            else:
                yield i, j, *_column(points, place, block, sea_floor)


def _column(
    points: GridPoints, place: tuple[float, float], block: Block, sea_floor: xr.DataArray | None
) -> tuple[int, dict[str, NDArray[Any]]]:
    interpolation = block.links.interpolation
    grid = water_at(points, place, block.links, sea_floor)
    if grid is None:
        return EDGE, {}
    ice = _ice(block.ocean, grid)
    medium = Medium.from_local_grid(
        grid, interpolation=interpolation, ice_draft=ice, earth=block.sound.earth
    )
    currents = None
    if block.sound.currents:
        currents = Currents(grid.north, grid.east, grid.depth, np.stack(grid.currents(), axis=-1))
    return WATER, column_errors(medium, block.links, currents)._asdict()


def _ice(ocean: MissionOcean, grid: LocalGrid) -> BoundarySurface | float:
    """Surface of a local grid with the ice of an ocean; depth 0 without ice. [m]"""
    if not ocean.has_ice:
        return 0.0
    frame = grid.window.frame
    centre = {
        "centre_latitude_deg": frame.latitude_deg,
        "centre_longitude_deg": frame.longitude_deg,
    }
    axes = {"north": grid.north, "east": grid.east}
    return ice_of(ocean.with_ice(xr.Dataset(coords=axes, attrs=centre)))


def _water(block: Block) -> xr.Dataset:
    """Grid points that the links of a block may need; all of them may be land."""
    time = str(block.time)
    if block.files[0].startswith(SYNTHETIC):
        return crop(_whole(block.files, time), block.window)
    return read_ocean(block.files, time=time, window=block.window, **block.ocean.reading)


@lru_cache(maxsize=1)
def _whole(files: tuple[str, ...], time: str) -> xr.Dataset:
    """A complete synthetic ocean."""
    return read_ocean(files, time=time, window=None, currents="rest")


class ColumnErrors(NamedTuple):
    """Range errors and counts of one column."""

    range_error: Array
    """
    Shape (convention, pair, distance, bearing), also of the next two. NaN without a direct arrival.
    [m]
    """
    reference_speed_error: Array
    bending_error: Array
    link_status: NDArray[np.int8]
    """Shape (pair, distance, bearing), also of the next."""
    arrivals_within: NDArray[np.int16]
    no_direct_path: Array
    """Fraction (pair, distance) of the bearings; NaN if no receiver is in the water."""
    worst_range_error: Array
    """Maximum magnitude (convention, pair, distance) over the bearings. [m]"""
    safe_distance: Array
    """Shape (convention, safe). [m]"""


def water_at(
    points: GridPoints,
    place: tuple[float, float],
    links: AtlasLinks,
    sea_floor: xr.DataArray | None = None,
) -> LocalGrid | None:
    """
    Local grid around a place; None if the links do not fit into the ocean's window.

    It uses the grid points in the rectangle of all links and `SPLINE` more on each side, so it does
    not depend on the extent of the available ocean.
    """
    half = links.half_extent, links.half_extent
    window = Window.on(points.lat, points.lon, place)
    if not window.holds(*half):
        return None
    part = points.around(window.geographic(*rectangle(*half)), SPLINE)
    return LocalGrid.of(part, replace(window, lat=part.lat, lon=part.lon), half, sea_floor)


def medium_at(points: GridPoints, place: tuple[float, float], links: AtlasLinks) -> Medium | None:
    """Medium around a place, as in `water_at`, without a separate sea floor and without ice."""
    grid = water_at(points, place, links)
    return None if grid is None else Medium.from_local_grid(grid, interpolation=links.interpolation)


def column_errors(
    medium: Medium, links: AtlasLinks, currents: Currents | None = None
) -> ColumnErrors:
    """Errors of the links around the centre of a medium's frame, optionally with currents."""
    transmitter, receiver = links.ends()
    options: dict[str, Any] = {
        "spreading_cutoff_db": links.spreading_cutoff_db,
        "tolerance": links.tolerance,
        "threads": 1,
    }
    arrivals = find_eigenrays(medium, transmitter, receiver, **options)
    if currents is not None:
        arrivals = carried(medium, transmitter, receiver, arrivals, currents)
    direct = select(arrivals, "direct")
    most = links.max_surface_bounces, links.max_bottom_bounces
    if any(most):
        arrivals = find_eigenrays(medium, transmitter, receiver, *most, **options)
    distance = medium.straight_distance(transmitter, receiver)
    each = np.tile([distance, direct.travel_time, direct.chord_travel_time], len(CONVENTIONS))
    measured = TransmitterSpeed()
    at_transmitter = measured.speed(direct.source_sound_speed)
    at_receiver = measured.speed(direct.receiver_sound_speed)
    speed = np.concatenate(
        [
            at_transmitter,
            at_receiver,
            0.5 * (at_transmitter + at_receiver),
            distance / direct.chord_travel_time,
            ConstantSpeed(links.nominal_sound_speed).speed(distance),
        ]
    )
    errors = range_errors(RangingTruth(each[0], speed, each[1], each[2]))
    total, reference, bending = (
        part.reshape(len(CONVENTIONS), *links.shape)
        for part in (errors.total, errors.reference_speed, errors.bending)
    )
    status = direct.status.reshape(links.shape)
    # number of each link's arrivals within a level of its strongest arrival, by spreading
    loss = np.where(np.isnan(arrivals.spreading_db), np.inf, arrivals.spreading_db)
    least = np.full(arrivals.status.size, np.inf)
    np.minimum.at(least, arrivals.link, loss)
    strong = loss <= least[arrivals.link] + links.within_db
    in_water = (status != RayStatus.OUTSIDE).sum(axis=-1)
    with_path = (status == RayStatus.OK).sum(axis=-1)
    return ColumnErrors(
        range_error=total,
        reference_speed_error=reference,
        bending_error=bending,
        link_status=status,
        arrivals_within=np.bincount(arrivals.link[strong], minlength=least.size)
        .astype(np.int16)
        .reshape(links.shape),
        no_direct_path=np.where(in_water > 0, 1.0 - with_path / np.maximum(in_water, 1), np.nan),
        worst_range_error=_worst(total, axis=-1),
        safe_distance=_safe_distance(total, links),
    )


def _worst(error: Array, axis: int | tuple[int, ...]) -> Array:
    """Largest absolute error along axes, NaN if no link has one."""
    return np.asarray(np.fmax.reduce(np.abs(error), axis=axis))


def _safe_distance(error: Array, links: AtlasLinks) -> Array:
    """
    Greatest distance up to which every direct range error, over all pairs and bearings, is within
    each threshold.

    0 if an error at the shortest distance exceeds the threshold, NaN if the shortest distance has
    no direct range. The search stops at the first distance without a direct range.
    """
    worst = _worst(error, (1, 3))
    safe = worst[:, None] <= np.array(links.safe)[:, None]  # False for NaN
    steps = np.logical_and.accumulate(safe, axis=-1).sum(axis=-1)
    reach = np.array([0.0, *links.distances])[steps]
    return np.where(np.isnan(worst[:, :1]), np.nan, reach)
