"""OPeNDAP's answers (DAP 2) as arrays, every size checked before a byte is believed."""

import math
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.convert import without_scaled_fill
from pymantaray.ocean.fetch.messages import EXTRA, one_line, server_message

Array = NDArray[np.float64]
Instants = NDArray[np.datetime64]
_SEPARATOR = re.compile(rb"\r?\nData:\r?\n")
_NUMBER = {"f": (4, 8), "i": (1, 2, 4), "u": (1, 2, 4)}


@dataclass(frozen=True)
class Leaf:
    """One array of an answer: its dimensions' names and lengths, and its values."""

    dims: tuple[str, ...]
    values: NDArray[Any]


class Readers(NamedTuple):
    """What reads descriptions and attributes: pydap's parsers and the types that they give."""

    das: Callable[[str], dict[str, Any]]
    dds: Callable[[str], Any]
    grid: type[Any]
    base: type[Any]


@cache
def readers() -> Readers:
    """
    Import pydap's parsers.

    Returns
    -------
    Readers

    Raises
    ------
    OceanError
        If pydap is not installed.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # its client imports webob, and that cgi
        try:
            from pydap.model import BaseType, GridType
            from pydap.parsers.das import parse_das
            from pydap.parsers.dds import dds_to_dataset
        except ImportError:
            raise OceanError(f"fetch: {EXTRA}") from None
    return Readers(parse_das, dds_to_dataset, GridType, BaseType)


def read_attributes(body: bytes) -> dict[str, dict[str, Any]]:
    """
    Attributes of the variables, from a DAS.

    Parameters
    ----------
    body : bytes

    Returns
    -------
    dict of str to dict

    Raises
    ------
    OceanError
        If it is none.
    """
    text = _text(body)
    if not re.match(r"\s*attributes\s*\{", text, re.IGNORECASE) or not text.rstrip().endswith("}"):
        raise OceanError("attributes were expected; something else came, or not all of them")
    table = readers().das(text)
    return {name: value for name, value in table.items() if isinstance(value, dict)}


def read_arrays(body: bytes) -> dict[str, Leaf]:
    """
    Arrays of a DODS answer: a description, then the numbers in XDR.

    Parameters
    ----------
    body : bytes

    Returns
    -------
    dict of str to Leaf
        By the name within the answer; the array of a grid under the grid's name.

    Raises
    ------
    OceanError
        If the description is none, or the numbers are not as many as it says.
    """
    pydap = readers()
    head = _SEPARATOR.search(body[: 1 << 20])
    if head is None:
        _text(body)
        raise OceanError("data were expected; something else came")
    described = pydap.dds(_text(body[: head.start()]))
    leaves: dict[str, Leaf] = {}
    place = head.end()

    def take(name: str, described_as: Any) -> None:
        nonlocal place
        values, place = _numbers(body, place, described_as)
        leaves.setdefault(name, Leaf(tuple(str(d).rpartition("/")[2] for d in described_as.dims), values))

    for child in described.children():
        if isinstance(child, pydap.grid):
            for i, part in enumerate(child.children()):
                take(child.name if i == 0 else f"{child.name}.{part.name}", part)
        elif isinstance(child, pydap.base):
            take(child.name, child)
        else:
            raise OceanError(f"{one_line(child.name)} is neither an array nor a grid")
    if place != len(body):
        raise OceanError(f"wrong size: {len(body) - place} bytes more than described")
    return leaves


def unpack(name: str, raw: NDArray[Any], attributes: dict[str, Any]) -> Array:
    """
    Physical values of a variable as it was sent.

    Parameters
    ----------
    name : str
        One of HYCOM's.
    raw : ndarray
        Packed integers or numbers.
    attributes : dict
        ``scale_factor``, ``add_offset``, ``_FillValue``, ``missing_value``, all optional.

    Returns
    -------
    ndarray of float
        NaN where there is a fill value, also where a server has scaled it like data.

    Raises
    ------
    OceanError
        If the attributes make no sense, or the variable is potential temperature.
    """
    if str(attributes.get("standard_name", "")).startswith("sea_water_potential"):
        raise OceanError(f"{name} is potential temperature; in-situ temperature is needed")
    scale, offset = (_decimal(attributes.get(k, d)) for k, d in (("scale_factor", 1.0), ("add_offset", 0.0)))
    if not (math.isfinite(scale) and math.isfinite(offset) and scale != 0.0):
        raise OceanError(f"{name} has scale_factor {scale!r} and add_offset {offset!r}; needs numbers")
    values = np.asarray(raw, dtype=float)
    dry = ~np.isfinite(values)
    for key in ("_FillValue", "missing_value"):
        for fill in np.ravel(np.asarray(attributes.get(key, []), dtype=float)):
            dry |= values == fill
    values = values * scale + offset
    return without_scaled_fill(name, np.where(dry, np.nan, values))


def decode_times(values: NDArray[Any], units: str) -> Instants:
    """
    Instants of a time axis.

    Parameters
    ----------
    values : ndarray, shape (time,)
    units : str
        ``hours since 2000-01-01 00:00:00`` or the like.

    Returns
    -------
    ndarray of datetime64[s]
        Rounded to a second.

    Raises
    ------
    OceanError
        If the units are not understood or a value is not a number.

    Examples
    --------
    >>> str(decode_times(np.array([12.0]), "hours since 2000-01-01 00:00:00")[0])
    '2000-01-01T12:00:00'
    """
    match = re.fullmatch(r"\s*(second|minute|hour|day)s?\s+since\s+(\S.{0,40}?)\s*", units)
    origin = pd.NaT if match is None else pd.to_datetime(match[2], errors="coerce", utc=True)
    if match is None or pd.isna(origin):
        raise OceanError(f"time has units {one_line(units)!r}; needs 'hours since' a date")
    unit = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "day": 86400.0}[match[1]]
    seconds = np.asarray(values, dtype=float) * unit
    if not np.all(np.abs(seconds) < 1e11):
        raise OceanError("time axis holds values that are no times")
    return np.datetime64(origin.tz_localize(None), "s") + np.round(seconds).astype("timedelta64[s]")


def _numbers(body: bytes, place: int, described: Any) -> tuple[NDArray[Any], int]:
    """Values of one array in XDR, and where the next begins."""
    dtype, shape = np.dtype(described.dtype), tuple(int(n) for n in described.shape)
    name = one_line(described.name)
    if dtype.itemsize not in _NUMBER.get(dtype.kind, ()):
        raise OceanError(f"{name} is of type {dtype}; needs numbers")
    sent = np.dtype("u1") if dtype.itemsize == 1 else dtype.newbyteorder(">")
    if dtype.kind in "iu" and dtype.itemsize == 2:
        sent = np.dtype(f">{dtype.kind}4")  # DAP 2 sends short integers as long ones
    count = math.prod(shape)
    if shape:
        if place + 8 > len(body):
            raise OceanError(f"answer cut short: no values of {name}")
        lengths = np.frombuffer(body, ">u4", 2, place)
        if not (lengths == count).all():
            raise OceanError(f"wrong size: {lengths[0]} values of {name}; described are {count}")
        place += 8
    end = place + count * sent.itemsize
    if end > len(body):
        raise OceanError(f"answer cut short: {len(body)} bytes, {name} needs {end}")
    values = np.frombuffer(body, sent, count, place).reshape(shape)
    return values, place + -(-(end - place) // 4) * 4


def _text(body: bytes) -> str:
    if re.match(rb"\s*Error\s*\{", body):
        raise OceanError(f"server reports: {server_message(body)}")
    return body.decode("utf-8", errors="replace")


def _decimal(value: Any) -> float:
    """Shortest decimal number of a float32: HYCOM packs in steps of 0.001, not of 0.0010000000474974513."""
    number = float(value)
    return (
        float(str(np.float32(number)))
        if abs(number - float(np.float32(number))) < 1e-6 * abs(number)
        else number
    )
