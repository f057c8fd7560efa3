"""
Reader of Argo profile files, as data centres deliver them or argopy writes them, and of EN4.

Format: Argo user's manual, doi:10.13155/29825, core-Argo profile format 3.1 and reference table 2.
Sources: excerpts of the manual and headers of files.
"""

from pathlib import Path

import gsw
import numpy as np
import xarray as xr

from pymantaray.arrays import AnyArray, Array, Instants, Mask
from pymantaray.errors import OceanError
from pymantaray.ocean.cast import Cast, clean_cast
from pymantaray.ocean.convert import decoded_times, degrees
from pymantaray.ocean.files import numbers, reading, text

_GOOD = list("1258")  # accepted quality flags: good, probably good, changed, estimated
_REJECTED = "4"  # of EN4, for levels and profiles
ARGO = {"PRES", "POTM_CORRECTED"}
"""Variables of which a file of Argo or EN4 has one."""
_PARAMETERS = ("PRES", "TEMP", "PSAL")
_DIMS = ("N_PROF", "N_LEVELS")
_FILL = 99_999.0  # fill value of the format, also if it is not declared
_LATEST = np.datetime64("2200-01-01")  # later dates come from the fill value, 999999 days


def read_argo(path: str | Path) -> list[Cast]:
    """
    Read all profiles of an Argo file with at least two usable levels; names are float and cycle.

    A profile in real-time mode (``DATA_MODE`` R) gives raw values, a profile in mode A or D gives
    adjusted values. Raw values never replace missing adjusted values, because adjustment removes
    bad values. A level is used if all its flags are good. A profile is used if the flags of its
    position and date are good. Files without flags or modes are used unfiltered, for example files
    that argopy's standard mode has filtered. The notes of a cast report this and the numbers of
    rejected levels and profiles.
    """
    path = Path(path)
    try:
        with reading(path) as data:
            return _profiles(_of_en4(data) if "POTM_CORRECTED" in data else data, path)
    except OceanError as error:
        raise OceanError(f"{path}: {str(error).removeprefix(f'{path.name}: ')}") from None


def _of_en4(data: xr.Dataset) -> xr.Dataset:
    """
    Profiles of EN4 (Good et al., 2013, https://doi.org/10.1002/2013JC009067) with the names of
    Argo: corrected depth, potential temperature and salinity as pressure, temperature and salinity.

    The flag of a whole profile, PROFILE_POTM_QC or PROFILE_PSAL_QC, counts for each of its levels.
    """
    missing = [n for n in ("DEPH_CORRECTED", "PSAL_CORRECTED") if n not in data.variables]
    if missing:
        raise OceanError(f"lacks {' and '.join(missing)}, which profiles of EN4 have")
    shape = data.variables["POTM_CORRECTED"].shape
    lat, lon = (
        np.where(np.abs(angle) < _FILL, angle, np.nan)[:, None]
        for angle in (_angles(data, name, shape[:1]) for name in ("LATITUDE", "LONGITUDE"))
    )
    depth, potential, salinity = (
        _values(data, f"{name}_CORRECTED", shape) for name in ("DEPH", "POTM", "PSAL")
    )
    with np.errstate(all="ignore"):
        pressure = gsw.p_from_z(-depth, lat)
        absolute = gsw.SA_from_SP(salinity, pressure, lon, lat)
        temperature = gsw.pt_from_t(absolute, potential, 0.0, pressure)
    values = {"PRES": pressure, "TEMP": temperature, "PSAL": salinity}
    argo = data.drop_vars([n for n in data.variables if "CYCLE_NUMBER" in str(n)])
    for (name, array), own in zip(values.items(), ("DEPH", "POTM", "PSAL"), strict=True):
        argo[name] = _DIMS, array
        flags = _letters(data, f"{own}_CORRECTED_QC", shape)
        whole = _letters(data, f"PROFILE_{own}_QC", shape[:1])
        if flags is not None:
            rejected = np.False_ if whole is None else whole[:, None] == _REJECTED
            argo[f"{name}_QC"] = _DIMS, np.where(rejected, _REJECTED, flags)
    return argo


def _profiles(data: xr.Dataset, path: Path) -> list[Cast]:
    if "PRES" not in data.variables or data.variables["PRES"].dims != _DIMS:
        hint = "; convert points to profiles with argopy's ds.argo.point2profile()"
        raise OceanError(
            "not an Argo profile file: no PRES over N_PROF and"
            f" N_LEVELS{hint if 'PRES' in data.variables else ''}"
        )
    shape = data.variables["PRES"].shape
    for name in (*_PARAMETERS, "LATITUDE", "LONGITUDE"):
        if name not in data.variables:
            raise OceanError(f"lacks {name}; a cast needs PRES, TEMP, PSAL, LATITUDE and LONGITUDE")
    lat, lon = (_angles(data, name, shape[:1]) for name in ("LATITUDE", "LONGITUDE"))
    time = _times(data, shape[0])
    # profiles at a good position with at least two good levels
    values, usable, notes = _levels(data, shape)
    located = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0)
    for name in ("POSITION_QC", "JULD_QC", "TIME_QC"):
        flags = _letters(data, name, shape[:1])
        if flags is not None:
            located &= np.isin(flags, _GOOD)
    profiles = np.flatnonzero(located & (usable.sum(axis=1) >= 2)).tolist()
    if not profiles:
        raise OceanError(
            f"none of {shape[0]} profiles has a good position and at least two levels with good"
            " pressure, temperature and salinity"
        )
    if len(profiles) < shape[0]:
        notes.append(
            f"{shape[0] - len(profiles)} of {shape[0]} profiles rejected: no good position or"
            " fewer than two good levels"
        )
    # a cast of the good levels of each profile
    names = _names(data, shape[0], path.stem)
    casts = []
    for i in profiles:
        present = int(np.count_nonzero(np.isfinite(values[:, i]).any(axis=0)))
        flagged = max(present - int(usable[i].sum()), 0)
        pressure, temperature, salinity = values[:, i, usable[i]]
        cast_notes = [*notes, "depth from pressure by TEOS-10"]
        if flagged:
            cast_notes.append(
                f"{flagged} of {present} levels rejected: bad quality flags or missing values"
            )
        depth = np.asarray(-gsw.z_from_p(pressure, lat[i]), dtype=float)
        casts.append(
            clean_cast(
                names[i],
                (float(lat[i]), float(lon[i])),
                time[i],
                (depth, temperature, salinity),
                dropped=flagged,
                notes=cast_notes,
                where=f"{path}, profile {i}",
            )
        )
    return casts


