"""Tangent plane of the ellipsoid: north, east and down along straight axes."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pymantaray.arrays import Array
from pymantaray.geometry.frames import LocalFrame
from pymantaray.geometry.longitude import wrap_longitude

if TYPE_CHECKING:
    import pyproj


class TangentPlane:
    """
    Plane that touches WGS 84 at the centre of a local frame.

    Its axes north, east and down are straight, so the sea surface is below the plane by about r² /
    2R at the distance r: 1.26 m at 4 km.

    Parameters
    ----------
    frame : LocalFrame
        Frame with the same centre.
    """

    def __init__(self, frame: LocalFrame) -> None:
        self._frame = frame

    @cached_property
    def _transformer(self) -> pyproj.Transformer:
        import pyproj

        return pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84"
            f" +lat_0={self._frame.latitude_deg!r} +lon_0={self._frame.longitude_deg!r} +h_0=0"
        )

    def to_geodetic(self, position: Array) -> tuple[Array, Array, Array]:
        """
        Convert positions in the plane to latitude, longitude and depth below the ellipsoid.

        Parameters
        ----------
        position : ndarray, shape (n, 3)
            North, east, down. [m]

        Returns
        -------
        latitude_deg, longitude_deg, depth : ndarray, shape (n,)
            [degrees, degrees, m]
        """
        north, east, down = np.asarray(position, dtype=float).T
        longitude, latitude, height = self._transformer.transform(
            east, north, -down, direction="INVERSE"
        )
        offset = wrap_longitude(np.asarray(longitude) - self._frame.longitude_deg)
        return np.asarray(latitude), self._frame.longitude_deg + offset, -np.asarray(height)

    def to_frame(self, position: Array, frame: LocalFrame | None = None) -> Array:
        """
        Convert positions in the plane to a local frame, with depths below the ellipsoid.

        Parameters
        ----------
        position : ndarray, shape (n, 3)
            North, east, down; rows with NaN stay NaN. [m]
        frame : LocalFrame, optional
            Frame of the result. Default: the one with the same centre.

        Returns
        -------
        ndarray, shape (n, 3)
            North, east, depth. [m]
        """
        out = np.full(np.shape(position), np.nan)
        rows = np.isfinite(position).all(axis=-1)
        lat, lon, depth = self.to_geodetic(position[rows])
        out[rows] = np.column_stack([*(frame or self._frame).to_local(lat, lon), depth])
        return out

    def from_frame(self, position: Array) -> Array:
        """
        Convert positions in the local frame with the same centre to the plane.

        Parameters
        ----------
        position : ndarray, shape (n, 3)
            North, east, depth below the ellipsoid. [m]

        Returns
        -------
        ndarray, shape (n, 3)
            North, east, down. [m]
        """
        lat, lon = self._frame.to_geodetic(position[:, 0], position[:, 1])
        east, north, up = self._transformer.transform(lon, lat, -position[:, 2])
        return np.column_stack([north, east, -np.asarray(up)])
