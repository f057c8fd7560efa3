"""A medium and its links as BELLHOP3D input, and such input as a medium."""

import math
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.bellhop.environment import Environment, HalfSpace
from pymantaray.acoustics.bellhop.grids import bty_text, read_bty, read_bty_2d, read_ssp, ssp_text
from pymantaray.acoustics.bellhop.read_env import env_path, read_environment
from pymantaray.acoustics.bellhop.refine import merge_grids
from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
Bottom = Literal["rigid", "vacuum", "matching"] | HalfSpace
Run = Literal["arrivals", "arrivals-binary", "rays", "eigenrays"]
CONE = math.radians(15.0)  # rad, to either side of the chord
BEAMS = 100
STEP = 50.0  # m; Bellhop's own choice, a tenth of the depth, can cost milliseconds
_LETTER = {"arrivals": "A", "arrivals-binary": "a", "rays": "R", "eigenrays": "E"}
_LONGEST_NAME = 60  # Bellhop keeps 80 characters of a name with its extension


def write_bellhop(
    folder: str | Path,
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    *,
    name: str = "link",
    run: Run = "arrivals",
    beams: int = BEAMS,
    cone: float = CONE,
    frequency: float = 10_000.0,
    bottom: Bottom = "rigid",
    origin: Sequence[float] = (0.0, 0.0),
    step: float = STEP,
) -> list[Path]:
    """
    Write a medium and its links as input of BELLHOP3D, one run per link.

    Parameters
    ----------
    folder : str or pathlib.Path
        Where the files go; made if needed. Files of the same names are replaced.
    medium : Medium
        Its values at the grid points are written. Bellhop's grid means straight lines between them, so a
        smooth medium is not the same ocean there; pass it through `linear_medium` first.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        Positions ``(north, east, down)`` inside the grid. [m]
    name : str
        Stem of the files of one link; several links add ``_0``, ``_1`` and so on.
    run : {"arrivals", "arrivals-binary", "rays", "eigenrays"}
        What Bellhop is to write: `.arr` as text or binary, or `.ray`.
    beams : int
        Beams in declination and again in bearing.
    cone : float
        Width of the fan to either side of the chord, in both. [rad]
    frequency : float
        Bellhop joins arrivals nearer than 0.05/(2 pi frequency) seconds. [Hz]
    bottom : {"rigid", "vacuum", "matching"} or HalfSpace
        Sea bed: lossless with or without a change of sign, without a contrast to the water, or given.
    origin : sequence of 2 floats
        North and east of Bellhop's x = y = 0. Bellhop keeps positions in single precision: near the source
        they lose least. [m]
    step : float
        Step along the rays; 0 leaves it to Bellhop, a tenth of the last level. [m]

    Returns
    -------
    list of pathlib.Path
        The `.env` file of each link. The `.ssp` and `.bty` files of further links are hard links to the first.

    Raises
    ------
    AcousticsError
        If an end lies outside the grid or its levels, an option is impossible or a file cannot be written.

    Notes
    -----
    Bellhop's x is north, y east and z down, so its bearings are azimuths clockwise from north. Lengths are
    written with all their digits. A medium with one profile is written as one (option C) with a flat `.bty`
    that reaches beyond all links; any other as a hexahedral grid. The sea bed is bilinear in a medium and two
    triangles a cell in Bellhop.
    """
    a, b = (np.atleast_2d(np.asarray(points, dtype=float)) for points in (source, receiver))
    _check(medium, a, b, name, beams=beams, cone=cone, frequency=frequency, step=step)
    if run not in _LETTER:
        raise AcousticsError(f"run: {run!r}; allowed are {', '.join(_LETTER)}")
    north0, east0 = float(origin[0]), float(origin[1])
    ends = np.concatenate([a, b])[:, :2]
    centre = [np.mean(axis) for axis in (medium.north, medium.east)]
    reach = 10_000.0 + 2.0 * float(np.abs(ends - centre).max())
    x, y = medium.north - north0, medium.east - east0
    uniform = medium.sound_speed.shape[:2] == (1, 1)
    texts = {
        ".bty": bty_text(medium.bed_north - north0, medium.bed_east - east0, medium.bathymetry, reach=reach)
    }
    if not uniform:
        texts[".ssp"] = ssp_text(x, y, medium.depth, medium.sound_speed, reach=reach)
    profile = medium.sound_speed.mean(axis=(0, 1)) if not uniform else medium.sound_speed[0, 0]
    letter, half_space = _bed(bottom, float(profile[-1]))
    paths: list[Path] = []
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        for i, (start, end) in enumerate(zip(a, b, strict=True)):
            stem = name if len(a) == 1 else f"{name}_{i}"
            path = Path(folder) / f"{stem}.env"
            if i == 0:
                for suffix, text in texts.items():
                    path.with_suffix(suffix).write_text(text, encoding="ascii")
            else:
                for suffix in texts:
                    _same_file(paths[0].with_suffix(suffix), path.with_suffix(suffix))
            step_to = end - start
            distance, across = float(np.linalg.norm(step_to)), math.hypot(step_to[0], step_to[1])
            fan = np.linspace(-cone, cone, beams)
            side = 1.05 * across + distance * math.sin(min(cone, 0.5 * math.pi)) + 100.0
            environment = Environment(
                title=f"{stem} by MantaRay, x north, y east",
                frequency=frequency,
                profile="C" if uniform else "H",
                depth=medium.depth,
                sound_speed=profile,
                bottom=letter,
                half_space=half_space,
                bathymetry_file=True,
                source_x=np.array([start[0] - north0]),
                source_y=np.array([start[1] - east0]),
                source_depth=start[2:],
                receiver_depth=end[2:],
                receiver_range=np.array([across]),
                receiver_bearing=np.array([math.atan2(step_to[1], step_to[0])]),
                run_type=f"{_LETTER[run]}G RR3",
                declination=math.atan2(step_to[2], across) + fan,
                bearing=math.atan2(step_to[1], step_to[0]) + fan,
                step=step,
                box=(side, side, 1.1 * float(max(medium.bathymetry.max(), medium.depth[-1]))),
            )
            path.write_text(environment.text(), encoding="utf-8")
            paths.append(path)
    except OSError as error:
        raise AcousticsError(f"{error.filename}: cannot be written: {error.strerror}") from None
    return paths