def _levels(data: xr.Dataset, shape: tuple[int, ...]) -> tuple[Array, Mask, list[str]]:
    """Values of the three parameters, a mask of usable levels, and notes for all profiles."""
    values = np.empty((3, *shape))
    usable = np.ones(shape, dtype=bool)
    notes = []
    adjusted = np.zeros(shape[0], dtype=bool)
    if all(f"{p}_ADJUSTED" in data.variables for p in _PARAMETERS):
        modes = _letters(data, "DATA_MODE", shape[:1])
        adjusted[:] = True if modes is None else np.isin(modes, ["A", "D"])
    for k, name in enumerate(_PARAMETERS):
        values[k] = _values(data, name, shape)
        flags = _letters(data, f"{name}_QC", shape)
        if adjusted.any():
            values[k, adjusted] = _values(data, f"{name}_ADJUSTED", shape)[adjusted]
            better = _letters(data, f"{name}_ADJUSTED_QC", shape)
            if better is not None:
                flags = better if flags is None else np.where(adjusted[:, None], better, flags)
        if flags is None:
            notes.append(f"{name} has no quality flags in the file: all levels used")
        else:
            usable &= np.isin(flags, _GOOD)
        usable &= np.isfinite(values[k])
    if adjusted.any():
        notes.append(
            "adjusted values"
            if adjusted.all()
            else "adjusted values of the profiles in mode A or D"
        )
    return values, usable, notes


def _values(data: xr.Dataset, name: str, shape: tuple[int, ...]) -> Array:
    _check_shape(data, name, shape)
    values = numbers(data, name)
    return np.where(np.abs(values) >= _FILL, np.nan, values)


def _angles(data: xr.Dataset, name: str, shape: tuple[int, ...]) -> Array:
    """Latitudes or longitudes in degrees, 99999 if missing."""
    _check_shape(data, name, shape)
    return np.nan_to_num(degrees(data, name, name.lower()), nan=_FILL)


def _check_shape(data: xr.Dataset, name: str, shape: tuple[int, ...]) -> None:
    if data.variables[name].shape != shape:
        raise OceanError(f"{name}: shape is {data.variables[name].shape}; it must be {shape}")


def _letters(data: xr.Dataset, name: str, shape: tuple[int, ...]) -> AnyArray | None:
    """First letter of each cell; None if the variable is missing."""
    if name not in data.variables:
        return None
    _check_shape(data, name, shape)
    return _texts(data, name).astype("U1")


def _texts(data: xr.Dataset, name: str) -> AnyArray:
    """Cells as text: data centres write letters, argopy writes integers or text."""
    raw = np.asarray(data.variables[name].values)
    if raw.dtype.kind in "iuf":
        raw = np.where(np.isfinite(raw), raw, 9).astype(int)
    cells = [
        c.decode("latin-1") if isinstance(c, bytes) else str(c).replace("nan", "") for c in raw.flat
    ]
    return np.array(cells).reshape(raw.shape)


def _times(data: xr.Dataset, count: int) -> Instants:
    """Instants to the millisecond; NaT if unknown."""
    times = np.full(count, np.datetime64("NaT", "ms"))
    name = next((n for n in ("JULD", "TIME") if n in data.variables), None)
    if name is not None:
        values = _values(data, name, (count,)) if name == "JULD" else numbers(data, name)
        known = np.isfinite(values)
        if known.any():
            instants = decoded_times(values[known], text(data.variables[name], "units"), where=name)
            times[known] = instants + np.timedelta64(500, "us")
            times[times > _LATEST] = np.datetime64("NaT", "us")
    return times


def _names(data: xr.Dataset, count: int, stem: str) -> list[str]:
    """Float and cycle, as in ``6901234_012``, with a D for a descending profile."""
    floats = [stem] * count
    cycles = [f"{i}" for i in range(count)]
    if "PLATFORM_NUMBER" in data.variables and len(data.variables["PLATFORM_NUMBER"]) == count:
        letters = _texts(data, "PLATFORM_NUMBER").reshape(count, -1)
        floats = ["".join(row).strip("\0 ") or stem for row in letters]
    if "CYCLE_NUMBER" in data.variables:
        cycles = [f"{int(c):03d}" for c in np.nan_to_num(_values(data, "CYCLE_NUMBER", (count,)))]
    direction = _letters(data, "DIRECTION", (count,))
    down = (
        [""] * count
        if direction is None
        else ["D" if letter == "D" else "" for letter in direction]
    )
    return [f"{f}_{c}{d}" for f, c, d in zip(floats, cycles, down, strict=True)]
