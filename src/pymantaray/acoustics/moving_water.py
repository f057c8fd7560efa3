"""What a current does to travel times: the first-order change along each ray of the water at rest."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import AcousticsError

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
_GRID = ("north", "east", "depth")
_SWIFTEST = 10.0  # m/s; no current is faster, a unit is wrong


class Nodes(Protocol):
    """Quadrature points along rays, as `pymantaray.acoustics.quadrature` returns them."""

    @property
    def arrival(self) -> NDArray[np.int64]:
        """Row of the arrival that each point belongs to, shape (n,)."""

    @property
    def position(self) -> Array:
        """Place, shape (n, 3). [m]."""

    @property
    def slowness(self) -> Array:
        """Slowness vector along the ray, shape (n, 3). [s m⁻¹]."""

    @property
    def weight(self) -> Array:
        """Arc length that the point stands for, shape (n,). [m]."""


@dataclass(frozen=True, eq=False)
class Currents:
    """
    Horizontal current on a local grid.

    Parameters
    ----------
    north, east, depth : ndarray, shape (n_north,), (n_east,), (n_depth,)
        Axes, strictly increasing; an axis of one point means no variation along it. [m]
    velocity : ndarray, shape (n_north, n_east, n_depth, 2)
        Components to the north and to the east. [m s⁻¹]

    Raises
    ------
    AcousticsError
        If an axis does not increase, the shape does not fit, or a value is not finite or above 10 m/s.
    """

    north: Array
    east: Array
    depth: Array
    velocity: Array

    def __post_init__(self) -> None:
        """Check and freeze the arrays."""
        for name in (*_GRID, "velocity"):
            array = np.array(getattr(self, name), dtype=float)
            if name in _GRID and (array.ndim != 1 or not array.size or not (np.diff(array) > 0.0).all()):
                raise AcousticsError(
                    f"currents: axis {name!r} must be one-dimensional and strictly increasing"
                )
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        needed = (self.north.size, self.east.size, self.depth.size, 2)
        if self.velocity.shape != needed:
            raise AcousticsError(
                f"currents: velocity has shape {self.velocity.shape}; the axes ask for {needed}"
            )
        wrong = ~(np.abs(self.velocity) <= _SWIFTEST)
        if wrong.any():
            raise AcousticsError(
                f"currents: {np.count_nonzero(wrong)} components are not finite or above {_SWIFTEST:g} m/s;"
                " fill what is missing and check the units"
            )

    @classmethod
    def from_dataset(cls, ocean: "xr.Dataset") -> Self:
        """
        Currents of a local ocean data set.

        Parameters
        ----------
        ocean : xarray.Dataset
            ``current_north``, ``current_east`` (north, east, depth), as `pymantaray.ocean.to_local` makes
            them. [m s⁻¹]

        Returns
        -------
        Currents

        Raises
        ------
        AcousticsError
            If a variable or axis is missing, or for what `Currents` refuses.
        """
        names = ("current_north", "current_east")
        missing = [name for name in (*names, *_GRID) if name not in ocean.variables]
        if missing:
            raise AcousticsError(
                f"ocean data set lacks {', '.join(missing)}; make it with open_ocean and to_local"
            )
        north, east, depth = (ocean[name].values for name in _GRID)
        velocity = np.stack([ocean[name].transpose(*_GRID).values for name in names], axis=-1)
        return cls(north, east, depth, velocity)

    @classmethod
    def uniform(cls, north: float, east: float) -> Self:
        """
        One current everywhere.

        Parameters
        ----------
        north, east : float
            Its components. [m s⁻¹]

        Returns
        -------
        Currents
        """
        zero = np.zeros(1)
        return cls(zero, zero, zero, np.array([[[[north, east]]]]))

    def at(self, position: ArrayLike) -> Array:
        """
        Velocity of the water, trilinear between the grid points as the fleet drifts in it.

        Parameters
        ----------
        position : array_like, shape (n, 3)
            Beyond the grid the value at its edge holds. [m]

        Returns
        -------
        ndarray, shape (n, 3)
            North, east and down; the last is zero. [m s⁻¹]
        """
        place = np.asarray(position, dtype=float)
        (i, x), (j, y), (k, z) = (
            _cell(axis, place[:, d]) for d, axis in enumerate((self.north, self.east, self.depth))
        )
        out = np.zeros((len(place), 3))
        for di, wx in ((0, 1.0 - x), (1, x)):
            for dj, wy in ((0, 1.0 - y), (1, y)):
                for dk, wz in ((0, 1.0 - z), (1, z)):
                    corner = self.velocity[
                        np.minimum(i + di, self.north.size - 1),
                        np.minimum(j + dj, self.east.size - 1),
                        np.minimum(k + dk, self.depth.size - 1),
                    ]
                    out[:, :2] += (wx * wy * wz)[:, None] * corner
        return out


def current_delays(nodes: Nodes, currents: Currents, n_arrivals: int) -> Array:
    r"""
    First-order change of each arrival's travel time by the current along its ray.

    Parameters
    ----------
    nodes : Nodes
        Quadrature points of the rays, ``quadrature(trace_paths(...))``.
    currents : Currents
    n_arrivals : int
        Number of arrivals; one whose points stand for no length (equal positions) has no delay.

    Returns
    -------
    ndarray, shape (n_arrivals,)
        To be added to ``travel_time``, from source to receiver. From receiver to source the change has
        the opposite sign. [s]

    Notes
    -----
    In water that moves with velocity :math:`u` the eikonal equation is
    :math:`c |p| + u \cdot p = 1`, :math:`p` the slowness. To first order in :math:`u / c` travel time
    changes by minus the integral, over the time along the ray at rest, of what :math:`u` adds to the
    Hamiltonian on the left:

    .. math:: \delta t = -\int u \cdot p \, dt = -\int \frac{u \cdot \hat s}{c^2} \, ds .

    The ray itself moves, but between fixed ends that acts in second order only (Fermat). Neglected on the
    unmoved ray: at most :math:`(u / c)^2 t`, 0.2 mm at 10 km for 0.2 m/s. Neglected with the ray's shift,
    away from caustics: about :math:`\kappa^2 L^3 / 24 c` for a path of length :math:`L` with the extra
    curvature :math:`\kappa = |\nabla \times u| / c`; see the theory page for figures. A boundary reflects
    without a change in time, the water beside it moves along it.

    Derived in the theory page on timing; the same first-order formula underlies reciprocal tomography
    (Munk, Worcester and Wunsch, *Ocean Acoustic Tomography*, 1995; known to the author at second hand only).
    """
    p = np.asarray(nodes.slowness, dtype=float)
    weight = np.asarray(nodes.weight, dtype=float)
    rate = np.einsum("ij,ij->i", currents.at(nodes.position), p) * np.linalg.norm(p, axis=-1)
    change = np.where(weight > 0.0, -rate * weight, 0.0)  # between equal positions slowness is NaN
    row = np.asarray(nodes.arrival, dtype=np.int64)
    return np.bincount(row, weights=change, minlength=n_arrivals).astype(float)


def _cell(axis: Array, x: Array) -> tuple[NDArray[np.int64], Array]:
    """Index of the grid point below each coordinate and the fraction of the cell above it, both clamped."""
    if axis.size == 1:
        return np.zeros(x.size, dtype=np.int64), np.zeros(x.size)
    i = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, axis.size - 2)
    return i.astype(np.int64), np.clip((x - axis[i]) / (axis[i + 1] - axis[i]), 0.0, 1.0)
