"""Boundary of the water, the sea bed or the sea surface with ice, and its reflection of sound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import GeometryError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.geometry.roughness import Roughness
from pymantaray.quantities.checks import Error, checked_array, distinct_digits

if TYPE_CHECKING:
    import xarray as xr

    from pymantaray.geometry.boundary_kernels import BoundaryGrid

_SLACK = 1e-6  # of the water's extent; a boundary may end this far inside its edge
_AXES = ("floor_north", "floor_east"), ("north", "east")


class Reflection(Protocol):
    """Reflection of a plane wave at a boundary."""

    def loss_and_phase(
        self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike
    ) -> tuple[Array, Array]:
        """
        Loss and phase of each reflection, with time as exp(-i omega t).

        Parameters
        ----------
        grazing_angle : array_like, shape (n,)
            Grazing angles. [rad]
        frequency_hz : float
            Frequency. [Hz]
        sound_speed : array_like, shape (n,)
            Sound speed of the water at the boundary. [m/s]

        Returns
        -------
        loss : ndarray, shape (n,)
            Loss. [dB]
        phase : ndarray, shape (n,)
            Phase. [rad]
        """
        ...


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BoundarySurface:
    """
    Depth of the sea bed or of the sea surface on a grid, and its reflection of sound.

    Parameters
    ----------
    depth : float or array_like, shape (n_north, n_east)
        Depth, positive down, bilinear between the grid points; one value if it is the same
        everywhere. [m]
    north, east : array_like, shape (n_north,), (n_east,)
        Axes, strictly increasing; one point if the depth does not vary along the axis. [m]
    reflection : Reflection, optional
        Loss and phase of a reflection, such as `pymantaray.acoustics.FluidBottom`. Without one, the
        boundary reflects all sound: the sea bed without a change of phase, the surface with phase
        pi.
    roughness : Roughness, optional
        Random elevation about the depth, for rays only. Positions and vehicles are limited by the
        depth itself.

    Raises
    ------
    GeometryError
        If a value is not finite, an axis does not increase, or the shapes differ.

    Examples
    --------
    >>> from pymantaray.acoustics import BoundarySurface
    >>> bed = BoundarySurface([[900.0], [1100.0]], north=[0.0, 5000.0])
    >>> print(bed.depth_at([[2500.0, 0.0, 0.0]]))
    [1000.]
    """

    depth: Array
    north: Array
    east: Array
    reflection: Reflection | None
    roughness: Roughness | None

    def __init__(
        self,
        depth: ArrayLike,
        north: ArrayLike = (0.0,),
        east: ArrayLike = (0.0,),
        reflection: Reflection | None = None,
        roughness: Roughness | None = None,
    ) -> None:
        fields: dict[str, object] = {"reflection": reflection, "roughness": roughness}
        shape = []
        for name, axis in (("north", north), ("east", east)):
            points = checked_array(GeometryError, f"boundary: {name}", axis, (None,), rising=True)
            fields[name] = points
            shape.append(points.size)
        values = np.full((1, 1), depth) if np.ndim(depth) == 0 else depth
        fields["depth"] = checked_array(GeometryError, "boundary: depth", values, tuple(shape))
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        size = " x ".join(str(n) for n in self.depth.shape)
        loss = "" if self.reflection is None else f", {self.reflection!r}"
        rough = "" if self.roughness is None else f", rough by {self.roughness.height:.3g} m"
        return (
            f"<BoundarySurface {size}, {self.depth.min():g} to {self.depth.max():g} m{rough}{loss}>"
        )

    @classmethod
    def from_dataset(cls, ocean: xr.Dataset, name: str, exception: Error = GeometryError) -> Self:
        """
        Make a boundary from a variable of a local ocean.

        Parameters
        ----------
        ocean : xarray.Dataset
            Ocean on a local grid.
        name : str
            Variable on (floor_north, floor_east) or (north, east), or with one value. [m]
        exception : type of exception
            Class of the error for a variable that is not allowed.

        Returns
        -------
        BoundarySurface
        """
        variable = ocean[name]
        if variable.ndim == 0:
            return cls(variable.item())
        dims = next((pair for pair in _AXES if set(variable.dims) == set(pair)), None)
        if dims is None:
            raise exception(
                f"ocean: {name} has dimensions {variable.dims}; it needs (north, east), or axes of"
                " its own, (floor_north, floor_east)"
            )
        depth = np.asarray(variable.transpose(*dims).values, dtype=float)
        if missing := np.count_nonzero(~np.isfinite(depth)):
            raise exception(
                f"ocean: {name} has {missing} missing values; none are allowed: fill it with"
                " pymantaray.ocean.to_local"
            )
        north, east = (
            checked_array(
                exception, f"ocean: axis {dim!r}", ocean[dim].values, (None,), rising=True
            )
            for dim in dims
        )
        return cls(depth, north, east)

    def with_roughness(self, roughness: Roughness | None) -> Self:
        """
        Return the same boundary with another roughness.

        Parameters
        ----------
        roughness : Roughness or None
            Random elevation about the depth; None for a smooth boundary.

        Returns
        -------
        BoundarySurface
        """
        return type(self)(self.depth, self.north, self.east, self.reflection, roughness)

    def check_extent(self, north: Array, east: Array, *, name: str, exception: Error) -> None:
        """
        Raise an error if the boundary does not extend over water.

        Parameters
        ----------
        north, east : ndarray, shape (n,)
            Axes of the water. [m]
        name : str
            Name of the boundary for the message.
        exception : type of exception
            Class of the error.
        """
        for direction, axis, water in (("north", self.north, north), ("east", self.east, east)):
            slack = _SLACK * max(np.ptp(water), 1.0)
            if axis.size > 1 and (axis[0] > water[0] + slack or axis[-1] < water[-1] - slack):
                first, last, low, high = distinct_digits(axis[0], axis[-1], water[0], water[-1])
                raise exception(
                    f"{name}: {direction} {first} to {last} m; it must extend over the water,"
                    f" {low} to {high} m"
                )

    @cached_property
    def _look_up(self) -> Callable[[ArrayLike], Array]:
        return linear_interpolator((self.north, self.east), self.depth)

    def depth_at(self, position: ArrayLike) -> Array:
        """
        Depth at positions.

        Parameters
        ----------
        position : array_like, shape (n, 2), (n, 3) or one position
            North, east and, without effect, down. [m]

        Returns
        -------
        ndarray, shape (n,)
            Bilinear between the grid points, constant beyond the edges. [m]
        """
        return self._look_up(np.atleast_2d(np.asarray(position, dtype=float))[:, :2])

    @property
    def nodes(self) -> Array:
        """Positions (n, 2) of the grid points. [m]"""
        return np.stack(np.meshgrid(self.north, self.east, indexing="ij"), axis=-1).reshape(-1, 2)

    @property
    def grid(self) -> BoundaryGrid:
        """Depth and axes as the kernels take them."""
        from pymantaray.geometry.boundary_kernels import BoundaryGrid

        return BoundaryGrid(self.depth, self.north, self.east)


def as_boundary(
    depth: BoundarySurface | ArrayLike, north: Array, east: Array, *, name: str, error: Error
) -> BoundarySurface:
    """
    Boundary over axes of water [m], from a boundary, one depth, or depths at the grid points. [m]

    Name and error are for refusals.
    """
    if isinstance(depth, BoundarySurface):
        depth.check_extent(north, east, name=name, exception=error)
        return depth
    if np.ndim(depth) == 0:
        return BoundarySurface(checked_array(error, name, np.full((1, 1), depth), (1, 1)))
    return BoundarySurface(checked_array(error, name, depth, (north.size, east.size)), north, east)
