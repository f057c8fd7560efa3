"""Medium of rays: sound speed on a grid, sea bed and surface."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.acoustics.bounded import (
    DEPTH_MARGIN,
    LEAST_STEP,
    across_degrees,
    beyond_margin,
    bounded_levels,
    resolved_steps,
    spline_departure,
    straight_notes,
)
from pymantaray.acoustics.solving import as_positions, solve_on_processor
from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.boundary import BoundarySurface, as_boundary
from pymantaray.geometry.sphere import Earth, EarthSphere
from pymantaray.quantities.checks import checked_array

if TYPE_CHECKING:
    import xarray as xr

    from pymantaray.acoustics._kernels.layout import Domain
    from pymantaray.ocean.local import LocalGrid

Interpolation = Literal["smooth", "linear"]
_SLOWEST = 1000.0  # m/s; other values have a wrong unit
_FASTEST = 2500.0
_VALUES_PER_PART = 2**22  # whose spline coefficients are computed at a time
_MAX_ADDED_LEVELS = 100  # above the first level
# 1/(m s); mean change of the second derivative of sound speed from one level to the next beyond
# which fans are traced layer by layer, and least number of levels
_ROUGH, _MANY_LEVELS = 1e-4, 32
_COLUMN_STEP = 500.0  # m; spacing of the columns of a section at most


@dataclass(frozen=True, eq=False)
class Medium:
    """
    Sound speed and bathymetry on a local grid; build it with `from_profile`, `from_grid` or
    `from_dataset`.

    Attributes
    ----------
    north, east : ndarray, shape (n_north,), (n_east,)
        Grid axes, with one value each if the medium is horizontally uniform. [m]
    depth : ndarray, shape (n_depth,)
        Levels, positive down. [m]
    sound_speed : ndarray, shape (n_north, n_east, n_depth)
        [m/s]
    bed : BoundarySurface
        Sea bed.
    surface : BoundarySurface
        Sea surface, at depth 0, or the underside of an ice cover.
    interpolation : {"smooth", "linear"}
        C2 cubic spline in depth and cubic B-spline horizontally, or piecewise linear in depth and
        bilinear horizontally. Bed and surface are bilinear in both.
    earth : EarthSphere or None
        Sphere below the local frame; None for a flat Earth.
    notes : tuple of str
        Changes of the grid that bound the interpolation, see `from_grid`.

    Examples
    --------
    >>> from pymantaray import Medium
    >>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
    >>> print(medium.sound_speed_at([0.0, 0.0, 50.0]).round(2))
    [1456.39]
    """

    north: Array
    east: Array
    depth: Array
    sound_speed: Array
    bed: BoundarySurface
    surface: BoundarySurface
    interpolation: Interpolation
    field: Array
    knots_north: Array
    knots_east: Array
    lut: Array
    lut_scale: float
    uniform: bool
    layered: bool
    earth: EarthSphere | None = None
    notes: tuple[str, ...] = ()

    def plot(self, ax: Any = None) -> Any:
        """
        Plot the sound speed of all columns against depth: mean, range from minimum to maximum
        (shaded), and sea bed.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from pymantaray.acoustics.plots import plot_medium

        return plot_medium(self, ax)

    @classmethod
    def from_grid(
        cls,
        north: ArrayLike,
        east: ArrayLike,
        depth: ArrayLike,
        sound_speed: ArrayLike,
        *,
        bathymetry: BoundarySurface | ArrayLike,
        interpolation: Interpolation = "smooth",
        ice_draft: BoundarySurface | ArrayLike = 0.0,
        earth: EarthSphere | None = None,
    ) -> Self:
        """
        Build a medium on a grid of the local frame.

        Parameters
        ----------
        north, east, depth : array_like, shape (n_north,), (n_east,), (n_depth,)
            Strictly increasing axes. The medium does not vary along a horizontal axis with one
            point. If the first level is below the surface, levels above it have its sound speed,
            see `up_to_surface`. [m]
        sound_speed : array_like, shape (n_north, n_east, n_depth)
            [m/s]
        bathymetry : BoundarySurface, float or array_like, shape (n_north, n_east)
            Depth of the sea bed: one value, or values at the grid points of the sound speed. [m] A
            `BoundarySurface` has axes of its own, which must extend over those of the sound speed,
            and may have a reflection.
        interpolation : {"smooth", "linear"}
            Interpolation of the sound speed between the grid points.
        ice_draft : BoundarySurface, float or array_like, shape (n_north, n_east)
            Depth of the underside of an ice cover, which replaces the surface, like ``bathymetry``.
            [m] The reflection of an open sea surface is that of ``BoundarySurface(0.0,
            reflection=...)``.
        earth : EarthSphere, optional
            Sphere below the local frame. Rays then run in flattened water, and straight distances
            through the Earth. Default: flat.

        Returns
        -------
        Medium

        Raises
        ------
        AcousticsError
            If an axis does not increase, a shape does not fit, sea bed or ice do not cover the
            water, ice is below the sea bed or above the surface, or a sound speed is not finite or
            outside 1000 to 2500 m/s.

        Notes
        -----
        The sound speed stays near its grid points. Where a spline in depth would leave the range of
        two neighbouring levels by more than 3 m/s in any column, the medium has more levels between
        them, on the straight line. Along a horizontal axis on which a spline would leave the range
        of two neighbouring grid points by more than 5 m/s, it is linear. Steps of more than
        1000 m/s per metre are wider. ``Medium.notes`` lists these changes with numbers.
        """
        n, e, z = (
            _axis(name, values)
            for name, values in (("north", north), ("east", east), ("depth", depth))
        )
        bed = as_boundary(bathymetry, n, e, name="bathymetry", error=AcousticsError)
        surface = as_boundary(ice_draft, n, e, name="ice_draft", error=AcousticsError)
        if z.size < 2:
            raise AcousticsError(f"depth: {z.size} level; a medium needs at least 2")
        c = checked_array(AcousticsError, "sound_speed", sound_speed, (n.size, e.size, z.size))
        z, c = up_to_surface(z, c)
        _check_speed(c)
        if interpolation not in ("smooth", "linear"):
            raise AcousticsError(
                f"interpolation: {interpolation!r}; allowed are 'smooth' and 'linear'"
            )
        from pymantaray.acoustics._kernels.field import LUT_SIZE, depth_lut

        # splines of the sound speed in depth of the flattened Earth, then across
        (n, e, z), c, notes = _with_wide_steps((n, e, z), c)
        levels_z, speed = _flattened(z, c, earth)
        knots_n = knots_e = np.array([0.0, 1.0])
        field = speed
        if interpolation == "smooth":
            field = _with_slopes(levels_z, speed)
            # a spline that leaves its levels too far is linear there
            if beyond_margin(levels_z, speed, field[..., z.size :]).any():
                levels = z
                z, c, left = bounded_levels(z, c)
                notes += straight_notes(levels, left)
                levels_z, speed = _flattened(z, c, earth)
                field = _with_slopes(levels_z, speed)
            degrees, straight = across_degrees((n, e), c)
            notes += straight
            knots_n, knots_e = _into_coefficients(field, (n, e), degrees)
        # table from depth to level, by which the kernels find a cell at once
        lut = np.zeros((LUT_SIZE, 4))
        scale = float(depth_lut(levels_z, lut))
        _check_ice(surface, bed)
        # threads and copies of the medium share these arrays
        for array in (n, e, z, c, field, knots_n, knots_e, lut):
            array.setflags(write=False)
        uniform = bool((c == c[0, 0]).all())
        layered = uniform and (interpolation == "linear" or surface.grid.depth.size == 1)
        between = bed, surface, interpolation
        return cls(
            n,
            e,
            z,
            c,
            *between,
            field,
            knots_n,
            knots_e,
            lut,
            scale,
            uniform,
            layered,
            earth,
            notes,
        )

    def __repr__(self) -> str:
        """Size, extents and kind in one line."""
        facts = ", ".join(
            value if name in ("sound speed", "interpolation") else f"{name} {value}"
            for name, value in self.facts().items()
        )
        return f"<{self._title}: {facts}>"

    def _repr_html_(self) -> str:
        """HTML for a notebook: the same facts."""
        from pymantaray.records.result_table import notebook_html

        return notebook_html(self._title, self.facts(), [])

    @property
    def _title(self) -> str:
        return f"Medium {self.north.size} x {self.east.size} x {self.depth.size}"

    def facts(self) -> dict[str, str]:
        """
        Describe extents and kind.

        Returns
        -------
        dict of str to str
            Values with units by name.
        """
        axes = {
            name: f"{axis[0]:g} to {axis[-1]:g} m"
            for name, axis in (("north", self.north), ("east", self.east), ("depth", self.depth))
        }
        ice = {"ice": f"to {self.surface.depth.max():g} m"} if self.has_ice else {}
        radius = {} if self.earth is None else {"sphere": f"of {1e-3 * self.earth.radius:.1f} km"}
        return {
            **axes,
            "sound speed": f"{self.sound_speed.min():.1f} to {self.sound_speed.max():.1f} m/s",
            "sea bed": f"{self.bed.depth.min():g} to {self.bed.depth.max():g} m",
            **ice,
            "interpolation": self.interpolation,
            **radius,
        }

    @classmethod
    def from_profile(
        cls,
        depth: ArrayLike,
        sound_speed: ArrayLike,
        *,
        bottom_depth: float | BoundarySurface,
        interpolation: Interpolation = "smooth",
        ice_draft: float | BoundarySurface = 0.0,
        earth: EarthSphere | None = None,
    ) -> Self:
        """
        Build a horizontally uniform and unbounded medium from one profile over a flat sea bed.

        Parameters
        ----------
        depth : array_like, shape (n_depth,)
            Strictly increasing levels, as in `from_grid`. [m]
        sound_speed : array_like, shape (n_depth,)
            [m/s]
        bottom_depth : float or BoundarySurface
            Depth of the sea bed. [m]
        interpolation : {"smooth", "linear"}
            Interpolation of the sound speed between the levels.
        ice_draft : float or BoundarySurface
            Depth of the underside of an ice cover, which replaces the surface. [m]
        earth : EarthSphere, optional
            Sphere below the local frame, such as ``EarthSphere.at_latitude(78.0)``. Default: flat.

        Returns
        -------
        Medium
        """
        c = np.asarray(sound_speed, dtype=float)
        if c.ndim != 1:
            raise AcousticsError(f"sound_speed: shape {c.shape}; a profile has one dimension")
        return cls.from_grid(
            [0.0],
            [0.0],
            depth,
            c[None, None],
            bathymetry=bottom_depth,
            interpolation=interpolation,
            ice_draft=ice_draft,
            earth=earth,
        )

    @classmethod
    def from_dataset(
        cls, ocean: xr.Dataset, *, interpolation: Interpolation = "smooth", earth: Earth = "flat"
    ) -> Self:
        """
        Build the medium of an ocean data set.

        Parameters
        ----------
        ocean : xarray.Dataset
            Geographic ocean from `pymantaray.ocean.open_ocean`, which is regridded around the
            middle of its window, or local ocean from `pymantaray.ocean.to_local`, or in metres;
            without a sea floor its levels end there. A variable ``sea_ice_draft`` replaces the
            surface.
        interpolation : {"smooth", "linear"}
            Interpolation of the sound speed between the grid points.
        earth : {"flat", "sphere"}
            A plane, or the sphere with the Gaussian radius of curvature at the centre of the local
            frame.

        Returns
        -------
        Medium

        Raises
        ------
        AcousticsError
            As in `from_grid`, or if the Earth is a sphere and the ocean has no geographic position.
        """
        if "lat" in ocean.dims:
            from pymantaray.ocean.local import local_grid

            return cls.from_local_grid(local_grid(ocean), interpolation=interpolation, earth=earth)
        from pymantaray.ocean.metres import is_in_metres, ocean_in_metres

        if is_in_metres(ocean) and "sea_floor_depth" not in ocean:
            ocean = ocean_in_metres(ocean)
        require_local(ocean, "sound_speed", "sea_floor_depth", "north", "east", "depth")
        latitude = ocean.attrs.get("centre_latitude_deg")
        medium = cls.from_grid(
            ocean["north"].values,
            ocean["east"].values,
            ocean["depth"].values,
            ocean["sound_speed"].transpose("north", "east", "depth").values,
            bathymetry=BoundarySurface.from_dataset(ocean, "sea_floor_depth", AcousticsError),
            interpolation=interpolation,
            ice_draft=ice_of(ocean),
            earth=_sphere_at(None if latitude is None else float(latitude), earth),
        )
        return medium._with_note(str(ocean.attrs.get("sound_speed_bound", "")))

    @classmethod
    def from_local_grid(
        cls,
        grid: LocalGrid,
        *,
        interpolation: Interpolation = "smooth",
        ice_draft: BoundarySurface | float = 0.0,
        earth: Earth = "flat",
    ) -> Self:
        """
        Build the medium of a local grid: the one that `from_dataset` builds of its data set,
        without the time to make the data set.

        Parameters
        ----------
        grid : LocalGrid
            Local grid of an ocean.
        interpolation, earth
            As in `from_dataset`.
        ice_draft : BoundarySurface or float
            As in `from_grid`. [m]

        Returns
        -------
        Medium
        """
        medium = cls.from_grid(
            grid.north,
            grid.east,
            grid.depth,
            grid.sound_speed(),
            bathymetry=grid.sea_floor(),
            interpolation=interpolation,
            ice_draft=ice_draft,
            earth=_sphere_at(grid.window.frame.latitude_deg, earth),
        )
        return medium._with_note(grid.bound)

    def _with_note(self, note: str) -> Self:
        """Medium with a note about its source, if there is one."""
        return replace(self, notes=(note, *self.notes)) if note else self

    def with_earth(self, earth: EarthSphere | None) -> Self:
        """
        Return the same water on another Earth.

        Parameters
        ----------
        earth : EarthSphere or None
            Sphere below the local frame; None for a flat Earth.

        Returns
        -------
        Medium
        """
        if earth == self.earth:
            return self
        return replace(self._rebuilt(self.sound_speed, earth), notes=self.notes)

    def _rebuilt(self, sound_speed: Array, earth: EarthSphere | None) -> Self:
        """Medium of another sound speed on the same grid, or on another Earth."""
        return self.from_grid(
            self.north,
            self.east,
            self.depth,
            sound_speed,
            bathymetry=self.bed,
            interpolation=self.interpolation,
            ice_draft=self.surface,
            earth=earth,
        )

    def plus(self, profiles: ArrayLike, fields: ArrayLike) -> Self:
        """
        Add products of profiles and horizontal fields to the sound speed.

        Spline coefficients are linear in the sound speed, so only those of the profiles and fields
        are computed.

        Parameters
        ----------
        profiles : array_like, shape (n, n_depth)
            Values at the levels of this medium. [m/s]
        fields : array_like, shape (n, n_north, n_east)
            Factors at the grid points of this medium. [-]

        Returns
        -------
        Medium
            A medium with the same grid, sea bed and surface.

        Raises
        ------
        AcousticsError
            If a shape does not fit, or the sum is not finite or outside 1000 to 2500 m/s.
        """
        size = self.sound_speed.shape
        down = checked_array(AcousticsError, "profiles", profiles, (None, size[2]))
        across = checked_array(AcousticsError, "fields", fields, (len(down), *size[:2]))
        speed = self.sound_speed + _product(down, across)
        _check_speed(speed)
        if self.earth is not None:
            down = down * self.earth.stretch(self.depth)
        if self.interpolation == "smooth":
            from pymantaray.geometry.natural_spline import natural_slopes
            from pymantaray.geometry.splines import spline_coefficients

            levels = self.depth if self.earth is None else self.earth.flattened_depth(self.depth)
            slopes = natural_slopes(levels, down)
            if self._may_leave(levels, (down, slopes), across):
                rebuilt = self._rebuilt(speed, self.earth)
                return replace(rebuilt, notes=tuple(dict.fromkeys(self.notes + rebuilt.notes)))
            down = np.hstack([down, slopes])
            for k, axis in enumerate((self.north, self.east)):
                across, _ = spline_coefficients(axis, across, axis=k + 1, degree=self.degrees[k])
        field = self.field + _product(down, across)
        for array in (speed, field):
            array.setflags(write=False)
        uniform = bool((speed == speed[0, 0]).all())
        return replace(
            self, sound_speed=speed, field=field, uniform=uniform, layered=self.layered and uniform
        )

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees of the splines along north and east."""
        return (
            max(self.knots_north.size - self.north.size - 1, 0),
            max(self.knots_east.size - self.east.size - 1, 0),
        )

    def _may_leave(self, levels: Array, down: tuple[Array, Array], across: Array) -> bool:
        """
        True if products of profiles with slopes and fields may add more than the margins to the
        distance by which the splines of this medium leave their neighbours.
        """
        profiles, slopes = down
        size = np.abs(across).max(axis=(1, 2), initial=0.0)
        if (size @ spline_departure(levels, profiles, slopes)).max() > DEPTH_MARGIN:
            return True
        each = np.moveaxis(across * np.abs(profiles).max(axis=1)[:, None, None], 0, -1)
        degrees, _ = across_degrees((self.north, self.east), each)
        return degrees != self.degrees

    def straight_distance(self, source: ArrayLike, receiver: ArrayLike) -> Array:
        """
        Straight distance between positions: in the frame, or through the Earth if it is a sphere.

        Parameters
        ----------
        source, receiver : array_like, shape (n, 3) or one position
            North, east, down. They broadcast. [m]

        Returns
        -------
        ndarray, shape (n,)
            Distance. [m]
        """
        a, b = (np.asarray(x, dtype=float) for x in (source, receiver))
        if self.earth is None:
            return np.asarray(np.linalg.norm(b - a, axis=-1))
        return self.earth.straight_distance(*(x.copy() for x in np.broadcast_arrays(a, b)))

    def bottom_depth(self, position: ArrayLike) -> Array:
        """
        Return the depth of the sea bed at positions.

        Parameters
        ----------
        position : array_like, shape (n, 2), (n, 3) or one position
            North, east and, without effect, down. [m]

        Returns
        -------
        ndarray, shape (n,)
            Depth, positive down. [m]
        """
        return self.bed.depth_at(position)

    def surface_depth(self, position: ArrayLike) -> Array:
        """
        Return the depth of the surface, or of the underside of ice, at positions.

        Parameters
        ----------
        position : array_like, shape (n, 2), (n, 3) or one position
            North, east and, without effect, down. [m]

        Returns
        -------
        ndarray, shape (n,)
            Depth, positive down. [m]
        """
        return self.surface.depth_at(position)

    @property
    def has_ice(self) -> bool:
        """True if the surface is anywhere below depth 0."""
        return bool(self.surface.depth.any())

    def sound_speed_at(self, position: ArrayLike) -> Array:
        """
        Return the sound speed at positions, with the same interpolation as for rays.

        Parameters
        ----------
        position : array_like, shape (n, 3) or (3,)
            North, east, down. [m]

        Returns
        -------
        ndarray, shape (n,)
            Sound speed; NaN outside the water. [m/s]
        """
        from pymantaray.acoustics._kernels.layout import SOURCE_SPEED, Settings

        points = as_positions("position", position)
        ends = (points, points) if self.earth is None else self.earth.flattened_ends(points, points)
        blocks = solve_on_processor(
            self.domain(), None, Settings(math.inf, 1e-3, canonical=True, shallower=False), *ends
        )
        speed: Array = np.concatenate([block.info[:, SOURCE_SPEED] for block in blocks])
        return speed if self.earth is None else speed / self.earth.stretch(points[:, 2])

    def __getstate__(self) -> dict[str, Any]:
        """Fields without the domain, whose arrays would be pickled again."""
        return {name: value for name, value in vars(self).items() if name != "_domain"}

    def domain(self) -> Domain:
        """
        Medium in the form of the kernels, with columns of a section every eighth of a cell; all
        arrays are read-only.
        """
        return self._domain

    def _needs_ladder(self, depth: Array) -> bool:
        """
        True if fans of rays are faster layer by layer: in LINEAR layered water, and in SMOOTH water
        whose sound speed bends at most of its levels [m].
        """
        n = depth.size
        if not self.layered or self.interpolation == "linear" or n < _MANY_LEVELS:
            return self.layered and self.interpolation == "linear"
        speed, slope, h = self.field[0, 0, :n], self.field[0, 0, n:], np.diff(depth)
        second = (6.0 * np.diff(speed) / h - 4.0 * slope[:-1] - 2.0 * slope[1:]) / h
        return bool(np.abs(np.diff(second)).mean() > _ROUGH)

    @property
    def _layers(self) -> int:
        """Domain.layered."""
        from pymantaray.acoustics._kernels.layout import DEEPER, LAYERED, VARYING

        if not self.layered:
            return VARYING
        return DEEPER if self.bed.depth.max() > self.depth[-1] else LAYERED

    @cached_property
    def _domain(self) -> Domain:
        from pymantaray.acoustics._kernels.layout import LINEAR, SMOOTH, Domain

        radius = 0.0
        depth = self.depth
        bed = self.bed.grid
        surface = self.surface.grid
        if self.earth is not None:
            radius = self.earth.radius
            depth = self.earth.flattened_depth(depth)
            bed = bed._replace(depth=self.earth.flattened_depth(bed.depth))
            surface = surface._replace(depth=self.earth.flattened_depth(surface.depth))
        steps = [np.diff(axis).min() for axis in (self.north, self.east) if axis.size > 1]
        domain = Domain(
            SMOOTH if self.interpolation == "smooth" else LINEAR,
            self.north,
            self.east,
            depth,
            self.field,
            self.knots_north,
            self.degrees[0],
            self.knots_east,
            self.degrees[1],
            self.lut,
            self.lut_scale,
            float(min([_COLUMN_STEP, *(step / 8.0 for step in steps)])),
            bed,
            surface,
            self.uniform,
            self._layers,
            self._needs_ladder(depth),
            radius,
        )
        every: Domain = _read_only(domain)
        return every


def _read_only(value: Any) -> Any:
    """
    Array that nobody can write, or named tuple of such arrays.

    Kernels are compiled for these only. Arrays that came from another process can be written.
    """
    if isinstance(value, np.ndarray):
        value = value.view()
        value.setflags(write=False)
    elif hasattr(value, "_fields"):
        value = value._make(map(_read_only, value))
    return value


def up_to_surface(depth: Array, sound_speed: Array) -> tuple[Array, Array]:
    """
    Extend levels and sound speed (..., n_depth) to the surface with the sound speed of the first
    level.

    Extrapolation of a spline or line from the first level would continue its slope. The spacing of
    the added levels, at most 100, is that of the first two, so a spline is flat between them.
    """
    if not depth[0] > 0.0:
        return depth, sound_speed
    n = min(math.ceil(depth[0] / (depth[1] - depth[0])), _MAX_ADDED_LEVELS)
    held = np.repeat(sound_speed[..., :1], n, axis=-1)
    levels = np.linspace(0.0, depth[0], n, endpoint=False)
    return np.concatenate([levels, depth]), np.concatenate([held, sound_speed], axis=-1)


def _flattened(depth: Array, speed: Array, earth: EarthSphere | None) -> tuple[Array, Array]:
    """Levels and sound speed of flattened water; unchanged on a flat Earth."""
    if earth is None:
        return depth, speed
    return earth.flattened_depth(depth), speed * earth.stretch(depth)


def _with_wide_steps(
    axes: tuple[Array, ...], speed: Array
) -> tuple[list[Array], Array, tuple[str, ...]]:
    """Axes and sound speed whose steps are wide enough for rays, and notes."""
    notes: tuple[str, ...] = ()
    wide = list(axes)
    for k, name in enumerate(("north", "east", "depth")):
        wide[k], lines, more = resolved_steps(axes[k], np.moveaxis(speed, k, -1), name)
        if more:
            speed = np.ascontiguousarray(np.moveaxis(lines, -1, k))
            notes += more
    return wide, speed, notes


def _with_slopes(depth: Array, speed: Array) -> Array:
    """Sound speed and its slopes by depth, side by side."""
    from pymantaray.geometry.natural_spline import natural_slopes

    size = depth.size
    field = np.empty((*speed.shape[:2], 2 * size))
    field[..., :size] = speed
    for rows in _parts(len(speed), speed.shape[1] * size):
        field[rows, :, size:] = natural_slopes(depth, speed[rows])
    return field


def _into_coefficients(
    field: Array, axes: tuple[Array, Array], degrees: tuple[int, int]
) -> tuple[Array, Array]:
    """Replace values on a grid by spline coefficients along both axes; return the knots."""
    from pymantaray.geometry.splines import spline_coefficients

    (north, east), (along_north, along_east) = axes, degrees
    for levels in _parts(field.shape[2], north.size * east.size):
        of_north, knots_north = spline_coefficients(
            north, field[..., levels], axis=0, degree=along_north
        )
        field[..., levels], knots_east = spline_coefficients(
            east, of_north, axis=1, degree=along_east
        )
    return knots_north, knots_east


def _parts(count: int, size: int) -> list[slice]:
    """Slices of slabs with a size, so small that intermediate arrays need little memory."""
    step = max(_VALUES_PER_PART // size, 1)
    return [slice(start, start + step) for start in range(0, count, step)]


def _product(profiles: Array, fields: Array) -> Array:
    """
    Sum over modes of profiles (n, n_depth) times fields (n, n_north, n_east), at the grid points of
    a medium.
    """
    return np.asarray(np.tensordot(fields, profiles, axes=(0, 0)))


def _check_speed(speed: Array) -> None:
    """Raise an error for sound speeds that sea water cannot have."""
    if speed.min() < _SLOWEST or speed.max() > _FASTEST:
        raise AcousticsError(
            f"sound_speed: {speed.min():g} to {speed.max():g} m/s; it must be {_SLOWEST:g} to"
            f" {_FASTEST:g} m/s in sea water; check the units"
        )


def _axis(name: str, values: ArrayLike) -> Array:
    axis = checked_array(AcousticsError, name, values, (None,), rising=True)
    step = np.diff(axis)
    if step.size and step.min() < LEAST_STEP:
        at = axis[int(np.argmin(step))]
        raise AcousticsError(
            f"{name}: two values at {at:g} m are {step.min():g} m apart; allowed are"
            f" {LEAST_STEP:g} m or more: remove one"
        )
    return axis


def _check_ice(surface: BoundarySurface, bed: BoundarySurface) -> None:
    """
    Raise an error for ice above depth 0 or, at a grid point of either boundary, below the sea bed.
    """
    if surface.depth.min() < 0.0:
        raise AcousticsError(
            f"ice_draft: {surface.depth.min():g} m; it must be 0 m or more, positive down"
        )
    if not surface.depth.any():
        return
    for nodes in (surface.nodes, bed.nodes):
        gap = bed.depth_at(nodes) - surface.depth_at(nodes)
        if gap.min() <= 0.0:
            raise AcousticsError(
                f"ice_draft: the ice reaches {-gap.min():g} m into the sea bed; reduce the draft"
            )


def ice_of(ocean: xr.Dataset) -> BoundarySurface | float:
    """Surface of a data set with ``sea_ice_draft``; depth 0 without ice. [m]"""
    if "sea_ice_draft" not in ocean:
        return 0.0
    from pymantaray.ocean.ice import roughness_of

    smooth = BoundarySurface.from_dataset(ocean, "sea_ice_draft", AcousticsError)
    return smooth.with_roughness(roughness_of(ocean))


def _sphere_at(latitude_deg: float | None, earth: Earth) -> EarthSphere | None:
    """
    Sphere at the centre of a local frame, None for a flat Earth; the latitude is None if the frame
    has no place.
    """
    if earth == "flat":
        return None
    if earth != "sphere":
        raise AcousticsError(f"earth: {earth!r}; allowed are 'flat' and 'sphere'")
    if latitude_deg is None:
        raise AcousticsError(
            "earth is 'sphere', but the water has no geographic position; give its latitude and"
            " longitude as `centre`, or use a flat Earth"
        )
    return EarthSphere.at_latitude(latitude_deg)


def require_local(ocean: xr.Dataset, *names: str) -> None:
    """Raise an error for a data set without variables of a local ocean."""
    if missing := [name for name in names if name not in ocean.variables]:
        raise AcousticsError(
            f"ocean data set lacks {', '.join(missing)}; make it with open_ocean and to_local"
        )
