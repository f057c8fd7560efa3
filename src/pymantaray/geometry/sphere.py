"""The Earth as a sphere in the local frame: flattened depths and distances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import GeometryError

Earth = Literal["flat", "sphere"]
"""Shape of the Earth for sound: a plane below the local frame, or a sphere."""
_EQUATOR = 6378137.0  # m, WGS 84
_SQUARED_ECCENTRICITY = 0.0066943799901413165
_FLAT_LIMIT = 15e3  # m
# m over m³; of ranges where the sound speed increases with pressure, see `flat_earth_note`
_FLAT_ERROR = 0.15 / 1e4**3


def flat_earth_note(longest: float, farthest: float = 0.0) -> str | None:
    """
    Return a sentence about the error of a flat Earth, None for links and trajectories within 15 km.

    The curvature acts like a gradient c / R of the sound speed. Where the gradient g is that of
    pressure, it changes ranges over a distance d by about d^3 g / (12 c R): 0.15 m at 10 km, 3.9 m
    at 30 km.

    Parameters
    ----------
    longest : float
        Length of the longest link. [m]
    farthest : float
        Greatest horizontal distance of a trajectory from the centre of the frame. [m]

    Returns
    -------
    str or None
    """
    if not (longest > _FLAT_LIMIT or farthest > _FLAT_LIMIT):
        return None
    error = _FLAT_ERROR * longest**3
    amount = f"up to about {error:,.1f}" if error >= 0.1 else "less than 0.1"
    links = f"links are up to {1e-3 * longest:.1f} km long"
    subject = links.capitalize()
    if farthest > _FLAT_LIMIT:
        subject = (
            f"Trajectories extend to {1e-3 * farthest:.1f} km from the centre of the frame, and"
            f" {links}"
        )
    return (
        f"{subject}: on a flat Earth, their ranges are too long by {amount} m; use `earth='sphere'`"
        " (in a study: acoustics.earth)."
    )


@dataclass(frozen=True)
class EarthSphere:
    r"""
    Sphere that touches the ellipsoid at the centre of a local frame, and its flattened ocean.

    In a vertical plane, a point at the distance :math:`r` from the Earth's centre and the angle
    :math:`\theta` has
    :math:`ds^2 = dr^2 + r^2 d\theta^2 = (r / R)^2 (dx'^2 + dz'^2)` with :math:`x' = R \theta` and
    :math:`z' = R \ln(R / r)`. Therefore rays in flat water with the depths :math:`z'` and the sound
    speed
    :math:`c' = c R / r` have the travel times and angles of rays in spherical water.

    Parameters
    ----------
    radius : float
        Radius of the sphere. [m]

    Raises
    ------
    GeometryError
        If the radius is not positive.

    Examples
    --------
    >>> earth = EarthSphere.at_latitude(78.0)
    >>> print(round(earth.radius))
    6397730
    >>> depth = earth.flattened_depth(1000.0)
    >>> print(round(float(depth - 1000.0), 3), round(float(earth.true_depth(depth)), 6))
    0.078 1000.0
    """

    radius: float

    def __post_init__(self) -> None:
        """Check the radius."""
        if not (self.radius > 0.0 and math.isfinite(self.radius)):
            raise GeometryError(
                f"radius of the Earth is {self.radius} m; it must be positive and finite"
            )

    @classmethod
    def at_latitude(cls, latitude_deg: float) -> Self:
        """
        Return the sphere with the Gaussian radius of curvature of WGS 84 at a latitude.

        Parameters
        ----------
        latitude_deg : float
            Latitude. [degrees]

        Returns
        -------
        EarthSphere
        """
        w = 1.0 - _SQUARED_ECCENTRICITY * math.sin(math.radians(latitude_deg)) ** 2
        return cls(_EQUATOR * math.sqrt(1.0 - _SQUARED_ECCENTRICITY) / w)

    def flattened_depth(self, depth: ArrayLike) -> Array:
        """
        Convert depths below the surface to depths in flattened water.

        Parameters
        ----------
        depth : array_like, shape (...)
            Depths below the surface. [m]

        Returns
        -------
        ndarray, shape (...)
            Depths in flattened water. [m]
        """
        return np.asarray(-self.radius * np.log1p(-np.asarray(depth, dtype=float) / self.radius))

    def true_depth(self, flattened: ArrayLike) -> Array:
        """
        Convert depths in flattened water to depths below the surface.

        Parameters
        ----------
        flattened : array_like, shape (...)
            Depths in flattened water. [m]

        Returns
        -------
        ndarray, shape (...)
            Depths below the surface. [m]
        """
        return np.asarray(
            -self.radius * np.expm1(-np.asarray(flattened, dtype=float) / self.radius)
        )

    def stretch(self, depth: ArrayLike) -> Array:
        """
        Length in flattened water over true length at a depth, the same in all directions.

        Parameters
        ----------
        depth : array_like, shape (...)
            Depths below the surface. [m]

        Returns
        -------
        ndarray, shape (...)
            Ratio, 1 at the surface. [-]
        """
        return np.asarray(self.radius / (self.radius - np.asarray(depth, dtype=float)))

    def surface_distance(self, source: Array, receiver: Array) -> Array:
        r"""
        Distance along the surface between positions in the local frame.

        Parameters
        ----------
        source, receiver : ndarray, shape (n, 3)
            North, east, down. [m]

        Returns
        -------
        ndarray, shape (n,)
            [m]

        Notes
        -----
        North and east are those of a stereographic projection. The chord between its points is
        :math:`d / \sqrt{(1 + a^2 / 4R^2)(1 + b^2 / 4R^2)}` for a distance d in the plane and the
        distances a and b from the centre.
        """
        step = np.hypot(receiver[:, 0] - source[:, 0], receiver[:, 1] - source[:, 1])
        scale = [
            1.0 + np.sum(end[:, :2] ** 2, axis=-1) / (4.0 * self.radius**2)
            for end in (source, receiver)
        ]
        half = step / (2.0 * self.radius * np.sqrt(scale[0] * scale[1]))
        return np.asarray(2.0 * self.radius * np.arcsin(half))

    def frame_distance(self, surface_distance: ArrayLike) -> Array:
        """
        Convert distances along the surface from the frame's centre to distances in the frame.

        Parameters
        ----------
        surface_distance : array_like, shape (...)
            Distances along the surface. [m]

        Returns
        -------
        ndarray, shape (...)
            Distances in the frame. [m]
        """
        return np.asarray(
            2.0 * self.radius * np.tan(np.asarray(surface_distance) / (2.0 * self.radius))
        )

    def straight_distance(self, source: Array, receiver: Array) -> Array:
        """
        Length of the straight line through the Earth between positions in the local frame.

        Parameters
        ----------
        source, receiver : ndarray, shape (n, 3)
            North, east, down. [m]

        Returns
        -------
        ndarray, shape (n,)
            Distance. [m]
        """
        angle = self.surface_distance(source, receiver) / self.radius
        source_radius = self.radius - source[:, 2]
        receiver_radius = self.radius - receiver[:, 2]
        return np.asarray(
            np.hypot(
                receiver_radius - source_radius,
                2.0 * np.sqrt(source_radius * receiver_radius) * np.sin(0.5 * angle),
            )
        )

    def flattened_ends(self, source: Array, receiver: Array) -> tuple[Array, Array]:
        """
        Ends of links in flattened water.

        Their horizontal distance is that along the surface, about the same middle and in the same
        direction as in the frame.

        Parameters
        ----------
        source, receiver : ndarray, shape (n, 3)
            North, east, down in the local frame. [m]

        Returns
        -------
        source, receiver : ndarray, shape (n, 3)
            North, east, flattened depth. [m]
        """
        step = receiver[:, :2] - source[:, :2]
        distance = np.hypot(step[:, 0], step[:, 1])
        surface = self.surface_distance(source, receiver)
        ratio = np.divide(surface, distance, out=np.ones_like(distance), where=distance > 0.0)
        displacement = (0.5 * (1.0 - ratio))[:, None] * step
        return tuple(  # type: ignore[return-value]
            np.column_stack([end[:, :2] + sign * displacement, self.flattened_depth(end[:, 2])])
            for end, sign in ((source, 1.0), (receiver, -1.0))
        )
