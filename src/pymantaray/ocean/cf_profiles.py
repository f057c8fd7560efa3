"""
Reader of profiles in CF data sets (discrete sampling geometry, conventions 1.11, chapter 9 and
appendix H.3).

It reads single profiles, orthogonal and incomplete multidimensional arrays, contiguous and indexed
ragged arrays, and GO-SHIP's CF/netCDF of CCHDO (https://github.com/cchdo/hydro,
docs/format_spec.rst).
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.arrays import AnyArray, Array, Indices, Mask
from pymantaray.errors import OceanError
from pymantaray.ocean.cast import CastTable
from pymantaray.ocean.convert import decoded_times, degrees
from pymantaray.ocean.files import numbers, reading, text
from pymantaray.ocean.instrument_table import ITS_90_NOTE
from pymantaray.ocean.positions import is_position, unused_position
from pymantaray.records.digits import counted

_QUANTITIES = {
    "depth": ("depth",),
    "pressure": ("sea_water_pressure", "sea_water_pressure_due_to_sea_water"),
    "temperature": ("sea_water_temperature",),
    "potential_temperature": ("sea_water_potential_temperature",),
    "conservative_temperature": ("sea_water_conservative_temperature",),
    "salinity": ("sea_water_practical_salinity", "sea_water_salinity"),
    "absolute_salinity": ("sea_water_absolute_salinity",),
    "sound_speed": ("speed_of_sound_in_sea_water",),
}
DATA_SET = "CF"
"""Value of `CastTable.instrument`."""
_COPERNICUS = ("TIME", "DEPTH")
"""Dimensions of the in-situ profiles of Copernicus and OceanSITES."""
_BAD_FLAGS = (3, 4, 9)  # without meanings: those of OceanGliders, IMOS, Argo and QARTOD
_BAD = re.compile(
    r"(?<!no_)(?<!not_)(bad|fail|suspect|question|doubt|reject|invalid|error|wrong|missing)"
    r"|not_(sampled|reported)"
)
_ALL_BAD_BUT = "accepted"  # of the World Ocean Database, whose other flags are reasons


def holds_profiles(data: xr.Dataset) -> bool:
    """
    Return True if the attributes of a data set declare profiles, or if it has the layout of
    Copernicus' in-situ profiles.
    """
    feature = str(data.attrs.get("featureType", "")).lower()
    copernicus = any(
        tuple(v.dims) == _COPERNICUS and text(v, "standard_name") for v in data.variables.values()
    )
    return (
        feature == "profile"
        or any(v.attrs.get("cf_role") == "profile_id" for v in data.variables.values())
        or (copernicus and {"TIME", "LATITUDE", "LONGITUDE"} <= data.variables.keys())
    )


def read_cf_profiles(path: Path) -> dict[str, CastTable]:
    """Read each profile of a CF data set as a table, by name."""
    with reading(path) as data:
        return _tables(data, path)


def instance_of_rows(data: xr.Dataset, dim: str, path: Path) -> Indices | None:
    """Index of the feature of each row of a ragged array; None if there is one feature."""
    size = data.sizes[dim]
    for name, variable in data.variables.items():
        if variable.attrs.get("sample_dimension") == dim:
            counts = np.nan_to_num(numbers(data, str(name))).astype(np.int64)
            if counts.min(initial=0) < 0 or counts.sum() > size:
                raise OceanError(
                    f"{path}: {name} declares {counts.sum()} rows, but {dim} has {size}; correct it"
                )
            return np.pad(
                np.repeat(np.arange(counts.size), counts),
                (0, size - counts.sum()),
                constant_values=-1,
            )
        if "instance_dimension" in variable.attrs and variable.dims == (dim,):
            return np.nan_to_num(numbers(data, str(name)), nan=-1).astype(np.int64)
    return None


def labels_of(variable: xr.Variable) -> AnyArray:
    """Text of each element of a variable with names, letters or integers."""
    raw = np.asarray(variable.values)
    if raw.dtype.kind == "f" and np.array_equal(raw, np.round(raw)):
        raw = raw.astype(np.int64)
    cells = [
        c.decode("utf-8", "replace") if isinstance(c, bytes) else str(c)
        for c in raw.ravel().tolist()
    ]
    # letters along the last dimension
    if raw.dtype.kind in "SUO" and "str" in str(variable.dims[-1:]).lower():
        cells = ["".join(row) for row in np.array(cells).reshape(-1, raw.shape[-1])]
    return np.array([c.strip("\0 ") for c in cells], dtype=object)


_MAIN = "temperature", "potential_temperature", "conservative_temperature", "sound_speed"


def _tables(data: xr.Dataset, path: Path) -> dict[str, CastTable]:
    named = {q: name for q, standard in _QUANTITIES.items() if (name := _variable(data, standard))}
    main = next((named[q] for q in _MAIN if q in named), None)
    if main is None or not {"depth", "pressure"} & named.keys():
        raise OceanError(
            f"{path}: no profile; it needs variables with standard_name depth or"
            " sea_water_pressure, and sea_water_temperature or speed_of_sound_in_sea_water; it"
            f" contains {', '.join(map(str, data.variables))}"
        )
    count, _ = _rows_by_profile(data, main, path)
    columns, notes = {}, list[str]()
    for quantity, name in named.items():
        columns[quantity], own_notes = _column(data, quantity, name, main, path)
        notes += own_notes
    places = [_of_profile(data, standard, count) for standard in ("latitude", "longitude")]
    times = _times(data, count, path)
    names = _names(data, count, path)
    tables = {}
    for k in range(count):
        frame = pd.DataFrame({i: column(k) for i, column in enumerate(columns.values())})
        place = float(places[0][k]), float(places[1][k])
        located = () if is_position(*place) or np.isnan(sum(place)) else (unused_position(*place),)
        tables[names[k]] = CastTable(
            path,
            tuple(named.values()),
            frame,
            [],
            {q: (i, text(data.variables[n], "units")) for i, (q, n) in enumerate(named.items())},
            {},
            bracketed=False,
            instrument=DATA_SET,
            place=place if is_position(*place) else None,
            time=times[k],
            notes=(*notes, *located),
        )
    return tables


def _column(
    data: xr.Dataset, quantity: str, name: str, main: str, path: Path
) -> tuple[Callable[[int], Array], list[str]]:
    """
    Function that gives the values of a quantity in one profile, and notes.

    In ragged arrays of the World Ocean Database each quantity has rows of its own: as many as the
    ``main`` one, or none.
    """
    values, flagged = _adjusted(data, name)
    notes = []
    if "temperature" in quantity and "68" in text(data.variables[name], "reference_scale"):
        values = values / 1.00024
        notes.append(ITS_90_NOTE)
    if text(data.variables[name], "positive").lower() == "up":
        values = -values
    count, rows_of = _rows_by_profile(data, main, path)
    whole = np.zeros(count, dtype=bool)
    for known in _flags_of(data, name):
        if known.size == count and known.size != values.size:
            whole |= is_flagged(known).ravel()
    own, shape = rows_of, data.variables[main].shape
    if data.variables[name].dims != data.variables[main].dims and (
        instance_of_rows(data, str(data.variables[name].dims[0]), path) is not None
    ):
        own = _rows_by_profile(data, name, path)[1]
    else:
        values = np.broadcast_to(values, shape)
    missing = np.broadcast_to(np.nan, shape)

    def of_profile(k: int) -> Array:
        found, none = np.asarray(values[own(k)]), np.asarray(missing[rows_of(k)])
        return none if whole[k] or found.shape != none.shape else found

    if whole.any():
        notes.append(f"{name} of {counted(int(whole.sum()), 'profile')} rejected by quality flags")
    if flagged:
        notes.append(f"{counted(flagged, 'value')} of {name} rejected by quality flags")
    return of_profile, notes


def _names(data: xr.Dataset, count: int, path: Path) -> list[str]:
    """
    Name of each profile: its identifier, or station and cast, or the file's name and a number; each
    name once.
    """
    roles = [v for v in data.variables.values() if v.attrs.get("cf_role") == "profile_id"][:1]
    roles = roles or [
        data.variables[name] for name in ("station", "cast") if name in data.variables
    ]
    labels = [cells for v in roles if (cells := labels_of(v)).size == count]
    if not labels:
        return [f"{path.stem}_{k}" for k in range(count)] if count > 1 else [""]
    names = [
        "/".join(filter(None, parts)) or str(k) for k, parts in enumerate(zip(*labels, strict=True))
    ]
    first = {name: k for k, name in reversed(list(enumerate(names)))}
    return [name if first[name] == k else f"{name}_{k}" for k, name in enumerate(names)]


def _rows_by_profile(data: xr.Dataset, name: str, path: Path) -> tuple[int, Callable[[int], Any]]:
    """Number of profiles, and a function that gives the index of one profile's values."""
    dims = tuple(map(str, data.variables[name].dims))
    if len(dims) > 2:
        raise OceanError(
            f"{path}: {name} has dimensions {', '.join(dims)}; it must have one, or two with the"
            " index of the profile"
        )
    if len(dims) == 2:
        return data.sizes[dims[0]], lambda k: (k, slice(None))
    of_row = instance_of_rows(data, dims[0], path)
    if of_row is None:
        return 1, lambda _: slice(None)
    sizes = [v.size for v in data.variables.values() if v.attrs.get("sample_dimension") == dims[0]]
    count = max([*sizes, int(of_row.max(initial=-1)) + 1])  # the last ones may be empty
    order = np.argsort(of_row, kind="stable")
    edges = np.searchsorted(of_row[order], np.arange(count + 1))
    return count, lambda k: order[edges[k] : edges[k + 1]]


