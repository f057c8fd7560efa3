"""Table that maps depths and travel time to horizontal range, and range to travel time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.apps.table.cells import (
    LEAF,
    REFERENCE_SLOWNESS,
    CellStatus,
    Tree,
    find_cells,
    mean_slowness,
)
from pymantaray.arrays import Array
from pymantaray.errors import OnlineError
from pymantaray.records.base import Column, Record, column
from pymantaray.records.digits import counted

# relative differences from the mean slowness at the first corner
_GUESSES = np.array([0.0, 0.006, -0.006, 0.012, -0.012, 0.024, -0.024])
_ITERATIONS = 16  # of Newton's method, those of all guesses together
# relative difference between the travel times at the found range and the given one
_CONVERGED = 1e-9


@dataclass(frozen=True, eq=False)
class TableRanges(Record):
    """
    Ranges and travel times from a table, one row per look-up; NaN if the status has no range.

    At a given travel time, a faster ocean means a longer range: ``range_by_scale`` is the change of
    range per relative change of all sound speeds.

    Examples
    --------
    Continues the example of `pymantaray.apps.table`:

    >>> found = table.horizontal_range(50.0, 400.0, [1.0, 9.0])
    >>> print(found.status, found.horizontal_range.round(1))
    [0 5] [1419.4    nan]
    """

    kind = "table_ranges"

    status: Column = column("lookup", "1", "outcome of the look-up", "i1", flags=CellStatus)
    horizontal_range: Column = column("lookup", "m", "horizontal range")
    travel_time: Column = column("lookup", "s", "travel time")
    range_by_time: Column = column("lookup", "m s-1", "derivative of range by travel time")
    range_by_source_depth: Column = column(
        "lookup", "1", "derivative of range by source depth, at constant travel time"
    )
    range_by_receiver_depth: Column = column(
        "lookup", "1", "derivative of range by receiver depth, at constant travel time"
    )
    range_by_scale: Column = column(
        "lookup", "m", "derivative of range by the logarithm of the sound-speed scale"
    )
    range_sigma: Column = column(
        "lookup", "m", "standard deviation of the range over the ensemble of oceans"
    )
    surface_bounces: Column = column("lookup", "1", "reflections at the surface", "i2")
    bottom_bounces: Column = column("lookup", "1", "reflections at the bottom", "i2")


@dataclass(frozen=True, eq=False)
class TravelTimeTable:
    """
    Travel times between two depths at horizontal ranges, interpolated with a bounded error.

    Make one with `build_table`, or open a file with `open_table`. A look-up needs no ray and no
    ocean. A cell next to a shadow or between two families of arrivals is not interpolated: its
    status is BORDER.

    Attributes
    ----------
    lower, upper : tuple of float
        Limits of source depth, receiver depth and horizontal range. [m]
    tolerance : float
        Bound of the error of the interpolated range at a given travel time. [m]
    tree : Tree
        Cells and the arrivals at their corners.
    attrs : dict
        Description of the water and of the selection of arrivals.

    Examples
    --------
    Continues the example of `pymantaray.apps.table`:

    >>> table.upper, table.tolerance
    ((100.0, 500.0, 2000.0), 0.05)
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    tolerance: float
    tree: Tree
    attrs: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Number of cells, limits and bound of the error."""
        spans = [f"{low:g} to {high:g} m" for low, high in zip(self.lower, self.upper, strict=True)]
        return (
            f"<TravelTimeTable: {counted(self.tree.status.size, 'cell')}, source depth {spans[0]},"
            f" receiver depth {spans[1]}, range {spans[2]}, error below {self.tolerance:g} m>"
        )

    @property
    def sectors(self) -> int:
        """Number of sectors of bearing, the first centred on north."""
        return self.tree.root.size

    def travel_time(
        self,
        source_depth: ArrayLike,
        receiver_depth: ArrayLike,
        horizontal_range: ArrayLike,
        bearing: ArrayLike = 0.0,
    ) -> TableRanges:
        """
        Look up travel times.

        Parameters
        ----------
        source_depth, receiver_depth : array_like, shape (n,) or ()
            [m]
        horizontal_range : array_like, shape (n,) or ()
            [m]
        bearing : array_like, shape (n,) or ()
            Direction from the source to the receiver, clockwise from north. Ignored by a table with
            one sector. [rad]

        Returns
        -------
        TableRanges
        """
        places, sector = self._places(source_depth, receiver_depth, horizontal_range, bearing)
        return self._look_up(places, sector)

    def horizontal_range(
        self,
        source_depth: ArrayLike,
        receiver_depth: ArrayLike,
        travel_time: ArrayLike,
        bearing: ArrayLike = 0.0,
    ) -> TableRanges:
        """
        Look up horizontal ranges.

        Parameters
        ----------
        source_depth, receiver_depth : array_like, shape (n,) or ()
            [m]
        travel_time : array_like, shape (n,) or ()
            [s]
        bearing : array_like, shape (n,) or ()
            As in `travel_time`. [rad]

        Returns
        -------
        TableRanges
            ``travel_time`` is the given one.

        Notes
        -----
        Newton's method on the square of the travel time as a function of the square of the range,
        which is almost linear. It begins with the mean slowness at the first corner of the table,
        and again with a slightly different one where it meets a place without an arrival.
        """
        places, sector = self._places(source_depth, receiver_depth, travel_time, bearing)
        time = places[:, 2].copy()
        down = places[:, 1] - places[:, 0]
        attempt = np.zeros(time.size, dtype=np.intp)
        value = self.tree.value
        typical = (1.0 + (float(value[0, 0]) if value.size else 0.0)) * REFERENCE_SLOWNESS
        distance = _first_range(time, down, attempt, typical)
        for _ in range(_ITERATIONS):
            inside = places[:, 2] = np.clip(distance, self.lower[2], self.upper[2])
            at, by_range = self._slope(places, sector)
            has = np.isfinite(at)
            with np.errstate(divide="ignore", invalid="ignore"):
                square = inside * inside + (time * time - at * at) * inside / (at * by_range)
            attempt = attempt + ~has
            other = np.where(
                attempt < len(_GUESSES), _first_range(time, down, attempt, typical), distance
            )
            distance = np.where(has, np.sqrt(np.maximum(square, 0.0)), other)
        places[:, 2] = distance
        return self._look_up(places, sector, time)

    def _slope(self, places: Array, sector: NDArray[np.int64]) -> tuple[Array, Array]:
        """Travel time at places, and its derivative by range; NaN without an arrival."""
        mean = mean_slowness(self.tree, find_cells(self.tree, *self._limits, sector, places))
        down = places[:, 1] - places[:, 0]
        distance = places[:, 2]
        straight = np.sqrt(distance * distance + down * down)
        slowness = (1.0 + mean.value) * REFERENCE_SLOWNESS
        with np.errstate(divide="ignore", invalid="ignore"):
            by_range = (
                straight * mean.gradient[:, 2] * REFERENCE_SLOWNESS + slowness * distance / straight
            )
        return straight * slowness, by_range

    def shares(self) -> dict[str, float]:
        """
        Share of the volume of the table with each status.

        Returns
        -------
        dict
            Name of the status in lower case, and its share.
        """
        branch = self.tree.branch.astype(np.int64)
        volume = np.zeros(branch.size)
        volume[self.tree.root] = 1.0 / self.sectors
        leaf = branch & LEAF == LEAF
        for number in np.flatnonzero(~leaf):  # halves follow their whole
            volume[(branch[number] >> 2) + np.arange(2)] = 0.5 * volume[number]
        content = branch[leaf] >> 2
        status = content >> 1
        has = content & 1 == 1
        status[has] = self.tree.status[status[has]]
        total = np.bincount(status, volume[leaf], minlength=len(CellStatus))
        return {one.name.lower(): float(total[one]) for one in CellStatus}

    @property
    def _limits(self) -> tuple[Array, Array]:
        return np.array(self.lower, dtype=float), np.array(self.upper, dtype=float)

    def _places(self, *columns: ArrayLike) -> tuple[Array, NDArray[np.int64]]:
        """Broadcast the arguments of a look-up to columns, and find the sector of each bearing."""
        source, receiver, third, bearing = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(c, dtype=float)) for c in columns)
        )
        if source.ndim != 1:
            raise OnlineError(
                f"look-up: arguments have shape {source.shape}; one dimension is allowed"
            )
        known = np.isfinite(bearing)
        turns = np.mod(np.where(known, bearing, 0.0), 2.0 * math.pi) / (2.0 * math.pi)
        places = np.column_stack([source, receiver, third])
        if self.sectors > 1:
            places[~known] = np.nan  # outside
        return places, np.floor(turns * self.sectors + 0.5).astype(np.int64) % self.sectors

    def _look_up(
        self, places: Array, sector: NDArray[np.int64], time: Array | None = None
    ) -> TableRanges:
        """Travel time, and derivatives of range at constant travel time, at places."""
        cell = find_cells(self.tree, *self._limits, sector, places)
        mean = mean_slowness(self.tree, cell)
        down = places[:, 1] - places[:, 0]
        distance = places[:, 2]
        straight = np.sqrt(distance * distance + down * down)
        slowness = (1.0 + mean.value) * REFERENCE_SLOWNESS
        gradient = straight[:, None] * mean.gradient * REFERENCE_SLOWNESS
        with np.errstate(divide="ignore", invalid="ignore"):
            by_range = gradient[:, 2] + slowness * distance / straight
            by_source = gradient[:, 0] - slowness * down / straight
            by_receiver = gradient[:, 1] + slowness * down / straight
            found = straight * slowness
        has = cell.number >= 0
        status = cell.status
        if time is not None:
            lost = has & ~(np.abs(found - time) <= _CONVERGED * time)
            has = has & ~lost
            status = np.where(lost, int(CellStatus.BORDER), status)
        number = np.maximum(cell.number, 0)
        return TableRanges(
            status=status.astype(np.int8),
            horizontal_range=np.where(has, distance, np.nan),
            travel_time=np.where(has, found if time is None else time, np.nan),
            range_by_time=np.where(has, 1.0 / by_range, np.nan),
            range_by_source_depth=np.where(has, -by_source / by_range, np.nan),
            range_by_receiver_depth=np.where(has, -by_receiver / by_range, np.nan),
            range_by_scale=np.where(has, found / by_range, np.nan),
            range_sigma=np.where(has, found * mean.sigma / (1.0 + mean.value) / by_range, np.nan),
            surface_bounces=np.where(has, _of_cells(self.tree.surface_bounces, number), 0),
            bottom_bounces=np.where(has, _of_cells(self.tree.bottom_bounces, number), 0),
        )


def _first_range(time: Array, down: Array, attempt: NDArray[np.intp], typical: float) -> Array:
    """
    Horizontal range at a travel time [s] and a difference of depth [m] with one of the mean
    slownesses to begin with.
    """
    guess = _GUESSES[np.minimum(attempt, len(_GUESSES) - 1)]
    straight = time / ((1.0 + guess) * typical)
    return np.asarray(np.sqrt(np.maximum(straight * straight - down * down, 0.0)))


def _of_cells(values: NDArray[np.uint8], number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Values of cells; zero if the table has no cell."""
    return values.astype(np.int64)[number] if values.size else np.zeros(number.size, dtype=np.int64)
