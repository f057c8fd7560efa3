"""
Centre of a local frame from satellite fixes (latitude and longitude) of vehicles with known local
positions.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.exchange.centre import Centre
from pymantaray.geometry import LocalFrame

_MAX_ORIGIN_SPREAD = 10.0  # m; fixes of a frame's origin have a smaller spread
_MAX_PAIRS = 500
_ITERATIONS = 10


class Fixes(NamedTuple):
    """Satellite fixes with a solution, from one topic or file."""

    time: Indices
    """[ns]"""
    latitude: Array
    """[degrees]"""
    longitude: Array
    """[degrees]"""
    frame: str
    """Name of the frame whose origin has these positions."""


class FrameCentre(NamedTuple):
    """Centre of a local frame, and its spread over single fixes."""

    centre: Centre
    fixes: int
    spread: float
    """Greatest distance between the centre and the centre from a single fix. [m]"""


def origin_of_frame(fixes: Sequence[Fixes]) -> FrameCentre | None:
    """Centre from fixes of the frame's own origin; None if there are none, or if they move."""
    if not fixes:
        return None
    latitude = np.concatenate([f.latitude for f in fixes])
    longitude = np.concatenate([f.longitude for f in fixes])
    found = _middle(latitude, longitude)
    return found if found.spread < _MAX_ORIGIN_SPREAD else None


def centre_from_fixes(
    pairs: Sequence[tuple[Indices, Array, Fixes]],
) -> FrameCentre | None:
    """
    Centre of the frame of local positions, from the fixes of vehicles.

    Each entry has the times [ns] and positions (n, 3), north, east, down [m], of one vehicle, and
    its fixes. Positions are interpolated to the times of the fixes. Only fixes between the first
    and last position are used.
    """
    points = np.concatenate([np.empty((0, 4)), *(_at_fixes(*pair) for pair in pairs)])
    if not points.size:
        return None
    few = np.unique(np.linspace(0, len(points) - 1, min(len(points), _MAX_PAIRS)).astype(int))
    centres = [_centre_of(*map(float, point)) for point in points[few]]
    return _middle(*np.transpose(centres))


def _at_fixes(time: Indices, place: Array, fixes: Fixes) -> Array:
    """
    North, east [m], latitude and longitude [degrees] (n, 4) at the fixes between the first
    position and the last.
    """
    inside = (fixes.time >= time.min()) & (fixes.time <= time.max())
    order = np.argsort(time, kind="stable")
    at = (fixes.time[inside] - time.min()) * 1e-9
    own = (time[order] - time.min()) * 1e-9
    north, east = (np.interp(at, own, place[order, k]) for k in (0, 1))
    return np.column_stack([north, east, fixes.latitude[inside], fixes.longitude[inside]])


def _centre_of(north: float, east: float, latitude: float, longitude: float) -> Centre:
    """Centre of the frame in which a geographic position has these local coordinates."""
    frame = LocalFrame(latitude, longitude)
    step = -north, -east
    for _ in range(_ITERATIONS):
        lat, lon = frame.to_geodetic(*step)
        frame = LocalFrame(float(lat), float(lon))
        there = frame.to_local(latitude, longitude)
        step = float(there[0]) - north, float(there[1]) - east
    return frame.latitude_deg, frame.longitude_deg


def _middle(latitude: Array, longitude: Array) -> FrameCentre:
    """Median of adjacent positions, and the greatest distance from it."""
    about = LocalFrame(float(latitude[0]), float(longitude[0]))
    places = np.stack(about.to_local(latitude, longitude), axis=-1)
    middle = np.median(places, axis=0)
    spread = float(np.linalg.norm(places - middle, axis=-1).max())
    if spread == 0.0:
        return FrameCentre((float(latitude[0]), float(longitude[0])), latitude.size, 0.0)
    lat, lon = about.to_geodetic(*middle)
    return FrameCentre((float(lat), float(lon)), latitude.size, spread)
