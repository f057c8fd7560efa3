"""From latitude and longitude to the local frame: every node is looked up where it truly lies."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, NdBSpline, make_interp_spline
from scipy.sparse.linalg import splu

from pymantaray.errors import OceanError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.ocean.schema import VARIABLES, validate_ocean
from pymantaray.ocean.sea_floor import (
    fill_below_sea_bed,
    levels_to,
    local_floor,
    sea_floor_depth,
)
from pymantaray.ocean.seawater import Equation, sound_speed
from pymantaray.ocean.window import Window, half_sides_within

Array = NDArray[np.float64]
_MIN_CELLS = 2  # on either side of the centre: five nodes, enough for a cubic spline


def to_local(
    ocean: xr.Dataset,
    centre: tuple[float, float] | None = None,
    half_extent: tuple[float, float] | None = None,
    *,
    sea_floor: xr.DataArray | None = None,
    equation: Equation = "teos-10",
) -> xr.Dataset:
    """
    Sound speed, currents and sea floor of an ocean on a regular grid in the local NED frame.

    Each node of the local grid is projected back to its latitude and longitude and interpolated there:
    a cubic tensor spline for sound speed and currents, bilinear for the sea floor. One row's metres per
    degree for all rows would be 12 % wrong across the paper's Fram Strait.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean, see `validate_ocean`.
    centre : tuple of float, optional
        Latitude and longitude of the frame's centre, by default the window's middle. [degrees]
    half_extent : tuple of float, optional
        Half sides (north, east) of the domain about the centre, by default of the rectangle of largest
        area that the window holds. [m]
    sea_floor : xarray.DataArray, optional
        From `open_sea_floor`. It is taken if its grid is as fine as the ocean's
        or finer; otherwise, and by default, the sea floor is where the ocean's levels end. [m]
    equation : {"teos-10", "del-grosso", "unesco"}
        Equation of sound speed, see `sound_speed`.

    Returns
    -------
    xarray.Dataset
        Dimensions ``(north, east, depth)`` [m], depth being the ocean's own levels. Variables
        ``sound_speed``, ``current_north``, ``current_east`` (components along the frame's axes) [m/s] and
        ``sea_floor_depth`` (north, east) [m]. Attributes ``centre_latitude_deg``,
        ``centre_longitude_deg``, ``proj_string``, ``scale_error_max`` (largest distortion of lengths in
        the domain), ``time``, ``title``, ``source``, ``synthetic``.

        A sea floor that is taken lies on axes of its own, ``(floor_north, floor_east)`` [m], spaced about as
        its file is, and levels are added down to its deepest point. Where one was given, taken or not,
        attribute ``sea_floor_source`` says which it is and why; ``sea_floor_spacing`` [m] and
        ``levels_added`` [m] say what was done. An equation other than TEOS-10 is named in
        ``sound_speed_equation``.

    Raises
    ------
    OceanError
        If the ocean is not valid, or the domain does not fit into its window or the sea floor's.

    Notes
    -----
    Sound speed is computed from temperature and salinity at the ocean's own grid points. Beneath the sea
    bed both are carried downward first, so that sound speed goes on rising with pressure there and the
    spline meets no step where the coarse floor lies between two levels. Added levels carry them on in the
    same way, and the currents, which no vehicle above the coarse floor meets.
    """
    validate_ocean(ocean)
    window, depth = Window.of(ocean, centre), np.asarray(ocean["depth"].values, dtype=float)
    lat, lon = window.lat, window.lon
    half = window.largest_rectangle() if half_extent is None else _checked(half_extent, window)
    north, east = _axes(window, half)
    finer = None if sea_floor is None else local_floor(sea_floor, window, half)
    notes = _notes(sea_floor, finer)
    added = np.empty(0) if finer is None else levels_to(depth, float(finer.max()))

    fields = {}
    for v in VARIABLES:
        filled = fill_below_sea_bed(ocean[v.name].values, lat)
        fields[v.name] = np.concatenate([filled, np.repeat(filled[-1:], added.size, axis=0)])
    depth = np.concatenate([depth, added])
    if added.size:
        notes["levels_added"] = added
    if equation != "teos-10":
        notes["sound_speed_equation"] = equation
    place = (depth[:, None, None], lat[:, None], lon)
    speed = sound_speed(fields["water_temp"], fields["salinity"], *place, equation=equation)
    at_lat, at_lon = window.geographic(north[:, None], east[None, :])
    smooth = TensorSpline(lat, lon, at_lat, at_lon)
    bearing = window.frame.convergence(at_lat, at_lon)[..., None]
    current = _along_axes(smooth(fields["water_u"]), smooth(fields["water_v"]), bearing)
    scale = window.frame.scale_factor(north[:, None], east[None, :])
    return assemble_local(
        {"north": north, "east": east, "depth": depth},
        smooth(speed),
        current,
        _own_floor(ocean, window, at_lat, at_lon) if finer is None else finer,
    ).assign_attrs(
        {
            "centre_latitude_deg": window.frame.latitude_deg,
            "centre_longitude_deg": window.frame.longitude_deg,
            "proj_string": window.frame.proj_string,
            "scale_error_max": float(np.max(np.abs(scale - 1.0))),
            "time": str(np.datetime_as_string(ocean["time"].values, unit="s")),
            **{name: ocean.attrs[name] for name in ("title", "source", "synthetic")},
            **notes,
        }
    )


def assemble_local(
    axes: dict[str, Array], sound_speed: Array, current: tuple[Array, Array], floor: Array | xr.DataArray
) -> xr.Dataset:
    """
    Local ocean of fields (north, east, depth) on its axes [m], currents along them [m/s].

    The sea floor is on (north, east), or a data array with axes ``floor_north`` and ``floor_east`` of its own. [m]
    """
    grid, floor_grid = ("north", "east", "depth"), ("north", "east")
    letters = {"north": "y", "east": "x", "floor_north": "y", "floor_east": "x"}
    coords: dict[str, Any] = {"depth": ("depth", axes["depth"], {**_attrs("depth", "m"), "positive": "down"})}
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
            "sea_floor_depth": (floor_grid, floor, _attrs("sea_floor_depth_below_sea_surface", "m")),
        },
        coords={name: coords[name] for name in ("north", "east", "depth", *list(horizontal)[2:])},
        attrs={"Conventions": "CF-1.8"},
    )


def floor_in_domain(
    ocean: xr.Dataset, window: Window, half: tuple[float, float], sea_floor: xr.DataArray | None
) -> Callable[[ArrayLike], Array]:
    """Depth of the sea floor at places (..., 2) north and east of a domain, as `to_local` has it. [m]"""
    finer = None if sea_floor is None else local_floor(sea_floor, window, half)
    if finer is not None:
        return linear_interpolator((finer["floor_north"].values, finer["floor_east"].values), finer.values)
    north, east = _axes(window, half)
    place = window.geographic(north[:, None], east[None, :])
    return linear_interpolator((north, east), _own_floor(ocean, window, *place))


def _axes(window: Window, half: tuple[float, float]) -> tuple[Array, Array]:
    north, east = (_axis(h, step) for h, step in zip(half, window.native_spacing(), strict=True))
    return north, east


def _own_floor(ocean: xr.Dataset, window: Window, at_lat: Array, at_lon: Array) -> Array:
    """Where an ocean's levels end, at the nodes of its local grid. [m]"""
    own = sea_floor_depth(ocean).values
    floor = TensorSpline(window.lat, window.lon, at_lat, at_lon, degree=1)(own[None])[..., 0]
    return np.clip(floor, own.min(), own.max())  # not even by rounding below the deepest level


def _along_axes(u: Array, v: Array, bearing: Array) -> tuple[Array, Array]:
    """Components along the frame's north and east of true eastward and northward ones; bearing of true north. [rad]"""
    cos, sin = np.cos(bearing), np.sin(bearing)
    return v * cos - u * sin, v * sin + u * cos


def _notes(sea_floor: xr.DataArray | None, finer: xr.DataArray | None) -> dict[str, object]:
    """What there is to record about a sea floor, and what of it is taken."""
    if finer is not None:
        return {f"sea_floor_{name}": finer.attrs[name] for name in ("source", "spacing")}
    if sea_floor is None:
        return {}
    name = sea_floor.attrs.get("source", "sea_floor")
    return {"sea_floor_source": f"where the ocean's levels end; the grid of {name} is coarser"}


def _attrs(standard_name: str, units: str) -> dict[str, str]:
    return {"standard_name": standard_name, "units": units}


def _checked(half_extent: tuple[float, float], window: Window) -> tuple[float, float]:
    north, east = (float(h) for h in half_extent)
    if not (north > 0.0 and east > 0.0):
        raise OceanError(f"half_extent is {half_extent} m; both half sides must be positive")
    if not window.holds(north, east):
        largest = window.largest_rectangle()
        raise OceanError(
            f"domain of +-{north / 1e3:g} km north, +-{east / 1e3:g} km east about"
            f" {window.frame.latitude_deg:g} N {window.frame.longitude_deg:g} E does not fit into the data;"
            f" the largest that fits is {half_sides_within(largest)}"
        )
    return north, east


def _axis(half: float, spacing: float) -> Array:
    """Nodes from -half to half with one on the centre, as near to the native spacing as that allows."""
    cells = max(_MIN_CELLS, round(half / spacing))
    return np.linspace(-half, half, 2 * cells + 1)


class TensorSpline:
    """
    Tensor-product spline through values on a rectangular grid, evaluated at fixed points of any shape inside it.

    Degree 1 is bilinear, 3 the C2 cubic spline with not-a-knot ends. The weights of the points are worked out once; a
    field is then interpolated by one sparse product for all its levels.
    """

    def __init__(
        self, rows: Array, columns: Array, at_rows: Array, at_columns: Array, *, degree: int = 3
    ) -> None:
        self._axes, self._degree, self._shape = (rows, columns), degree, at_rows.shape
        places = np.stack([_on_axis(rows, at_rows), _on_axis(columns, at_columns)], axis=-1).reshape(-1, 2)
        knots = tuple(make_interp_spline(axis, axis, k=degree).t for axis in self._axes)
        weights = NdBSpline.design_matrix(places, knots, (degree, degree))
        self._weights = sp.csr_array(  # whose last columns may have no entry
            (weights.data, weights.indices, weights.indptr), shape=(len(places), rows.size * columns.size)
        )

    def __call__(self, field: Array) -> Array:
        """Values (..., levels) at the points, from a field (levels, rows, columns) without NaN."""
        coefficients = field
        for k, axis in enumerate(self._axes, start=1):
            coefficients, _ = spline_coefficients(axis, coefficients, axis=k, degree=self._degree)
        flat = coefficients.reshape(len(field), -1)
        return np.asarray(self._weights @ flat.T).reshape(*self._shape, len(field))


def spline_coefficients(points: Array, values: Array, *, axis: int, degree: int = 3) -> tuple[Array, Array]:
    """
    Coefficients and knots of the B-spline through values along one axis, with not-a-knot ends.

    Of the degree where there are points enough, else n - 1. With one point, whose knots are 0 and 1, nothing varies along
    the axis. By a sparse factorization: LAPACK's banded solver waits for its own threads.
    """
    if points.size == 1:
        return values, np.array([0.0, 1.0])
    degree = min(degree, points.size - 1)
    knots = make_interp_spline(points, points, k=degree).t
    solver = splu(BSpline.design_matrix(points, knots, degree).tocsc())
    lines = np.moveaxis(values, axis, 0)
    solved = solver.solve(np.ascontiguousarray(lines.reshape(len(lines), -1)))
    coefficients = np.moveaxis(solved.reshape(lines.shape), 0, axis)
    return np.ascontiguousarray(coefficients), np.ascontiguousarray(knots)


def _on_axis(axis: Array, points: Array) -> Array:
    """Points of a domain, whose side may lie on the window's edge, on the axis."""
    slack = 1e-6 * (axis[-1] - axis[0])
    outside = np.count_nonzero((points < axis[0] - slack) | (points > axis[-1] + slack))
    if outside:
        raise OceanError(
            f"regridding: {outside} of {points.size} points lie outside {axis[0]:g} to {axis[-1]:g} degrees;"
            " shrink the domain"
        )
    return np.clip(points, axis[0], axis[-1])
