"""Argo's profile files, as the data centres deliver them or argopy writes them, as casts."""

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gsw
import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.cast import Cast, clean_cast
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.files import open_file

if TYPE_CHECKING:
    import netCDF4

Array = NDArray[np.float64]
GOOD_FLAGS = frozenset("1258")
"""Quality flags of values that are used: good, probably good, changed, estimated."""
_PARAMETERS = ("PRES", "TEMP", "PSAL")
_DIMS = ("N_PROF", "N_LEVELS")
_LARGEST = 20_000_000  # values of one variable; a float's whole life has a hundredth of it
_UNIT = re.compile(
    r"(day|hour|minute|second|millisecond|microsecond|nanosecond)s? since (\d{4}-\d{2}-\d{2}(?:[T ][\d:]+)?)"
)
_SECONDS = {
    "day": 86_400.0,
    "hour": 3_600.0,
    "minute": 60.0,
    "second": 1.0,
    "millisecond": 1e-3,
    "microsecond": 1e-6,
    "nanosecond": 1e-9,
}
_LONGEST = 7e9  # s, 220 years; longer is the fill value, 999999 days
_MAGIC = (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF")


def is_netcdf(path: Path) -> bool:
    """
    Whether a file begins as NetCDF does.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    bool
        False too for a file that is not there.
    """
    try:
        with path.open("rb") as stream:
            return stream.read(4) in _MAGIC
    except OSError:
        return False


def read_argo(path: str | Path) -> list[Cast]:
    """
    Read the profiles of an Argo file.

    Parameters
    ----------
    path : str or pathlib.Path
        NetCDF with dimensions ``N_PROF`` and ``N_LEVELS``: a core profile file (``R...``, ``D...``), a float's
        or a day's collection (``..._prof.nc``), or what argopy's ``to_netcdf`` writes of a collection of
        profiles.

    Returns
    -------
    list of Cast
        Those with at least two usable levels, named by float and cycle; each one's notes count the levels
        left out and the profiles of the file that had none.

    Raises
    ------
    OceanError
        If the file is unreadable, not of this form, or has no usable profile.

    Notes
    -----
    A profile in real-time mode (``DATA_MODE`` R) gives its raw values, one in the modes A and D its adjusted
    ones; raw values never stand in for missing adjusted ones, since adjustment leaves out what is bad. A
    level counts if pressure, temperature and salinity all have a flag of `GOOD_FLAGS`; a profile, if its
    position and date have. Files without flags or modes, as argopy's standard mode writes them after
    filtering, are used as they are, and the notes say so.

    References
    ----------
    .. [1] Argo user's manual, doi:10.13155/29825, core-Argo profile format 3.1 and reference table 2. Read in
       excerpts and in the headers of files.
    """
    import netCDF4

    path = Path(path)
    _check_sizes(path)
    try:
        with netCDF4.Dataset(path, "r") as data:
            return _profiles(data, path)
    except OceanError:
        raise
    except Exception as error:  # noqa: BLE001  the library raises whatever it stumbles over
        reason = " ".join(str(error).split())[:120]
        raise OceanError(f"{path}: cannot be read as an Argo file, perhaps cut short ({reason})") from None


def _check_sizes(path: Path) -> None:
    with open_file(path) as data:
        for name, variable in data.variables.items():
            if math.prod(variable.shape) > _LARGEST:
                declared = " x ".join(map(str, variable.shape))
                raise OceanError(f"{path}: {name} declares {declared} values; allowed are {_LARGEST} in all")


def _profiles(data: "netCDF4.Dataset", path: Path) -> list[Cast]:
    if "PRES" not in data.variables or data.variables["PRES"].dimensions != _DIMS:
        hint = (
            " (points: argopy's ds.argo.point2profile() makes profiles of them)"
            if "PRES" in data.variables
            else ""
        )
        raise OceanError(f"{path}: no PRES over N_PROF and N_LEVELS, so no Argo profile file{hint}")
    count, levels = (len(data.dimensions[d]) for d in _DIMS)
    for name in (*_PARAMETERS, "LATITUDE", "LONGITUDE"):
        if name not in data.variables:
            raise OceanError(f"{path}: lacks {name}; a cast needs PRES, TEMP, PSAL, LATITUDE and LONGITUDE")
    lat, lon = (_numbers(data, name, (count,)) for name in ("LATITUDE", "LONGITUDE"))
    time = _times(data, count)
    modes = _characters(data, "DATA_MODE", (count,))
    values, usable, notes = _levels(data, (count, levels), modes)
    placed = np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0)
    for flag in ("POSITION_QC", "JULD_QC", "TIME_QC"):
        flags = _characters(data, flag, (count,))
        if flags is not None:
            placed &= np.isin(flags, list(GOOD_FLAGS))
    used = np.flatnonzero(placed & (usable.sum(axis=1) >= 2))
    if not used.size:
        raise OceanError(
            f"{path}: none of {count} profiles has a good position and two levels with good pressure, temperature"
            " and salinity"
        )
    if used.size < count:
        notes.append(f"{count - used.size} of {count} profiles of the file had no good position or levels")
    names = _names(data, count, path)
    return [_cast(i, names[i], (lat, lon, time), values[:, i], usable[i], notes, path) for i in used.tolist()]


