"""Trajectories: poses of a fleet at common times."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from pymantaray.geometry.frames import LocalFrame
from pymantaray.records.base import Column, DatedRecord, column
from pymantaray.records.status import VehicleStatus

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Trajectories(DatedRecord):
    """
    Poses ``T_world_body`` of a fleet at common sample times, in the local NED frame.

    ``status`` contains `VehicleStatus` values; a stopped vehicle stays at its last position.
    ``centre`` is the latitude and longitude of the frame's centre [degrees], or None if unknown.
    With a centre, data sets have latitudes and longitudes of all poses.

    Examples
    --------
    >>> from pymantaray import Trajectories
    >>> still = Trajectories(
    ...     name=["A"],
    ...     role=["vehicle"],
    ...     time=[0.0, 60.0],
    ...     position=[[[0.0, 0.0, 10.0], [30.0, 0.0, 10.0]]],
    ...     quaternion=[[[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]],
    ...     status=[[0, 0]],
    ... )
    >>> still
    <Trajectories: 1 vehicle, 2 times>
    >>> print(still.to_dataset()["position"].dims)
    ('vehicle', 'time', 'axis')
    """

    kind: ClassVar[str] = "trajectories"

    name: Column = column("vehicle", "", "vehicle name", "U", labels=True)
    role: Column = column(
        "vehicle",
        "",
        "behaviour of the vehicle: float, station, drifting, twist, waypoints or track",
        "U",
    )
    time: Column = column("time", "s", "time since the start of the mission")
    position: Column = column("vehicle time axis", "m", "north, east, down in the local frame")
    quaternion: Column = column("vehicle time quat", "1", "rotation body to world, (w, x, y, z)")
    status: Column = column("vehicle time", "1", "status of the vehicle", "i1", flags=VehicleStatus)
    centre: tuple[float, float] | None = field(default=None, kw_only=True)

    @property
    def frame(self) -> LocalFrame | None:
        """Local frame; None if its centre is unknown."""
        return None if self.centre is None else LocalFrame(*self.centre)

    def to_dataset(self) -> "xr.Dataset":
        """
        Convert the record to an xarray data set.

        It has latitudes and longitudes if the frame's centre is known.
        """
        dataset = super().to_dataset()
        frame = self.frame
        dims = ("vehicle", "time")
        if frame is None:
            return dataset
        latitude, longitude = frame.to_geodetic(self.position[..., 0], self.position[..., 1])
        dataset = dataset.assign_attrs(
            centre_latitude_deg=frame.latitude_deg,
            centre_longitude_deg=frame.longitude_deg,
            proj_string=frame.proj_string,
        )
        return dataset.assign_coords(
            latitude=(dims, latitude, {"standard_name": "latitude", "units": "degrees_north"}),
            longitude=(dims, longitude, {"standard_name": "longitude", "units": "degrees_east"}),
        )

    @classmethod
    def from_dataset(cls, dataset: "xr.Dataset") -> Self:
        """
        Build the record from a data set of `to_dataset`, with decoded or raw times.

        Parameters are those of `Record.from_dataset`.
        """
        record = super().from_dataset(dataset)
        if "centre_latitude_deg" not in dataset.attrs:
            return record
        centre = (
            float(dataset.attrs["centre_latitude_deg"]),
            float(dataset.attrs["centre_longitude_deg"]),
        )
        return replace(record, centre=centre)

    @property
    def stops(self) -> dict[str, tuple[VehicleStatus, float]]:
        """
        Final status and its first time [s] of vehicles that are not active at the end, by name.
        """
        out = {}
        for name, row in zip(self.name.tolist(), self.status, strict=True):
            if row[-1] != VehicleStatus.ACTIVE:
                since = int(np.flatnonzero(row == VehicleStatus.ACTIVE).max(initial=-1)) + 1
                out[name] = VehicleStatus(int(row[-1])), float(self.time[since])
        return out
