"""Shape of the Earth below a survey, and its tangent plane in water with a curved surface."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.options import Earth, EarthOption
from pymantaray.apps.locate.survey import Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.geometry import EarthSphere
from pymantaray.geometry.tangent_plane import TangentPlane

_MEAN_RADIUS = 6371e3  # m; the radius of curvature of WGS 84 differs by up to 0.6 %
_FLAT_LIMIT = 0.02  # m of depth
_LEAST_DISTANCE = 1.0  # m; horizontal distance with a direction
_PREFERRED = 0.95  # probability of the shape that the pings prefer
_METRES = "positions are north and east, without latitude and longitude"


class WaterOnEarth(NamedTuple):
    """Medium on the Earth of a survey."""

    medium: Medium
    sentence: str
    on_sphere: Medium | None = None
    """The medium on a sphere, if the survey does not say whether it is flat."""

    def decided(self, earths: Mapping[Earth, float], deeper: float) -> str:
        """
        Sentence about the Earth after the solution.

        ``earths`` has the probability of each possible shape, and ``deeper`` [m] is the depth on a
        sphere minus that on a plane.
        """
        if self.on_sphere is None:
            return self.sentence
        best = max(earths, key=lambda earth: earths[earth])
        names = {"flat": "flat", "sphere": f"sphere of {1e-3 * _MEAN_RADIUS:,.0f} km"}
        other = "sphere" if best == "flat" else "flat"
        difference = f"on the sphere, depths are {deeper:+.2g} m"
        advice = f"{difference}; state `earth='flat'` or `earth='sphere'` if it is known"
        if earths[best] < _PREFERRED:
            return (
                f"Earth: flat or sphere, averaged (probability of the sphere"
                f" {earths['sphere']:.2f}), because {_METRES}; {advice}"
            )
        return (
            f"Earth: {names[best]}, which the pings prefer to {names[other]} (probability"
            f" {_percent(earths[best])}); {_METRES}; {advice}"
        )


def _percent(probability: float) -> str:
    """Probability without the impression of certainty."""
    return "above 0.999" if probability > 0.999 else f"{probability:.3f}"


def medium_on_earth(survey: Survey, medium: Medium, earth: EarthOption) -> WaterOnEarth:
    """Medium on the Earth of a survey; both shapes if the survey does not say which."""
    # depth of the curved sea surface below the tangent plane, at the farthest ping
    node = np.array([node.position for node in survey.nodes])
    partner = node[np.maximum(survey.partner, 0)]
    start = np.where(survey.between_nodes[:, None], partner, survey.transmit_position)
    step = start - node[survey.node]
    farthest = float(np.hypot(step[:, 0], step[:, 1]).max())
    drop = farthest**2 / (2.0 * _MEAN_RADIUS)
    distance = f"{drop:.2g} m at the farthest ping ({1e-3 * farthest:.1f} km)"
    frame = survey.frame
    is_plane = survey.depth_reference == "plane"
    if earth == "flat":
        reason = f"as requested; a curved sea surface is lower by {distance}"
        return WaterOnEarth(medium.with_earth(None), f"Earth: flat, {reason}")
    if frame is None and is_plane:
        raise LocateError(
            f"{survey.source}: depths below a tangent plane need the latitude and longitude of"
            " its origin; state its frame"
        )
    if frame is None and earth == "auto" and medium.earth is None:
        on_sphere = medium.with_earth(EarthSphere(_MEAN_RADIUS)) if drop > _FLAT_LIMIT else None
        reason = f"because {_METRES}; a curved sea surface is lower by {distance}"
        return WaterOnEarth(medium, f"Earth: flat, {reason}", on_sphere)
    if frame is None:
        sphere = medium.earth or EarthSphere(_MEAN_RADIUS)
        reason = "as requested" if earth == "sphere" else "that of the water"
    else:
        sphere = medium.earth or EarthSphere.at_latitude(frame.latitude_deg)
        reason = (
            "because positions are geographic and depths are below the sea surface, which is lower"
            f" by {distance}"
        )
    if is_plane:
        reason = (
            "with positions and depths in the tangent plane of the origin, below which the sea"
            f" surface is lower by {distance}"
        )
    name = f"sphere of {1e-3 * sphere.radius:,.0f} km"
    return WaterOnEarth(medium.with_earth(sphere), f"Earth: {name}, {reason}")


def in_water(survey: Survey, medium: Medium, position: Array) -> Array:
    """Positions (n, 3) of a survey in the frame of the water: north, east, depth. [m]"""
    if survey.frame is None or survey.depth_reference != "plane" or medium.earth is None:
        return position
    return TangentPlane(survey.frame).to_frame(position)


def water_ends(survey: Survey, medium: Medium, first: Array, second: Array) -> tuple[Array, Array]:
    """
    Ends (n, 3) of links in the frame of the water. [m]

    The first end moves by millimetres, so that the straight distance on the sphere is that on the
    ellipsoid, whose curvature depends on the direction.
    """
    if survey.frame is None or medium.earth is None:
        return first, second
    plane = TangentPlane(survey.frame)
    if survey.depth_reference == "plane":
        straight = np.linalg.norm(first - second, axis=1)
        first, second = plane.to_frame(first), plane.to_frame(second)
    else:
        straight = np.linalg.norm(plane.from_frame(first) - plane.from_frame(second), axis=1)
    step = first[:, :2] - second[:, :2]
    squared_distance = np.maximum(np.sum(step**2, axis=1), _LEAST_DISTANCE**2)
    excess = straight - medium.earth.straight_distance(first, second)
    moved = first.copy()
    moved[:, :2] += (excess * straight / squared_distance)[:, None] * step
    return moved, second


def in_plane(survey: Survey, medium: Medium, position: Array, gradient: Array) -> Array:
    """
    Derivatives (n, 3) by the survey's coordinates from those by the coordinates of the water.

    ``position`` is that of the survey. The error is of second order in distance over the radius.
    """
    if survey.depth_reference != "plane" or medium.earth is None:
        return gradient
    north, east, down = (position / medium.earth.radius).T
    by_north, by_east, by_depth = gradient.T
    by_north = by_north * (1.0 + down)
    by_east = by_east * (1.0 + down)
    return np.column_stack(
        [
            by_north - north * by_depth,
            by_east - east * by_depth,
            by_depth + north * by_north + east * by_east,
        ]
    )