def _adjusted(data: xr.Dataset, name: str) -> tuple[Array, int]:
    """Values as `without_bad_flags`; in each profile that has adjusted values, these."""
    values, flagged = without_bad_flags(data, name)
    better = f"{name}_ADJUSTED"
    if (
        values.ndim != 2
        or better not in data.variables
        or data.variables[better].shape != values.shape
    ):
        return values, flagged
    adjusted, more = without_bad_flags(data, better)
    used = np.asarray(np.isfinite(adjusted).any(axis=1, keepdims=True))
    return np.where(used, adjusted, values), flagged + more


def _variable(data: xr.Dataset, standard: Sequence[str]) -> str:
    """
    Variable with the first available of several standard names, and of several variables the one
    with most good values, such as a CTD's before the bottles'; empty if there is none.
    """
    for name in standard:
        keys = [
            str(key)
            for key, variable in data.variables.items()
            if text(variable, "standard_name") == name
            and variable.dtype.kind in "biuf"
            and variable.ndim
        ]
        if len(keys) > 1:
            keys.sort(
                key=lambda key: -np.count_nonzero(np.isfinite(without_bad_flags(data, key)[0]))
            )
        if keys:
            return keys[0]
    return ""


def without_bad_flags(data: xr.Dataset, name: str) -> tuple[Array, int]:
    """
    Values of a variable, NaN where its quality flags are bad, and the number of values that they
    reject.
    """
    values = numbers(data, name)
    bad = np.zeros(values.shape, dtype=bool)
    for known in _flags_of(data, name):
        if known.size == values.size:
            bad |= is_flagged(known).reshape(values.shape) & np.isfinite(values)
    return np.where(bad, np.nan, values), int(bad.sum())