def _cast(
    i: int,
    name: str,
    where: tuple[Array, Array, NDArray[np.datetime64]],
    values: Array,
    usable: NDArray[np.bool_],
    notes: list[str],
    path: Path,
) -> Cast:
    lat, lon, time = (column[i] for column in where)
    pressure, temperature, salinity = values[:, usable]
    present = int(np.count_nonzero(np.isfinite(values).any(axis=0)))
    flagged = present - int(usable.sum())
    told = [*notes, "depth from pressure by TEOS-10"]
    if flagged > 0:
        told.append(f"{flagged} of {present} levels left out for their quality flags or missing values")
    depth = np.asarray(-gsw.z_from_p(pressure, lat), dtype=float)
    cast = clean_cast(
        name=name,
        place=(float(lat), float(lon)),
        time=time,
        profile=(depth, temperature, salinity),
        notes=told,
        where=f"{path}, profile {i}",
    )
    object.__setattr__(cast, "dropped", cast.dropped + max(flagged, 0))
    return cast


def _levels(
    data: "netCDF4.Dataset", shape: tuple[int, int], modes: NDArray[Any] | None
) -> tuple[Array, NDArray[np.bool_], list[str]]:
    """Values of the three parameters, which levels are usable, and notes for all profiles."""
    values = np.empty((3, *shape))
    usable = np.ones(shape, dtype=bool)
    notes = []
    adjusted = np.zeros(shape[0], dtype=bool)
    if all(f"{p}_ADJUSTED" in data.variables for p in _PARAMETERS):
        adjusted[:] = True if modes is None else np.isin(modes, ["A", "D"])
    for k, name in enumerate(_PARAMETERS):
        values[k] = _numbers(data, name, shape)
        flags = _characters(data, f"{name}_QC", shape)
        if adjusted.any():
            values[k, adjusted] = _numbers(data, f"{name}_ADJUSTED", shape)[adjusted]
            better = _characters(data, f"{name}_ADJUSTED_QC", shape)
            if better is not None:
                flags = better if flags is None else np.where(adjusted[:, None], better, flags)
        if flags is None:
            notes.append(f"{name} has no quality flags in the file: all levels used")
        else:
            usable &= np.isin(flags, list(GOOD_FLAGS))
        usable &= np.isfinite(values[k])
    if adjusted.any():
        notes.append(
            "adjusted values" if adjusted.all() else "adjusted values of the profiles in mode A or D"
        )
    return values, usable, notes


def _numbers(data: "netCDF4.Dataset", name: str, shape: tuple[int, ...]) -> Array:
    variable = data.variables[name]
    if variable.shape != shape or not np.issubdtype(variable.dtype, np.number):
        raise OceanError(
            f"{name} is {variable.dtype} of shape {variable.shape}; needs numbers of shape {shape}"
        )
    found: Array = np.asarray(np.ma.filled(np.ma.asarray(variable[:], dtype=float), np.nan))
    return np.where(np.abs(found) >= 99_999.0, np.nan, found)  # the format's fill value, also undeclared


def _characters(data: "netCDF4.Dataset", name: str, shape: tuple[int, ...]) -> NDArray[Any] | None:
    """First letter of each cell; argopy writes flags as integers, the data centres as characters."""
    if name not in data.variables:
        return None
    variable = data.variables[name]
    if variable.shape[: len(shape)] != shape:
        raise OceanError(f"{name} has shape {variable.shape}; needs {shape}")
    raw = np.ma.asarray(variable[:])
    if raw.ndim > len(shape):  # characters of strings
        raw = raw[..., 0]
    if raw.dtype.kind in "iuf":
        whole: Array = np.asarray(np.ma.filled(np.ma.asarray(raw, dtype=float), 9.0))
        return np.where(np.isfinite(whole), whole, 9.0).astype(int).astype(str).astype("U1")
    filled = np.ma.filled(raw, b" " if raw.dtype.kind == "S" else " ")
    text = np.char.decode(filled, "latin-1") if filled.dtype.kind == "S" else filled.astype(str)
    return np.asarray(text.astype("U1"))


def _times(data: "netCDF4.Dataset", count: int) -> NDArray[np.datetime64]:
    found = np.full(count, np.datetime64("NaT", "ns"))
    name = next((n for n in ("JULD", "TIME") if n in data.variables), None)
    if name is None:
        return found
    variable = data.variables[name]
    units = str(getattr(variable, "units", ""))
    match = _UNIT.match(units.strip())
    if variable.shape != (count,) or not np.issubdtype(variable.dtype, np.number) or not match:
        raise OceanError(
            f"{name} is {variable.dtype} of shape {variable.shape} in {units!r}; needs numbers of shape {(count,)} in"
            " units as 'days since 1950-01-01 00:00:00 UTC'"
        )
    seconds = np.ma.filled(np.ma.asarray(variable[:], dtype=float), np.nan) * _SECONDS[match[1]]
    known = np.abs(seconds) < _LONGEST
    epoch = parse_instant(match[2])
    found[known] = epoch + np.round(seconds[known] * 1e3).astype("timedelta64[ms]")
    return found


def _names(data: "netCDF4.Dataset", count: int, path: Path) -> list[str]:
    """Float and cycle, as in ``6901234_012``; a D is added for a descending profile."""
    floats = [path.stem] * count
    if "PLATFORM_NUMBER" in data.variables:
        raw = np.ma.filled(data.variables["PLATFORM_NUMBER"][:])
        if raw.dtype.kind == "S" and raw.ndim == 2:
            floats = ["".join(c.decode("latin-1") for c in row).strip("\0 ") or path.stem for row in raw]
        elif raw.shape == (count,):
            floats = [str(value).strip() for value in raw]
    cycles = [f"{i}" for i in range(count)]
    if "CYCLE_NUMBER" in data.variables:
        cycles = [f"{int(c):03d}" for c in np.ma.filled(data.variables["CYCLE_NUMBER"][:], 0)]
    direction = _characters(data, "DIRECTION", (count,))
    down = [""] * count if direction is None else ["D" if letter == "D" else "" for letter in direction]
    return [f"{f}_{c}{d}" for f, c, d in zip(floats, cycles, down, strict=True)]
