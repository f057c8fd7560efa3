"""
Water around one column of an ocean, as in a study centred there, and the range errors of its links.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium, find_eigenrays, select
from pymantaray.acoustics.currents import carried
from pymantaray.apps.atlas.links import CONVENTIONS, AtlasLinks
from pymantaray.arrays import Array
from pymantaray.estimation.ranges.range_models import ConstantSpeed, TransmitterSpeed
from pymantaray.evaluation.ranging_error import range_errors
from pymantaray.ocean.grid_points import GridPoints
from pymantaray.ocean.local import LocalGrid
from pymantaray.ocean.window import Window, rectangle
from pymantaray.records import RangingTruth, RayStatus

SPLINE = 8  # grid points beyond the domain for interpolation
WATER, LAND, EDGE = 0, 1, 2
"""Status of a column; `EDGE`: its links do not fit into the data."""


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
    cutoff = links.spreading_cutoff_db
    options: dict[str, Any] = {
        "spreading_cutoff_db": cutoff,
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
