"""Profiles of sound speed: reading, and thinning or smoothing with a record of the change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.bounded import bounded_levels
from pymantaray.acoustics.medium import Interpolation, up_to_surface
from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError, MantaRayError, OceanError
from pymantaray.geometry.natural_spline import natural_spline
from pymantaray.quantities.checks import check_number, checked_array, distinct_digits

if TYPE_CHECKING:
    from pymantaray.ocean.cast import Cast, CastTable

_RAW_SPACING = 2.0  # m
DEFAULT_TOLERANCE = 0.02
"""Tolerance to which a raw cast is thinned unless its user chooses. [m/s]"""
_OF_CASTS = ("time unknown", "time of day unknown", "day unknown", "depth from pressure by TEOS-10")
"""First words of notes that rays do not need."""
_FWHM = 2.0 * math.sqrt(2.0 * math.log(2.0))  # of a Gaussian, in standard deviations
_CUT_OFF = 4.0  # standard deviations beyond which Gaussian weights are zero


class Named(Protocol):
    """Cast, profile or water with a name."""

    @property
    def name(self) -> str:
        """Name for messages."""


NamedT = TypeVar("NamedT", bound=Named)


class Profile(NamedTuple):
    """
    Levels [m], sound speed [m/s], and the latitude and longitude that TEOS-10 used, if any
    [degrees].
    """

    depth: Array
    sound_speed: Array
    position: tuple[float, float] | None
    name: str
    """Station in the table, or name of the file."""
    time: np.datetime64
    """UTC; NaT if unknown."""
    water: tuple[Array, Array] | None
    """
    In-situ temperature [degC] and practical salinity of all levels; None if the table lacks one of
    them.
    """
    notes: tuple[str, ...]
    """Doubts about the profile."""
    place: tuple[float, float] | None = None
    """Latitude and longitude from the file or the caller. [degrees]"""


@dataclass(frozen=True, eq=False)
class ReducedProfile:
    """
    Profile with fewer levels than its raw cast, and the change of its sound speed at the levels of
    the cast.
    """

    depth: Array  # m
    sound_speed: Array  # m/s
    method: Literal["thinned", "smoothed"]
    parameter: float  # tolerance, m/s, or length, m
    interpolation: Interpolation
    raw_levels: int
    rms_change: float  # m/s
    greatest_change: float  # m/s
    vertical_change: float
    """Greatest change of a vertical travel time from the first level to any other. [s]"""

    def __repr__(self) -> str:
        return f"<ReducedProfile {self}>"

    def __str__(self) -> str:
        how = (
            f"within {self.parameter:g} m/s"
            if self.method == "thinned"
            else f"over {self.parameter:g} m"
        )
        return (
            f"{self.raw_levels} levels {self.method} {how} to {self.depth.size}, sound speed"
            f" changed by {self.rms_change:.2g} m/s rms, {self.greatest_change:.2g} m/s at most,"
            f" vertical travel times by {1e6 * self.vertical_change:.2g} us at most"
        )


def read_profile(
    path: str | Path, place: tuple[float, float] | None = None, *, repair_freezing: bool = False
) -> Profile:
    r"""
    Read a profile of sound speed, or compute it by TEOS-10 from temperature and salinity.

    Parameters
    ----------
    path : str or Path
        File with one cast in a format of `pymantaray.ocean.read_cast`; a file with sound speed
        alone, such as a Kongsberg ``.asvp``; or a CSV file with ``depth`` or ``pressure``, and
        ``sound_speed`` or in-situ ``temperature`` and practical ``salinity``. Names of columns may
        end in their units, as in ``depth_m``.
    place : tuple of float, optional
        Latitude and longitude. Default: from the file, or from a comment line with ``lat ...`` and
        ``lon ...``. [degrees]
    repair_freezing : bool
        True to raise the salinity of water below its freezing point to the freezing line, where it
        gives the sound speed.

    Returns
    -------
    Profile
        Levels [m] and sound speed [m/s].

    Raises
    ------
    AcousticsError
        If the file contains several casts, lacks a column, or its depth does not increase; the
        message gives the line.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.acoustics import read_profile
    >>> _ = Path("cast.csv").write_text("depth,sound_speed\n0,1450\n100,1460\n1000,1475\n")
    >>> print(read_profile("cast.csv").sound_speed)
    [1450. 1460. 1475.]
    """
    return only_one(
        path, read_profiles(path, place, repair_freezing=repair_freezing), AcousticsError
    )


def only_one(source: object, casts: Sequence[NamedT], error: type[MantaRayError]) -> NamedT:
    """Return the only cast of a source; several raise an error that names them."""
    if len(casts) > 1:
        raise error(
            f"{source}: contains {len(casts)} casts ({names_of(casts)}); only one is allowed;"
            " select it by its name or place with `cast`"
        )
    return casts[0]


def names_of(casts: Sequence[Named]) -> str:
    """Names of the first four casts, for messages."""
    return ", ".join(cast.name for cast in casts[:4]) + (", ..." if len(casts) > 4 else "")


def read_profiles(
    path: str | Path, place: tuple[float, float] | None = None, *, repair_freezing: bool = False
) -> list[Profile]:
    r"""
    Read all profiles of a file, one per station.

    Parameters
    ----------
    path, place, repair_freezing
        As in `read_profile`.

    Returns
    -------
    list of Profile
        Profiles with name and, if the file contains it, time.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.acoustics import read_profiles
    >>> rows = ["station,depth,sound_speed", "A,0,1450", "A,1000,1475", "B,0,1452", "B,900,1474"]
    >>> _ = Path("casts.csv").write_text("\n".join(rows))
    >>> [(profile.name, float(profile.depth[-1])) for profile in read_profiles("casts.csv")]
    [('A', 1000.0), ('B', 900.0)]
    """
    from pymantaray.ocean.cast_folders import is_cast_folder, read_each
    from pymantaray.ocean.casts import cast_tables, each_usable, holds_argo, read_casts
    from pymantaray.ocean.positions import is_position

    if place is not None and not is_position(*place):
        raise AcousticsError(
            f"{path}: position {place[0]:g} {place[1]:g}; latitude must be -90 to 90 and longitude"
            " -360 to 360 degrees"
        )
    try:
        if is_cast_folder(path):
            read = partial(read_profiles, place=place, repair_freezing=repair_freezing)
            profiles, notes = read_each(Path(path), read, AcousticsError)
        elif holds_argo(path):
            return [_of_cast(cast) for cast in read_casts(path, repair_freezing=repair_freezing)]
        else:

            def make(name: str, table: CastTable) -> Profile:
                return _profile(table, name or Path(path).stem, place, repair_freezing)

            profiles, notes = each_usable(Path(path), cast_tables(Path(path)), make)
    except OceanError as error:
        raise AcousticsError(str(error)) from None
    return [profile._replace(notes=(*profile.notes, *notes)) for profile in profiles]


def _profile(
    table: CastTable, name: str, position: tuple[float, float] | None, repair: bool
) -> Profile:
    """
    Profile of a table or an instrument's file: usable rows of the downcast, with its own sound
    speed if it has one.
    """
    from pymantaray.ocean.casts import cast_of_table, cast_position, has_water

    if table.has("sound_speed"):
        return _of_sound_speed(table, name, position)
    there = {
        "depth": table.has("depth") or table.has("pressure"),
        "sound_speed": has_water(table) or bool(table.instrument),
    }
    if not all(there.values()):
        lacks = ", ".join(name for name, present in there.items() if not present)
        raise AcousticsError(
            f"{table.path}: no column {lacks}; {table.listing}; pressure can replace depth, and"
            " temperature with salinity can replace sound_speed"
        )
    cast = cast_of_table(table, name, _cast_position(table, position), None)
    profile = _of_cast(cast.with_repaired_salinity() if repair else cast)
    notes = (*profile.notes, *cast_position(table)[1])
    if not table.instrument:
        notes = tuple(note for note in notes if not note.startswith(_OF_CASTS))
    return profile._replace(notes=notes)


def _of_cast(cast: Cast) -> Profile:
    """Profile of a cast with computed sound speed."""
    place = (cast.lat, cast.lon)
    water = (cast.temperature, cast.salinity)
    return Profile(
        cast.depth, cast.sound_speed(), place, cast.name, cast.time, water, cast.notes, place
    )


def _of_sound_speed(table: CastTable, name: str, position: tuple[float, float] | None) -> Profile:
    """Profile of a table with a column of sound speed."""
    from pymantaray.ocean.cast_rows import usable_rows, water_beside
    from pymantaray.ocean.casts import cast_depth, cast_place, cast_position, cast_time
    from pymantaray.ocean.seawater import freezing_notes

    place = (
        (position or cast_place(table)) if table.has("depth") else _cast_position(table, position)
    )
    depth, depth_notes = cast_depth(table, None if place is None else place[0])
    time, time_notes = cast_time(table)
    notes = [*table.notes, *(depth_notes if table.instrument else []), *cast_position(table)[1]]
    notes += [note for note in time_notes if not note.startswith(_OF_CASTS)]
    beside = {q: table.values(q) for q in ("temperature", "salinity") if table.has(q)}
    speed = table.values("sound_speed")
    rows, notes, _ = usable_rows(
        depth,
        {"sound_speed": speed},
        beside=beside,
        titles={"sound_speed": table.title("sound_speed")},
        notes=notes,
        where=str(table.path),
    )
    water, more = water_beside({quantity: values[rows] for quantity, values in beside.items()})
    notes += more
    if water is not None and place is not None:
        notes += freezing_notes(*water, depth[rows], *place)
    computed = place if depth_notes else None
    return Profile(depth[rows], speed[rows], computed, name, time, water, tuple(notes), place)


def is_raw_cast(depth: ArrayLike) -> bool:
    """
    True if the median distance of levels is below 2 m: a spline through them would follow the
    instrument's errors.
    """
    spacing = np.diff(np.asarray(depth, dtype=float))
    return bool(spacing.size and np.median(spacing) < _RAW_SPACING)


def reduce_profile(
    depth: ArrayLike,
    sound_speed: ArrayLike,
    *,
    thin: float | None = None,
    smooth: float | None = None,
    interpolation: Interpolation = "smooth",
) -> ReducedProfile | None:
    """
    Thin or smooth a profile; by default thin a raw cast and keep any other profile.

    Parameters
    ----------
    depth, sound_speed : array_like, shape (n_levels,)
        Levels, strictly increasing, and their sound speed. [m, m/s]
    thin : float, optional
        Tolerance of `thin_profile`; 0 keeps all levels. Default: `DEFAULT_TOLERANCE` for a raw
        cast, 0 otherwise. [m/s]
    smooth : float, optional
        Length of `smooth_profile`, instead of thinning. [m]
    interpolation : {"smooth", "linear"}
        Interpolation of the `Medium` that will use the profile.

    Returns
    -------
    ReducedProfile or None
        None if all levels are kept.
    """
    if smooth is not None:
        return smooth_profile(depth, sound_speed, length=smooth, interpolation=interpolation)
    if thin is None:
        thin = DEFAULT_TOLERANCE if is_raw_cast(depth) else 0.0
    if thin == 0.0:
        return None
    return thin_profile(depth, sound_speed, tolerance=thin, interpolation=interpolation)


def thin_profile(
    depth: ArrayLike,
    sound_speed: ArrayLike,
    *,
    tolerance: float = 0.1,
    interpolation: Interpolation = "smooth",
) -> ReducedProfile:
    """
    Omit levels of a cast while the interpolation stays within a tolerance of the omitted levels.

    Parameters
    ----------
    depth, sound_speed : array_like, shape (n_levels,)
        Levels of the cast, strictly increasing, and their sound speed. [m, m/s]
    tolerance : float
        Maximum difference from the cast at any of its levels. [m/s]
    interpolation : {"smooth", "linear"}
        Interpolation of the `Medium` that will use the profile.

    Returns
    -------
    ReducedProfile
        Its levels are the surface and levels of the cast, including the last.

    Notes
    -----
    ``linear`` keeps the minimum number of levels: the shortest chain of chords, each within the
    tolerance of all levels between its ends [1]_. ``smooth`` adds levels where a natural cubic
    spline differs most until the spline is within the tolerance. It then removes every level that
    the tolerance does not require. The result has few levels, but not provably the minimum number.

    The time t of the fastest path between two positions changes by at most a fraction ``tolerance``
    / c of t, because the fastest path in one medium takes at most this much longer in the other.
    (Two splines may differ by more between the cast's levels than at them.) The fastest path is the
    earliest arrival, unless it runs along the surface, the sea bed, or a maximum of a ``linear``
    profile, where no ray exists.

    References
    ----------
    .. [1] Imai, H. and Iri, M. (1988), Polygonal approximations of a curve, in Computational
       Morphology, 71-86; cited from secondary sources, for the shortest path in the graph of
       admissible chords.

    Examples
    --------
    >>> z = np.arange(0.0, 301.0)
    >>> speed = 1450.0 + 0.05 * np.abs(z - 120.0)
    >>> kept = thin_profile(z, speed, tolerance=0.01, interpolation="linear")
    >>> kept.depth
    array([  0., 120., 300.])
    """
    cast = _checked(depth, sound_speed)
    z, c = up_to_surface(*cast)
    check_number(AcousticsError, "tolerance", tolerance, "m/s", positive=True)
    rows = (
        _fewest_chords(z, c, tolerance)
        if interpolation == "linear"
        else _spline_levels(z, c, tolerance)
    )
    return _record(*cast, z[rows], c[rows], "thinned", tolerance, interpolation)


def smooth_profile(
    depth: ArrayLike,
    sound_speed: ArrayLike,
    *,
    length: float = 10.0,
    interpolation: Interpolation = "smooth",
) -> ReducedProfile:
    """
    Average a cast over a length, on equally spaced levels at half this length.

    Parameters
    ----------
    depth, sound_speed : array_like, shape (n_levels,)
        Levels of the cast, strictly increasing, and their sound speed. [m, m/s]
    length : float
        Full width at half maximum of the weights. [m]
    interpolation : {"smooth", "linear"}
        Interpolation of the `Medium` that will use the profile.

    Returns
    -------
    ReducedProfile
        Averaged profile.

    Raises
    ------
    AcousticsError
        If the levels do not increase, a value is not finite, or the length is less than the largest
        gap between levels or more than half the depth of the cast.

    Notes
    -----
    The value at each level is that of a straight line, fitted with Gaussian weights times the depth
    interval of each level of the cast. The average preserves a constant gradient exactly, also at
    the ends.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.acoustics import smooth_profile
    >>> z = np.arange(0.0, 301.0)
    >>> smooth = smooth_profile(z, 1450.0 + 0.05 * np.abs(z - 120.0), length=20.0)
    >>> smooth.depth.size, round(smooth.greatest_change, 2)
    (31, 0.34)
    """
    cast = _checked(depth, sound_speed)
    z, c = up_to_surface(*cast)
    gap = float(np.diff(z).max())
    extent = float(z[-1] - z[0])
    if not gap <= length <= 0.5 * extent:
        own, least, most = distinct_digits(length, gap, 0.5 * extent)
        raise AcousticsError(
            f"length: {own} m; the cast allows {least} m, its widest gap, to {most} m, half its"
            " depth"
        )
    levels = np.linspace(z[0], z[-1], math.ceil(extent / (0.5 * length)) + 1)
    share = np.gradient(z)
    sigma = length / _FWHM
    smoothed = np.empty(levels.size)
    for i, level in enumerate(levels):
        part = slice(*np.searchsorted(z, [level - _CUT_OFF * sigma, level + _CUT_OFF * sigma]))
        x = (z[part] - level) / sigma
        w = share[part] * np.exp(-0.5 * x * x)
        s0 = w.sum()
        s1 = (w * x).sum()
        s2 = (w * x * x).sum()
        smoothed[i] = (w * (s2 - s1 * x) * c[part]).sum() / (s0 * s2 - s1 * s1)
    return _record(*cast, levels, smoothed, "smoothed", length, interpolation)


def _cast_position(table: CastTable, position: tuple[float, float] | None) -> tuple[float, float]:
    from pymantaray.ocean.casts import cast_place, unread_position

    place = position or cast_place(table)
    if place is None:
        raise AcousticsError(
            f"{table.path}: computing sound speed or depth needs a"
            f" position{unread_position(table)}; give `place=LAT LON`"
        )
    return place


def _checked(depth: ArrayLike, sound_speed: ArrayLike) -> tuple[Array, Array]:
    z = checked_array(AcousticsError, "profile: depth", depth, (None,), rising=True)
    if z.size < 2:
        raise AcousticsError("profile: has one level; at least 2 are required")
    return z, checked_array(AcousticsError, "profile: sound_speed", sound_speed, z.shape)


def _interpolated(levels: Array, values: Array, at: Array, interpolation: Interpolation) -> Array:
    if interpolation == "linear":
        return np.interp(at, levels, values)
    return natural_spline(levels, values, at)


def _record(
    z: Array,
    c: Array,
    levels: Array,
    values: Array,
    method: Literal["thinned", "smoothed"],
    parameter: float,
    interpolation: Interpolation,
) -> ReducedProfile:
    reduced = _interpolated(levels, values, z, interpolation)
    change = reduced - c
    slowness_change = 1.0 / reduced - 1.0 / c
    interval_mean = 0.5 * (slowness_change[1:] + slowness_change[:-1])
    vertical = np.cumsum(interval_mean * np.diff(z))
    for array in (levels, values):
        array.setflags(write=False)
    return ReducedProfile(
        depth=levels,
        sound_speed=values,
        method=method,
        parameter=float(parameter),
        interpolation=interpolation,
        raw_levels=z.size,
        rms_change=float(np.sqrt(np.mean(change**2))),
        greatest_change=float(np.abs(change).max()),
        vertical_change=float(np.abs(vertical).max()),
    )


def _fewest_chords(z: Array, c: Array, tolerance: float) -> NDArray[np.int64]:
    """
    Rows of the shortest chain of chords within the tolerance from the first level to the last, by
    breadth-first search.
    """
    n = z.size
    came_from = np.full(n, -1)
    front = [0]
    while came_from[n - 1] < 0:
        reached: list[int] = []
        for i in front:
            dz = z[i + 1 :] - z[i]
            dc = c[i + 1 :] - c[i]
            slope = dc / dz
            lowest = np.maximum.accumulate((dc - tolerance) / dz)
            highest = np.minimum.accumulate((dc + tolerance) / dz)
            ends = i + 1 + np.flatnonzero((slope >= lowest) & (slope <= highest))
            ends = ends[came_from[ends] < 0]
            came_from[ends] = i
            reached.extend(ends.tolist())
        front = reached
    chain = [n - 1]
    while chain[-1] > 0:
        chain.append(int(came_from[chain[-1]]))
    return np.array(chain[::-1])


def _spline_levels(z: Array, c: Array, tolerance: float) -> NDArray[np.int64]:
    """Rows whose natural cubic spline is within the tolerance of all levels."""

    def departure(kept: NDArray[np.int64]) -> Array:
        return np.abs(_interpolated(z[kept], c[kept], z, "smooth") - c)

    def within(rows: NDArray[np.int64]) -> NDArray[np.int64]:
        while True:
            off = departure(rows)
            off[rows] = 0.0  # exact except for rounding
            if off.max() <= tolerance:
                return rows
            worst = [a + int(np.argmax(off[a:b])) for a, b in pairwise(rows)]
            rows = np.union1d(rows, [row for row in worst if off[row] > tolerance])

    rows = within(np.array([0, z.size - 1]))
    for row in rows[1:-1]:
        fewer = rows[rows != row]
        if departure(fewer).max() <= tolerance:
            rows = fewer
    while True:
        # a medium is linear where a spline leaves its levels: keep all levels there
        _, _, left = bounded_levels(z[rows], c[rows])
        inside = [np.arange(rows[k], rows[k + 1]) for k in np.flatnonzero(left)]
        more = np.union1d(rows, np.concatenate([rows, *inside]))
        if more.size == rows.size:
            return rows
        rows = within(more)