def read_bellhop(path: str | Path, *, x_axis: Literal["north", "east"] = "north") -> Medium:
    """
    Medium of a `.env` file and the `.ssp` and `.bty` files that belong to it.

    Parameters
    ----------
    path : str or pathlib.Path
        The `.env` file, its extension may be left out.
    x_axis : {"north", "east"}
        Where Bellhop's x points; y is the other. The range of a 2-D file is north.

    Returns
    -------
    Medium
        ``linear`` for a hexahedral grid (option H) and for straight lines between levels (C), ``smooth`` for
        a spline (S), whose end conditions are natural here and cubic in Bellhop.

    Raises
    ------
    AcousticsError
        If a file is damaged or missing, or is none a medium can be made of, see `read_environment`.

    Notes
    -----
    Where the grids of sound speed and sea bed differ, the medium has the points of both inside the
    rectangle that both cover: linear interpolation does not change. What the boundaries are made of is no
    part of a medium.
    """
    file = env_path(path)
    if x_axis not in ("north", "east"):
        raise AcousticsError(f"x_axis: {x_axis!r}; allowed are 'north' and 'east'")
    environment = read_environment(file)
    point, depth = np.zeros(1), environment.depth
    x, y, c = point, point, environment.sound_speed[None, None]
    if environment.profile == "H":
        x, y, depth, c = read_ssp(file.with_suffix(".ssp"))
        if depth[0] != 0.0:
            raise AcousticsError(
                f"{file.with_suffix('.ssp')}: the first level, Bellhop's surface, is at {depth[0]:g} m; a medium's"
                " is at 0"
            )
    bed_x, bed_y, bed = point, point, np.full((1, 1), environment.depth[-1])
    if environment.bathymetry_file and environment.three_d:
        bed_x, bed_y, bed = read_bty(file.with_suffix(".bty"))
    elif environment.bathymetry_file:
        bed_x, depths = read_bty_2d(file.with_suffix(".bty"))
        bed = depths[:, None]
    if x_axis == "east" and environment.three_d:
        x, y, c = y, x, c.swapaxes(0, 1)
        bed_x, bed_y, bed = bed_y, bed_x, bed.T
    north, east, c, bed = merge_grids((x, y, c), (bed_x, bed_y, bed), str(file))
    return Medium.from_grid(
        north,
        east,
        depth,
        c,
        bathymetry=bed,
        interpolation=environment.interpolation,
    )


def _check(
    medium: Medium,
    a: Array,
    b: Array,
    name: str,
    *,
    beams: int,
    cone: float,
    frequency: float,
    step: float,
) -> None:
    if a.ndim != 2 or a.shape[1:] != (3,) or a.shape != b.shape or len(a) == 0:
        raise AcousticsError(f"source has shape {a.shape}, receiver {b.shape}; both need (n_links, 3)")
    if not name or len(name) > _LONGEST_NAME or Path(name).name != name:
        raise AcousticsError(f"name: {name!r}; a file name of 1 to {_LONGEST_NAME} characters is needed")
    if beams < 2 or not 0.0 < cone <= math.pi:
        raise AcousticsError(f"beams {beams}, cone {cone:g} rad; at least 2 beams and up to pi are allowed")
    if not (frequency > 0.0 and math.isfinite(frequency) and step >= 0.0 and math.isfinite(step)):
        raise AcousticsError(
            f"frequency {frequency} Hz, step {step} m; the first must be positive, the second not less than 0"
        )
    if medium.depth[0] != 0.0:
        raise AcousticsError(
            f"depth: the first level is at {medium.depth[0]:g} m; Bellhop takes it for the surface, give one at 0"
        )
    low = [axis[0] if axis.size > 1 else -math.inf for axis in (medium.north, medium.east)] + [0.0]
    high = [axis[-1] if axis.size > 1 else math.inf for axis in (medium.north, medium.east)] + [
        medium.depth[-1]
    ]
    for end, points in (("source", a), ("receiver", b)):
        outside = np.flatnonzero(~np.all((points >= low) & (points <= high), axis=1))
        if outside.size:
            p = points[outside[0]]
            raise AcousticsError(
                f"{end} of link {outside[0]}: {p[0]:g} north, {p[1]:g} east, {p[2]:g} m deep is outside the grid or"
                f" its levels (0 to {medium.depth[-1]:g} m); Bellhop would move or lose it"
            )


def _bed(bottom: Bottom, water_speed: float) -> tuple[str, HalfSpace | None]:
    if isinstance(bottom, HalfSpace):
        return "A", bottom
    if bottom == "matching":
        return "A", HalfSpace(sound_speed=water_speed, density_g_per_cm3=1.0)
    if bottom in ("rigid", "vacuum"):
        return ("R" if bottom == "rigid" else "V"), None
    raise AcousticsError(f"bottom: {bottom!r}; allowed are 'rigid', 'vacuum', 'matching' and a HalfSpace")


def _same_file(first: Path, other: Path) -> None:
    other.unlink(missing_ok=True)
    try:
        os.link(first, other)
    except OSError:  # a file system without hard links
        shutil.copyfile(first, other)
