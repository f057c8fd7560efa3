"""Instants of a data set, in UTC and in the calendar that is."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.files import StoredFile
from pymantaray.ocean.schema import parse_instant

Instants = NDArray[np.datetime64]
_CALENDARS = ("", "standard", "gregorian", "proleptic_gregorian", "none")
_WITHIN = np.timedelta64(1, "m")  # of an instant that is asked for


def instants(file: StoredFile, name: str) -> Instants:
    """
    Decode a time coordinate.

    Parameters
    ----------
    file : StoredFile
    name : str
        Of the coordinate.

    Returns
    -------
    ndarray of datetime64[ns], shape (time,)
        One element for a scalar.

    Raises
    ------
    OceanError
        If it is a climatology, in a calendar other than the real one, or cannot be decoded.
    """
    axis = file.variables[name]
    where, unit, calendar = f"{file.name}: {name}", axis.text("units"), axis.text("calendar").lower()
    if "climatology" in axis.attrs or unit.lower().startswith(("month", "year", "common_year")):
        raise OceanError(
            f"{where} ({unit or 'climatology'}) is a climatology's or counts months; pick one and set its instant,"
            " data.isel(time=[0]).assign_coords(time=[numpy.datetime64('2014-07-15')])"
        )
    if calendar not in _CALENDARS:
        raise OceanError(
            f"{where} is in the calendar {calendar!r}, whose days are not real ones; convert it first,"
            " data.convert_calendar('standard', align_on='date')"
        )
    if " since " not in unit:
        raise OceanError(
            f"{where} has units {unit[:40]!r}: no time coordinate that can be read; needs units 'hours since ...'"
        )
    values = file.values(name)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            attrs = {"units": unit, "calendar": calendar or "standard"}
            raw = xr.Variable(("time",), np.atleast_1d(_whole(values)), attrs)
            found = xr.decode_cf(xr.Dataset({"when": raw}))["when"].values
            found = found.astype("datetime64[ns]")
    except Exception as error:  # noqa: BLE001  cftime and pandas raise many kinds
        reason = " ".join(str(error).split())[:80]
        raise OceanError(f"{where} cannot be read as {unit[:40]!r} ({reason})") from None
    if found.size == 0 or np.any(np.isnat(found)):
        raise OceanError(f"{where} is empty or has missing instants; correct the axis")
    return found


def _whole(values: NDArray[np.float64]) -> NDArray[np.generic]:
    """Integers where they are, so that instants come out to the nanosecond."""
    if np.all(np.isfinite(values)) and np.all(values == np.round(values)) and np.all(np.abs(values) < 2**53):
        return values.astype(np.int64)
    return values


def pick(times: Instants, wanted: str | np.datetime64 | None, names: str) -> np.datetime64:
    """
    Choose the instant that is asked for, or the only one.

    Parameters
    ----------
    times : ndarray of datetime64, shape (time,)
        Rising.
    wanted : str or numpy.datetime64 or None
    names : str
        Of the files, for the message.

    Returns
    -------
    numpy.datetime64

    Raises
    ------
    OceanError
        If there is a choice and none was made, or nothing within a minute of it.
    """
    if wanted is None:
        if len(times) > 1:
            raise OceanError(f"{names}: {len(times)} times ({listing(times)}); choose one")
        return np.datetime64(times[0])
    instant = parse_instant(wanted)
    nearest = times[np.argmin(np.abs(times - instant))]
    if abs(nearest - instant) > _WITHIN:
        raise OceanError(f"{names}: time {wanted} is not in it; there is {listing(times)}")
    return np.datetime64(nearest)


def listing(times: Sequence[np.datetime64] | Instants) -> str:
    """
    First four instants and the last, for messages.

    Parameters
    ----------
    times : sequence of numpy.datetime64

    Returns
    -------
    str
    """
    text = ", ".join(str(np.datetime_as_string(t, unit="m")) for t in times[:4])
    return text + (f", ... {np.datetime_as_string(times[-1], unit='m')}" if len(times) > 4 else "")
