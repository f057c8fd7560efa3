"""Data of a run for export: true and estimated poses and ranges of one realization."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.errors import ExchangeError
from pymantaray.records import Measurements, RayStatus, Trajectories, VehicleStatus
from pymantaray.records.status import TRUTH


class FleetPoses(NamedTuple):
    """Poses of all vehicles at the times of the truth."""

    position: Array
    """North, east, down (vehicle, time, 3). [m]"""
    quaternion: Array
    """Unit quaternions from body to world (w, x, y, z), (vehicle, time, 4)."""


class VehiclePoses(NamedTuple):
    """Poses of one vehicle under one condition, at the times when it is present."""

    condition: str
    vehicle: str
    samples: Indices
    """Indices into the times of the truth, (n,)."""
    position: Array
    """North, east, down (n, 3). [m]"""
    quaternion: Array
    """Body to world (w, x, y, z), (n, 4)."""


def new_file(folder: Path, p: VehiclePoses, suffix: str) -> Path:
    """File ``<condition>-<vehicle>`` of a trajectory in a folder, where no other one has it."""
    path = folder / f"{p.condition}-{p.vehicle}{suffix}"
    if path.exists():
        raise ExchangeError(
            f"{path.name}: two trajectories have this file name; rename vehicle {p.vehicle} or"
            f" condition {p.condition}"
        )
    return path


@dataclass(frozen=True, eq=False)
class Recording:
    """One realization of a run; estimates by condition, without failed solves."""

    name: str
    truth: Trajectories
    estimates: Mapping[str, FleetPoses]
    measurements: Measurements
    landmarks: Array
    """True positions of the landmarks, (landmark, 3). [m]"""

    @property
    def poses(self) -> Iterator[VehiclePoses]:
        """Poses of every vehicle, true poses first."""
        truth = self.truth
        present = [np.flatnonzero(status != VehicleStatus.ABSENT) for status in truth.status]
        fleets = {TRUTH: FleetPoses(truth.position, truth.quaternion), **self.estimates}
        for condition, fleet in fleets.items():
            for vehicle, rows, position, quaternion in zip(
                truth.name.tolist(), present, *fleet, strict=True
            ):
                yield VehiclePoses(condition, vehicle, rows, position[rows], quaternion[rows])

    @property
    def participants(self) -> list[str]:
        """Names of vehicles, then of landmarks, in the order of participants of range attempts."""
        return [*self.measurements.name.tolist(), *self.measurements.landmark_name.tolist()]

    @property
    def received(self) -> Indices:
        """Rows of received range attempts in order of time."""
        m = self.measurements
        rows = np.flatnonzero(m.range_status == RayStatus.OK)
        return rows[np.argsort(m.range_sample[rows], kind="stable")]

    def place(self, participant: int, sample: int) -> Array:
        """True north, east, down of a vehicle or landmark. [m]"""
        n = self.truth.name.size
        if participant < n:
            return np.asarray(self.truth.position[participant, sample])
        return np.asarray(self.landmarks[participant - n])
