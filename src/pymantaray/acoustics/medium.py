"""The sound-speed field and sea bed through which rays run, as contiguous arrays."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import AcousticsError
from pymantaray.geometry.checks import checked_array, told_apart
from pymantaray.geometry.grid import linear_interpolator

if TYPE_CHECKING:
    import xarray as xr

    from pymantaray.acoustics._kernels.layout import Domain

Array = NDArray[np.float64]
Interpolation = Literal["smooth", "linear"]
Sheet = tuple[Array, Array, Array]  # depth of a boundary (n_north, n_east) and its axes
_SLOWEST, _FASTEST = 1000.0, 2500.0  # m/s; outside this a unit is wrong
_MOST_VALUES = 2**22  # that coefficients are worked out for at a time
_MOST_ADDED = 100  # levels above the first
_COLUMN_STEP = 500.0  # m; spacing of the columns of a section at most


@dataclass(frozen=True, eq=False)
class Medium:
    """
    Sound speed and bathymetry on a local grid; build it with `from_profile`, `from_grid` or `from_dataset`.

    Attributes
    ----------
    north, east : ndarray, shape (n_north,), (n_east,)
        Grid axes; one value each where the medium is horizontally uniform. [m]
    depth : ndarray, shape (n_depth,)
        Levels, positive down. [m]
    sound_speed : ndarray, shape (n_north, n_east, n_depth)
        [m/s]
    bathymetry : ndarray, shape (n_bed_north, n_bed_east)
        Depth of the sea bed. [m]
    bed_north, bed_east : ndarray, shape (n_bed_north,), (n_bed_east,)
        Its axes, those of the sound speed unless it came with its own. [m]
    interpolation : {"smooth", "linear"}
        C2 cubic spline in depth and cubic B-spline horizontally, or piecewise linear in depth and
        bilinear horizontally. Sea bed and ice are bilinear in both.
    ice_draft : ndarray, shape (n_ice_north, n_ice_east)
        Depth of the underside of an ice cover, one value 0 where there is none. [m]
    ice_north, ice_east : ndarray, shape (n_ice_north,), (n_ice_east,)
        Its axes. [m]
    """

    north: Array
    east: Array
    depth: Array
    sound_speed: Array
    bathymetry: Array
    bed_north: Array
    bed_east: Array
    interpolation: Interpolation
    ice_draft: Array
    ice_north: Array
    ice_east: Array
    field: Array
    knots_north: Array
    knots_east: Array
    lut: Array
    lut_scale: float
    uniform: bool
    layered: bool

    @classmethod
    def from_grid(
        cls,
        north: ArrayLike,
        east: ArrayLike,
        depth: ArrayLike,
        sound_speed: ArrayLike,
        *,
        bathymetry: ArrayLike,
        bed_north: ArrayLike | None = None,
        bed_east: ArrayLike | None = None,
        interpolation: Interpolation = "smooth",
        ice_draft: ArrayLike = 0.0,
        ice_north: ArrayLike | None = None,
        ice_east: ArrayLike | None = None,
    ) -> Self:
        """
        Medium on a grid of the local frame.

        Parameters
        ----------
        north, east, depth : array_like, shape (n_north,), (n_east,), (n_depth,)
            Axes, strictly increasing. A horizontal axis of one point means no variation along it. Above a first
            level below the surface its sound speed holds, on levels that are added, see `up_to_surface`. [m]
        sound_speed : array_like, shape (n_north, n_east, n_depth)
            [m/s]
        bathymetry : float or array_like, shape (n_bed_north, n_bed_east)
            Depth of the sea bed. [m]
        bed_north, bed_east : array_like, optional
            Its axes, where they are not those of the sound speed; they must reach as far. [m]
        interpolation : {"smooth", "linear"}
            What lies between the grid points.
        ice_draft : float or array_like, shape (n_ice_north, n_ice_east)
            Depth of the underside of an ice cover, which takes the place of the surface. [m]
        ice_north, ice_east : array_like, optional
            Its axes, where they are not those of the sound speed. [m]

        Returns
        -------
        Medium

        Raises
        ------
        AcousticsError
            If an axis does not increase, a shape does not fit, sea bed or ice do not cover the water, ice is below the sea
            bed or above the surface, or a sound speed is not finite or outside 1000 to 2500 m/s.
        """
        n, e, z = (
            _axis(name, values) for name, values in (("north", north), ("east", east), ("depth", depth))
        )
        bed = _sheet("bathymetry", bathymetry, ("bed_north", bed_north, n), ("bed_east", bed_east, e))
        ice = _sheet("ice_draft", ice_draft, ("ice_north", ice_north, n), ("ice_east", ice_east, e))
        if z.size < 2:
            raise AcousticsError(f"depth: {z.size} level; a medium needs at least 2")
        c = checked_array(AcousticsError, "sound_speed", sound_speed, (n.size, e.size, z.size))
        z, c = up_to_surface(z, c)
        if c.min() < _SLOWEST or c.max() > _FASTEST:
            raise AcousticsError(
                f"sound_speed: {c.min():g} to {c.max():g} m/s; sea water lies in {_SLOWEST:g} to {_FASTEST:g},"
                " check the units"
            )
        if interpolation not in ("smooth", "linear"):
            raise AcousticsError(f"interpolation: {interpolation!r}; allowed are 'smooth' and 'linear'")
        from pymantaray.acoustics._kernels.field import LUT_SIZE, depth_lut

        knots_n = knots_e = np.array([0.0, 1.0])
        if interpolation == "smooth":
            from scipy.interpolate import CubicSpline

            from pymantaray.ocean.local import spline_coefficients

            field = np.empty((n.size, e.size, 2 * z.size))
            field[..., : z.size] = c
            for rows in _parts(n.size, e.size * z.size):
                field[rows, :, z.size :] = CubicSpline(z, c[rows], axis=2, bc_type="natural")(z, 1)
            for levels in _parts(2 * z.size, n.size * e.size):
                along_north, knots_n = spline_coefficients(n, field[..., levels], axis=0)
                field[..., levels], knots_e = spline_coefficients(e, along_north, axis=1)
        else:
            field = c
        lut = np.zeros((LUT_SIZE, 4))
        scale = float(depth_lut(z, lut))
        _check_ice(ice, bed)
        for array in (n, e, z, c, *bed, *ice, field, knots_n, knots_e, lut):
            array.setflags(write=False)
        uniform = bool((c == c[0, 0]).all())
        layered = uniform and interpolation == "linear" and bool(bed[0].max() <= z[-1])
        sheets = *bed, interpolation, *ice
        return cls(n, e, z, c, *sheets, field, knots_n, knots_e, lut, scale, uniform, layered)

    def __repr__(self) -> str:
        """Size, extents and kind in one line."""
        n, e, d = self.north, self.east, self.depth
        speeds = f"{self.sound_speed.min():.1f} to {self.sound_speed.max():.1f} m/s"
        bed = f"sea bed {self.bathymetry.min():g} to {self.bathymetry.max():g} m"
        ice = f", ice to {self.ice_draft.max():g} m" if self.ice_draft.any() else ""
        return (
            f"<Medium {n.size} x {e.size} x {d.size}: north {n[0]:g} to {n[-1]:g} m, east {e[0]:g} to {e[-1]:g} m,"
            f" depth {d[0]:g} to {d[-1]:g} m, {speeds}, {bed}{ice}, {self.interpolation}>"
        )

    @classmethod
    def from_profile(
        cls,
        depth: ArrayLike,
        sound_speed: ArrayLike,
        *,
        bottom_depth: float,
        interpolation: Interpolation = "smooth",
        ice_draft: float = 0.0,
    ) -> Self:
        """
        Horizontally uniform and unbounded medium from one profile, over a flat sea bed.

        Levels (n_depth,) [m] increase strictly; the sound speed [m/s] of a first level below the surface holds up to it.
        Bottom and draft of ice, which takes the place of the surface, are depths [m]; otherwise as `from_grid`.
        """
        c = np.asarray(sound_speed, dtype=float)
        if c.ndim != 1:
            raise AcousticsError(f"sound_speed: shape {c.shape}; a profile has one dimension")
        return cls.from_grid(
            [0.0],
            [0.0],
            depth,
            c[None, None],
            bathymetry=[[bottom_depth]],
            interpolation=interpolation,
            ice_draft=ice_draft,
        )

    @classmethod
    def from_dataset(cls, ocean: "xr.Dataset", *, interpolation: Interpolation = "smooth") -> Self:
        """
        Medium of an ocean data set, local or geographic as `open_ocean` returns it.

        A geographic one is regridded about the middle of its window. Ice as `pymantaray.ocean.with_ice` puts it there is taken.
        """
        if "lat" in ocean.dims:
            from pymantaray.ocean import to_local

            ocean = to_local(ocean)
        require_local(ocean, "sound_speed", "sea_floor_depth", "north", "east", "depth")
        bed = ocean["sea_floor_depth"]
        axes = ("floor_north", "floor_east") if "floor_north" in bed.dims else ("north", "east")
        return cls.from_grid(
            ocean["north"].values,
            ocean["east"].values,
            ocean["depth"].values,
            ocean["sound_speed"].transpose("north", "east", "depth").values,
            bathymetry=bed.transpose(*axes).values,
            bed_north=bed[axes[0]].values,
            bed_east=bed[axes[1]].values,
            interpolation=interpolation,
            ice_draft=ocean["sea_ice_draft"].values if "sea_ice_draft" in ocean else 0.0,
        )

    def bottom_depth(self, position: ArrayLike) -> Array:
        """Depth of the sea bed under positions (n, 2) or (n, 3) [m], bilinear between its grid points, the edge's outside. [m]"""
        return _sheet_depth((self.bathymetry, self.bed_north, self.bed_east), position)

    def surface_depth(self, position: ArrayLike) -> Array:
        """Depth of the ice's underside above positions, 0 without ice, otherwise as `bottom_depth`. [m]"""
        return _sheet_depth((self.ice_draft, self.ice_north, self.ice_east), position)

    def sound_speed_at(self, position: ArrayLike) -> Array:
        """
        Sound speed at positions, as rays meet it.

        Parameters
        ----------
        position : array_like, shape (n, 3) or (3,)
            North, east, down. [m]

        Returns
        -------
        ndarray, shape (n,)
            By the medium's interpolation; NaN outside the water. [m/s]
        """
        from pymantaray.acoustics.eigenrays import find_eigenrays

        speed: Array = find_eigenrays(self, position, position).source_sound_speed
        return speed

    @property
    def boundaries(self) -> dict[str, Array]:
        """Sea bed and ice as `from_grid` takes them, for another medium between the same two."""
        names = ("bathymetry", "bed_north", "bed_east", "ice_draft", "ice_north", "ice_east")
        return {name: getattr(self, name) for name in names}

    def domain(self) -> "Domain":
        """Give the medium as the kernels take it; columns of a section at an eighth of a cell."""
        from pymantaray.acoustics._kernels.layout import LINEAR, SMOOTH, Domain, Sheet

        steps = [np.diff(axis).min() for axis in (self.north, self.east) if axis.size > 1]
        return Domain(
            SMOOTH if self.interpolation == "smooth" else LINEAR,
            self.north,
            self.east,
            self.depth,
            self.field,
            self.knots_north,
            min(3, self.north.size - 1),
            self.knots_east,
            min(3, self.east.size - 1),
            self.lut,
            self.lut_scale,
            float(min([_COLUMN_STEP, *(step / 8.0 for step in steps)])),
            Sheet(self.bed_north, self.bed_east, self.bathymetry),
            Sheet(self.ice_north, self.ice_east, self.ice_draft),
            self.uniform,
            self.layered,
        )