def _flags_of(data: xr.Dataset, name: str) -> list[xr.Variable]:
    """Variables with quality flags of a variable, for each value or for each profile."""
    linked = text(data.variables[name], "ancillary_variables").split()
    ending = ("_qc", "_quality_control", "flag")
    return [
        known
        for flags in (*linked, f"{name}_QC", f"{name}_qc", f"{name}_quality_control")
        if (known := data.variables.get(flags)) is not None
        and (
            known.dtype.kind in "SU"
            or flags.lower().endswith(ending)
            or "flag" in text(known, "standard_name")
        )  # other numbers are uncertainties
    ]


def is_flagged(known: xr.Variable) -> Mask:
    """True where a quality flag is bad by its meaning (CF 1.11, section 3.5), or by its number."""
    raw = np.asarray(known.values)
    if raw.dtype.kind in "SU":
        letters = np.char.strip(raw.astype("U1"))
        raw = np.where(np.char.isdigit(letters), letters, "0").astype(int)
    flags = np.ravel(known.attrs.get("flag_values", ()))
    meanings = text(known, "flag_meanings").lower().split()
    if flags.dtype.kind not in "iuf" or not 0 < flags.size == len(meanings):
        return np.isin(raw, _BAD_FLAGS)
    if meanings[0] == _ALL_BAD_BUT:
        return np.asarray(raw != flags[0])
    return np.isin(raw, [f for f, words in zip(flags, meanings, strict=True) if _BAD.search(words)])


def _of_profile(data: xr.Dataset, standard: str, count: int) -> Array:
    """One number per profile, NaN if the file has none."""
    name = next(
        (
            str(n)
            for n, v in data.variables.items()
            if text(v, "standard_name") == standard and v.dtype.kind in "biuf"
        ),
        "",
    )
    if not name:
        return np.full(count, np.nan)
    angles = standard in ("latitude", "longitude")
    values = np.atleast_1d(degrees(data, name, standard) if angles else numbers(data, name)).ravel()
    known = data.variables.get("POSITION_QC" if angles else f"{name}_QC")
    if known is not None and known.size == values.size and known.dtype.kind in "iuf":
        values = np.where(is_flagged(known).ravel(), np.nan, values)
    return values if values.size == count else np.resize(values[:1], count)


def _times(data: xr.Dataset, count: int, path: Path) -> list[str]:
    """Time of each profile in ISO 8601, empty if the file has none."""
    name = next(
        (str(n) for n, v in data.variables.items() if text(v, "standard_name") == "time"), ""
    )
    unit = text(data.variables[name], "units") if name else ""
    seconds = _of_profile(data, "time", count)
    out = [""] * count
    for k in np.flatnonzero(np.isfinite(seconds)) if " since " in unit else ():
        calendar = text(data.variables[name], "calendar")
        (instant,) = decoded_times(seconds[k : k + 1], unit, calendar, where=f"{path}: {name}")
        out[k] = str(np.datetime_as_string(instant, unit="ms"))
    return out
