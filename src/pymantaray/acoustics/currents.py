"""Currents, and their first-order effect on travel times along the rays in water at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.acoustics.medium import Medium, require_local
from pymantaray.acoustics.paths import Quadrature, quadrature, trace_paths
from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.quantities.checks import checked_array
from pymantaray.records import Arrivals

if TYPE_CHECKING:
    import xarray as xr

_GRID = ("north", "east", "depth")
_SWIFTEST = 10.0  # m/s; faster currents have a wrong unit


@dataclass(frozen=True, eq=False)
class Currents:
    """
    Horizontal current on a local grid.

    Parameters
    ----------
    north, east, depth : ndarray, shape (n_north,), (n_east,), (n_depth,)
        Strictly increasing axes; a current does not vary along an axis with one point. [m]
    velocity : ndarray, shape (n_north, n_east, n_depth, 2)
        Northward and eastward components. [m/s]

    Examples
    --------
    >>> from pymantaray.acoustics import Currents
    >>> print(Currents.uniform(0.3, 0.0).at([[0.0, 0.0, 100.0]]))
    [[0.3 0.  0. ]]
    """

    north: Array
    east: Array
    depth: Array
    velocity: Array

    def __post_init__(self) -> None:
        for name in _GRID:
            axis = checked_array(
                AcousticsError, f"currents: {name}", getattr(self, name), (None,), rising=True
            )
            object.__setattr__(self, name, axis)
        shape = (self.north.size, self.east.size, self.depth.size, 2)
        velocity = checked_array(AcousticsError, "currents: velocity", self.velocity, shape)
        object.__setattr__(self, "velocity", velocity)
        wrong = ~(np.abs(self.velocity) <= _SWIFTEST)
        if wrong.any():
            raise AcousticsError(
                f"currents: {np.count_nonzero(wrong)} components are above {_SWIFTEST:g} m/s;"
                " check the units"
            )

    def __repr__(self) -> str:
        n, e, z = (axis.size for axis in (self.north, self.east, self.depth))
        return f"<Currents {n} x {e} x {z}, up to {np.hypot(*self.velocity.T).max():.2g} m/s>"

    @classmethod
    def from_dataset(cls, ocean: xr.Dataset) -> Self:
        """
        Return the currents of a local ocean.

        Parameters
        ----------
        ocean : xarray.Dataset
            Data set from `pymantaray.ocean.to_local`, with ``current_north`` and ``current_east``
            on (north, east, depth). [m/s]

        Returns
        -------
        Currents
        """
        names = ("current_north", "current_east")
        require_local(ocean, *names, *_GRID)
        velocity = np.stack([ocean[name].transpose(*_GRID).values for name in names], axis=-1)
        north, east, depth = (ocean[name].values for name in _GRID)
        return cls(north, east, depth, velocity)

    @classmethod
    def uniform(cls, current_north: float, current_east: float) -> Self:
        """
        Return a uniform current.

        Parameters
        ----------
        current_north, current_east : float
            Northward and eastward components. [m/s]

        Returns
        -------
        Currents
        """
        zero = np.zeros(1)
        return cls(zero, zero, zero, np.array([current_north, current_east]).reshape(1, 1, 1, 2))

    def at(self, position: ArrayLike) -> Array:
        """
        Return the velocity of the current at positions.

        Parameters
        ----------
        position : array_like, shape (n, 3)
            North, east, down. [m]

        Returns
        -------
        ndarray, shape (n, 3)
            Velocity, trilinear between grid points and constant beyond the edges; the downward
            component is 0. [m/s]
        """
        horizontal = linear_interpolator((self.north, self.east, self.depth), self.velocity)(
            position
        )
        return np.concatenate([horizontal, np.zeros((len(horizontal), 1))], axis=1)


def current_delays(nodes: Quadrature, currents: Currents, n_arrivals: int) -> Array:
    r"""
    Return the first-order change of each arrival's travel time by the current along its ray.

    Parameters
    ----------
    nodes : Quadrature
        Points along the rays, from `quadrature`.
    currents : Currents
        Current along the rays.
    n_arrivals : int
        Number of arrivals; ``nodes.arrival`` is less than this.

    Returns
    -------
    ndarray, shape (n_arrivals,)
        Delay to add to ``travel_time`` from source to receiver, and to subtract in the other
        direction; 0 between equal positions. [s]

    Notes
    -----
    :math:`\delta t = -\int u \cdot p \, dt` with the slowness :math:`p` along the ray in water at
    rest. The theory page on timing has the derivation and lists the neglected terms. Reflections do
    not contribute, because water moves along a boundary.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import Currents, current_delays, quadrature
    >>> delays = current_delays(quadrature(paths), Currents.uniform(0.3, 0.0), arrivals.link.size)
    >>> print((1e6 * delays).round(), "us")
    [-421. -422.] us
    """
    p = nodes.slowness
    rate = np.einsum("ij,ij->i", currents.at(nodes.position), p) * np.linalg.norm(p, axis=-1)
    # slowness is NaN between equal positions
    change = np.where(nodes.weight > 0.0, -rate * nodes.weight, 0.0)
    return np.bincount(nodes.arrival, weights=change, minlength=n_arrivals).astype(float)


def carried(
    medium: Medium,
    source: Array,
    receiver: Array,
    arrivals: Arrivals,
    currents: Currents,
    **options: Any,
) -> Arrivals:
    """
    Arrivals of links whose travel times include the delays of the current; options as for
    `trace_paths`.
    """
    paths = trace_paths(medium, source, receiver, arrivals, **options)
    delay = current_delays(quadrature(paths), currents, arrivals.link.size)
    return replace(arrivals, travel_time=arrivals.travel_time + delay)
