"""Local NED frame on the ellipsoid: a conformal azimuthal projection around a centre."""

from __future__ import annotations

import math
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import GeometryError
from pymantaray.geometry.longitude import wrap_longitude

if TYPE_CHECKING:
    import pyproj

_TURNS = 720.0  # degrees; a longitude in another turn, but not a wrong number


@cache
def ellipsoid() -> pyproj.Geod:
    """WGS 84."""
    import pyproj

    return pyproj.Geod(ellps="WGS84")


class LocalFrame:
    """
    Local frame with axes north and east at the centre, depth positive down.

    The projection is the oblique stereographic projection on WGS 84 by way of the conformal sphere
    that touches the ellipsoid at the centre (PROJ's ``sterea``). Its scale is stationary at the
    centre, whereas the scale of ``stere`` has a gradient of 3e-10 per metre in the Arctic. The
    projection preserves angles, so a rotation by the meridian convergence converts current vectors.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        Centre of the frame, where the scale is 1 and grid north is true north. [degrees]

    Examples
    --------
    >>> frame = LocalFrame(78.0, 0.0)
    >>> north, east = frame.to_local(78.0, 0.0)
    >>> print(abs(float(north)) < 1e-6, abs(float(east)) < 1e-6)
    True True
    """

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        if (
            not (math.isfinite(latitude_deg) and math.isfinite(longitude_deg))
            or abs(latitude_deg) > 90.0
            or abs(longitude_deg) > _TURNS
        ):
            raise GeometryError(
                f"frame centre: latitude {latitude_deg}, longitude {longitude_deg}; both must be"
                f" finite, latitude must be -90 to 90 and longitude -{_TURNS:g} to {_TURNS:g}"
                " degrees"
            )
        self.latitude_deg = float(latitude_deg)
        self.longitude_deg = float(wrap_longitude(longitude_deg))

    @property
    def proj_string(self) -> str:
        """PROJ definition of the horizontal frame."""
        return (
            f"+proj=sterea +lat_0={self.latitude_deg!r} +lon_0={self.longitude_deg!r} +k_0=1 +x_0=0"
            " +y_0=0 +ellps=WGS84 +units=m +no_defs"
        )

    @cached_property
    def _proj(self) -> pyproj.Proj:
        import pyproj

        return pyproj.Proj(self.proj_string)

    def to_local(self, latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> tuple[Array, Array]:
        """
        Convert latitude and longitude to local coordinates.

        Parameters
        ----------
        latitude_deg, longitude_deg : array_like, shape (...)
            Positions; longitude in any 360 degree window. They broadcast. [degrees]

        Returns
        -------
        north, east : ndarray, shape (...)
            [m]
        """
        longitude, latitude = np.broadcast_arrays(
            np.asarray(longitude_deg, dtype=float), np.asarray(latitude_deg, dtype=float)
        )
        x, y = self._proj(longitude, latitude)
        return np.asarray(y, dtype=float), np.asarray(x, dtype=float)

    def to_geodetic(self, north: ArrayLike, east: ArrayLike) -> tuple[Array, Array]:
        """
        Convert local coordinates to latitude and longitude.

        Parameters
        ----------
        north, east : array_like, shape (...)
            Local coordinates. They broadcast. [m]

        Returns
        -------
        latitude_deg, longitude_deg : ndarray, shape (...)
            Longitude is within 180 degrees of the centre. [degrees]
        """
        n, e = np.broadcast_arrays(np.asarray(north, dtype=float), np.asarray(east, dtype=float))
        longitude, latitude = self._proj(e, n, inverse=True)
        offset = wrap_longitude(np.asarray(longitude, dtype=float) - self.longitude_deg)
        return np.asarray(latitude, dtype=float), self.longitude_deg + offset

    def convergence(self, latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> Array:
        """
        Meridian convergence: bearing of true north in the frame, clockwise from grid north.

        Parameters
        ----------
        latitude_deg, longitude_deg : array_like, shape (...)
            Positions. They broadcast. [degrees]

        Returns
        -------
        ndarray, shape (...)
            [rad]

        Notes
        -----
        A vector with components ``(v_east, v_north)`` on the sphere has local components ``north =
        v_north cos(g) - v_east sin(g)`` and ``east = v_north sin(g) + v_east cos(g)``. The
        convergence is a central difference of the projection along the meridian. With a step of
        1e-4 degrees, its error is below 1e-9 rad.
        """
        latitude = np.asarray(latitude_deg, dtype=float)
        step = 1e-4
        lo = np.clip(latitude - step, -90.0, 90.0)
        hi = np.clip(latitude + step, -90.0, 90.0)
        n0, e0 = self.to_local(lo, longitude_deg)
        n1, e1 = self.to_local(hi, longitude_deg)
        return np.asarray(np.arctan2(e1 - e0, n1 - n0))

    def scale_factor(self, north: ArrayLike, east: ArrayLike) -> Array:
        """
        Local metres per metre on the ellipsoid; 1 at the centre.

        Parameters
        ----------
        north, east : array_like, shape (...)
            Local coordinates. They broadcast. [m]

        Returns
        -------
        ndarray, shape (...)
            [-]
        """
        latitude, longitude = self.to_geodetic(north, east)
        factors = self._proj.get_factors(longitude, latitude, errcheck=False)
        return np.asarray(factors.meridional_scale, dtype=float)
