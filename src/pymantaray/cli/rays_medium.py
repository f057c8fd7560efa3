"""The medium that the options of `mantaray rays` ask for, and a record of how it was made."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pymantaray.cli.rays_options import MediumOptions
from pymantaray.errors import AcousticsError, OceanError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pymantaray.acoustics import Medium
    from pymantaray.ocean.cast import CastTable

_GAP = 100.0  # m; a profile that ends higher above the sea bed is worth a note
_ONLY = {
    "profile": ("bottom", "thin", "smooth", "position"),
    "ocean": ("centre", "half_extent", "time"),
    "run": (),
}


class LoadedMedium(NamedTuple):
    """A medium, how it was made for the files, and what of that to tell the user."""

    medium: "Medium"
    record: dict[str, Any]
    notes: list[str]


def load_medium(
    options: MediumOptions, *, default: Literal["smooth", "linear"] | None = None
) -> LoadedMedium:
    """
    Medium from the one source that is given.

    Parameters
    ----------
    options : MediumOptions
    default : {"smooth", "linear"}, optional
        Interpolation if none is asked for. Default: smooth, and a run's own for a run.

    Returns
    -------
    LoadedMedium

    Raises
    ------
    MantaRayError
        If not exactly one source is given, an option does not go with it, or it is no ocean.
    """
    kind = _source(options)
    interpolation = options.interpolation or default
    if options.profile is not None:
        return _from_profile(options.profile, options, interpolation or "smooth")
    from pymantaray.acoustics import Medium

    if options.run is not None:
        from pymantaray.study import open_run

        run = open_run(options.run)
        interpolation = interpolation or run.config.acoustics.interpolation
        local, named = run.ocean, str(options.run)
    else:
        from pymantaray.ocean import open_ocean, to_local

        local = to_local(
            open_ocean(options.ocean or [], time=options.time),
            centre=options.centre,
            half_extent=options.half_extent,
        )
        named = " ".join(options.ocean or [])
    medium = Medium.from_dataset(local, interpolation=interpolation or "smooth")
    centre = [float(local.attrs[f"centre_{name}_deg"]) for name in ("latitude", "longitude")]
    reach = [float(medium.north[-1]), float(medium.east[-1])]
    record = {
        kind: named,
        "centre_deg": centre,
        "half_extent_m": reach,
        "interpolation": medium.interpolation,
    }
    note = (
        f"{named}: north +-{reach[0]:.0f} m, east +-{reach[1]:.0f} m about {centre[0]:g} N {centre[1]:g} E,"
        f" sea bed {medium.bathymetry.min():.0f} to {medium.bathymetry.max():.0f} m"
    )
    return LoadedMedium(medium, record, [note])


def _source(options: MediumOptions) -> str:
    given = [kind for kind in ("ocean", "profile", "run") if getattr(options, kind)]
    if len(given) != 1:
        named = " and ".join(f"--{kind}" for kind in given) or "no ocean"
        raise AcousticsError(f"{named} given; exactly one of --ocean, --profile and --run is needed")
    for kind, names in _ONLY.items():
        for name in names:
            if kind != given[0] and getattr(options, name) is not None:
                raise AcousticsError(f"--{name.replace('_', '-')}: goes with --{kind}, not with --{given[0]}")
    return given[0]


def _from_profile(
    path: Path, options: MediumOptions, interpolation: Literal["smooth", "linear"]
) -> LoadedMedium:
    from pymantaray.acoustics import Medium, smooth_profile, thin_profile
    from pymantaray.acoustics.profiles import is_raw_cast

    bottom = options.bottom
    if bottom is None:
        raise AcousticsError("--profile and --bottom: the one needs the other")
    if not 0.0 < bottom < float("inf"):
        raise AcousticsError(f"--bottom {bottom:g}: a positive depth in metres is needed")
    if options.thin is not None and options.smooth is not None:
        raise AcousticsError("--thin and --smooth exclude each other; give one")
    depth, speed, record = read_profile(path, options.position)
    first = float(depth[0])
    notes = []
    if interpolation == "smooth" and is_raw_cast(depth) and options.thin is options.smooth is None:
        raise AcousticsError(
            f"{path}: {depth.size} levels less than 2 m apart are a raw cast; thin it, as by --thin 0.1 (m/s),"
            " smooth it, as by --smooth 10 (m), or take --interpolation linear"
        )
    try:
        reduced = None
        if options.thin is not None:
            reduced = thin_profile(depth, speed, tolerance=options.thin, interpolation=interpolation)
        elif options.smooth is not None:
            reduced = smooth_profile(depth, speed, length=options.smooth, interpolation=interpolation)
        if reduced is not None:
            depth, speed = reduced.depth, reduced.sound_speed
            record[reduced.method] = {
                "tolerance_m_s" if reduced.method == "thinned" else "length_m": reduced.parameter,
                "rms_change_m_s": reduced.rms_change,
                "greatest_change_m_s": reduced.greatest_change,
            }
            notes.append(f"{path}: {reduced}")
        medium = Medium.from_profile(depth, speed, bottom_depth=bottom, interpolation=interpolation)
    except AcousticsError as error:
        raise AcousticsError(f"{path}: {error}") from None
    if first > 0.0:
        notes.append(f"{path}: starts at {first:g} m; the sound speed there is taken up to the surface")
    if bottom > depth[-1] + _GAP:
        notes.append(
            f"{path}: ends at {depth[-1]:g} m, above the sea bed at {bottom:g} m; sound speed is continued from there"
            " to a constant within some 400 m, so add levels if rays go that deep"
        )
    record |= {"levels": int(depth.size), "bottom_depth_m": bottom, "interpolation": interpolation}
    record["last_level_m"] = float(depth[-1])
    return LoadedMedium(medium, record, notes)


def read_profile(
    path: Path, position: tuple[float, float] | None = None
) -> "tuple[NDArray[np.float64], NDArray[np.float64], dict[str, Any]]":
    """
    Sound speed of a profile or a cast, computed by TEOS-10 if the file does not have it.

    Parameters
    ----------
    path : pathlib.Path
        CSV with ``depth`` or ``pressure``, and ``sound_speed`` or in-situ ``temperature`` and practical
        ``salinity``; the names may end in their units as in ``depth_m``.
    position : tuple of float, optional
        Latitude and longitude. Default: from a comment line with ``lat ...`` and ``lon ...``. [degrees]

    Returns
    -------
    depth, sound_speed : ndarray, shape (n_levels,)
        [m, m s⁻¹]
    record : dict
        The file, its number of levels and what was computed.

    Raises
    ------
    AcousticsError
        If columns, numbers or a position that is needed are missing, or depth does not increase.
    """
    import gsw
    import numpy as np

    from pymantaray.ocean.cast import read_cast_table
    from pymantaray.ocean.seawater import sound_speed

    try:
        table = read_cast_table(path)
        has_speed, has_water = table.has("sound_speed"), table.has("temperature", "salinity")
        vertical = "depth" if table.has("depth") else "pressure"
        if not table.has(vertical) or not (has_speed or has_water):
            wanted = ["depth"] if not table.has(vertical) else []
            wanted += [] if has_speed or has_water else ["sound_speed"]
            raise AcousticsError(
                f"{path}: lacks {', '.join(wanted)}; found {', '.join(table.header)}; pressure serves for depth,"
                " temperature and salinity for sound_speed"
            )
        used = (vertical, "sound_speed") if has_speed else (vertical, "temperature", "salinity")
        level, *water = (table.values(name, complete=True) for name in used)
    except OceanError as error:
        raise AcousticsError(str(error)) from None
    record: dict[str, Any] = {"profile": str(path), "raw_levels": level.size}
    falls = np.flatnonzero(np.diff(level) <= 0.0)
    if falls.size:
        line = table.lines[falls[0] + 1]
        raise AcousticsError(
            f"{path}, line {line}: {table.name(vertical)} is {level[falls[0] + 1]:g} after {level[falls[0]]:g}; it must"
            " increase"
        )
    if level[0] < 0.0:
        raise AcousticsError(f"{path}: {table.name(vertical)} begins at {level[0]:g}; it is positive down")
    if has_speed and vertical == "depth":
        return level, water[0], record
    lat, lon = _place(table, position)
    record |= {"position_deg": [lat, lon], "computed": "TEOS-10"}
    depth = level if vertical == "depth" else np.asarray(-gsw.z_from_p(level, lat), dtype=float)
    return depth, water[0] if has_speed else sound_speed(water[0], water[1], depth, lat, lon), record


def _place(table: "CastTable", position: tuple[float, float] | None) -> tuple[float, float]:
    from pymantaray.ocean.casts import place_in_comments

    found = position or place_in_comments(table.comments)
    if found is None:
        raise AcousticsError(
            f"{table.path}: sound speed or depth has to be computed, for which --position LAT LON is needed"
        )
    lat, lon = found
    if not (-90.0 <= lat <= 90.0 and -360.0 <= lon <= 360.0):
        raise AcousticsError(
            f"{table.path}: position {lat:g} {lon:g}; latitude and longitude in degrees are needed"
        )
    return lat, lon
