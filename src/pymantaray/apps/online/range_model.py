"""Range models on board: a travel-time table, eigenrays in a medium, or a constant sound speed."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Medium
from pymantaray.apps.table.cells import HAS_RANGE, CellStatus
from pymantaray.apps.table.table import TableRanges, TravelTimeTable
from pymantaray.arrays import Array
from pymantaray.errors import OnlineError
from pymantaray.estimation.ranges.range_models import (
    ConstantSpeed,
    Prediction,
    RangeEndpoints,
    RangeModel,
    TravelTimeUncertainty,
)
from pymantaray.range_models.eigenray_model import EigenrayModel

_OTHER_END = {
    "range_by_source_depth": "range_by_receiver_depth",
    "range_by_receiver_depth": "range_by_source_depth",
}


class TableModel(RangeModel, TravelTimeUncertainty):
    """
    Range model of a travel-time table; the source of the table is the transmitter.

    A table with one sector holds in both directions: if the transmitter's depth is outside the
    table's source depths, the receiver becomes the source. A link without a range in the table
    (shadow, border, outside) has no arrival. The table's standard deviations over its ensemble of
    oceans are the uncertainty of the travel times.

    Parameters
    ----------
    table : TravelTimeTable
    """

    def __init__(self, table: TravelTimeTable) -> None:
        self.table = table

    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Predict travel times and their derivatives by both positions.

        Parameters
        ----------
        links : RangeEndpoints

        Returns
        -------
        Prediction
        """
        found = self._look_up(links)
        step = links.receiver - links.transmitter
        distance = np.hypot(step[:, 0], step[:, 1])
        by_range = 1.0 / found.range_by_time
        receiver = np.zeros_like(step)
        receiver[:, :2] = (
            by_range[:, None] * step[:, :2] / np.where(distance > 0.0, distance, 1.0)[:, None]
        )
        transmitter = -receiver
        transmitter[:, 2] = -found.range_by_source_depth * by_range
        receiver[:, 2] = -found.range_by_receiver_depth * by_range
        possible = np.isin(found.status, HAS_RANGE) & np.isfinite(transmitter + receiver).all(
            axis=1
        )
        bounces = np.asarray(found.surface_bounces + found.bottom_bounces, dtype=np.intp)
        return Prediction(np.asarray(found.travel_time), transmitter, receiver, possible, bounces)

    def covariances(self, links: RangeEndpoints, epoch: NDArray[np.intp]) -> list[Array]:
        """
        Variances of the travel times due to the ensemble of oceans; zero without one.

        Parameters
        ----------
        links : RangeEndpoints
        epoch : ndarray of int, shape (n,)
            Number of the ping.

        Returns
        -------
        list of ndarray
            One diagonal matrix per ping. [s²]
        """
        found = self._look_up(links)
        variance = np.nan_to_num((found.range_sigma / found.range_by_time) ** 2)
        return [np.diag(variance[epoch == one]) for one in np.unique(epoch)]

    def _look_up(self, links: RangeEndpoints) -> TableRanges:
        a = links.transmitter
        b = links.receiver
        north, east = (b - a)[:, :2].T
        distance = np.hypot(north, east)
        found = self.table.travel_time(a[:, 2], b[:, 2], distance, np.arctan2(east, north))
        outside = found.status == CellStatus.OUTSIDE
        if self.table.sectors > 1 or not outside.any():
            return found
        back = self.table.travel_time(b[outside, 2], a[outside, 2], distance[outside])
        columns = {field.name: np.array(getattr(found, field.name)) for field in fields(found)}
        for name, values in columns.items():
            values[outside] = getattr(back, _OTHER_END.get(name, name))
        return TableRanges(**columns)


def range_model_of(
    ranges: TravelTimeTable | Medium | RangeModel | float,
) -> tuple[RangeModel, TravelTimeUncertainty | None]:
    """
    Range model of a table, a medium, a sound speed [m/s] or a model itself, and its uncertainty.
    """
    if isinstance(ranges, TravelTimeTable):
        table = TableModel(ranges)
        return table, table
    if isinstance(ranges, Medium):
        return EigenrayModel(ranges), None
    if isinstance(ranges, int | float | np.number):
        return ConstantSpeed(float(ranges)), None
    if not isinstance(ranges, RangeModel):
        raise OnlineError(
            f"ranges: found {type(ranges).__name__}; it must be a travel-time table, a medium, a"
            " range model or a sound speed in m/s"
        )
    return ranges, ranges if isinstance(ranges, TravelTimeUncertainty) else None
