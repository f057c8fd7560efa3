"""Reading a `.env` file."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.bellhop.environment import INTERPOLATIONS, Environment, HalfSpace
from pymantaray.acoustics.bellhop.listing import ListReader

Array = NDArray[np.float64]
_SAME_DEPTH = 100.0 * float(np.finfo(np.float32).eps)  # m; Bellhop takes a level this near for the last one
_MOST_LEVELS = 100_000
_DB_PER_NEPER = 20.0 / math.log(10.0)
_DB_PER_WAVELENGTH: dict[str, Callable[[float, float, float], float]] = {  # of a value, speed and frequency
    "N": lambda nepers_per_m, c, f: nepers_per_m * _DB_PER_NEPER * c / f,
    "M": lambda db_per_m, c, f: db_per_m * c / f,
    "F": lambda db_per_m_khz, c, _f: db_per_m_khz * c / 1000.0,
    "W": lambda db_per_wavelength, _c, _f: db_per_wavelength,
    "Q": lambda quality, _c, _f: math.pi * _DB_PER_NEPER / quality,
    "L": lambda loss_tangent, _c, _f: 2.0 * math.pi * _DB_PER_NEPER * loss_tangent,
}
_REFUSED = {
    "N": "n-squared linear",
    "P": "PCHIP",
    "Q": "quadrilateral",
    "A": "analytic",
}


def read_environment(path: str | Path) -> Environment:
    """
    Read a `.env` file of BELLHOP or BELLHOP3D.

    Parameters
    ----------
    path : str or pathlib.Path
        The file, its extension may be left out.

    Returns
    -------
    Environment
        A file with six lists of positions before the run type is 3-D, one with three is 2-D.

    Raises
    ------
    AcousticsError
        If the file is damaged, or asks for what a medium cannot be: a profile option other than C, S and H,
        an altimetry file, or a surface that is not at depth 0.

    References
    ----------
    .. [1] Acoustics Toolbox, "Description of Environmental File" and "BELLHOP3D", blocks 1 to 10.
    """
    reader = ListReader(env_path(path))
    title = reader.word("the title")
    frequency = float(reader.numbers(1, "frequency [Hz]")[0])
    media = reader.count("number of media")
    if media != 1:
        raise reader.fail(f"number of media: {media}; Bellhop's is 1")
    options = reader.word("the top options").ljust(6)
    _check_options(reader, options)
    if options[1] == "A":
        reader.numbers(6, "half-space above the surface", least=0)
    depth, speed = _levels(reader)
    words = [*reader.words(2, "the bottom option"), "0"]
    bottom = words[0].ljust(2)
    half_space = None
    if bottom[0] == "A":
        half_space = _half_space(reader, float(speed[-1]), options[2], frequency)
    elif bottom[0] == "G":
        reader.numbers(2, "grain size")
    three_d, (x, y, z, receiver_z, ranges, bearings) = _positions(reader)
    run_type = reader.word("the run type")
    single = options[5] == "I"
    declination = _fan(reader, "declinations [deg]", single=single)
    fan_bearing = _fan(reader, "bearings of the fan [deg]", single=single) if three_d else np.zeros(1)
    limits = reader.numbers(4 if three_d else 3, "step and box")
    box = tuple(limits[1:] * [1e3, 1e3, 1.0]) if three_d else (limits[2] * 1e3, math.inf, limits[1])
    return Environment(
        title=title,
        frequency=frequency,
        profile=options[0],
        depth=depth,
        sound_speed=speed,
        bottom=bottom[0],
        half_space=half_space,
        bathymetry_file=bottom[1] in "~*",
        source_x=x,
        source_y=y,
        source_depth=z,
        receiver_depth=receiver_z,
        receiver_range=ranges,
        receiver_bearing=np.radians(bearings),
        run_type=run_type,
        declination=np.radians(declination),
        bearing=np.radians(fan_bearing),
        step=float(limits[0]),
        box=(float(box[0]), float(box[1]), float(box[2])),
        three_d=three_d,
    )


def env_path(path: str | Path) -> Path:
    """
    Give the `.env` file of a name with or without its extension.

    Parameters
    ----------
    path : str or pathlib.Path

    Returns
    -------
    pathlib.Path
    """
    given = Path(path)
    return given if given.suffix == ".env" else given.with_name(given.name + ".env")


def _check_options(reader: ListReader, options: str) -> None:
    if options[0] not in INTERPOLATIONS:
        name = _REFUSED.get(options[0], "unknown")
        raise reader.fail(f"profile option {options[0]!r} ({name}); supported are C, S and H")
    if options[4] in "~*":
        raise reader.fail("top options ask for an altimetry file; a medium's surface is flat")
    if options[3] == "F":
        reader.numbers(4, "temperature, salinity, pH and depth")
    elif options[3] == "B":
        for _ in range(reader.count("number of biological layers")):
            reader.numbers(5, "biological layer")


def _levels(reader: ListReader) -> tuple[Array, Array]:
    last = float(reader.numbers(3, "levels, roughness and last level")[2])
    speed = 1500.0  # Bellhop's value until the first one is given
    rows: list[tuple[float, float]] = []
    while len(rows) < _MOST_LEVELS:
        if reader.text_follows():
            raise reader.fail(f"the profile ends above the last level that is announced, {last:g} m")
        level = reader.numbers(6, "depth and sound speed of a level", least=1)
        speed = float(level[1]) if level.size > 1 else speed
        rows.append((float(level[0]), speed))
        if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
            raise reader.fail(f"level {rows[-1][0]:g} m follows {rows[-2][0]:g} m; depths must increase")
        if abs(rows[-1][0] - last) < _SAME_DEPTH:
            break
        if rows[-1][0] > last:
            raise reader.fail(f"level {rows[-1][0]:g} m is below the last one, {last:g} m")
    if rows[0][0] != 0.0:
        raise reader.fail(f"the first level, Bellhop's surface, is at {rows[0][0]:g} m; a medium's is at 0")
    levels = np.array(rows)
    return levels[:, 0], levels[:, 1]


def _half_space(reader: ListReader, water_speed: float, unit: str, frequency: float) -> HalfSpace:
    found = reader.numbers(6, "half-space below the bottom", least=0)
    defaults = np.array([0.0, water_speed, 0.0, 1.0, 0.0, 0.0])
    _, speed, shear, density, loss, shear_loss = np.concatenate([found, defaults[found.size :]]).tolist()
    if unit not in _DB_PER_WAVELENGTH:
        raise reader.fail(f"attenuation unit {unit!r}; supported are {', '.join(_DB_PER_WAVELENGTH)}")
    convert = _DB_PER_WAVELENGTH[unit]
    return HalfSpace(
        sound_speed=speed,
        density_g_per_cm3=density,
        attenuation_db_per_wavelength=convert(loss, speed, frequency) if loss else 0.0,
        shear_speed=shear,
        shear_attenuation_db_per_wavelength=convert(shear_loss, shear, frequency) if shear_loss else 0.0,
    )


def _positions(reader: ListReader) -> tuple[bool, list[Array]]:
    """Whether the file is 3-D; x, y, depth of the sources; depth, range, bearing of the receivers."""
    start, found = reader.next_line, 0
    while not reader.text_follows():
        reader.vector("positions")
        found += 1
    if found not in (3, 6):
        raise reader.fail(f"{found} lists of positions before the run type; a 2-D file has 3, a 3-D file 6")
    reader.next_line = start
    if found == 3:
        z, receiver_z = reader.vector("source depths"), reader.vector("receiver depths")
        ranges = reader.vector("receiver ranges", kilometres=True)
        return False, [np.zeros(1), np.zeros(1), z, receiver_z, ranges, np.zeros(1)]
    names = ("source x", "source y", "source depths", "receiver depths", "receiver ranges", "bearings")
    return True, [reader.vector(name, kilometres=name.endswith((" x", " y", "ranges"))) for name in names]


def _fan(reader: ListReader, what: str, *, single: bool) -> Array:
    """Launch angles; with a count of 0 Bellhop chooses how many, and the limits are given."""
    words = reader.words(2 if single else 1, f"number of {what}")
    count = int(words[0]) if words and words[0].isdigit() else -1
    if not 0 <= count <= 10_000_000:
        raise reader.fail(f"number of {what}: {words[0] if words else 'nothing'!r}; a whole number is needed")
    return reader.spaced(count or 2, what)