def up_to_surface(depth: Array, sound_speed: Array) -> tuple[Array, Array]:
    """
    Sound speed (..., n_depth) held constant above a first level that is below the surface.

    A spline or line continued from there would go on with the slope below. The levels that are added are as close as
    the first two, 100 at most, so that a spline is flat between them.
    """
    if not depth[0] > 0.0:
        return depth, sound_speed
    n = min(math.ceil(depth[0] / (depth[1] - depth[0])), _MOST_ADDED)
    held = np.repeat(sound_speed[..., :1], n, axis=-1)
    levels = np.linspace(0.0, depth[0], n, endpoint=False)
    return np.concatenate([levels, depth]), np.concatenate([held, sound_speed], axis=-1)


def _parts(count: int, size: int) -> list[slice]:
    """All of a number of slabs of a size, some at a time, so that what is worked out meanwhile takes little memory."""
    step = max(_MOST_VALUES // size, 1)
    return [slice(start, start + step) for start in range(0, count, step)]


def _axis(name: str, values: ArrayLike) -> Array:
    return checked_array(AcousticsError, name, values, (None,), rising=True)


def _sheet(name: str, depth: ArrayLike, *axes: tuple[str, ArrayLike | None, Array]) -> Sheet:
    """
    A boundary on axes of its own, by default the water's, which it must cover; one number is the same everywhere.

    One point of an axis means that the boundary does not vary along it.
    """
    if np.ndim(depth) == 0:
        return checked_array(AcousticsError, name, np.full((1, 1), depth), (1, 1)), np.zeros(1), np.zeros(1)
    sides = []
    for axis_name, values, water in axes:
        own = water if values is None else _axis(axis_name, values)
        slack = 1e-6 * max(np.ptp(water), 1.0)
        if own.size > 1 and (own[0] > water[0] + slack or own[-1] < water[-1] - slack):
            first, last, low, high = told_apart(own[0], own[-1], water[0], water[-1])
            raise AcousticsError(
                f"{axis_name}: {first} to {last} m; must reach over the water, {low} to {high} m"
            )
        sides.append(own)
    north, east = sides
    return checked_array(AcousticsError, name, depth, (north.size, east.size)), north, east


def _sheet_depth(sheet: Sheet, position: ArrayLike) -> Array:
    depth, north, east = sheet
    place = np.atleast_2d(np.asarray(position, dtype=float))
    return linear_interpolator((north, east), depth)(place[:, :2])


def _check_ice(ice: Sheet, bed: Sheet) -> None:
    """Ice must float: below the surface and, at the grid points of both, above the sea bed."""
    if ice[0].min() < 0.0:
        raise AcousticsError(f"ice_draft: {ice[0].min():g} m; a draft is a depth, 0 or more")
    if not ice[0].any():
        return
    for _, north, east in (ice, bed):
        places = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
        gap = _sheet_depth(bed, places) - _sheet_depth(ice, places)
        if gap.min() <= 0.0:
            raise AcousticsError(
                f"ice_draft: the ice reaches {-gap.min():g} m into the sea bed; sound needs water"
            )


def require_local(ocean: "xr.Dataset", *names: str) -> None:
    """Refuse a data set that lacks variables of a local ocean."""
    if missing := [name for name in names if name not in ocean.variables]:
        raise AcousticsError(
            f"ocean data set lacks {', '.join(missing)}; make it with open_ocean and to_local"
        )
