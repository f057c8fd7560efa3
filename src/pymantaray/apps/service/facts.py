"""Facts of a service's water, and the check that a position is in it."""

from typing import Any

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.arrays import Array
from pymantaray.errors import ServiceError
from pymantaray.sensing import TwoWay
from pymantaray.sensing.water import Water


def require_place(medium: Medium, name: str, place: Array) -> None:
    """
    Refuse a position beyond the horizontal extent, which is an error of the request and no outcome
    of a ping. [m]
    """
    for k, along in enumerate(("north", "east")):
        axis = getattr(medium, along)
        if axis.size > 1 and not axis[0] <= place[k] <= axis[-1]:
            raise ServiceError(
                f"{name}: {along} {place[k]:.6g} m is outside the ocean, which reaches from"
                f" {axis[0]:.6g} to {axis[-1]:.6g} m; move it or take a larger ocean"
            )


def facts(water: Water) -> dict[str, Any]:
    """Facts to know before the first ping, as JSON takes them."""
    medium = water.at_start[0]
    detector = water.reception.detector
    timing = water.timing
    out: dict[str, Any] = {
        name: _ends(axis) if axis.size > 1 else None
        for name, axis in (("north", medium.north), ("east", medium.east))
    }
    out["sea_floor_depth"] = _ends(medium.bed.depth)
    out["sound_speed"] = _ends(_in_water(medium))
    out["start"] = water.start
    out["time"] = [float(t) for t in water.span] if water.varies else None
    for name in ("title", "source", "centre_latitude_deg", "centre_longitude_deg"):
        out[name] = None if water.local is None else water.local.attrs.get(name)
    out["arrival"] = water.reception.arrival
    out["max_surface_bounces"] = water.reception.max_surface_bounces
    out["max_bottom_bounces"] = water.reception.max_bottom_bounces
    out["currents"] = water.currents is not None
    out["timing"] = "two-way" if isinstance(timing, TwoWay) else "one-way"
    out["turn_around"] = timing.turn_around if isinstance(timing, TwoWay) else None
    out["source_level_db"] = None if detector is None else detector.sonar.source_level_db
    out["noise_level_db"] = None if detector is None else detector.sonar.noise_level_db
    return out


def _in_water(medium: Medium) -> Array:
    """
    Sound speeds at grid points in the water, and at the sea bed and the surface below and above
    them. [m/s]
    """
    north, east = (x.ravel() for x in np.meshgrid(medium.north, medium.east, indexing="ij"))
    columns = np.stack([north, east], axis=-1)
    top, bed = (
        depth[:, None] for depth in (medium.surface_depth(columns), medium.bottom_depth(columns))
    )
    speed = medium.sound_speed.reshape(len(columns), -1)
    ends = [
        medium.sound_speed_at(np.column_stack([columns, depth]))
        for depth in (top, np.minimum(bed, medium.depth[-1]))
    ]
    inside = speed[(medium.depth >= top) & (medium.depth <= bed)]
    return np.concatenate([inside, *(values[np.isfinite(values)] for values in ends)])


def _ends(values: Array) -> list[float]:
    """Smallest and largest value."""
    return [float(values.min()), float(values.max())]
