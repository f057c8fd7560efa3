"""Interpolation of an ocean from latitude and longitude to a regular grid in the local frame."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.geometry.splines import ACROSS_MARGIN, axis_spline
from pymantaray.ocean.grid_points import GridPoints
from pymantaray.ocean.names import Equation
from pymantaray.ocean.sea_floor import MIN_CELLS, levels_to, local_floor, sea_floor_depth
from pymantaray.ocean.window import Window, centred, rectangle

# grid points beyond the domain for interpolation; a point n away has the influence 0.268^n, here
# 1e-23
_SPLINE = 40
_MOST_OF_SPAN = 3.5  # at least r + r (1 + 2 r) for r = 0.9, see `AxisSpline.reach`


def to_local(
    ocean: xr.Dataset,
    centre: tuple[float, float] | None = None,
    half_extent: tuple[float, float] | None = None,
    *,
    sea_floor: xr.DataArray | None = None,
    equation: Equation = "teos-10",
) -> xr.Dataset:
    """
    Interpolate an ocean to sound speed, currents and sea floor on a regular grid in the local NED
    frame.

    Each node of the local grid is projected to its latitude and longitude and interpolated there,
    with a cubic tensor spline for sound speed and currents, and bilinearly for the sea floor. A
    constant number of metres per degree of longitude would be wrong by 12 % across the paper's Fram
    Strait.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean, see `validate_ocean`.
    centre : tuple of float, optional
        Latitude and longitude of the frame's centre. Default: the middle of the window. [degrees]
    half_extent : tuple of float, optional
        Half sides (north, east) of the domain around the centre. Default: those of the rectangle of
        largest area inside the window. [m]
    sea_floor : xarray.DataArray, optional
        From `open_sea_floor`. By default, the sea floor is where the ocean's levels end. [m]
    equation : str
        Equation of sound speed, see `sound_speed`.

    Returns
    -------
    xarray.Dataset
        Dimensions ``(north, east, depth)`` [m]; depth has the levels of the ocean. Variables
        ``sound_speed``, ``current_north``, ``current_east`` (components along the frame's axes)
        [m/s] and ``sea_floor_depth`` (north, east) [m]. Attributes ``centre_latitude_deg``,
        ``centre_longitude_deg``, ``proj_string``, ``scale_error_max`` (largest distortion of
        lengths in the domain), ``time``, ``title``, ``source``, ``synthetic``;
        ``sound_speed_bound`` is a note about sound speed that is linear, see Notes.

        A separate sea floor has its own axes ``(floor_north, floor_east)`` [m] with about the
        spacing of its file, or of the ocean if that is finer, and levels are added down to its
        deepest point. Attribute ``sea_floor_source`` names it.
        ``sea_floor_spacing`` [m] and ``levels_added`` [m] describe it. ``sound_speed_equation``
        names an equation other than TEOS-10.

    Raises
    ------
    OceanError
        If the ocean is invalid, or the domain does not fit into its window or the window of the sea
        floor.

    Notes
    -----
    Sound speed is computed from temperature and salinity at the grid points of the ocean. Below the
    sea bed, both are first extended downward. Sound speed then increases with pressure there, and
    the spline has no step if the coarse floor is between two levels. Added levels extend
    temperature and salinity in the same way. They also extend the currents, which do not affect
    vehicles above the coarse floor.

    If the spline of sound speed leaves the four grid points around a node of the water by more than
    5 m/s, as at fronts that the grid does not resolve, sound speed is bilinear instead.

    Examples
    --------
    >>> from pymantaray import open_ocean, to_local
    >>> ocean = open_ocean("synthetic:fram")
    >>> local = to_local(ocean, centre=(78.5, 1.0), half_extent=(10e3, 10e3))
    >>> print(local["sound_speed"].dims)
    ('north', 'east', 'depth')
    """
    return local_grid(
        ocean, centre, half_extent, sea_floor=sea_floor, equation=equation
    ).to_dataset()


def local_grid(
    ocean: xr.Dataset,
    centre: tuple[float, float] | None = None,
    half_extent: tuple[float, float] | None = None,
    *,
    sea_floor: xr.DataArray | None = None,
    equation: Equation = "teos-10",
) -> "LocalGrid":
    """Local grid of an ocean, with the arguments and errors of `to_local`."""
    points = GridPoints.of(centred(ocean, centre), equation)
    window = Window.on(points.lat, points.lon, centre)
    half = window.largest_rectangle() if half_extent is None else window.checked_sides(half_extent)
    part = points.around(window.geographic(*rectangle(*half)), _SPLINE)
    return LocalGrid.of(part, replace(window, lat=part.lat, lon=part.lon), half, sea_floor)


@dataclass(frozen=True, eq=False)
class LocalGrid:
    """
    Local grid of a domain in the window of an ocean, and interpolation of the ocean to its nodes.
    """

    points: GridPoints
    window: Window
    north: Array
    """Shape (north,). [m]"""
    east: Array
    """Shape (east,). [m]"""
    finer_floor: xr.DataArray | None
    """Separate sea floor on axes of its own; None if the sea floor is that of the ocean. [m]"""
    added: Array
    """Levels below those of the ocean, down to the finer sea floor. [m]"""
    notes: dict[str, object]
    """Attributes that describe a separate sea floor."""

    @classmethod
    def of(
        cls,
        points: GridPoints,
        window: Window,
        half: tuple[float, float],
        sea_floor: xr.DataArray | None = None,
    ) -> Self:
        """
        Local grid over a domain with half sides [m] inside the window of grid points; arguments as
        for `to_local`.
        """
        axes = _axes(window, half)
        if sea_floor is None:
            return cls(points, window, *axes, None, np.empty(0), {})
        finer = local_floor(sea_floor, window, half)
        added = levels_to(points.depth, float(finer.max()))
        notes = {f"sea_floor_{name}": finer.attrs[name] for name in ("source", "spacing")}
        return cls(points, window, *axes, finer, added, notes)

    @property
    def depth(self) -> Array:
        """Levels of the ocean and added levels. [m]"""
        return np.concatenate([self.points.depth, self.added])

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        return self.window.geographic(self.north[:, None], self.east[None, :])

    @cached_property
    def _smooth(self) -> "TensorSpline":
        return TensorSpline(self.window.lat, self.window.lon, *self._places)

    def sound_speed(self) -> Array:
        """Sound speed (north, east, depth). [m/s]"""
        return self._sound_speed[0]

    @property
    def bound(self) -> str:
        """Note about sound speed that is linear between grid points; empty if a spline is used."""
        return self._sound_speed[1]

    @cached_property
    def _sound_speed(self) -> tuple[Array, str]:
        """
        Sound speed by the cubic spline, or bilinear if that would leave the four grid points around
        a node of the water by more than the margin; and a note about this.
        """
        field = self.points.sound_speed(self.added)
        if not np.isfinite(field).all():
            south = f"{self.window.lat[0]:g} to {self.window.lat[-1]:g}"
            raise OceanError(
                f"sound speed: no value at some points of latitude {south}; TEOS-10 has no sea"
                " water south of 86 S; use a domain north of it"
            )
        smooth = self._smooth(field)
        level, beyond = self._furthest_beyond(field, smooth)
        if beyond <= ACROSS_MARGIN:
            return smooth, ""
        linear = TensorSpline(self.window.lat, self.window.lon, *self._places, degree=1)
        return linear(field), (
            "along latitude and longitude the sound speed is linear between grid points: a spline"
            f" would leave them by {beyond:.0f} m/s at {self.depth[level]:g} m"
        )

    def _furthest_beyond(self, field: Array, values: Array) -> tuple[int, float]:
        """
        Level and distance by which values (north, east, depth) in the water leave the four grid
        points of a field (depth, lat, lon) around them furthest.
        """
        levels = np.flatnonzero(_MOST_OF_SPAN * np.ptp(field, axis=(1, 2)) > ACROSS_MARGIN)
        if not levels.size:
            return 0, 0.0
        corners = np.ascontiguousarray(np.moveaxis(field[levels], 0, 2))
        row, column = (
            np.clip(np.searchsorted(axis, at, side="right") - 1, 0, axis.size - 2)
            for axis, at in zip((self.window.lat, self.window.lon), self._places, strict=True)
        )
        low = high = corners[row, column]
        for more in ((0, 1), (1, 0), (1, 1)):
            corner = corners[row + more[0], column + more[1]]
            low, high = np.minimum(low, corner), np.maximum(high, corner)
        beyond = np.maximum(values[..., levels] - high, low - values[..., levels])
        # the level below the sea floor acts on the water above it
        above = np.concatenate([[-1.0], self.depth])[levels]
        nodes = np.stack(np.meshgrid(self.north, self.east, indexing="ij"), axis=-1)
        floor = self.sea_floor().depth_at(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])
        beyond[above >= floor[..., None]] = 0.0
        most = beyond.max(axis=(0, 1))
        furthest = int(np.argmax(most))
        return int(levels[furthest]), float(most[furthest])

    def currents(self) -> tuple[Array, Array]:
        """Northward and eastward current (north, east, depth) along the frame's axes. [m/s]"""
        bearing = self.window.frame.convergence(*self._places)[..., None]
        u, v = (
            self._smooth(self.points.extended(name, self.added.size))
            for name in ("water_u", "water_v")
        )
        cos, sin = np.cos(bearing), np.sin(bearing)  # of the bearing of true north
        return v * cos - u * sin, v * sin + u * cos

    def sea_floor(self) -> BoundarySurface:
        """Sea floor on the axes of the grid, or on axes of its own. [m]"""
        if self.finer_floor is not None:
            north, east = (self.finer_floor[name].values for name in self.finer_floor.dims)
            return BoundarySurface(self.finer_floor.values, north, east)
        own = _own_floor(self.points.sea_floor, self.window, *self._places)
        return BoundarySurface(own, self.north, self.east)

    def to_dataset(self) -> xr.Dataset:
        """Local ocean, see `to_local`."""
        points = self.points
        frame = self.window.frame
        notes = dict(self.notes)
        if self.bound:
            notes["sound_speed_bound"] = self.bound
        if self.added.size:
            notes["levels_added"] = self.added
        if points.equation != "teos-10":
            notes["sound_speed_equation"] = points.equation
        scale = frame.scale_factor(self.north[:, None], self.east[None, :])
        attrs = {
            "centre_latitude_deg": frame.latitude_deg,
            "centre_longitude_deg": frame.longitude_deg,
            "proj_string": frame.proj_string,
            "scale_error_max": float(np.max(np.abs(scale - 1.0))),
            **(
                {}
                if np.isnat(points.time)
                else {"time": str(np.datetime_as_string(points.time, unit="s"))}
            ),
            **points.attrs,
            **notes,
        }
        axes = {"north": self.north, "east": self.east, "depth": self.depth}
        floor = self.sea_floor().depth if self.finer_floor is None else self.finer_floor
        return assemble_local(axes, self.sound_speed(), self.currents(), floor, attrs)


def assemble_local(
    axes: dict[str, Array],
    sound_speed: Array,
    current: tuple[Array, Array],
    floor: Array | xr.DataArray,
    attrs: dict[str, Any],
) -> xr.Dataset:
    """
    Assemble a local ocean from fields (north, east, depth) on axes [m], with currents along the
    axes [m/s].

    The sea floor is on (north, east), or a data array with its own axes ``floor_north`` and
    ``floor_east``. [m]
    """
    grid = ("north", "east", "depth")
    floor_grid = ("north", "east")
    letters = {"north": "y", "east": "x", "floor_north": "y", "floor_east": "x"}
    coords: dict[str, Any] = {
        "depth": ("depth", axes["depth"], {**_attrs("depth", "m"), "positive": "down"})
    }
    horizontal = {name: axes[name] for name in floor_grid}
    if isinstance(floor, xr.DataArray):
        floor_grid = ("floor_north", "floor_east")
        horizontal |= {name: floor[name].values for name in floor_grid}
        floor = floor.values
    for name, axis in horizontal.items():
        coords[name] = (name, axis, _attrs(f"projection_{letters[name]}_coordinate", "m"))
    return xr.Dataset(
        {
            "sound_speed": (grid, sound_speed, _attrs("speed_of_sound_in_sea_water", "m s-1")),
            "current_north": (grid, current[0], _attrs("sea_water_y_velocity", "m s-1")),
            "current_east": (grid, current[1], _attrs("sea_water_x_velocity", "m s-1")),
            "sea_floor_depth": (
                floor_grid,
                floor,
                _attrs("sea_floor_depth_below_sea_surface", "m"),
            ),
        },
        coords={name: coords[name] for name in ("north", "east", "depth", *list(horizontal)[2:])},
        attrs={"Conventions": "CF-1.8", **attrs},
    )


def floor_in_domain(
    ocean: xr.Dataset, window: Window, half: tuple[float, float], sea_floor: xr.DataArray | None
) -> Callable[[ArrayLike], Array]:
    """Sea-floor depth at places (..., 2), north and east, of a domain, as in `to_local`. [m]"""
    finer = None if sea_floor is None else local_floor(sea_floor, window, half)
    if finer is not None:
        return linear_interpolator(
            (finer["floor_north"].values, finer["floor_east"].values), finer.values
        )
    north, east = _axes(window, half)
    place = window.geographic(north[:, None], east[None, :])
    return linear_interpolator(
        (north, east), _own_floor(sea_floor_depth(ocean).values, window, *place)
    )


def _axes(window: Window, half: tuple[float, float]) -> tuple[Array, Array]:
    """
    Nodes from -half to half, with one at the centre and a spacing close to the native spacing.
    """
    cells = [
        max(MIN_CELLS, round(h / step))
        for h, step in zip(half, window.native_spacing(), strict=True)
    ]
    north, east = (np.linspace(-h, h, 2 * n + 1) for h, n in zip(half, cells, strict=True))
    return north, east


def _own_floor(own: Array, window: Window, at_lat: Array, at_lon: Array) -> Array:
    """
    Sea-floor depth at the nodes of a local grid, from that at the grid points of a window. [m]
    """
    if own.min() == own.max():
        return np.full(at_lat.shape, own.min())
    floor = TensorSpline(window.lat, window.lon, at_lat, at_lon, degree=1)(own[None])[..., 0]
    return np.clip(floor, own.min(), own.max())  # rounding must not put it below the deepest level


def _attrs(standard_name: str, units: str) -> dict[str, str]:
    return {"standard_name": standard_name, "units": units}


class TensorSpline:
    """
    Tensor-product spline through values on a rectangular grid, evaluated at fixed points inside the
    grid.

    Degree 1 is bilinear. Degree 3 is the C2 cubic spline with not-a-knot ends. The weights of the
    points and the factors of the axes are computed once. One sparse product then interpolates all
    levels of a field.
    """

    def __init__(
        self, rows: Array, columns: Array, at_rows: Array, at_columns: Array, *, degree: int = 3
    ) -> None:
        from scipy.interpolate import NdBSpline
        from scipy.sparse import csr_array

        self._axes = [axis_spline(axis, degree) for axis in (rows, columns)]
        self._shape = at_rows.shape
        places = np.stack(
            [_on_axis(rows, at_rows), _on_axis(columns, at_columns)], axis=-1
        ).reshape(-1, 2)
        knots = tuple(axis.knots for axis in self._axes)
        weights = NdBSpline.design_matrix(places, knots, (degree, degree))
        self._weights = csr_array(  # its last columns may be empty
            (weights.data, weights.indices, weights.indptr),
            shape=(len(places), rows.size * columns.size),
        )

    def __call__(self, field: Array) -> Array:
        """Values (..., levels) at the points, from a field (levels, rows, columns) without NaN."""
        coefficients = field
        for k, axis in enumerate(self._axes, start=1):
            coefficients = axis.coefficients(coefficients, axis=k)
        flat = coefficients.reshape(len(field), -1)
        return np.asarray(self._weights @ flat.T).reshape(*self._shape, len(field))


def _on_axis(axis: Array, points: Array) -> Array:
    """Clip points of a domain to an axis; a side of the domain may be on the edge of the window."""
    slack = 1e-6 * (axis[-1] - axis[0])
    outside = np.count_nonzero((points < axis[0] - slack) | (points > axis[-1] + slack))
    if outside:
        raise OceanError(
            f"regridding: {outside} of {points.size} points are outside {axis[0]:g} to {axis[-1]:g}"
            " degrees; shrink the domain"
        )
    return np.clip(points, axis[0], axis[-1])
