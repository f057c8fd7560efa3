"""
Writer of a medium and links as BELLHOP3D input files: `.env`, `.ssp`, `.bty` and, under ice,
`.ati`.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.acoustics.medium import Medium
from pymantaray.apps.bellhop.options import BellhopOptions, BellhopOutput, HalfSpace
from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.geometry.natural_spline import natural_spline
from pymantaray.quantities.checks import distinct_digits
from pymantaray.records.writing import whole_file

_LETTER: dict[BellhopOutput, str] = {
    "arrivals": "A",
    "arrivals-binary": "a",
    "rays": "R",
    "eigenrays": "E",
}
_MAX_POINTS = 100_000_000  # of a finer grid; 0.8 GB


def write_bellhop(
    folder: str | Path,
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    options: BellhopOptions | None = None,
    *,
    origin: Sequence[float] = (0.0, 0.0),
) -> list[Path]:
    """
    Write a medium and its links as input of BELLHOP3D, one run per link.

    Parameters
    ----------
    folder : str or pathlib.Path
        Folder for the files, which is created if necessary. Existing files with the same names are
        replaced.
    medium : Medium
        The files contain its values at the grid points. Bellhop interpolates linearly between them,
        so convert a smooth medium with `linear_medium` first.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        Positions ``(north, east, down)`` inside the grid. [m]
    options : BellhopOptions, optional
        Default: arrivals of 100 x 100 beams within 15 degrees of the chord over a rigid bed.
    origin : sequence of 2 floats
        North and east of Bellhop's x = y = 0. Bellhop stores positions in single precision, so an
        origin near the source preserves most digits. [m]

    Returns
    -------
    list of pathlib.Path
        The `.env` file of each link: ``link.env`` for one link, otherwise ``link_0.env`` and so on.
        The other files of further links are hard links to those of the first.

    Raises
    ------
    AcousticsError
        If an end is outside the grid or its levels.
    WriteError
        If a file cannot be written.

    Notes
    -----
    Bellhop's x is north, y is east and z is down, so its bearings are azimuths clockwise from
    north. The files contain all digits of lengths. A medium with one profile becomes a profile
    (option C) with a flat `.bty` that extends beyond all links; any other medium becomes a
    hexahedral grid. The sea bed is bilinear in a medium, and consists of two triangles per cell in
    Bellhop.

    Examples
    --------
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.bellhop import linear_medium, write_bellhop
    >>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
    >>> files = write_bellhop("links", linear_medium(medium), [0, 0, 50], [3000, 0, 400])
    >>> [file.name for file in files]
    ['link.env']
    """
    options = options or BellhopOptions()
    a, b = (np.atleast_2d(np.asarray(points, dtype=float)) for points in (source, receiver))
    _check_ends(medium, a, b)
    shift = np.array([origin[0], origin[1], 0.0])
    grids = _grid_texts(medium, np.concatenate([a, b]) - shift, shift)
    stems = ["link"] if len(a) == 1 else [f"link_{i}" for i in range(len(a))]
    paths = [Path(folder) / f"{stem}.env" for stem in stems]
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        for suffix, text in grids.items():
            first = paths[0].with_suffix(suffix)
            _write(first, text)
            for path in paths[1:]:
                other = path.with_suffix(suffix)
                other.unlink(missing_ok=True)
                try:
                    other.hardlink_to(first)
                except OSError:  # a file system without hard links
                    shutil.copyfile(first, other)
    except OSError as error:
        raise AcousticsError(f"{error.filename}: cannot be written: {error.strerror}") from None
    for path, start, end in zip(paths, a - shift, b - shift, strict=True):
        _write(path, _env_text(path.stem, medium, start, end, options))
    return paths


def linear_medium(medium: Medium, *, horizontal: int = 1, vertical: int = 1) -> Medium:
    """
    Sample a medium on a finer grid with linear interpolation.

    Parameters
    ----------
    medium : Medium
        Smooth or linear medium; the sound speed of a linear medium does not change.
    horizontal, vertical : int
        Number of parts of each cell along north and east, and along depth.

    Returns
    -------
    Medium
        Medium with ``linear`` interpolation. Its difference from a smooth medium decreases with the
        square of the number of parts.

    Examples
    --------
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.bellhop import linear_medium
    >>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
    >>> linear_medium(medium, vertical=4).interpolation
    'linear'
    """
    from scipy.interpolate import make_interp_spline

    if horizontal < 1 or vertical < 1:
        raise AcousticsError(
            f"horizontal {horizontal}, vertical {vertical}; both must be at least 1"
        )
    axes = (medium.north, medium.east, medium.depth)
    parts = (horizontal, horizontal, vertical)
    points = math.prod((axis.size - 1) * n + 1 for axis, n in zip(axes, parts, strict=True))
    if points > _MAX_POINTS:
        raise AcousticsError(
            f"horizontal {horizontal}, vertical {vertical}: {points:,} points; at most"
            f" {_MAX_POINTS:,}"
        )
    north, east, depth = (_cut(axis, n) for axis, n in zip(axes, parts, strict=True))
    c = medium.sound_speed
    if medium.interpolation == "smooth":
        c = natural_spline(medium.depth, c, depth)
        for k, (axis, finer) in enumerate(((medium.north, north), (medium.east, east))):
            if axis.size > 1:
                c = make_interp_spline(axis, c, k=medium.degrees[k], axis=k)(finer)
    else:
        c = _on_grid(axes, c, (north, east, depth))
    bed = medium.bed
    bed_north = _cut(bed.north, horizontal)
    bed_east = _cut(bed.east, horizontal)
    bed_depth = _on_grid((bed.north, bed.east), bed.depth, (bed_north, bed_east))
    return Medium.from_grid(
        north,
        east,
        depth,
        c,
        interpolation="linear",
        bathymetry=BoundarySurface(bed_depth, bed_north, bed_east, bed.reflection),
        ice_draft=medium.surface,
    )


def _check_ends(medium: Medium, a: Array, b: Array) -> None:
    if medium.earth is not None:
        raise AcousticsError(
            "Bellhop: its Earth is flat, but that of the medium is a sphere; use a flat Earth"
        )
    if a.ndim != 2 or a.shape[1:] != (3,) or a.shape != b.shape or len(a) == 0:
        raise AcousticsError(
            f"source has shape {a.shape}, receiver {b.shape}; both need (n_links, 3)"
        )
    sides = [
        (axis[0], axis[-1]) if axis.size > 1 else (-math.inf, math.inf)
        for axis in (medium.north, medium.east)
    ]
    low, high = np.array([*sides, (0.0, medium.depth[-1])]).T
    for end, points in (("source", a), ("receiver", b)):
        outside = np.flatnonzero(~np.all((points >= low) & (points <= high), axis=1))
        if outside.size:
            p = points[outside[0]]
            deep, last = distinct_digits(p[2], medium.depth[-1])
            raise AcousticsError(
                f"{end} of link {outside[0]}: {p[0]:g} north, {p[1]:g} east, {deep} m deep is"
                f" outside the grid or its levels (0 to {last} m); move it inside"
            )


def _grid_texts(medium: Medium, ends: Array, shift: Array) -> dict[str, str]:
    """
    Content of the files by suffix: `.bty`; under ice `.ati` of type R; and the hexahedral `.ssp` if
    sound speed varies horizontally.

    All have x and y in kilometres, followed by lists along x for each y, or for each depth and y.
    Bellhop requires two points along an axis, so an axis with one point (no variation) becomes two
    points beyond all ends.
    """
    centre = [np.mean(medium.north) - shift[0], np.mean(medium.east) - shift[1]]
    reach = 10_000.0 + 2.0 * float(np.abs(ends[:, :2] - centre).max())

    def axes(values: Array, north: Array, east: Array) -> tuple[list[str], Array]:
        lines: list[str] = []
        for k, axis in enumerate((north - shift[0], east - shift[1])):
            if axis.size == 1:
                axis = axis[0] + reach * np.array([-1.0, 1.0])
                values = np.repeat(values, 2, axis=k)
            lines += [f"{axis.size} /", _row(axis, _kilometres)]
        return lines, values

    boundaries = {".bty": medium.bed} | ({".ati": medium.surface} if medium.has_ice else {})
    texts = {}
    for suffix, boundary in boundaries.items():
        lines, z = axes(boundary.depth, boundary.north, boundary.east)
        texts[suffix] = ["'R'", *lines, *map(_row, z.T)]
    if medium.sound_speed.shape[:2] != (1, 1):
        lines, c = axes(medium.sound_speed, medium.north, medium.east)
        levels = [f"{medium.depth.size} /", _row(medium.depth)]
        texts[".ssp"] = [*lines, *levels, *map(_row, c.transpose(2, 1, 0).reshape(-1, len(c)))]
    return {suffix: "\n".join(lines) + "\n" for suffix, lines in texts.items()}


def _env_text(title: str, medium: Medium, start: Array, end: Array, options: BellhopOptions) -> str:
    """
    The `.env` of one link, with a vacuum above the surface or ice, and attenuation in dB per
    wavelength.
    """
    uniform = medium.sound_speed.shape[:2] == (1, 1)
    profile = medium.sound_speed[0, 0] if uniform else medium.sound_speed.mean(axis=(0, 1))
    # a bed like the last level reflects nothing
    bed = options.bottom
    if bed == "matching":
        bed = HalfSpace(sound_speed=float(profile[-1]), density_g_per_cm3=1.0)
    half_space = []
    if isinstance(bed, HalfSpace):
        losses = (bed.attenuation_db_per_wavelength, bed.shear_attenuation_db_per_wavelength)
        half_space = [
            _row(
                (medium.depth[-1], bed.sound_speed, bed.shear_speed, bed.density_g_per_cm3, *losses)
            )
        ]
    letter = "A" if isinstance(bed, HalfSpace) else "R" if bed == "rigid" else "V"
    # the box holds all rays of the cone about the link
    step = end - start
    across = math.hypot(step[0], step[1])
    bearing = math.atan2(step[1], step[0])
    fan = np.degrees(np.linspace(-options.cone, options.cone, options.beams))
    side = (
        1.05 * across
        + float(np.linalg.norm(step)) * math.sin(min(options.cone, 0.5 * math.pi))
        + 100.0
    )
    deepest = 1.1 * float(max(medium.bed.depth.max(), medium.depth[-1]))
    box = f"{_plain(options.step)} {_kilometres(side)} {_kilometres(side)} {_plain(deepest)}"
    # lines in the order in which Bellhop reads them
    last = _plain(medium.depth[-1])
    lines = [
        f"'{title} by MantaRay, x north, y east'",
        f"{_plain(options.frequency)} ! frequency [Hz]",
        "1 ! media",
        (
            f"'{'C' if uniform else 'H'}VW{' ~' if medium.has_ice else ''}' ! profile, vacuum"
            " above,"
            " attenuation in dB per wavelength"
        ),
        f"{medium.depth.size} 0.0 {last} ! levels, roughness [m], last level [m]",
        *(_row(level) for level in zip(medium.depth, profile, strict=True)),
        f"'{letter}~' 0.0 ! sea bed, roughness [m]",
        *half_space,
        *_list([start[0]], "source x [km]", _kilometres),
        *_list([start[1]], "source y [km]", _kilometres),
        *_list([start[2]], "source depth [m]"),
        *_list([end[2]], "receiver depth [m]"),
        *_list([across], "receiver range [km]", _kilometres),
        *_list([math.degrees(bearing)], "receiver bearing [deg] from x towards y"),
        f"'{_LETTER[options.run]}G RR3' ! run type",
        *_list(math.degrees(math.atan2(step[2], across)) + fan, "declination [deg], positive down"),
        *_list(math.degrees(bearing) + fan, "bearing [deg] from x towards y"),
        f"{box} ! step [m], box x [km], y [km], z [m]",
    ]
    return "\n".join(lines) + "\n"


def _plain(value: float) -> str:
    """Shortest decimal that reads back as the same double."""
    return repr(float(value))


def _kilometres(value: float) -> str:
    """
    Text of a length in kilometres, from metres with a shifted decimal point to keep all digits.
    """
    return format(Decimal(_plain(value)).scaleb(-3), "f")


def _row(values: Iterable[float], word: Callable[[float], str] = _plain) -> str:
    """Numbers of one list with a slash at the end."""
    return " ".join(map(word, values)) + " /"


def _list(
    values: Sequence[float] | Array, what: str, word: Callable[[float], str] = _plain
) -> list[str]:
    return [f"{len(values)} ! {what}", _row(values, word)]


def _write(path: Path, text: str) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _cut(axis: Array, parts: int) -> Array:
    if axis.size == 1 or parts == 1:
        return axis
    inner = axis[:-1, None] + np.diff(axis)[:, None] * (np.arange(parts) / parts)
    return np.append(inner.ravel(), axis[-1])


def _on_grid(axes: tuple[Array, ...], values: Array, finer: tuple[Array, ...]) -> Array:
    places = np.stack(np.meshgrid(*finer, indexing="ij"), axis=-1)
    return linear_interpolator(axes, values)(places.reshape(-1, len(axes))).reshape(
        places.shape[:-1]
    )
